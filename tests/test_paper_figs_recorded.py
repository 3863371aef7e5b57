"""Figures from recorded results, on a small real study: they show its lines, and nothing where there are none."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import by_task
import confusion
import efficiency
import failures
import laws
import learning
import numpy as np
import pytest
import recorded
import side_by_side
import style
import symmetry
import table4
import tables
import text_encoders
from cells import FAILURES, UNSPLIT, Cell
from loading import load

from equigrasp.cli.study import Study
from equigrasp.config import differences
from equigrasp.models import MODELS
from equigrasp.study.settings import config
from equigrasp.study.tables import TABLES
from equigrasp.success import Rate
from tasks import TASKS

TASK = "pick-by-part"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two models with a kernel and without one, hardly trained, on the real task."""
    return Study(
        models=("leg-steerable", "fcgq"),
        tasks=(TASK,),
        demos=(1,),
        seeds=(0,),
        steps=(51,),
        scenes=0,
        queries=6,
        checkpoints=2,
        validation=4,
        turned=2,
        camera="overhead",
        text_encoder="hashing",
        out=tmp_path_factory.mktemp("recorded") / "study",
    ).execute()


@pytest.fixture
def lines(results: Path) -> dict[str, dict[str, Any]]:
    found = [json.loads(line) for line in results.read_text().splitlines()]
    return {line["model"]: line for line in found}


@pytest.fixture
def cells(results: Path) -> list[Cell]:
    return load([results])[0]


def test_failures_are_the_judges_and_add_up(cells: list[Cell], lines: dict[str, dict[str, Any]]) -> None:
    for way, (found, trials) in failures.counts(cells, TASK).items():
        assert found == lines[way.model]["single_shot"]["failures"]
        assert set(found) <= set(FAILURES)
        assert sum(found.values()) == trials - lines[way.model]["single_shot"]["correct"]["successes"]
    figure = failures.bars(cells)
    assert figure is not None
    (axes,) = figure.axes
    drawn = sum(patch.get_width() for patch in axes.patches)  # ty: ignore[missing-attribute]
    counted = failures.counts(cells, TASK)
    failed = sum(sum(found.values()) for found, _ in counted.values())
    assert drawn == pytest.approx(100 * failed / 6)
    assert axes.get_xlim() == (0, 100)
    # a kind of which no bar is seen is named with its number, and one that does not occur is not
    few = {way: ({"wrong part": 1, "wrong object": 100}, 500) for way in counted}
    assert failures.invisible(few, ["wrong object"]) == [f"wrong part ({len(few)} of {500 * len(few):,})"]
    assert failures.kinds(few) == ["wrong object", "wrong part"]


def test_failures_have_a_block_for_each_number_of_demonstrations(cells: list[Cell]) -> None:
    ten = [replace(cell, way=replace(cell.way, demos=10)) for cell in cells]
    (two, *_) = [replace(cell, way=replace(cell.way, demos=2)) for cell in cells]
    figure = failures.bars([*ten, two, *cells])
    assert figure is not None
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["from 1 demonstration", "from 10 demonstrations"]
    assert "so many demonstrations: 2" in figure.get_suptitle()
    steps = {way.steps for way in failures.counts(cells, TASK)}
    labels = [text.get_text() for axes in figure.axes for text in axes.get_yticklabels()]
    assert len(steps) == 1
    assert not any("steps" in label for label in labels)
    assert f"{steps.pop()} steps" in figure.get_suptitle()


def test_confusions_are_the_trials_that_lifted_something_else(
    cells: list[Cell], lines: dict[str, dict[str, Any]]
) -> None:
    for cell in cells:
        recorded_ones = lines[cell.way.model]["single_shot"]
        assert cell.mistaken == recorded_ones["mistaken"]
        others = sum(count for kind, count in recorded_ones["failures"].items() if kind != "nothing lifted")
        labels, counts = confusion.matrix(confusion.pairs([cell, cell]), confusion.names(TASKS[TASK]))
        assert counts.sum() == 2 * others
        assert len(counts) == len(TASKS[TASK].goals) <= len(labels)
    own = [replace(cell, way=replace(cell.way, text_encoder=None)) for cell in cells]
    asked, taken, *_ = confusion.names(TASKS[TASK])
    often = confusion.panels([replace(cell, mistaken={asked: {taken: confusion.OFTEN}}) for cell in own])
    assert often is not None
    assert len(often.axes) == 1
    assert "left out" not in often.get_suptitle()
    for few in ({}, {asked: {taken: (confusion.OFTEN - 1) // len(own)}}):
        seldom = confusion.panels([replace(cell, mistaken=few) for cell in own])
        assert seldom is not None
        assert not seldom.axes
        assert f"{TASK} (" in seldom.get_suptitle()
    assert confusion.panels([replace(cell, mistaken=None) for cell in own]) is None
    assert {row.labels[0] for row in confusion.table(own).rows} <= {TASK}


def test_a_confusion_stands_where_it_belongs() -> None:
    """Asked for in a row, lifted in a column: another object, another colour, the same colour of another thing."""
    asked, *others = confusion.names(TASKS["pick-tool"])
    mistaken = Counter({(asked, others[0]): 3, (asked, f"{asked} and {others[0]}"): 2})
    labels, counts = confusion.matrix(mistaken, confusion.names(TASKS["pick-tool"]))
    assert labels == [asked, *others, confusion.ANOTHER]
    assert counts[labels.index(asked), labels.index(others[0])] == 3
    assert counts[labels.index(asked), -1] == 2
    assert counts.sum() == 5
    called = confusion.names(TASKS["pick-colored-toy"])
    mistaken = Counter({("red lion", "blue lion"): 4, ("red lion", "red deer"): 1, ("blue deer", "red lion"): 2})
    labels, counts = confusion.matrix(mistaken, called)
    assert len(labels) == len(set(called.values())) == 10
    red, blue = labels.index("red"), labels.index("blue")
    assert (counts[red, blue], counts[red, red], counts[blue, red]) == (4, 1, 2)
    assert np.count_nonzero(counts) == 3


def test_what_all_goals_have_before_a_hyphen_is_said_once() -> None:
    assert confusion.short(["bottle-A", "bottle-B", confusion.ANOTHER]) == ("bottle-", ["A", "B", confusion.ANOTHER])
    for labels in (["bottle-A", "block-moon"], ["bottle-A", "lion"], ["red", "blue"], ["two-handed pan-A", "pan-A"]):
        assert confusion.short(labels) == ("", labels)


def test_results_from_before_the_kinds_are_not_split_by_guessing() -> None:
    cells, _ = load([style.RESULTS / "easier-hand" / "pick-by-part.jsonl"])
    old = [cell for cell in cells if cell.shots]
    for cell in old:
        correct = cell.shots["correct"]
        assert sum(cell.failures.values()) == correct.trials - correct.successes
    assert {kind for cell in old for kind in cell.failures} == {"nothing lifted", UNSPLIT, "wrong part"}


def test_learning_curves_are_the_validations(cells: list[Cell], lines: dict[str, dict[str, Any]]) -> None:
    drawn = learning.lines(cells, TASK)
    assert {way.model for way in drawn} == {"leg-steerable", "fcgq"}
    for way, points in drawn.items():
        found = {str(step): rate.successes for step, rate in points}
        assert found == lines[way.model]["validation_successes"]
        assert {rate.trials for _, rate in points} == {4}
    assert learning.curve(cells) is not None


def test_a_training_counts_once_however_many_tests_it_had(cells: list[Cell]) -> None:
    again = [*cells, *(replace(cell, task="pick-logo") for cell in cells)]
    assert learning.lines(again, TASK) == learning.lines(cells, TASK)
    unseen = [replace(cell, way=replace(cell.way, phrasings="unseen")) for cell in cells]
    assert learning.lines(unseen, TASK) == learning.lines([*cells, *unseen], TASK) == learning.lines(cells, TASK)
    # and another seed counts
    more = [*cells, *(replace(cell, seeds=(1, 1)) for cell in cells)]
    assert {rate.trials for points in learning.lines(more, TASK).values() for _, rate in points} == {8}


def test_symmetry_stands_against_success(cells: list[Cell], lines: dict[str, dict[str, Any]]) -> None:
    drawn = {way.model: found for way, found in symmetry.points(cells, TASK).items()}
    for model, (errors, rate) in drawn.items():
        line = lines[model]
        assert errors["scores"] == line["equivariance"]["scores"]
        assert errors["degrees"] == line["equivariance"]["turned"]["degrees"]
        assert rate.successes == line["single_shot"]["correct"]["successes"]
    assert drawn["fcgq"][0]["kernel"] is None
    kernel = drawn["leg-steerable"][0]["kernel"]
    assert kernel is not None
    assert kernel < 1e-3
    assert symmetry.panels(cells) is not None
    assert symmetry.points([replace(cell, symmetry=None) for cell in cells], TASK) == {}


def test_what_differs_in_recombination_alone_is_one_row(cells: list[Cell]) -> None:
    recombined = [replace(cell, way=replace(cell.way, recombination=0.7)) for cell in cells]
    longer = [replace(cell, way=replace(cell.way, steps=60)) for cell in cells]
    rows = side_by_side.rows([*recombined, *cells, *longer], TASK)
    assert [(row.model, row.steps) for row in rows] == [
        (model, steps) for model in ("leg-steerable", "fcgq") for steps in (51, 60)
    ]
    assert [[way.recombination for way in ways] for ways in rows.values()] == [[0.0, 0.7], [0.0]] * 2
    # and no two ways of a figure look alike
    looks = recorded.looks(way for ways in rows.values() for way in ways if way.steps == 51)
    assert len(set(looks.values())) == len(looks) == 4


def test_rows_are_told_apart_by_their_number_of_demonstrations(cells: list[Cell]) -> None:
    ten = [replace(cell, way=replace(cell.way, demos=10)) for cell in cells]
    one_block, both = side_by_side.tables(cells, TASK), side_by_side.tables([*ten, *cells], TASK)
    assert [grid.title for grid in both] == [
        f"{TASK} from {many}, %" for many in ("1 demonstration", "10 demonstrations")
    ]
    assert [row.values[:4] for row in both[0].rows] == [row.values[:4] for row in one_block[0].rows]
    figure = side_by_side.panels([*ten, *cells], TASK)
    assert figure is not None
    assert len(figure.axes) == 4
    # a number that one model alone was given compares nothing, unless it is all there is
    alone = [cell for cell in ten if cell.way.model == "fcgq"]
    assert side_by_side.blocks([*alone, *cells], TASK).keys() == {1}
    assert side_by_side.blocks(alone, TASK).keys() == {10}


def test_readme_and_docs_have_the_table_that_the_results_give() -> None:
    cells, _ = load(tables.recorded())
    made = [grid.markdown() for grid in side_by_side.tables(cells)]
    assert (style.FIGURES / "side-by-side.md").read_text() == "\n".join(made)
    lines = [[line for line in table.splitlines() if line.startswith("|")] for table in made]
    assert len(lines[0]) > 4
    for table in lines:
        assert "\n".join(table) in (style.HERE.parent / "docs" / "results.md").read_text()
    # README has some rows of what one demonstration gives
    head, rule, *rows = lines[0]
    readme = (style.HERE.parent / "README.md").read_text()
    shown = readme.partition(f"{head}\n{rule}\n")[2].partition("\n\n")[0].splitlines()
    assert len(shown) > 4
    assert shown == [row for row in rows if row in shown]


def test_a_row_of_all_tasks_has_what_was_trained_alike_alone(
    cells: list[Cell], lines: dict[str, dict[str, Any]]
) -> None:
    own = [replace(cell, way=replace(cell.way, text_encoder=None)) for cell in cells]
    kernel, network = (next(cell for cell in own if cell.way.model == name) for name in ("leg-steerable", "fcgq"))
    recombined = replace(network, way=replace(network.way, recombination=0.7))
    hard = replace(recombined, way=replace(recombined.way, hard_negatives=0.5))
    crowded = replace(recombined, way=replace(recombined.way, crowded=0.4))
    both = replace(hard, way=replace(hard.way, crowded=0.4))
    longer = replace(kernel, way=replace(kernel.way, steps=99))
    elsewhere = replace(kernel, task="pick-logo")
    others = [
        replace(kernel, way=replace(kernel.way, **more)) for more in ({"phrasings": "unseen"}, {"text_encoder": "a"})
    ]
    found = by_task.rates([both, crowded, hard, elsewhere, *others, longer, recombined, kernel, network])
    assert [(place.steps, place.tested_on, set(row)) for place, row in found.items()] == [
        (51, "pick-logo", {("leg-steerable", by_task.WITHOUT)}),
        (
            51,
            TASK,
            {
                ("leg-steerable", by_task.WITHOUT),
                ("fcgq", by_task.WITHOUT),
                ("fcgq", by_task.WITH),
                ("fcgq", by_task.HARD),
                ("fcgq", by_task.CROWDED),
                ("fcgq", by_task.BOTH),
            },
        ),
        (99, TASK, {("leg-steerable", by_task.WITHOUT)}),
    ]
    for row in found.values():
        for (model, _), rate in row.items():
            single = lines[model]["single_shot"]["correct"]
            assert (rate.successes, rate.trials) == (single["successes"], single["trials"])
    ten = replace(kernel, way=replace(kernel.way, demos=10))
    (row,) = by_task.best([kernel, ten]).rows
    assert ", 1 demo," in row.labels[1]
    # the fewest that the task itself was learned from
    rows = by_task.best([kernel, ten, replace(ten, task="pick-logo")]).rows
    assert [(each.labels[0], ", 1 demo," in each.labels[1]) for each in rows] == [("pick-logo", False), (TASK, True)]
    most = Rate(6, 6)
    (row,) = by_task.best([kernel, replace(network, shots={**network.shots, "correct": most})]).rows
    assert row.labels[1].startswith("fcgq")
    assert str(row.values[0]).startswith("100.0 [")
    seeds = [kernel, replace(kernel, seeds=(1, 1))]
    (row,) = by_task.rates(seeds).values()
    assert (
        row["leg-steerable", by_task.WITHOUT].trials == 2 * lines["leg-steerable"]["single_shot"]["correct"]["trials"]
    )


def test_all_tasks_are_drawn_from_what_ships_and_not_from_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shipped, _ = load(tables.recorded())
    best, everything = by_task.best(shipped).markdown(), by_task.table(shipped).markdown()
    assert (style.FIGURES / "by-task.md").read_text() == f"{best}\n{everything}"
    rows = [line for line in best.splitlines() if line.startswith("|")]
    for name in ("README.md", "docs/results.md"):
        assert "\n".join(rows) in (style.HERE.parent / name).read_text(), name
    nothing = tmp_path / "nothing.jsonl"
    nothing.write_text("")
    by_task.main(["--results", str(nothing), "--out", str(tmp_path / "none")])
    assert f"not drawn; `{by_task.COMMAND}` makes one" in capsys.readouterr().out
    assert not (tmp_path / "none").exists()
    with pytest.raises(SystemExit):
        by_task.main(["--results", "nowhere.jsonl"])


def test_confusions_are_drawn_from_what_ships_and_not_from_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shipped, _ = load(tables.recorded())
    assert (style.FIGURES / "confusion.md").read_text() == confusion.table(shipped).markdown()
    nothing = tmp_path / "nothing.jsonl"
    nothing.write_text("")
    confusion.main(["--results", str(nothing), "--out", str(tmp_path / "none")])
    assert f"not drawn; `{confusion.COMMAND}` makes one" in capsys.readouterr().out
    assert not (tmp_path / "none").exists()


def test_the_papers_own_figures_stand_beside_ours() -> None:
    assert side_by_side.known(TASK)["leg-unet", 1] == 87.0
    assert side_by_side.known("pick-logo") == {}


@pytest.mark.parametrize(
    ("name", "draw", "command"),
    [
        ("failures", failures.bars, failures.COMMAND),
        ("learning", learning.curve, learning.COMMAND),
        ("symmetry", symmetry.panels, symmetry.COMMAND),
        ("side-by-side", side_by_side.panels, side_by_side.COMMAND),
        ("sample-efficiency", efficiency.curve, efficiency.COMMAND),
    ],
)
def test_what_no_result_backs_is_not_drawn(
    name: str, draw: Any, command: str, results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = ["--results", str(results), "--task", "pick-logo", "--out", str(tmp_path / "none")]
    recorded.main(name, draw, command, nothing)
    assert f"it is not drawn; `{command}` makes one" in capsys.readouterr().out
    assert not (tmp_path / "none").exists()
    # a line of sample efficiency needs two numbers of demonstrations
    more = tmp_path / "more.jsonl"
    found = [json.loads(line) for line in results.read_text().splitlines()]
    more.write_text("".join(json.dumps({**line, "demos": demos}) + "\n" for line in found for demos in (1, 2)))
    recorded.main(name, draw, command, ["--results", str(more), "--out", str(tmp_path / "some")])
    assert {path.name for path in (tmp_path / "some").iterdir()} == {f"{name}.png", f"{name}.pdf"}
    with pytest.raises(SystemExit):
        recorded.main(name, draw, command, ["--results", "nowhere.jsonl"])
    assert "there is no file nowhere.jsonl" in capsys.readouterr().err


def test_the_rows_of_table_4_are_the_models_that_a_study_runs() -> None:
    rows = table4.rows()
    assert {row.name for row in rows.values()} == set(TABLES[4].models)
    for row in rows.values():
        assert config(row) == config(MODELS[row.name])
        settings = set(differences(table4.FULL, row)) - {"name", "summary", "note", "paper_parameters"}
        assert len(settings) == (row.name != table4.FULL.name)


def test_a_row_of_table_4_is_run_and_stands_in_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tables.recorded", list)  # whatever ships by now
    small = ["--tasks", TASK, "--demos", "1", "--seeds", "0", "--steps", "2", "--queries", "2", "--scenes", "0"]
    table4.main(["--run", "NO_STEERABILITY", *small, "--turned", "0", "--camera", "overhead", "--out", str(tmp_path)])
    said = capsys.readouterr().out
    assert "| leg-unet-no-steerability | 1 | ours | pick-by-part | 2 | no | 1 |" in said
    assert "| leg-unet-no-phi-language | 1 | ours | pick-by-part |  |  | not run |" in said


def test_held_out_phrasings_stand_beside_demonstrated_ones_by_who_read(cells: list[Cell]) -> None:
    seen = [cell for cell in cells if cell.way.model == "leg-steerable"]
    assert text_encoders.heard(seen) == []
    unseen = [
        replace(cell, way=replace(cell.way, phrasings="unseen"), shots={"correct": Rate(successes, 6)})
        for cell in seen
        for successes in (1, 4)
    ]
    (row,) = (line for line in text_encoders.heard(seen + unseen) if "leg-steerable" in line)
    assert "| hashing |" in row
    assert "41.7 [" in row
    own = [replace(cell, way=replace(cell.way, text_encoder=None)) for cell in seen + unseen]
    assert sum("| minilm |" in line for line in text_encoders.heard(own)) == 1
    assert sum("leg-steerable" in line for line in text_encoders.heard(own + seen + unseen)) == 2


def test_who_read_sets_ways_apart(cells: list[Cell]) -> None:
    assert {cell.way.text_encoder for cell in cells} == {"hashing"}
    assert all("read by hashing" in recorded.label(cell.way, TASK, [cell.way]) for cell in cells)


def test_how_finely_was_read_out_sets_ways_apart(lines: dict[str, dict[str, Any]], tmp_path: Path) -> None:
    half = lines["leg-steerable"]
    half["config"]["text_encoder"] = "minilm"
    full = {**half, "config": {**half["config"], "stride": 1}}
    path = tmp_path / "results.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in (half, full)))
    ways = [cell.way for cell in load([path])[0]]
    assert [way.read_out for way in ways] == [None, "full"]
    finer = "full-resolution read-out"
    assert [finer in recorded.label(way, TASK, ways) for way in ways] == [False, True]
    assert [finer in tables.label(way) for way in ways] == [False, True]
    (row,) = by_task.rates(load([path])[0]).values()
    assert [finer in model for model, _ in row] == [False, True]


def test_a_model_looks_the_same_in_every_figure() -> None:
    every = recorded.series(recorded.models([*MODELS, "mine"]))
    few = recorded.series(["fcgq", "leg-equivariant", "leg-equivariant, full-resolution read-out", "mine"])
    assert [few[name] == every[name] for name in ("fcgq", "leg-equivariant")] == [True, True]
    assert len(set(few.values())) == 4
    assert len({every[name] for name in recorded.ALWAYS}) == len(recorded.ALWAYS)
    assert set(recorded.ALWAYS) <= set(MODELS)


def test_the_page_of_laws_tells_an_ablation_from_the_model(cells: list[Cell]) -> None:
    names = ("leg-steerable", "leg-unet-no-steerability")
    page = laws.page(names, cells)
    found = {line.split(" | ")[0].strip("| "): line.split(" | ")[-2:] for line in page.splitlines()}
    for law in ("lemma 1", "steerability", "equivariance", "eq. 2, whole bins"):
        holds, fails = found[law]
        assert "**" not in holds, law
        assert "**" in fails, law
    assert not any("**" in entry for entry in found["translation"])
    assert "| leg-steerable, 1 demo, 51 steps, read by hashing |" in page
    assert "## After training" not in laws.page((), [])


def test_the_page_of_laws_that_ships_has_every_training_that_is_recorded() -> None:
    shipped, _ = load(tables.recorded())
    lines = laws.trained(shipped)
    assert len(lines) > 9
    assert laws.PAGE.read_text().endswith("\n".join(lines) + "\n")
