"""Results that differ are told apart: no pool has a policy's scenes twice, no two rows of a table the same label."""

from __future__ import annotations

import itertools
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import by_task
import efficiency
import failures
import laws
import learning
import pytest
import recorded
import side_by_side
import symmetry
import tables
from cells import Cell
from loading import load

from equigrasp.config import ClipConfig, ModelConfig, read_out_at
from equigrasp.models import MODELS
from equigrasp.study.matrix import CostJob, Job, Protocol

TASK = "pick-by-part"
MODEL = MODELS["leg-unet"]
CLIPORT = MODELS["cliport-vit"]
assert isinstance(CLIPORT, ClipConfig)
VALIDATED = {"2500": 10, "5000": 20, "7500": 90, "10000": 80}


def line(successes: int = 450, tested_on: str = TASK, validation: int = 100, **changes: Any) -> dict[str, Any]:
    """A cell as `equigrasp study` would write it, of 500 single shots and 100 scenes."""
    settings: dict[str, Any] = {"model": MODEL, "task": TASK, "demos": 1, "seed": 0, "steps": 10_000, "threads": 1}
    settings |= {"camera": "overhead", "recombination": 0.0, "checkpoints": 4, "tests": (tested_on,)} | changes
    kinds = ("grasped", "correct_object", "correct")
    measured = {
        "single_shot": {kind: {"successes": successes, "trials": 500} for kind in kinds},
        "paper": {"reward": successes / 500, "scenes": 100},
        "clip_pretrained": None,
        "checkpoint": 7500 if settings["checkpoints"] > 1 else 10_000,
        "validation_successes": VALIDATED if settings["checkpoints"] > 1 else {"10000": 80},
        "equivariance": {"kernel": 1e-3, "scores": 0.1, "turned": {"scenes": 40, "followed": 40, "degrees": 2.0}},
    }
    return {**Job(protocol=Protocol(100, 500, validation), **settings).cell(tested_on), **measured}


def evaluation(test_seed: int = 0, **training: Any) -> dict[str, Any]:
    """The same as `equigrasp evaluate --record` would write it."""
    run = {
        "model": MODEL.to_dict(),
        "task": TASK,
        "demos": 1,
        "data_seed": 0,
        "training": {"steps": 10_000, "seed": 0, "recombination": 0.0, "threads": 1, **training},
    }
    what = {"task": TASK, "protocol": "single-shot", "phrasings": "seen", "camera": "overhead"}
    return {**what, "seed": test_seed, "step": 10_000, "run": run, "policy": line(440)["single_shot"]}


def loaded(folder: Path, *lines: dict[str, Any]) -> list[Cell]:
    """The cells of lines that lie in a file each."""
    paths = [folder / f"{number}.jsonl" for number in range(len(lines))]
    for path, each in zip(paths, lines, strict=True):
        path.write_text(json.dumps(each) + "\n")
    return load(paths)[0]


def shot(cells: Sequence[Cell]) -> dict[tuple[str, ...], tuple[float, int | None]]:
    """Labels, without the seeds -> percent and trials, of the rows of table 6 that were run."""
    rows = [row for row in tables.single_shots(6, TASK, cells).rows if row.values[0] is not None]
    found = {row.labels[:-1]: (value.value, value.trials) for row in rows for value in row.values if value}
    assert len(found) == len(rows), "no two rows have the same labels"
    return found


UNSAID = {
    "checkpoints 1": line(460, checkpoints=1),
    "validation 200": line(460, validation=200),
    "threads 2": line(460, threads=2),
    "training device cuda": line(460, device="cuda"),
    "learning rate 0.002": {**line(460), "learning_rate": 2e-3},
    "kernel size 9": {**line(460), "config": {**line()["config"], "kernel_size": 9}},
    "row of pick-by-part 1f": line(460, rows=((TASK, "1f"),)),
    "checkpoint 5000": {**line(460), "queries": 400, "checkpoint": 5000},
    "recorded by equigrasp evaluate": evaluation(),
}
"""What is said of a line -> the line, which no Way tells from the usual one."""


@pytest.mark.parametrize("said", UNSAID)
def test_the_same_scenes_of_one_seed_are_never_pooled(said: str, tmp_path: Path) -> None:
    for lines in itertools.permutations((line(), UNSAID[said], line(400, seed=1))):
        cells = loaded(tmp_path, *lines)
        assert len({(cell.way, cell.task, cell.seeds) for cell in cells}) == len(cells) == 3
        found = {labels[0]: value for labels, value in shot(cells).items()}
        usual = "leg-unet (checkpoint 7500)" if "checkpoint " in said else "leg-unet"
        assert found.keys() == {usual, f"leg-unet ({said})"}
        # the other seed is still of the usual way
        assert found[usual] == (85.0, 1000)
        assert found[f"leg-unet ({said})"][1] == 500


def test_a_setting_without_two_values_for_one_seed_is_not_said(tmp_path: Path) -> None:
    cells = loaded(tmp_path, line(), line(400, seed=1, threads=2), line(model=MODELS["vit"], threads=2))
    assert {labels[0] for labels in shot(cells)} == {"leg-unet", "vit"}
    # and where it is, then of that model alone, and however else it was trained
    more = [line(threads=2), line(threads=2, recombination=0.7), line(threads=2, tested_on="pick-logo")]
    cells = loaded(tmp_path, line(), line(model=MODELS["vit"], threads=2), *more)
    assert {(cell.way.model, cell.way.otherwise == ["threads 2"]) for cell in cells} == {
        ("leg-unet", False),
        ("leg-unet", True),
        ("vit", False),
    }
    assert sum(cell.way.otherwise == ["threads 2"] for cell in cells) == 3


def test_evaluations_of_one_seed_are_never_pooled(tmp_path: Path) -> None:
    cells = loaded(tmp_path, evaluation(), evaluation(batch=8), evaluation(test_seed=5))
    assert sorted(cell.way.otherwise for cell in cells) == [
        ["batch 8", "test seed 0"],
        ["test seed 0"],
        ["test seed 5"],
    ]
    assert {trials for _, trials in shot(cells).values()} == {500}


def test_of_what_was_measured_again_the_latest_counts_in_any_order(tmp_path: Path) -> None:
    before, after = ({**line(successes), "date": f"2026-12-0{day}"} for day, successes in ((1, 400), (2, 450)))
    longer = {**line(300), "queries": 600, "turned": 0, "equivariance": None, "date": "2026-11-01"}
    for lines in itertools.permutations((before, after, longer)):
        (cell,) = loaded(tmp_path, *lines)
        assert cell.shots["correct"].successes == 450
        assert cell.symmetry == before["equivariance"]


def test_a_learning_curve_does_not_depend_on_which_line_stands_first(tmp_path: Path) -> None:
    # two trainings of one way and seed, that no one task was tested after
    finer = line(checkpoints=8, tested_on="pick-logo") | {"validation_successes": dict.fromkeys(map(str, range(8)), 5)}
    drawn = [learning.lines(loaded(tmp_path, *lines), TASK) for lines in itertools.permutations((line(), finer))]
    ((curve,), (same,)) = (each.values() for each in drawn)
    assert curve == same
    assert len(curve) == 8
    cells = loaded(tmp_path, line(), finer)
    assert learning.lines(cells, TASK) == learning.lines(cells[::-1], TASK)


WAYS: list[dict[str, Any]] = [
    {},
    {"camera": "fused"},
    {"task": "pick-random-v1"},
    {"threads": 2},
    {"steps": 3000},
    {"model": read_out_at(MODEL, "full")},
    {"model": replace(MODEL, text_encoder="hashing")},
    *({"recombination": share} for share in (0.3, 0.7)),
    *({"recombination": 0.7, "crowded": share} for share in (0.2, 0.4)),
    *({"recombination": 0.7, "hard_negatives": share} for share in (0.2, 0.4)),
]
"""Ways to make a policy, each of which is another."""


@pytest.fixture
def varied(tmp_path: Path) -> list[Cell]:
    lines = [line(400 + number, **way) for number, way in enumerate(WAYS)]
    clip = [line(model=replace(CLIPORT, clip_weights=weights)) for weights in ("openai", "random")]
    for each, pretrained in zip(clip, (True, False), strict=True):
        each["clip_pretrained"] = pretrained
    return loaded(tmp_path, *lines, *clip)


def test_no_two_ways_of_a_figure_or_table_have_the_same_label(varied: list[Cell]) -> None:
    ways = {cell.way for cell in varied}
    assert len(ways) == len(varied) == len(WAYS) + 2
    assert len({recorded.label(way, TASK, ways) for way in ways}) == len(ways)
    own = [cell for cell in varied if cell.way.trained_on == TASK]
    for grid in (each(6, TASK, own) for each in (tables.rewards, tables.single_shots, tables.failures)):
        labels = [row.labels for row in grid.rows if any(row.values) and row.labels[2] == tables.OURS]
        assert len(set(labels)) == len(labels) == len(own)
    labels = [row.labels for row in by_task.table(varied).rows]
    assert len(set(labels)) == len(labels)
    bars = failures.bars(varied, TASK)
    assert bars is not None
    ticks = [text.get_text() for text in bars.axes[0].get_yticklabels()]
    assert len(set(ticks)) == len(ticks) == len(varied)
    ten = [replace(cell, way=replace(cell.way, demos=10)) for cell in varied]
    for curve, several in ((efficiency.curve([*varied, *ten], TASK), varied), (learning.curve(own, TASK), own)):
        assert curve is not None
        # beside a panel, each after its number
        labels = [(axes.get_title(), text.get_text().partition("  ")[2]) for axes in curve.axes for text in axes.texts]
        assert len(set(labels)) == len(labels) == len(several)


def test_what_is_usual_or_has_one_value_alone_is_not_said(tmp_path: Path) -> None:
    ways = [cell.way for cell in loaded(tmp_path, line(), line(recombination=0.7, crowded=0.4))]
    assert {recorded.label(way, TASK, ways) for way in ways} == {
        "leg-unet, 1 demo, 10,000 steps",
        "leg-unet, 1 demo, 10,000 steps, recombination, crowded",
    }
    # the V-1 tasks are learned together, and alone where it is said
    (together,) = loaded(tmp_path, line(task="pick-random-v1", tested_on="pick-toy"))
    alone = replace(together.way, trained_on="pick-toy")
    found = [
        recorded.label(way, "pick-toy", [together.way, alone], demos=False, steps=False)
        for way in (together.way, alone)
    ]
    assert found == ["leg-unet", "leg-unet, trained on pick-toy"]


def test_of_several_shares_no_result_vanishes(varied: list[Cell]) -> None:
    (grid,) = side_by_side.tables(varied, TASK)
    assert len({row.labels for row in grid.rows}) == len(grid.rows)
    shown = [value.value for row in grid.rows for value in row.values[:2] if value is not None]
    assert sorted(shown) == sorted(100 * cell.shots["correct"].value for cell in varied)
    rows = side_by_side.rows(varied, TASK)
    assert all(len(ways) == 1 for ways in rows.values())
    # each in a row of its own, with its share
    named = side_by_side.labels({1: rows}, TASK).values()
    assert {"leg-unet, 10,000 steps, recombination 0.3", "leg-unet, 10,000 steps, recombination 0.7"} <= set(named)


def test_what_was_trained_on_another_task_is_not_said_to_be_trained_on_this_one(tmp_path: Path) -> None:
    own, other = line(), line(task="pick-random-v1", model=MODELS["vit"])
    cells = loaded(tmp_path, own, other)
    assert {cell.task for cell in cells} == {TASK}
    assert {way.model for way in symmetry.points(cells, TASK)} == {"leg-unet"}
    assert not any("vit" in each for each in laws.trained(cells, TASK))
    assert any("leg-unet" in each for each in laws.trained(cells, TASK))


def cost(step: float, processor: str = "EPYC", model: ModelConfig = MODEL, timed: int = 20) -> dict[str, Any]:
    """A line of what a model costs."""
    measured = {"parameters": 3, "frozen_parameters": 0, "seconds": {"step": step, "read_out": 1.0}, "memory": 1}
    return {**CostJob(model, 1, timed).cell(), **measured, "device": {"processor": processor}}


def test_every_processors_costs_have_a_row_of_their_own(tmp_path: Path) -> None:
    lines = [
        cost(0.2),
        cost(0.06, processor="Xeon"),
        cost(0.5, model=read_out_at(MODEL, "full")),
        cost(0.3, timed=5),
        cost(0.4, model=CLIPORT),
    ]
    grids = []
    for several in (lines, lines[::-1]):
        paths = [tmp_path / f"{number}.jsonl" for number in range(len(several))]
        for path, each in zip(paths, several, strict=True):
            path.write_text(json.dumps(each) + "\n")
        grids.append(tables.costs(load(paths)[1]))
    one, other = grids
    assert one == other
    assert {row.labels[:2]: str(row.values[3]) for row in one.rows if row.values[3]} == {
        ("leg-unet", "EPYC"): "0.200",
        ("leg-unet", "Xeon"): "0.060",
        ("leg-unet (full-resolution read-out)", "EPYC"): "0.500",
        ("leg-unet (timed steps 5)", "EPYC"): "0.300",
        ("cliport-vit", "EPYC"): "0.400",
    }
