"""Which clue was missed: counted by hand of a few mistakes, and of what ships all of them and no more."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import clues
import pytest
import style
import tables
from cells import Cell
from loading import load
from matplotlib.patches import Rectangle

from tasks import TASKS

TOYS = "pick-colored-toy"


@pytest.fixture(scope="module")
def shipped() -> list[Cell]:
    return load(tables.recorded())[0]


@pytest.mark.parametrize(
    ("taken", "kind"),
    [
        ("blue medium clamp", clues.COLOR),
        ("red lion", clues.THING),
        ("blue lion", clues.BOTH),
        ("blue clamp", clues.BOTH),
        ("red lion and blue lion", clues.SEVERAL),
        ("lion", clues.BOTH),
    ],
)
def test_a_mistake_is_of_the_clue_that_differs(taken: str, kind: str) -> None:
    assert clues.missed("red medium clamp", taken) == kind


def test_tasks_of_one_colour_or_one_thing_or_without_colours_are_told_by_one_clue() -> None:
    told = {name for name, task in TASKS.items() if clues.is_told_by_both(task)}
    assert told == {"pick-colored-fruit", "pick-colored-tool", TOYS, "pick-random-v2", "pick-novel-v2"}


def test_every_mistake_is_counted_once(shipped: list[Cell]) -> None:
    for task, ways in clues.every(shipped).items():
        tested = [cell for cell in shipped if cell.task == task and cell.mistaken is not None]
        assert {cell.way for cell in tested} == set(ways)
        for way, (kinds, trials) in ways.items():
            own = [cell for cell in tested if cell.way == way]
            mistakes = [count for cell in own for others in (cell.mistaken or {}).values() for count in others.values()]
            assert kinds.total() == sum(mistakes)
            assert trials == sum(cell.shots["correct"].trials for cell in own)


def test_the_figure_has_the_fewest_demonstrations_and_the_table_all(shipped: list[Cell]) -> None:
    [one, *_] = [cell for cell in shipped if cell.task == TOYS and cell.mistaken is not None and cell.way.demos == 1]
    ten = replace(one, way=replace(one.way, demos=10))
    mistaken = {"red lion": {"blue lion": 4, "red deer": 1}, "blue deer": {"red lion": 2}}
    both = [replace(each, mistaken=mistaken) for each in (one, ten)]
    figure = clues.bars(both)
    assert figure is not None
    [axes] = figure.axes
    widths = [bar.get_width() for bar in axes.patches if isinstance(bar, Rectangle)]
    assert [round(width * 5) for width in widths] == [4, 1, 2, 0]
    assert [[str(value) for value in row.values] for row in clues.table(both).rows] == [["4", "1", "2", "0", "500"]] * 2
    assert clues.bars([replace(each, mistaken=None) for each in both]) is None


def test_it_is_drawn_from_what_ships_and_not_from_nothing(
    shipped: list[Cell], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (style.FIGURES / "clues.md").read_text() == clues.table(shipped).markdown()
    nothing = tmp_path / "nothing.jsonl"
    nothing.write_text("")
    clues.main(["--results", str(nothing), "--out", str(tmp_path / "none")])
    assert f"not drawn; `{clues.COMMAND}` makes one" in capsys.readouterr().out
    assert not (tmp_path / "none").exists()
