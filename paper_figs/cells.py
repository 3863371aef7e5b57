"""Recorded results as cells, whoever wrote the lines: `equigrasp study`, or `equigrasp evaluate --record`.

A cell is one policy on one task. `study` writes it as one line; `evaluate` as a line for each protocol and set of
phrasings, which are put together here.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from apart import CHECKPOINT, RECORDED_BY, told_apart

from equigrasp.config import LABELS, READ_OUTS, ModelConfig
from equigrasp.models import MODELS
from equigrasp.study.results import MEASURED, known_by, read
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
        apart: in words, settings that nothing above says, where the same task and seeds were run with several of them.
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
    apart: tuple[str, ...] = ()

    @property
    def recombined(self) -> dict[str, float]:
        """What was asked of its recombined examples, in words, and of which share of them."""
        asked = {"hard negatives": self.hard_negatives, "crowded": self.crowded}
        return {name: share for name, share in asked.items() if share}

    @property
    def otherwise(self) -> list[str]:
        """What is not as the model's row has it, in words."""
        return [*_in_words(self.text_encoder, self.read_out), *self.apart]

    @property
    def unusual(self) -> list[str]:
        """The same, and before it the camera that is not overhead and the CLIP that learned nothing."""
        camera = [] if self.camera == "overhead" else [f"{self.camera} camera"]
        return [*camera, *(["CLIP not pretrained"] if self.pretrained is False else []), *self.otherwise]


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
        settings: what else determined the result, by name.
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
    settings: Mapping[str, Any] = field(default_factory=dict)


KINDS = ("grasped", "correct_object", "correct")
FAILURES = ("nothing lifted", "wrong object", "several lifted", "wrong part")
"""The judge's words for what a grasp may be instead of a success."""
UNSPLIT = "wrong object or several"
"""Of results that were recorded before failures were counted by kind: their rates do not tell these two apart."""


def load(paths: Iterable[Path]) -> tuple[list[Cell], list[dict[str, Any]]]:
    """The cells of these files, and the lines of what models cost.

    A line counts once, however many of the files have it (a cost once a processor), and so does a policy's test, with
    its most trials: what is measured again begins with the same scenes. Of equals the latest counts, in whichever file
    it is. No two cells have the same way, task and seeds: what sets them apart else is in their ways.

    Raises:
        InputError: if a line that is not a file's last is no JSON object.
    """
    known: dict[tuple[str, str], dict[str, Any]] = {}
    lines = [line for path in paths for line in read(path)[0]]
    for line in sorted(lines, key=lambda line: (line.get("date", ""), json.dumps(line, sort_keys=True)), reverse=True):
        processor = line["device"]["processor"] if line.get("kind") == "cost" else ""
        known.setdefault((known_by(line), processor), line)
    costs = [line for line in known.values() if line.get("kind") == "cost"]
    studied = _of_studies(line for line in known.values() if line.get("kind") == "grasp")
    cells = studied + _of_evaluations(line for line in known.values() if "run" in line)
    apart = told_apart([(cell.way.model, (cell.way, cell.task, cell.seeds), cell.settings) for cell in cells])
    ways = [replace(cell.way, apart=words) for cell, words in zip(cells, apart, strict=True)]
    return [replace(cell, way=way) for cell, way in zip(cells, ways, strict=True)], costs


def costs_otherwise(lines: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Of each line of costs, in words: what is not as the model's row has it, and what sets it apart from the rest."""
    models = [line["model"] for line in lines]
    rows = [MODELS[model].untrained() if model in MODELS else None for model in models]
    otherwise = [_in_words(*_otherwise(row, line["config"])) for row, line in zip(rows, lines, strict=True)]
    places = [(line["device"]["processor"], line["threads"], *own) for line, own in zip(lines, otherwise, strict=True)]
    settings = [{**line["config"], "timed_steps": line["timed_steps"]} for line in lines]
    apart = told_apart(list(zip(models, places, settings, strict=True)))
    return [[*own, *words] for own, words in zip(otherwise, apart, strict=True)]


def _shots(rates: Mapping[str, Any]) -> dict[str, Rate]:
    return {kind: Rate(rates[kind]["successes"], rates[kind]["trials"]) for kind in KINDS}


def _failures(rates: Mapping[str, Any]) -> dict[str, int]:
    if "failures" in rates:
        return dict(rates["failures"])
    trials = rates["correct"]["trials"]
    grasped, right, correct = (rates[kind]["successes"] for kind in KINDS)
    counts = {"nothing lifted": trials - grasped, UNSPLIT: grasped - right, "wrong part": right - correct}
    return {kind: count for kind, count in counts.items() if count}


def _otherwise(row: ModelConfig | None, config: Mapping[str, Any]) -> tuple[str | None, str | None]:
    """Who read and at which resolution it was read out, each None where it is the row's own."""
    own = {} if row is None else row.to_dict()
    resolutions = {pixels: name for name, pixels in READ_OUTS.items()}
    reader, pixels = config["text_encoder"], config.get("stride")
    return (
        None if own.get("text_encoder") == reader else reader,
        None if own.get("stride") == pixels else resolutions.get(pixels),
    )


def _in_words(text_encoder: str | None, read_out: str | None) -> list[str]:
    reader = [f"read by {text_encoder}"] if text_encoder else []
    return reader + ([f"{read_out}-resolution read-out"] if read_out else [])


def _of_study(line: Mapping[str, Any]) -> Cell:
    reader, read_out = _otherwise(MODELS.get(line["model"]), line["config"])
    way = Way(
        model=line["model"],
        demos=line["demos"],
        steps=line["steps"],
        recombination=line["recombination"],
        camera=line["camera"],
        trained_on=line["trained_on"],
        pretrained=line["clip_pretrained"],
        phrasings=line["phrasings"],
        text_encoder=reader,
        read_out=read_out,
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
        settings={
            RECORDED_BY: "equigrasp study",
            "training_device": "cpu",
            "learning_rate": ModelConfig.learning_rate,
            **{name: value for name, value in line.items() if name not in MEASURED | SAID},
            **line["config"],
            CHECKPOINT: line.get("checkpoint"),
        },
    )


SAID = {each.name for each in fields(Way)} | {"kind", "config", "tested_on", "seed", "scenes", "queries", "turned"}
"""Settings of a study's line that its cell says otherwise, or that only set how much was measured."""


def _of_studies(lines: Iterable[Mapping[str, Any]]) -> list[Cell]:
    """One cell for each policy and task, with the most single shots and the most scenes that it was given."""
    cells: dict[tuple[Way, str, tuple[int, int], str], Cell] = {}
    for line in lines:
        cell = _of_study(line)
        place = (cell.way, cell.task, cell.seeds, json.dumps(cell.settings, sort_keys=True))
        other = cells.setdefault(place, cell)
        if _trials(cell) > _trials(other):
            other = replace(other, shots=cell.shots, failures=cell.failures, mistaken=cell.mistaken)
        if cell.scenes > other.scenes:
            other = replace(other, reward=cell.reward, scenes=cell.scenes)
        checkpoints = other.checkpoints or cell.checkpoints
        cells[place] = replace(other, checkpoints=checkpoints, symmetry=other.symmetry or cell.symmetry)
    return list(cells.values())


def _trials(cell: Cell) -> int:
    return cell.shots["correct"].trials if cell.shots else 0


def _of_evaluations(lines: Iterable[Mapping[str, Any]]) -> list[Cell]:
    """Cells of final weights; weights on the way belong to learning curves."""
    cells: dict[tuple[Way, str, tuple[int, int], str], Cell] = {}
    for line in lines:
        run, rates = line["run"], line["policy"]
        if line["step"] != run["training"]["steps"]:
            continue
        weights = run["model"].get("clip_weights")
        reader, read_out = _otherwise(MODELS.get(run["model"]["name"]), run["model"])
        way = Way(
            model=run["model"]["name"],
            demos=run["demos"],
            steps=line["step"],
            recombination=run["training"]["recombination"],
            camera=line["camera"],
            trained_on=run["task"],
            pretrained=None if weights is None else weights != "random",
            phrasings=line["phrasings"],
            text_encoder=reader,
            read_out=read_out,
            hard_negatives=run["training"].get("hard_negatives", 0.0),
            crowded=run["training"].get("crowded", 0.0),
        )
        seeds = (run["data_seed"], run["training"]["seed"])
        # the whole plan: two trainings of one way are two policies
        settings = {
            RECORDED_BY: "equigrasp evaluate",
            "test seed": line["seed"],
            **{name: value for name, value in run.items() if name not in ("model", "training")},
            **{name: value for name, value in run["model"].items() if name not in LABELS},
            **run["training"],
        }
        place = (way, line["task"], seeds, json.dumps(settings, sort_keys=True))
        cell = cells.get(place, Cell(way, line["task"], seeds, {}, None, 0, settings=settings))
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
