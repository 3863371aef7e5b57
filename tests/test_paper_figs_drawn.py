"""What figures show: numbers that are the results', what all share said once, and no two series that look alike."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import ablations
import by_task
import by_task_short
import efficiency
import learning
import pytest
import recorded
import side_by_side
import style
import symmetry
from cells import Cell
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from test_paper_figs_apart import line, loaded

from equigrasp.config import read_out_at
from equigrasp.models import MODELS

TASK = "pick-by-part"


VARIED: list[dict[str, Any]] = [
    {},
    {"steps": 40_000},
    {"recombination": 0.7},
    {"recombination": 0.7, "crowded": 0.4},
    {"recombination": 0.7, "model": replace(MODELS["leg-unet"], text_encoder="hashing")},
    *({"model": MODELS["vit"], "recombination": share} for share in (0.0, 0.7)),
]
"""Ways to make a policy, that lines tell apart."""


def varied(folder: Path, *demos: int) -> list[Cell]:
    return loaded(folder, *(line(400 + each, demos=each, **way) for way in VARIED for each in demos))


def texts(drawn: Figure | Axes | None) -> list[str]:
    """Everything that is written in it."""
    assert drawn is not None
    found: Sequence[Artist] = drawn.findobj(Text)
    return [text for each in found if isinstance(each, Text) and (text := each.get_text())]


def test_the_usual_steps_are_said_once_and_every_number_beside_its_row(tmp_path: Path) -> None:
    longer = line(300, steps=40_000, model=MODELS["vit"])
    cells = loaded(tmp_path, line(453), line(489, recombination=0.7), line(222, model=MODELS["vit"]), longer)
    figure = side_by_side.panels(cells, TASK)
    said = texts(figure)
    assert sum("10,000 steps" in each for each in said) == 1
    assert {"leg-unet", "vit", "vit, 40,000 steps"} <= set(said)
    # single shots and mean rewards, which are equal here
    assert [said.count(value) for value in ("90.6", "97.8", "44.4", "60.0")] == [2, 2, 2, 2]
    assert said.count(f"{side_by_side.known(TASK)['leg-unet', 1]:.1f}") == 1
    # the table has no such title, and says the steps of every row
    (grid,) = side_by_side.tables(cells, TASK)
    assert all("steps" in row.labels[0] for row in grid.rows)


def test_of_equally_usual_steps_the_greatest_are_the_usual_ones(tmp_path: Path) -> None:
    ways = [cell.way for cell in loaded(tmp_path, line(), line(steps=3000), line(steps=500, model=MODELS["vit"]))]
    assert recorded.usual_steps(ways) == 10_000
    assert recorded.usual_steps([*ways, replace(ways[0], steps=3000, model="other")]) == 3000


def compared(tmp_path: Path, *more: dict[str, Any]) -> list[Cell]:
    """Three models after 100 steps, two after 200, one after 300, and an ablation at every number."""
    names = ("leg-unet", "fcgq", "vit")
    counts = ((100, 3), (200, 2), (300, 1))
    found = [line(steps=steps, model=MODELS[name]) for steps, count in counts for name in names[:count]]
    ablations = [line(steps=steps, model=MODELS["leg-unet-no-steerability"]) for steps, _ in counts]
    return loaded(tmp_path, *found, *ablations, *more)


def test_in_short_most_models_are_compared_and_no_ablation(tmp_path: Path) -> None:
    ten = line(steps=100, demos=10), line(steps=100, demos=10, model=MODELS["vit"])
    ((place, row),) = by_task_short.chosen(compared(tmp_path, *ten)).items()
    assert (place.demos, place.steps) == (1, 100)
    assert {model for model, _ in row} == {"leg-unet", "fcgq", "vit"}
    # where as many are compared after more steps, there
    ((place, _),) = by_task_short.chosen(compared(tmp_path, line(steps=200, model=MODELS["vit"]))).items()
    assert place.steps == 200
    assert by_task_short.chosen(loaded(tmp_path, line())) == {}
    assert by_task_short.panel(loaded(tmp_path, line())) is None


def test_in_short_the_best_of_a_task_is_named_however_it_was_trained(tmp_path: Path) -> None:
    best = line(487, steps=300, recombination=0.7, hard_negatives=0.5, model=MODELS["leg-equivariant"])
    cells = compared(tmp_path, best)
    figure = by_task_short.panel(cells)
    said = texts(figure)
    ((way, _),) = by_task.best_ways(cells).values()
    assert way.model == "leg-equivariant"
    assert "97.4" in said
    assert any(each.replace("\n", " ") == "leg-equivariant, hard negatives, 300 steps" for each in said)
    assert figure is not None
    (axes,) = figure.axes
    stars = [each for each in axes.lines if each.get_marker() == "*"]
    assert [star.get_xdata()[0] for star in stars] == [pytest.approx(97.4)]  # ty: ignore[not-subscriptable]


def test_ablations_stand_in_the_table_of_all_tasks_and_not_in_its_figure(tmp_path: Path) -> None:
    cells = compared(tmp_path)
    ablation = "leg-unet-no-steerability"
    assert ablation in by_task.table(cells).columns
    assert ablation not in texts(by_task.panels(cells))
    # unless there is nothing else
    assert ablation in texts(by_task.panels([cell for cell in cells if cell.way.model == ablation]))


@pytest.mark.parametrize("draw", [learning.curve, efficiency.curve])
def test_no_two_lines_of_a_panel_look_alike_and_each_is_named_at_its_end(draw: Any, tmp_path: Path) -> None:
    cells = varied(tmp_path, 1, 10)
    figure = draw(cells, TASK)
    count = 0
    for axes in figure.axes:
        # not the caps of error bars
        curves = [each for each in axes.lines if each.get_linestyle() != "None"]
        looks = [
            (each.get_color(), each.get_linestyle(), each.get_marker(), each.get_markerfacecolor()) for each in curves
        ]
        assert len(set(looks)) == len(looks) == len(axes.texts)
        assert {filling == "white" for *_, filling in looks} == {"without" in axes.get_title()}
        # a name has the number that its line ends with
        ends = sorted(round(each.get_ydata()[-1], 1) for each in curves)
        assert sorted(float(each.get_text().split()[0]) for each in axes.texts) == ends
        count += len(looks)
    assert count == len(VARIED) * (2 if draw is learning.curve else 1)
    # a dash means one thing, whatever the model
    (legend,) = figure.legends
    said = {handle.get_label(): handle.get_linestyle() for handle in legend.get_lines()}
    assert said == {kind: recorded.DASHES[kind] for kind in said}
    assert len(said) == 4


def test_a_learning_curve_of_one_model_alone_is_named_where_it_is_left_out(tmp_path: Path) -> None:
    alone = [line(demos=5)]
    figure = learning.curve(loaded(tmp_path, *alone, line(), line(model=MODELS["vit"])), TASK)
    assert figure is not None
    assert len(figure.axes) == 1
    assert "so many demonstrations: 5" in figure.get_suptitle()
    only = learning.curve(loaded(tmp_path, *alone), TASK)
    assert only is not None
    assert "left out" not in only.get_suptitle()
    assert "5 demonstrations" in only.axes[0].get_title()


@given(st.lists(st.floats(0, 100), min_size=1, max_size=12).map(sorted), st.floats(0.1, 8))
def test_names_are_apart_in_order_and_within_the_bounds(heights: list[float], gap: float) -> None:
    places = style.spread(heights, gap, 0, 100)
    assert len(places) == len(heights)
    assert all(after - before >= gap - 1e-9 for before, after in itertools.pairwise(places))
    assert -1e-9 <= places[0] <= places[-1] <= 100 + 1e-9
    # what is apart already stays
    if all(after - before >= gap for before, after in itertools.pairwise(heights)):
        assert places == pytest.approx(heights)


def test_ablations_are_compared_on_the_task_that_was_trained_on(tmp_path: Path) -> None:
    names = ("leg-unet", "leg-unet-no-steerability", "leg-unet-no-phi-language")
    found = [line(400 + 10 * number, model=MODELS[name]) for number, name in enumerate(names)]
    # a longer training of the full model alone, another test, a model that is no ablation
    others = [
        line(500, steps=20_000),
        *(line(7, steps=20_000, tested_on="pick-logo", model=MODELS[name]) for name in names),
        line(8, model=MODELS["vit"]),
        line(430, recombination=0.7, hard_negatives=0.5),
    ]
    ten = line(470, demos=10, recombination=0.7, model=MODELS[names[1]])
    cells = loaded(tmp_path, *found, *others, ten)
    chosen = ablations.chosen(cells)
    assert {key: place.steps for key, (place, _) in chosen.items()} == {(TASK, 1): 10_000, (TASK, 10): 10_000}
    assert {model: rate.successes for (model, _), rate in chosen[TASK, 1][1].items()} == dict(
        zip(names, (400, 410, 420), strict=True)
    )
    rows = [[value and value.value for value in row.values] for row in ablations.table(cells).rows]
    assert rows == [[80.0, None], [82.0, None], [84.0, None], [None, 94.0]]
    figure = ablations.panels(cells)
    assert figure is not None
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["from 1 demonstration", "from 10 demonstrations"]
    assert {"80.0", "82.0", "84.0", "94.0"} <= set(texts(figure))
    # the full model alone is no ablation
    assert ablations.panels(loaded(tmp_path, line())) is None


def test_in_short_a_table_has_one_training_of_each_number_of_demonstrations(tmp_path: Path) -> None:
    finer = line(450, steps=100, model=read_out_at(MODELS["leg-unet"], "full"))
    ten = [line(410, steps=50, demos=10, model=MODELS[name], tested_on=TASK) for name in ("leg-unet", "fcgq")]
    grids = by_task_short.tables(compared(tmp_path, finer, *ten, line(steps=200, model=MODELS["vit"])), TASK)
    assert [grid.title.partition(":")[0] for grid in grids] == [
        f"{TASK}, 1 demo, 200 steps",
        f"{TASK}, 10 demos, 50 steps",
    ]
    assert [[row.labels[0] for row in grid.rows] for grid in grids] == [
        ["leg-unet", "fcgq", "vit"],
        ["leg-unet", "fcgq"],
    ]
    assert by_task_short.tables([], TASK) == []


def test_what_has_no_kernel_is_named_where_it_has_no_point(tmp_path: Path) -> None:
    none = line(model=MODELS["vit"])
    none["equivariance"] = {**none["equivariance"], "kernel": None}
    both, kernel = symmetry.panels(loaded(tmp_path, none, line())), symmetry.panels(loaded(tmp_path, line()))
    assert [sum("without a kernel" in each for each in texts(drawn)) for drawn in (both, kernel)] == [1, 0]
    (said,) = (each for each in texts(both) if "without a kernel" in each)
    assert said.endswith("\nvit")
