"""Tables and figures say what the results say, and nothing where there is none."""

from __future__ import annotations

import csv
import io
import json
import re
import runpy
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import efficiency
import paper
import pytest
import style
import tables
from grid import PACKAGES, Grid, Row, Value, as_csv
from loading import load

from equigrasp.models import MODELS
from equigrasp.study.matrix import CostJob, Job, Protocol
from equigrasp.study.tables import TABLES
from equigrasp.success import MeanReward, Rate

ROOT = Path(__file__).parent.parent


def kpsewhich(package: str) -> str:
    """Where TeX has a package, or nothing."""
    return subprocess.run(["kpsewhich", f"{package}.sty"], capture_output=True, text=True).stdout.strip()


def rates(successes: int, trials: int) -> dict[str, Any]:
    return {kind: {"successes": successes, "trials": trials} for kind in ("grasped", "correct_object", "correct")}


def line(model: str, seed: int, successes: int, reward: float, task: str = "pick-by-part", demos: int = 1) -> dict:
    """A cell as `equigrasp study` would write it, of 100 single shots and 50 scenes."""
    job = Job(MODELS[model], task, demos, seed, 100, 0.0, "overhead", 1, 1, Protocol(50, 100), (task,))
    measured = {
        "single_shot": rates(successes, 100),
        "paper": {"reward": reward, "scenes": 50},
        "clip_pretrained": None,
    }
    return {**job.cell(task), **measured}


def written(folder: Path, *found: dict) -> Path:
    path = folder / "results.jsonl"
    path.write_text("".join(json.dumps(each) + "\n" for each in found))
    return path


def row(grid: Grid, model: str, demos: int = 1, whose: str = tables.OURS) -> Row:
    (found,) = (each for each in grid.rows if each.labels[:3] == (model, str(demos), whose))
    return found


def test_seeds_are_pooled_with_wilsons_interval(tmp_path: Path) -> None:
    cells, _ = load([written(tmp_path, line("leg-unet", 0, 90, 0.9), line("leg-unet", 1, 70, 0.6))])
    (shots,) = row(tables.single_shots(6, "pick-by-part", cells), "leg-unet").values
    assert shots is not None
    assert (shots.value, shots.trials) == (80.0, 200)
    assert shots.interval == pytest.approx([100 * end for end in Rate(160, 200).interval])
    (reward,) = row(tables.rewards(6, "pick-by-part", cells), "leg-unet").values
    assert reward is not None
    assert (reward.value, reward.trials) == (75.0, 100)
    assert reward.interval == pytest.approx([100 * end for end in MeanReward(0.75, 100).interval])
    assert row(tables.rewards(6, "pick-by-part", cells), "leg-unet").labels[-1] == "2"


def test_a_cell_counts_once_however_often_its_line_is_there(tmp_path: Path) -> None:
    one, other = line("vit", 0, 90, 0.9), line("vit", 1, 0, 0.0)
    cells, _ = load([written(tmp_path, one, one, other)])
    (shots,) = row(tables.single_shots(6, "pick-by-part", cells), "vit").values
    assert shots is not None
    assert shots.trials == 200


def test_a_policy_counts_once_with_its_most_trials(tmp_path: Path) -> None:
    one = line("vit", 0, 90, 0.9)
    longer = {**one, "queries": 200, "scenes": 0, "single_shot": rates(170, 200)}
    del longer["paper"]
    first, copy = written(tmp_path, one, longer), tmp_path / "copy.jsonl"
    copy.write_bytes(first.read_bytes())
    cells, _ = load([first, copy])
    (cell,) = cells
    assert cell.shots["correct"] == Rate(170, 200)
    assert (cell.reward, cell.scenes) == (0.9, 50)
    faster = {**one, "learning_rate": 5e-4}
    assert len(load([written(tmp_path, one, faster)])[0]) == 2


def test_evaluations_of_one_run_are_one_policy_and_of_another_run_another(tmp_path: Path) -> None:
    def evaluation(protocol: str, batch: int) -> dict:
        training = {"steps": 100, "seed": 0, "recombination": 0.7, "batch": batch}
        model = {"name": "vit", "text_encoder": "minilm"}
        run = {"model": model, "task": "pick-by-part", "demos": 1, "data_seed": 0, "training": training}
        policy = {"reward": 0.5, "scenes": 50} if protocol == "paper" else rates(90, 100)
        what = {"task": "pick-by-part", "protocol": protocol, "phrasings": "seen", "camera": "overhead"}
        return {**what, "seed": 0, "step": 100, "run": run, "policy": policy}

    same, _ = load([written(tmp_path, evaluation("paper", 1), evaluation("single-shot", 1))])
    assert [(cell.reward, cell.shots["correct"]) for cell in same] == [(0.5, Rate(90, 100))]
    brief = evaluation("single-shot", 1) | {"policy": rates(20, 23)}
    for lines in ((brief, evaluation("single-shot", 1)), (evaluation("single-shot", 1), brief)):
        (cell,) = load([written(tmp_path, *lines)])[0]
        assert cell.shots["correct"] == Rate(90, 100), "the most trials, whichever came last"
    others, _ = load([written(tmp_path, evaluation("paper", 1), evaluation("single-shot", 8))])
    assert [(cell.reward, bool(cell.shots)) for cell in others] == [(0.5, False), (None, True)]


def test_cells_that_were_not_run_are_blank_and_say_so(tmp_path: Path) -> None:
    cells, _ = load([written(tmp_path, line("leg-unet", 0, 90, 0.9))])
    for grid in (tables.rewards(6, "pick-by-part", cells), tables.single_shots(6, "pick-by-part", cells)):
        missing = row(grid, "vit", 10)
        assert missing.values == (None,)
        assert missing.labels[-1] == "not run"
    assert not tables.was_run(1, cells, [])
    assert all(value is None for each in tables.rewards(1, "pick-random-v1", cells).rows for value in each.values)


def test_the_papers_figures_are_these_and_no_others() -> None:
    known = [
        (table, each.labels[0], each.labels[1], value.value)
        for table in (1, 2, 4, 6)
        for task in TABLES[table].tasks
        for each in tables.rewards(table, task, []).rows
        for value in each.values
        if each.labels[2] == tables.PAPER and value is not None
    ]
    assert known == [
        (6, "leg-unet", "1", 87.0),
        (6, "fcgq", "1", 66.0),
        (6, "vit", "1", 19.5),
        (6, "leg-unet", "10", 98.0),
        (6, "fcgq", "10", 95.0),
        (6, "vit", "10", 53.0),
    ]
    assert "87.0" in "".join(tables.rewards(6, "pick-by-part", []).markdown())
    assert paper.COST in tables.costs([]).markdown()


def test_the_best_is_bold_among_ours_with_as_many_demonstrations(tmp_path: Path) -> None:
    found = (
        line("leg-unet", 0, 90, 0.5),
        line("vit", 0, 40, 0.5),
        line("fcgq", 0, 20, 0.1),
        line("vit", 0, 99, 0.99, demos=10),
    )
    cells, _ = load([written(tmp_path, *found)])
    shots, reward = (each(6, "pick-by-part", cells).markdown() for each in (tables.single_shots, tables.rewards))
    assert [text.split("|")[1].strip() for text in shots.splitlines() if "**" in text] == ["leg-unet"]
    # equal ones share it; the paper's higher one, and one that has no rival, do not take it
    assert [text.split("|")[1].strip() for text in reward.splitlines() if "**" in text] == ["leg-unet", "vit"]


def test_clip_that_learned_nothing_is_named_so(tmp_path: Path) -> None:
    cells, _ = load([written(tmp_path, {**line("cliport-vit", 0, 9, 0.1), "clip_pretrained": False})])
    assert "cliport-vit (CLIP not pretrained)" in tables.rewards(6, "pick-by-part", cells).markdown()


def test_markdown_latex_and_csv_say_the_same(tmp_path: Path) -> None:
    cells, _ = load([written(tmp_path, line("leg-unet", 0, 90, 0.9), line("vit", 0, 40, 0.25))])
    paths = {path.suffix: path.read_text() for path in tables.write(6, tables.grids(6, cells, []), tmp_path)}
    shots = "90.0 [82.6, 94.5]"
    assert f"**{shots}**" in paths[".md"]
    assert r"\textbf{90.0} {\tiny [82.6, 94.5]} \\" in paths[".tex"]
    assert r"\rotatebox{90}{pick-by-part} \\" in paths[".tex"]
    lines = list(csv.DictReader(io.StringIO(paths[".csv"])))
    (one,) = (each for each in lines if each["model"] == "leg-unet" and each["trials"] == "100" and each["low"])
    assert (one["value"], one["whose"], one["column"]) == ("90.0", "ours", "pick-by-part")
    assert paths[".tex"].count(r"\begin{longtable}") == paths[".tex"].count(r"\end{longtable}") == 3
    assert "%" not in paths[".tex"].replace(r"\%", "")


def test_latex_and_csv_escape_what_means_something_else() -> None:
    grid = Grid("50% & a_b", ("x",), ("a,b",), (Row(('"1"',), (Value(1.0),)),))
    assert r"50\% \& a\_b" in grid.latex()
    assert next(csv.DictReader(io.StringIO(as_csv([grid]))))["x"] == '"1"'


def test_a_label_that_every_row_has_stands_in_the_latex_caption_alone() -> None:
    rows = tuple(Row((name, "1", "0.7"), (Value(1.0),)) for name in ("one", "other"))
    grid = Grid("t", ("model", "demonstrations", "recombination"), ("c",), rows)
    assert r"\caption{t; demonstrations: 1; recombination: 0.7}" in grid.latex()
    assert "one & 1.0" in grid.latex()
    differs = Row(("third", "1", "no"), (None,))
    assert r"third & no &  \\" in replace(grid, rows=(*rows, differs)).latex()


def test_each_training_has_a_table_of_its_own(tmp_path: Path) -> None:
    name = "leg-unet-no-steerability"
    cells, _ = load([written(tmp_path, line(name, 0, 90, 0.9), line(name, 0, 40, 0.3, "pick-random-v1"))])
    drawn = [grid for grid in tables.grids(4, cells, []) if "mean reward" in grid.title]
    assert [grid.columns for grid in drawn] == [tables.columns(task) for task in TABLES[4].tasks]
    found = [[value.value for value in row(grid, name).values if value is not None] for grid in drawn]
    assert sorted(found) == [[], [30.0], [90.0]]
    for grid, task in zip(drawn, TABLES[4].tasks, strict=True):
        assert task in grid.title
        assert {each.labels[3] for each in grid.rows} == {task}


@pytest.mark.skipif(
    any(shutil.which("kpsewhich") is None or not kpsewhich(package) for package in PACKAGES),
    reason="no LaTeX with the packages that the tables need",
)
def test_latex_fits_on_pages(tmp_path: Path) -> None:
    rows = tuple(
        Row(
            (f"leg-unet-no-kernel-language {row}", "10", "ours", "10000", "0.7, hard negatives 0.5, crowded 0.4", "1"),
            (Value(98.0, (88.0, 99.9)), *[Value(9.0, (8.0, 9.9))] * 6),
            rivals="all",
        )
        for row in range(120)
    )
    heads = ("model", "demonstrations", "whose", "steps", "recombination", "seeds")
    wide = Grid("wide & long", heads, tuple(f"pick-colored-{each}" for each in range(7)), rows, ("A note of it.",) * 2)
    narrow = Grid("narrow", ("model",), ("pick_by_part",), (Row(("vit",), (Value(1.0),)),))
    packages = "".join(rf"\usepackage{{{package}}}" for package in PACKAGES)
    text = "\n".join(grid.latex() for grid in (wide, narrow))
    (tmp_path / "t.tex").write_text(
        rf"\documentclass{{article}}\usepackage[margin=1in]{{geometry}}{packages}\begin{{document}}{text}\end{{document}}"
    )
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "t.tex"]
    for _ in range(2):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout[-2000:]
    assert not re.findall(r"Overfull.*|.*too large.*", done.stdout)


@pytest.mark.parametrize(
    "script", [path for path in sorted((ROOT / "paper_figs").glob("*.py")) if "__main__" in path.read_text()]
)
def test_a_script_explains_itself_and_writes_where_it_is_told(
    script: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", [script.name, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(script), run_name="__main__")
    assert ended.value.code == 0
    assert "--out" in capsys.readouterr().out


def test_failures_add_up(tmp_path: Path) -> None:
    shots = {"grasped": 95, "correct_object": 90, "correct": 88}
    found = line("leg-unet", 0, 88, 0.9)
    found["single_shot"] = {kind: {"successes": count, "trials": 100} for kind, count in shots.items()}
    found["single_shot"]["failures"] = {"nothing lifted": 5, "several lifted": 1, "wrong object": 4, "wrong part": 2}
    cells, _ = load([written(tmp_path, found)])
    grid = tables.failures(6, "pick-by-part", cells)
    assert grid.columns == ("nothing lifted", "wrong object", "several lifted", "wrong part", "all failures")
    (only,) = grid.rows
    assert [value.value for value in only.values if value] == [5.0, 4.0, 1.0, 2.0, 12.0]


def test_costs_stand_beside_the_papers(tmp_path: Path) -> None:
    measured = {
        "parameters": 3_210_000,
        "frozen_parameters": 0,
        "seconds": {"step": 0.1234, "read_out": 0.05},
        "memory": 3 * 2**29,
        "device": {"processor": "a processor"},
    }
    _, costs = load([written(tmp_path, {**CostJob(MODELS["leg-unet"], 1).cell(), **measured})])
    (only,) = (each for each in tables.costs(costs).rows if each.labels[0] == "leg-unet")
    assert only.labels == ("leg-unet", "a processor", "1")
    assert list(map(str, only.values)) == ["3.3", "3.21", "0.0", "0.123", "0.050", "1.50"]


def test_what_ships_is_what_the_results_give(tmp_path: Path) -> None:
    """The tables in `figures` were drawn from the results beside them, and by hand by nobody."""
    tables.main(["--out", str(tmp_path)])
    drawn = {path.name: path.read_text() for path in tmp_path.iterdir()}
    shipped = {path.name: path.read_text() for path in style.FIGURES.glob("table-*")}
    assert drawn == shipped
    assert "table-6.md" in drawn


def test_figures_are_the_same_files_twice(tmp_path: Path) -> None:
    cells, _ = load([style.RESULTS / "easier-hand" / "pick-by-part.jsonl"])
    files = []
    for name in ("one", "two"):
        figure = efficiency.curve(cells)
        assert figure is not None
        png, pdf = style.save(figure, name, tmp_path)
        assert png.read_bytes().startswith(b"\x89PNG")
        files.append((png.read_bytes(), pdf.read_bytes()))
    assert files[0] == files[1]
    assert [[demos for demos, _ in points] for points in efficiency.lines(cells, "pick-by-part").values()] == [[1, 10]]


def test_a_file_that_is_not_there_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        tables.main(["--results", "nowhere.jsonl"])
    assert "there is no file nowhere.jsonl" in capsys.readouterr().err


def test_the_notebooks_run() -> None:
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", "--nbmake", "notebooks"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    assert f"{len(list((ROOT / 'notebooks').glob('*.ipynb')))} passed" in done.stdout
