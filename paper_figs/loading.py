"""Recorded results as cells, whoever wrote the lines: `equigrasp study`, or `equigrasp evaluate --record`.

`study` writes a cell as one line; `evaluate` as a line for each protocol and set of phrasings, which are put together
here.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from apart import CHECKPOINT, RECORDED_BY, told_apart
from cells import KINDS, UNSPLIT, Cell, Way, in_words

from equigrasp.artefacts import AGAIN
from equigrasp.config import LABELS, READ_OUTS, ModelConfig
from equigrasp.errors import InputError
from equigrasp.models import MODELS
from equigrasp.study.results import MEASURED, known_by, read, recency
from equigrasp.success import Rate

TEXT, WHOLE, NUMBER, OBJECT = (str,), (int,), (int, float), (dict,)
GRASP: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("model", "camera", "trained_on", "tested_on", "phrasings"), TEXT),
    **dict.fromkeys(("demos", "steps", "seed"), WHOLE),
    "recombination": NUMBER,
    "config": OBJECT,
}
COST: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("model", "device.processor"), TEXT),
    **dict.fromkeys(("threads", "timed_steps", "parameters", "frozen_parameters", "memory"), WHOLE),
    **dict.fromkeys(("seconds.step", "seconds.read_out"), NUMBER),
    "config": OBJECT,
    "config.text_encoder": TEXT,
}
EVALUATION: dict[str, tuple[type, ...]] = {
    **dict.fromkeys(("task", "protocol", "phrasings", "camera", "run.task", "run.model.name"), TEXT),
    **dict.fromkeys(("step", "seed", "run.demos", "run.data_seed", "run.training.steps", "run.training.seed"), WHOLE),
    "run.training.recombination": NUMBER,
    "policy": OBJECT,
}
"""What a line of each kind must have, and of which types, beside what its rates are."""


def load(paths: Iterable[Path]) -> tuple[list[Cell], list[dict[str, Any]]]:
    """The cells of these files, and the lines of what models cost.

    A line counts once, however many of the files have it (a cost once a processor), and so does a policy's test, with
    its most trials: what is measured again begins with the same scenes. Of equals the latest counts, in whichever file
    it is. No two cells have the same way, task and seeds: what sets them apart else is in their ways.

    Raises:
        InputError: if a line that is not a file's last is no JSON object, or is a result that lacks what one has.
    """
    known: dict[tuple[str, str], dict[str, Any]] = {}
    lines = [_checked(line, path) for path in paths for line in read(path)[0]]
    for line in sorted(lines, key=recency, reverse=True):
        processor = line["device"]["processor"] if line.get("kind") == "cost" else ""
        known.setdefault((known_by(line), processor), line)
    costs = [line for line in known.values() if line.get("kind") == "cost"]
    studied = _of_studies(line for line in known.values() if line.get("kind") == "grasp")
    return _apart(studied + _of_evaluations(line for line in known.values() if _is_final(line))), costs


def evaluated(paths: Iterable[Path], task: str) -> tuple[list[Cell], list[Rate]]:
    """What `equigrasp evaluate --record` wrote of a task, of weights on the way as well.

    Returns:
        a cell for each policy, step and kind of phrasing, whose way has that step; and what the oracle reached in
        single shots on seen phrasings, once for each set of scenes.

    Raises:
        InputError: as `load`.
    """
    lines = [_checked(line, path) for path in paths for line in read(path)[0]]
    here = [line for line in lines if "run" in line and line["task"] == task]
    sets: dict[tuple[str, int], Rate] = {}
    for line in here:
        if "oracle" in line and (line["protocol"], line["phrasings"]) == ("single-shot", "seen"):
            scenes, rate = (line["camera"], line["seed"]), _rate(line["oracle"]["correct"])
            # a longer test begins with the scenes of a shorter one
            sets[scenes] = max(rate, sets.get(scenes, rate), key=lambda rate: rate.trials)
    return _apart(_of_evaluations(here)), list(sets.values())


def _is_final(line: Mapping[str, Any]) -> bool:
    """Whether it is an evaluation of a training's last weights."""
    return "run" in line and line["step"] == line["run"]["training"]["steps"]


def _apart(cells: Sequence[Cell]) -> list[Cell]:
    """The same, with what sets them apart in their ways."""
    words = told_apart([(cell.way.model, (cell.way, cell.task, cell.seeds), cell.settings) for cell in cells])
    return [replace(cell, way=replace(cell.way, apart=each)) for cell, each in zip(cells, words, strict=True)]


def _checked(line: dict[str, Any], path: Path) -> dict[str, Any]:
    """The line, if it has what a result of its kind has; a line of another kind is nobody's to check."""
    kind = EVALUATION if "run" in line else {"grasp": GRASP, "cost": COST}.get(line.get("kind", ""), {})
    try:
        for name, types in kind.items():
            value: Any = line
            for key in name.split("."):
                value = value[key]
            if not isinstance(value, types) or (isinstance(value, bool) and bool not in types):
                raise _other(line, path, f"its {name} is {value!r:.60}")
        if kind is GRASP:
            _of_study(line)
        elif kind is EVALUATION:
            _of_evaluations([line])
    except KeyError as error:
        raise _other(line, path, f"it has no {error.args[0]}") from None
    except (TypeError, ValueError, AttributeError) as error:
        raise _other(line, path, str(error)) from None
    return line


def _other(line: Mapping[str, Any], path: Path, why: str) -> InputError:
    texts = path.read_text(errors="replace").splitlines()
    number = next((at for at, text in enumerate(texts, 1) if text.strip() and json.loads(text) == line), len(texts))
    return InputError(
        f"line {number} of {path} is no result as `equigrasp study` or `equigrasp evaluate --record` writes it: "
        f"{why}; {AGAIN}"
    )


def costs_otherwise(lines: Sequence[Mapping[str, Any]]) -> list[list[str]]:
    """Of each line of costs, in words: what is not as the model's row has it, and what sets it apart from the rest."""
    models = [line["model"] for line in lines]
    rows = [MODELS[model].untrained() if model in MODELS else None for model in models]
    otherwise = [in_words(*_otherwise(row, line["config"])) for row, line in zip(rows, lines, strict=True)]
    places = [(line["device"]["processor"], line["threads"], *own) for line, own in zip(lines, otherwise, strict=True)]
    settings = [{**line["config"], "timed_steps": line["timed_steps"]} for line in lines]
    apart = told_apart(list(zip(models, places, settings, strict=True)))
    return [[*own, *words] for own, words in zip(otherwise, apart, strict=True)]


def _rate(counts: Mapping[str, Any]) -> Rate:
    return Rate(counts["successes"], counts["trials"])


def _shots(rates: Mapping[str, Any]) -> dict[str, Rate]:
    return {kind: _rate(rates[kind]) for kind in KINDS}


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
    """A cell for each policy and step of its training, with the most single shots and the most scenes it was given."""
    cells: dict[tuple[Way, str, tuple[int, int], str], Cell] = {}
    for line in lines:
        run, rates = line["run"], line["policy"]
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
