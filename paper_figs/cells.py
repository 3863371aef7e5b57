"""Recorded results as cells, whoever wrote the lines: `equigrasp study`, or `equigrasp evaluate --record`.

A cell is one policy on one task. `study` writes it as one line; `evaluate` as a line for each protocol and set of
phrasings, which are put together here.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from equigrasp.config import READ_OUTS
from equigrasp.models import MODELS
from equigrasp.study.results import known_by, read
from equigrasp.success import Rate


@dataclass(frozen=True, order=True)
class Way:
    """How a policy was made, but for its seed: cells of the same way are pooled.

    Attributes:
        model: the row's name.
        demos: demonstrations.
        steps: gradient steps.
        recombination: share of recombined examples.
        camera: of the observations.
        trained_on: the task.
        pretrained: whether its CLIP had learned anything; None where it has none.
        phrasings: of the tests.
        text_encoder: who read the instructions, where it was not the model's own encoder.
        read_out: "half" or "full", the resolution of the read-out where it was not the model's own.
        hard_negatives: share of recombined examples whose other objects are like the target.
        crowded: share of recombined examples in which objects stand where the hand would come down.
    """

    model: str
    demos: int
    steps: int
    recombination: float
    camera: str
    trained_on: str
    pretrained: bool | None = None
    phrasings: str = "seen"
    text_encoder: str | None = None
    read_out: str | None = None
    hard_negatives: float = 0.0
    crowded: float = 0.0

    @property
    def recombined(self) -> dict[str, float]:
        """What was asked of its recombined examples, in words, and of which share of them."""
        asked = {"hard negatives": self.hard_negatives, "crowded": self.crowded}
        return {name: share for name, share in asked.items() if share}

    @property
    def otherwise(self) -> list[str]:
        """What is not as the model's row has it, in words."""
        reader = [f"read by {self.text_encoder}"] if self.text_encoder else []
        return reader + ([f"{self.read_out}-resolution read-out"] if self.read_out else [])


@dataclass(frozen=True)
class Cell:
    """One policy on one task.

    Attributes:
        way: how it was made.
        task: what it was tested on.
        seeds: of its demonstrations and of its training.
        shots: by "grasped", "correct_object", "correct": single shots; empty without any.
        reward: mean reward in the paper's protocol, from 0 to 1; None without it.
        scenes: over how many scenes.
        failures: how many single shots failed in which way, in the judge's words.
        mistaken: for each goal that something else was lifted in place of, what and in how many single shots; None of
            results that were recorded before this was.
        checkpoints: by training step, single shots in validation scenes that reached the goal; those that a study
            chose its checkpoint by.
        symmetry: how equivariant the policy is, as `equivariance_tests.record` has it; None where it was not measured.
    """

    way: Way
    task: str
    seeds: tuple[int, int]
    shots: Mapping[str, Rate]
    reward: float | None
    scenes: int
    failures: Mapping[str, int] = field(default_factory=dict)
    mistaken: Mapping[str, Mapping[str, int]] | None = None
    checkpoints: Mapping[int, Rate] = field(default_factory=dict)
    symmetry: Mapping[str, Any] | None = None


KINDS = ("grasped", "correct_object", "correct")
FAILURES = ("nothing lifted", "wrong object", "several lifted", "wrong part")
"""The judge's words for what a grasp may be instead of a success."""
UNSPLIT = "wrong object or several"
"""Of results that were recorded before failures were counted by kind: their rates do not tell these two apart."""


def load(paths: Iterable[Path]) -> tuple[list[Cell], list[dict[str, Any]]]:
    """The cells of these files, and the lines of what models cost.

    A line counts once, however many of the files have it, and so does a policy's test, with its most trials: what is
    measured again begins with the same scenes.

    Raises:
        InputError: if a line that is not a file's last is no JSON object.
    """
    known: dict[str, dict[str, Any]] = {}
    for path in paths:
        for line in read(path)[0]:
            known.setdefault(known_by(line), line)
    costs = [line for line in known.values() if line.get("kind") == "cost"]
    studied = _of_studies(line for line in known.values() if line.get("kind") == "grasp")
    return studied + _of_evaluations(line for line in known.values() if "run" in line), costs


def _shots(rates: Mapping[str, Any]) -> dict[str, Rate]:
    return {kind: Rate(rates[kind]["successes"], rates[kind]["trials"]) for kind in KINDS}


def _failures(rates: Mapping[str, Any]) -> dict[str, int]:
    if "failures" in rates:
        return dict(rates["failures"])
    trials = rates["correct"]["trials"]
    grasped, right, correct = (rates[kind]["successes"] for kind in KINDS)
    counts = {"nothing lifted": trials - grasped, UNSPLIT: grasped - right, "wrong part": right - correct}
    return {kind: count for kind, count in counts.items() if count}


def _otherwise(model: str, config: Mapping[str, Any]) -> dict[str, str | None]:
    """Who read and at which resolution it was read out, each None where it is what `equigrasp models` lists."""
    row = MODELS[model].to_dict() if model in MODELS else {}
    resolutions = {pixels: name for name, pixels in READ_OUTS.items()}
    reader, pixels = config["text_encoder"], config.get("stride")
    return {
        "text_encoder": None if row.get("text_encoder") == reader else reader,
        "read_out": None if row.get("stride") == pixels else resolutions.get(pixels),
    }


def _of_study(line: Mapping[str, Any]) -> Cell:
    way = Way(
        model=line["model"],
        demos=line["demos"],
        steps=line["steps"],
        recombination=line["recombination"],
        camera=line["camera"],
        trained_on=line["trained_on"],
        pretrained=line["clip_pretrained"],
        phrasings=line["phrasings"],
        **_otherwise(line["model"], line["config"]),
        hard_negatives=line.get("hard_negatives", 0.0),
        crowded=line.get("crowded", 0.0),
    )
    paper = line.get("paper")
    return Cell(
        way=way,
        task=line["tested_on"],
        seeds=(line["seed"], line["seed"]),
        shots=_shots(line["single_shot"]) if "single_shot" in line else {},
        reward=paper["reward"] if paper else None,
        scenes=paper["scenes"] if paper else 0,
        failures=_failures(line["single_shot"]) if "single_shot" in line else {},
        mistaken=line.get("single_shot", {}).get("mistaken"),
        checkpoints={
            int(step): Rate(successes, line["validation"])
            for step, successes in line.get("validation_successes", {}).items()
        },
        symmetry=line.get("equivariance"),
    )


TRAINED_BY = ("config", "threads", "training_device", "learning_rate")
"""Settings of a study's line, beside those of its Way and its seed, without which it would be another training."""


def _of_studies(lines: Iterable[Mapping[str, Any]]) -> list[Cell]:
    """One cell for each policy and task, with the most single shots and the most scenes that it was given."""
    cells: dict[tuple[Way, str, tuple[int, int], str, int | None], Cell] = {}
    for line in lines:
        cell = _of_study(line)
        training = json.dumps([line.get(name) for name in TRAINED_BY], sort_keys=True)
        place = (cell.way, cell.task, cell.seeds, training, line.get("checkpoint"))
        other = cells.setdefault(place, cell)
        if _trials(cell) > _trials(other):
            other = replace(other, shots=cell.shots, failures=cell.failures, mistaken=cell.mistaken)
        if cell.scenes > other.scenes:
            other = replace(other, reward=cell.reward, scenes=cell.scenes)
        checkpoints = max(other.checkpoints, cell.checkpoints, key=len)
        cells[place] = replace(other, checkpoints=checkpoints, symmetry=other.symmetry or cell.symmetry)
    return list(cells.values())


def _trials(cell: Cell) -> int:
    return cell.shots["correct"].trials if cell.shots else 0


def _of_evaluations(lines: Iterable[Mapping[str, Any]]) -> list[Cell]:
    """Cells of final weights; weights on the way belong to learning curves."""
    cells: dict[tuple[Way, str, tuple[int, int], int, str], Cell] = {}
    for line in lines:
        run, rates = line["run"], line["policy"]
        if line["step"] != run["training"]["steps"]:
            continue
        weights = run["model"].get("clip_weights")
        way = Way(
            model=run["model"]["name"],
            demos=run["demos"],
            steps=line["step"],
            recombination=run["training"]["recombination"],
            camera=line["camera"],
            trained_on=run["task"],
            pretrained=None if weights is None else weights != "random",
            phrasings=line["phrasings"],
            **_otherwise(run["model"]["name"], run["model"]),
            hard_negatives=run["training"].get("hard_negatives", 0.0),
            crowded=run["training"].get("crowded", 0.0),
        )
        seeds = (run["data_seed"], run["training"]["seed"])
        # the whole plan: two trainings of one way are two policies
        place = (way, line["task"], seeds, line["seed"], json.dumps(run, sort_keys=True))
        cell = cells.get(place, Cell(way, line["task"], seeds, {}, None, 0))
        if line["protocol"] == "paper":
            if rates["scenes"] > cell.scenes:
                cell = replace(cell, reward=rates["reward"], scenes=rates["scenes"])
        elif rates["correct"]["trials"] > _trials(cell):
            cell = replace(cell, shots=_shots(rates), failures=_failures(rates), mistaken=rates.get("mistaken"))
        cells[place] = cell
    return list(cells.values())


def pooled(cells: Iterable[Cell], kind: str = "correct") -> Rate | None:
    """One rate over several cells; None if none has single shots."""
    rates = [cell.shots[kind] for cell in cells if cell.shots]
    return Rate(sum(rate.successes for rate in rates), sum(rate.trials for rate in rates)) if rates else None


def mean_reward(cells: Iterable[Cell]) -> tuple[float, int] | None:
    """Mean reward over all scenes of several cells, and how many scenes; None if none has any."""
    counted = [(cell.reward, cell.scenes) for cell in cells if cell.reward is not None]
    scenes = sum(count for _, count in counted)
    return (sum(reward * count for reward, count in counted) / scenes, scenes) if scenes else None
