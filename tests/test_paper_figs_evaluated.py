"""What `equigrasp evaluate --record` wrote is drawn as it is: by task, each test once, and only what is there."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import evaluated
import numpy as np
import pytest
from cells import pooled
from hypothesis import given
from hypothesis import strategies as st
from loading import evaluated as read

from equigrasp.success import Rate

TASK = "pick-by-part"


def line(
    step: int = 100,
    successes: int = 90,
    trials: int = 100,
    task: str = TASK,
    seed: int = 0,
    oracle: bool = True,
    protocol: str = "single-shot",
    phrasings: str = "seen",
    model: str = "leg-unet",
) -> dict[str, Any]:
    """One evaluation, of a training of 100 steps."""
    rate = {"successes": successes, "trials": trials}
    rates: dict[str, Any] = dict.fromkeys(("grasped", "correct_object", "correct"), rate)
    if protocol == "paper":
        rates |= {"reward": successes / trials, "scenes": trials}
    training = {"steps": 100, "recombination": 0.7, "seed": seed}
    run = {"model": {"name": model, "text_encoder": "minilm"}, "task": TASK, "demos": 1, "data_seed": seed}
    where = {"task": task, "protocol": protocol, "phrasings": phrasings, "camera": "overhead", "seed": seed}
    all_right = {"successes": trials, "trials": trials}
    best = {"oracle": dict.fromkeys(("grasped", "correct_object", "correct"), all_right)}
    return {**where, "step": step, "run": {**run, "training": training}, "policy": rates, **(best if oracle else {})}


def written(folder: Path, *lines: dict[str, Any]) -> Path:
    path = folder / "evaluations.jsonl"
    path.write_text("".join(json.dumps(each) + "\n" for each in lines))
    return path


def test_tasks_are_told_apart_and_a_test_counts_once(tmp_path: Path) -> None:
    lines = (line(), line(successes=20, trials=23), line(task="pick-fruit", successes=1), line(step=50, successes=40))
    for order in (lines, lines[::-1]):
        cells, oracle = read([written(tmp_path, *order)], TASK)
        rates = {cell.way.steps: pooled([cell]) for cell in cells}
        assert rates == {100: Rate(90, 100), 50: Rate(40, 100)}
        assert oracle == [Rate(100, 100)]
    (cell,), _ = read([tmp_path / "evaluations.jsonl"], "pick-fruit")
    assert pooled([cell]) == Rate(1, 100)


@given(st.lists(st.tuples(st.sampled_from([25, 50, 75, 100]), st.integers(0, 2)), min_size=1, unique=True))
def test_points_of_a_line_are_of_the_same_trainings(
    tmp_path_factory: pytest.TempPathFactory, there: list[tuple[int, int]]
) -> None:
    path = written(tmp_path_factory.mktemp("some"), *(line(step=step, seed=seed) for step, seed in there))
    cells, _ = read([path], TASK)
    seeds = {seed for _, seed in there}
    full = [step for step in (25, 50, 75, 100) if all((step, seed) in there for seed in seeds)]
    drawn = evaluated.lines(cells)
    assert [[step for step, _ in points] for points in drawn.values()] == ([full] if len(full) > 1 else [])
    assert all(rate.trials == 100 * len(seeds) for points in drawn.values() for _, rate in points)


def test_without_an_oracle_nothing_is_said_of_one(tmp_path: Path) -> None:
    cells, oracle = read([written(tmp_path, line(oracle=False), line(step=50, oracle=False))], TASK)
    assert oracle == []
    text = evaluated.table(cells, oracle).markdown()
    assert "nan" not in text
    assert "oracle" not in text
    labels = evaluated.curve(cells, oracle).axes[0].get_legend_handles_labels()[1]
    assert [label.partition(",")[0] for label in labels] == ["leg-unet"]


def test_what_was_recorded_with_an_easier_hand_says_so(tmp_path: Path) -> None:
    cells, oracle = read([written(tmp_path, line(), line(step=50))], TASK)
    (axes,) = evaluated.curve(cells, oracle, said=evaluated.EASIER).axes
    assert axes.get_title().startswith("pick-by-part, recorded with an easier hand than today's\n")
    (axes,) = evaluated.curve(cells, oracle).axes
    assert "hand" not in axes.get_title()


@pytest.mark.parametrize("model", ["fcgq", "my_policy:MY_MODEL"])
def test_every_model_is_drawn_within_the_axes(tmp_path: Path, model: str) -> None:
    found = (line(successes=20, model=model), line(step=50, successes=0, model=model))
    cells, oracle = read([written(tmp_path, *found)], TASK)
    (axes,) = evaluated.curve(cells, oracle).axes
    (curve,) = (points for each in axes.lines if len(points := np.asarray(each.get_xydata())) == 2 and points[0, 0] > 1)
    low, high = axes.get_ylim()
    assert [low <= value <= high for value in curve[:, 1]] == [True, True]
    assert model in evaluated.table(cells, oracle).markdown()


def test_the_last_step_of_each_training_is_its_final_one(tmp_path: Path) -> None:
    found = [
        line(),
        line(step=50, successes=10),
        line(phrasings="unseen", successes=80),
        line(protocol="paper", successes=70),
    ]
    cells, oracle = read([written(tmp_path, *found)], TASK)
    grid = evaluated.table(cells, oracle)
    assert list(map(str, grid.rows[0].values)) == ["90.0 [82.6, 94.5]", "80.0 [71.1, 86.7]", "70.0 [60.4, 78.1]"]
    assert [value.value for value in evaluated.failures(cells).rows[0].values if value] == [10, 100]


def test_a_file_of_something_else_is_one_sentence_and_draws_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, line(task="pick-fruit"))
    evaluated.main(["--results", str(path), "--out", str(tmp_path / "out")])
    assert "no evaluation of pick-by-part is in these files" in capsys.readouterr().out
    assert not (tmp_path / "out").exists()
