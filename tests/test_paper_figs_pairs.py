"""Figures that hold policies against each other: pairs that differ in one thing, and trainings from several seeds."""

from __future__ import annotations

from dataclasses import replace

import contributions
import pytest
import seeds
import style
import tables
from cells import Cell, Way
from contributions import LEG, PARTS, Pair, Setup
from hypothesis import given
from hypothesis import strategies as st
from loading import load

from equigrasp.success import Rate

TASK = "pick-by-part"


def cell(
    successes: int, model: str = "leg-unet", steps: int = 100, seed: int = 0, task: str = TASK, **of_way: object
) -> Cell:
    """A result of 50 single shots."""
    way = Way(model, 1, steps, 0.0, "overhead", TASK)
    shots = {"correct": Rate(successes, 50)}
    return Cell(replace(way, **of_way), task, (seed, seed), shots, None, 0)


def of(name: str, cells: list[Cell]) -> dict[str, Pair]:
    """The pairs of a part, which is LEG's own."""
    found = contributions.pairs(cells)
    return next((by_task for part, by_task in found.items() if part.name == name and part.having == LEG), {})


def test_a_pair_differs_in_one_thing_that_its_part_names() -> None:
    for part in PARTS:
        one, other = vars(part.without), vars(part.having)
        assert len([name for name in one if one[name] != other[name]]) == 1, part.name


def test_both_of_a_pair_had_the_most_steps_that_both_had() -> None:
    cells = [cell(30), cell(40, steps=200), cell(50, steps=400), cell(10, "fcgq"), cell(20, "fcgq", steps=200)]
    assert of("a kernel", cells) == {TASK: Pair(200, Rate(20, 50), Rate(40, 50))}
    assert of("a kernel", [cell(30), cell(10, "fcgq", steps=200)]) == {}


def test_seeds_of_a_policy_are_pooled_in_a_pair() -> None:
    cells = [cell(30), cell(20, seed=1), cell(10, "fcgq")]
    assert of("a kernel", cells) == {TASK: Pair(100, Rate(10, 50), Rate(50, 100))}


@pytest.mark.parametrize(
    "other",
    [
        {"task": "pick-logo"},
        {"phrasings": "unseen"},
        {"camera": "fused"},
        {"text_encoder": "hashing"},
        {"apart": ("threads 2",)},
        {"demos": 10},
        {"recombination": 0.7},
        {"recombination": 0.7, "crowded": 0.4},
    ],
    ids=str,
)
def test_what_differs_in_more_is_in_no_pair(other: dict[str, object]) -> None:
    one = cell(10, "fcgq")
    assert of("a kernel", [one, cell(30)])
    assert not of("a kernel", [one, cell(30, **other)])  # ty: ignore[invalid-argument-type]


def test_policies_of_other_shares_are_pooled_no_more_than_they_are_a_pair() -> None:
    half, more, ten = cell(20, recombination=0.5), cell(30, recombination=0.7), cell(40, recombination=0.5, demos=10)
    found = contributions.pairs([cell(10), more, half, ten])
    assert {(part.name, part.among): by_task[TASK] for part, by_task in found.items()} == {
        ("recombination", "leg-unet"): Pair(100, Rate(10, 50), Rate(30, 50)),
        ("ten demonstrations for one", "leg-unet, recombined"): Pair(100, Rate(20, 50), Rate(40, 50)),
    }
    assert not contributions.pairs([more, ten])


def test_a_read_out_of_another_resolution_is_the_setup_that_says_so() -> None:
    assert contributions.setup(cell(1, read_out="full").way) == Setup(full=True)
    assert contributions.setup(cell(1, read_out="half").way) is None


def test_the_difference_stands_in_the_figure_and_the_table_has_both() -> None:
    cells = [cell(30), cell(40, "fcgq")]
    drawn = contributions.panels(cells)
    assert drawn is not None
    assert "\N{MINUS SIGN}20.0" in [text.get_text() for axes in drawn.axes for text in axes.texts]
    (row,) = contributions.table(cells).rows
    assert [str(value).split()[0] for value in row.values] == ["100", "80.0", "60.0"]
    assert contributions.panels([cell(30)]) is None


def test_a_way_of_one_seed_is_no_comparison_of_seeds() -> None:
    assert seeds.panel([cell(30), cell(30, "fcgq")]) is None
    both = [cell(30), cell(10, seed=3), cell(30, "fcgq"), cell(30, steps=200, seed=1)]
    ((way, rates),) = seeds.trainings(both)[TASK].items()
    assert (way.model, way.steps, rates) == ("leg-unet", 100, {0: Rate(30, 50), 3: Rate(10, 50)})
    drawn = seeds.panel(both)
    assert drawn is not None
    points = [100 * rate.value for rate in rates.values()]
    assert [line.get_xdata()[0] for line in drawn.axes[0].lines if line.get_marker() == "o"] == points  # ty: ignore[not-subscriptable]
    (row,) = seeds.table(both).rows
    assert [str(value).split()[0] for value in row.values] == ["60.0", "20.0", "40.0", "0.000"]


@given(successes=st.integers(0, 200), trials=st.integers(200, 400), seeds_=st.integers(2, 4))
def test_equal_shares_do_not_differ_and_far_ones_do(successes: int, trials: int, seeds_: int) -> None:
    assert seeds.differ([Rate(successes, trials)] * seeds_) == pytest.approx(1)
    assert seeds.differ([Rate(0, trials), *[Rate(trials, trials)] * (seeds_ - 1)]) < 1e-9


def test_what_ships_is_what_the_results_give() -> None:
    cells, _ = load(tables.recorded())
    assert (style.FIGURES / "contributions.md").read_text() == contributions.table(cells).markdown()
    every, _ = load([*tables.recorded(), *sorted(seeds.OTHERS.glob("*.jsonl"))])
    page = style.FIGURES / "seeds.md"
    assert page.exists() == bool(seeds.trainings(every))
    if page.exists():
        assert page.read_text() == seeds.table(every).markdown()
        rows = [line for line in page.read_text().splitlines() if line.startswith("|")]
        assert "\n".join(rows) in (style.HERE.parent / "docs" / "results.md").read_text()
