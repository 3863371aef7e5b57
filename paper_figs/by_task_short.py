"""Task by task, in short: what one demonstration gives on every task, by model, and the best of each.

    uv run equigrasp study --models leg-unet fcgq vit --tasks pick-random-v1 pick-random-v2 pick-by-part
    uv run python paper_figs/by_task_short.py --results studies/own/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/by-task-short.{png,pdf}`:
single shots with 95% Wilson intervals, a row for each task under what was trained on, hollow without recombination and
filled with it; of the fewest demonstrations, and of the steps after which most models were compared. A star is the best
of a task, however it was trained (`by_task.best_ways`); how stands beside it. `by_task.py` draws all of it.
"""

from __future__ import annotations

import textwrap
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence

import by_task
import recorded
from by_task import WITH, WITHOUT, Place, Rates
from cells import Cell, Way, pooled
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

ROW = 0.42
"""How high a row is, in inches: two lines of text."""
WRAP = 38
"""Letters of such a line."""


def longest(found: Mapping[Place, Rates]) -> dict[str, dict[int, Place]]:
    """Training task -> demonstrations -> a place of the training that stands for them.

    It is of the steps that most models share, of several such the most: a longer one may be of two models alone.
    """
    best: dict[str, dict[int, Place]] = defaultdict(dict)
    for place, row in found.items():
        other = best[place.trained_on].setdefault(place.demos, place)
        if _preferred(place, row) > _preferred(other, found[other]):
            best[place.trained_on][place.demos] = place
    return best


def _preferred(place: Place, row: Rates) -> tuple[int, int]:
    return len({model.partition(", ")[0] for model, _ in row}), place.steps


def chosen(cells: Sequence[Cell]) -> dict[Place, Rates]:
    """The figure's rows: of each training task those of the fewest demonstrations, without and with recombination."""
    found = {
        place: {key: rate for key, rate in row.items() if key[1] in (WITHOUT, WITH)}
        for place, row in by_task.rates(cells).items()
    }
    several = by_task.compared(found)
    trainings = {by_demos[min(by_demos)].training for by_demos in longest(several).values()}
    return {place: row for place, row in several.items() if place.training in trainings}


def tables(cells: Sequence[Cell], trained_on: str) -> list[Grid]:
    """What was trained on a task, a table for each number of demonstrations: single shots, percent, a column a test.

    As in the figure, but also with hard negatives and in crowded scenes; what other steps gave is in `by-task.md`.
    """
    several = by_task.compared(by_task.rates(cells))
    grids = []
    for place in longest(several).get(trained_on, {}).values():
        tests = {each.tested_on: row for each, row in several.items() if each.training == place.training}
        there = {key for row in tests.values() for key in row}
        keys = [(model, kind) for model in recorded.models(model for model, _ in there) for kind in by_task.KINDS]
        rates = {key: [row.get(key) for row in tests.values()] for key in keys if key in there}
        body = [
            Row(key, tuple(None if each is None else Value.of(each) for each in several), rivals=trained_on)
            for key, several in rates.items()
        ]
        notes = ("Bold: the highest; where intervals overlap, that may be chance. Blank: not run.",)
        grids.append(Grid(f"{place.training}: single shots, %", ("model", "trained"), tuple(tests), tuple(body), notes))
    return grids


def panel(cells: Sequence[Cell]) -> Figure | None:
    """The figure; None where no two models were compared."""
    drawn = chosen(cells)
    if not drawn:
        return None
    models = recorded.models(model for row in drawn.values() for model, _ in row)
    heights, headings, height = by_task.spread(drawn, heading=0.7)
    figure = Figure(figsize=(9.0, 1.4 + ROW * height), layout="constrained")
    axes = figure.subplots()
    for place, row in drawn.items():
        axes.axhspan(heights[place] - 0.44, heights[place] + 0.44, color="0.95", lw=0, zorder=0)
        by_task.dots(axes, heights[place], row, models)
    for training in {place.trained_on: place for place in drawn}:
        stars(axes, [cell for cell in cells if cell.way.trained_on == training], heights, models)
    shared = same(drawn)
    for place in {place.training: place for place in drawn}.values():
        said = place.trained_on if shared else place.training
        axes.text(-3, headings[place.training] + 0.1, f" trained on {said}", fontsize=9, weight="bold", va="center")
    axes.set_yticks(list(heights.values()), labels=[place.tested_on for place in heights], fontsize=9)
    axes.set_ylim(height - 0.4, -0.5)
    axes.set_xlim(-3, 103)
    axes.set_xlabel("goal reached (%), one grasp, no retries")
    axes.grid(alpha=0.25, axis="x")
    best = Line2D([], [], color="0.5", marker="*", mec="black", ms=12, ls="", label="best of the task, as at the right")
    handles = [*by_task.keys(models), best]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    figure.suptitle(
        f"{shared + ', ' if shared else ''}unseen scenes, 95% Wilson intervals; {recorded.RECOMBINATION}", fontsize=10
    )
    return figure


def same(places: Iterable[Place]) -> str:
    """Demonstrations, steps and camera in words where all have the same; nothing where not."""
    said = {place.training.removeprefix(f"{place.trained_on}, ") for place in places}
    return said.pop() if len(said) == 1 else ""


def stars(axes: Axes, cells: Sequence[Cell], heights: dict[Place, float], models: Sequence[str]) -> None:
    """The best of each task, a star at its row, and at the right its value and how it was trained."""
    dress = recorded.series(recorded.models([*models, *(cell.way.model for cell in cells)]))
    found = by_task.best_ways(cells)
    for place, height in heights.items():
        if place.tested_on not in found or {cell.way.trained_on for cell in cells} != {place.trained_on}:
            continue
        way, several = found[place.tested_on]
        rate = pooled(several)
        assert rate is not None
        color = dress[way.model][0]
        place_of = models.index(way.model) if way.model in models else len(models) - 1
        axes.plot(
            100 * rate.value,
            height + by_task.offset(place_of, len(models)),
            marker="*",
            ms=12,
            color=color if way.recombination else "white",
            mec="black",
            mew=0.8,
            zorder=5,
            clip_on=False,
        )
        right = axes.get_yaxis_transform()
        axes.text(1.015, height, f"{100 * rate.value:.1f}", weight="bold", fontsize=10, va="center", transform=right)
        axes.text(
            1.1,
            height,
            textwrap.fill(how(way, place), WRAP, break_on_hyphens=False),
            fontsize=8,
            va="center",
            transform=right,
        )


def how(way: Way, place: Place) -> str:
    """The model, and what else sets it apart from the row's."""
    steps = [] if way.steps == place.steps else [f"{way.steps:,} steps"]
    demos = [] if way.demos == place.demos else [f"{way.demos} demos"]
    return ", ".join([way.model, *way.recombined, *demos, *steps, *way.unusual])


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it from files of results; where none backs it, say what makes one, and draw nothing."""
    recorded.every_task("by-task-short", panel, by_task.COMMAND, (), arguments)


if __name__ == "__main__":
    main()
