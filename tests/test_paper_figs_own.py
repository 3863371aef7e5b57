"""A study of one's own tasks, models and tests ends in a table, and no table of the paper's takes it for its own."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import by_task
import pytest
import recorded
import side_by_side
import table4
import tables
from loading import load

from equigrasp.cli.study import Study
from equigrasp.config import ModelConfig
from equigrasp.models import MODELS
from equigrasp.study.matrix import Job, Protocol
from equigrasp.study.tables import TABLES, TESTED_ON

OWN_MODEL = replace(MODELS["leg-unet"], name="my-unet")


def line(
    trained_on: str, tested_on: str | None = None, model: ModelConfig = OWN_MODEL, seed: int = 0, correct: int = 90
) -> dict[str, Any]:
    """A cell as `equigrasp study` would write it, of 100 single shots and 50 scenes."""
    tested_on = tested_on or trained_on
    job = Job(model, trained_on, 1, seed, 100, 0.0, "overhead", 1, 1, Protocol(50, 100), (tested_on,))
    shots = {kind: {"successes": correct, "trials": 100} for kind in ("grasped", "correct_object", "correct")}
    measured = {
        "single_shot": {**shots, "failures": {"nothing lifted": 100 - correct}},
        "paper": {"reward": correct / 100, "scenes": 50},
        "clip_pretrained": None,
    }
    return {**job.cell(tested_on), **measured}


def written(folder: Path, *found: dict[str, Any]) -> Path:
    path = folder / "results.jsonl"
    path.write_text("".join(json.dumps(each) + "\n" for each in found))
    return path


def drawn(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_tasks_of_ones_own_stand_in_a_table_of_their_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = [
        line("my_task:PICK_MINE"),
        line("my_task:PICK_MINE", seed=1, correct=70),
        line("pick-fruit", correct=40),
        line("pick-by-part", "pick-fruit", MODELS["leg-unet"], correct=30),
    ]
    out = tmp_path / "out"
    tables.main(["--results", str(written(tmp_path, *found)), "--out", str(out)])
    assert drawn(out) == {f"table-own.{kind}" for kind in ("md", "tex", "csv")}
    said = capsys.readouterr().out
    assert "not written: 1, 2, 4, 5, 6, as the results are of policies trained on my_task:PICK_MINE; " in said
    assert "policies trained on pick-by-part and tested on pick-fruit; policies trained on pick-fruit" in said
    page = (out / "table-own.md").read_text()
    assert "### Cells of your own, trained on my_task:PICK_MINE: mean reward, %" in page
    assert "| my_task:PICK_MINE | 100 | no | 2 | 80.0 [" in page, "two seeds are pooled"
    assert "| ours | pick-fruit | 100 | no | 1 | 40.0 [" in page
    assert "| leg-unet | 1 | ours | pick-by-part | 100 | no | 1 | 30.0 [" in page
    assert "the paper |" not in page
    assert "not run |" not in page
    assert r"my\_task:PICK\_MINE" in (out / "table-own.tex").read_text()
    rows = list(csv.DictReader(io.StringIO((out / "table-own.csv").read_text())))
    assert {row["trained on"] for row in rows} == {"my_task:PICK_MINE", "pick-fruit", "pick-by-part"}
    assert {float(row["value"]) for row in rows if row["column"] == "nothing lifted"} == {20.0, 60.0, 70.0}


def test_each_cell_is_of_some_table_and_what_is_of_the_papers_is_none_of_ones_own(tmp_path: Path) -> None:
    """Whatever was trained and tested."""
    tasks = ["pick-random-v1", "pick-random-v2", "pick-by-part", "pick-fruit", "pick-novel-v2", "mine:MINE"]
    models = [OWN_MODEL, MODELS["vit"], MODELS["leg-unet-no-steerability"]]
    cells, _ = load([written(tmp_path, *(line(a, b, model) for a in tasks for b in tasks for model in models))])
    left = tables.own(cells)
    for cell in cells:
        the_papers = any(
            cell.way.trained_on in TABLES[table].tasks
            and cell.task in TESTED_ON.get(cell.way.trained_on, (cell.way.trained_on,))
            for table in (1, 2, 6)
        )
        assert (cell in left) != the_papers
    grids = tables.grids(tables.OWN, left, [])
    shown = [value for grid in grids if "single shots, seen" in grid.title for row in grid.rows for value in row.values]
    assert sum(value is not None for value in shown) == len(left)


def test_a_table_that_is_asked_for_says_what_it_leaves_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = written(tmp_path, line("pick-fruit"), line("pick-by-part", model=MODELS["vit"]))
    tables.main(["--results", str(results), "--table", "6", "--out", str(tmp_path / "out")])
    assert "left out: what is of policies trained on pick-fruit; without --table it" in capsys.readouterr().out
    assert drawn(tmp_path / "out") == {f"table-6.{kind}" for kind in ("md", "tex", "csv")}


def test_results_that_no_table_has_are_one_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        tables.main(["--results", str(written(tmp_path)), "--out", str(tmp_path / "out")])
    assert "no line of these files is a result that a table has; `equigrasp study`" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_of_what_ships_the_papers_tables_alone_are_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is recorded by now."""
    results = written(tmp_path, line("pick-fruit"), line("pick-by-part"))
    monkeypatch.setattr(tables, "recorded", lambda: [results])
    tables.main(["--out", str(tmp_path / "out")])
    assert drawn(tmp_path / "out") == {f"table-6.{kind}" for kind in ("md", "tex", "csv")}
    tables.main(["--results", str(results), "--out", str(tmp_path / "out")])
    assert "table-own.md" in drawn(tmp_path / "out")


def test_a_model_of_ones_own_stands_in_the_figure_of_all_tasks(tmp_path: Path) -> None:
    """Whoever reads for it: its row is not known here."""
    found = [line("pick-fruit"), line("pick-fruit", model=MODELS["leg-unet"], correct=80)]
    hashing = replace(OWN_MODEL, text_encoder="hashing")
    cells, _ = load([written(tmp_path, *found, line("pick-fruit", model=hashing, correct=10))])
    (row,) = by_task.rates(cells).values()
    shown = {model: rate.value for (model, _), rate in row.items()}
    assert sorted(shown.values()) == [0.1, 0.8, 0.9]
    assert shown["leg-unet"] == 0.8
    (best,) = by_task.best(cells).rows
    assert best.labels[1].startswith("my-unet, 1 demo, 100 steps")


def test_a_figure_that_is_not_drawn_says_what_the_results_are_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    results = written(tmp_path, line("pick-fruit"), line("pick-random-v1", "pick-toy"))
    recorded.main("side-by-side", side_by_side.panels, "some command", ["--results", str(results)])
    said = capsys.readouterr().out
    assert "no result of pick-by-part" in said
    assert "are of policies trained on pick-fruit; policies trained on pick-random-v1 and tested on pick-toy" in said
    without = {**line("pick-fruit"), "phrasings": "unseen"}
    by_task.main(["--results", str(written(tmp_path, without))])
    assert "makes one; the results are of policies trained on pick-fruit" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("row", "task"), [("NO_STEERABILITY", "pick-fruit"), ("MINE", "pick-fruit"), ("MINE", "pick-by-part")]
)
def test_a_row_that_was_just_run_is_printed_on_any_task_and_under_any_name(
    row: str, task: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table4, "MINE", replace(table4.FULL, name="my-row"), raising=False)
    model = table4.rows()[row]

    def execute(study: Study) -> Path:
        assert study.out is not None
        return written(study.out, line(task, model=model))

    monkeypatch.setattr(Study, "execute", execute)
    table4.main(["--run", row, "--tasks", task, "--out", str(tmp_path)])
    said = capsys.readouterr().out
    shots = [each for each in said.splitlines() if each.startswith(f"| {model.name} ") and "90.0 [82.6, 94.5]" in each]
    assert len(shots) == 1
    assert f"| ours | {task} | 100 | no | 1 |" in shots[0]
    titles = [each for each in said.splitlines() if each.startswith("### Table 4")]
    assert all(each.partition(" trained on ")[2].startswith(task) for each in titles), "no other task's table"
