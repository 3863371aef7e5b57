"""How far trainings from other seeds differ: demonstrations, training and test scenes drawn anew, the rest the same.

    uv run equigrasp study --models leg-unet fcgq --tasks pick-by-part --demos 1 --seeds 0 1 --recombination 0 0.7
    uv run python paper_figs/seeds.py --results studies/own/results.jsonl

reads files of results, by default all that lie in `paper_figs/results` and in `results/other-seeds`, and draws
`figures/seeds.{png,pdf}`, and `seeds.md` with the same numbers: a row for each way of making a policy that was run with
at least two seeds, and a point for each. A Wilson interval knows of the scenes alone; how far points of a row lie apart
says what a training's own luck adds.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

import recorded
import style
from by_task import place_among
from cells import Cell, Way, pooled, total
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.stats import chi2_contingency

from equigrasp.success import Rate

COMMAND = "equigrasp study --models leg-unet fcgq --tasks pick-by-part --demos 1 --seeds 0 1"
OTHERS = style.RESULTS / "other-seeds"
SPREAD = 0.6
"""Of a row, how much its seeds take, one below the other."""

Trainings = dict[str, dict[Way, dict[int, Rate]]]
"""Task tested on -> way -> training seed -> single shots."""


def trainings(cells: Sequence[Cell]) -> Trainings:
    """Single shots in demonstrated phrasings by seed, of the ways that have several; tasks as the tables have them."""
    groups: dict[str, dict[Way, dict[int, list[Cell]]]] = defaultdict(lambda: defaultdict(lambda: defaultdict(list)))
    for cell in cells:
        if cell.shots and cell.way.phrasings == "seen":
            groups[cell.task][cell.way][cell.seeds[1]].append(cell)
    found: Trainings = {}
    for task in sorted(groups, key=place_among):
        for way in recorded.in_order(groups[task]):
            by_seed = {seed: pooled(several) for seed, several in sorted(groups[task][way].items())}
            rates = {seed: rate for seed, rate in by_seed.items() if rate is not None}
            if len(rates) > 1:
                found.setdefault(task, {})[way] = rates
    return found


def labels(found: Trainings) -> dict[tuple[str, Way], str]:
    """What each row is called."""
    return {(task, way): recorded.label(way, task, ways) for task, ways in found.items() for way in ways}


def panel(cells: Sequence[Cell]) -> Figure | None:
    """The figure, with 95% Wilson intervals; None where no way has two seeds."""
    found = trainings(cells)
    if not found:
        return None
    names = labels(found)
    looks = recorded.looks(way for ways in found.values() for way in ways)
    figure, axes = style.figure(9.0, 1.2 + 0.34 * (len(found) + len(names)))
    axes.grid(visible=False, axis="y")
    places: dict[tuple[str, Way], float] = {}
    height = 0.0
    for task, ways in found.items():
        axes.text(-2, height, f" tested on {task}", fontsize=8.5, weight="bold", va="center")
        for way, rates in ways.items():
            height += 1.0
            places[task, way] = height
            axes.axhline(height, color="0.95", lw=14, zorder=0)
            draw(axes, height, rates, looks[way])
        height += 1.0
    axes.set_yticks(list(places.values()), labels=[names[key] for key in places], fontsize=9)
    axes.set_ylim(height - 0.4, -0.6)
    axes.set_xlim(-3, 103)
    axes.set_xlabel("goal reached (%), one grasp, no retries")
    figure.suptitle(
        f"a point for each seed, the lowest uppermost; {recorded.RECOMBINATION}; bars: 95% Wilson intervals",
        fontsize=10,
    )
    return figure


def draw(axes: Axes, height: float, rates: Mapping[int, Rate], look: recorded.Look) -> None:
    """The points of a row, the lowest seed uppermost."""
    for index, rate in enumerate(rates.values()):
        axes.errorbar(
            100 * rate.value,
            height + SPREAD * ((index + 0.5) / len(rates) - 0.5),
            xerr=recorded.bars([rate]),
            color=look.color,
            marker=look.marker,
            mfc=look.filling,
            ms=5,
            lw=1,
            ls="",
        )


def table(cells: Sequence[Cell]) -> Grid:
    """The figure's numbers, percent: each seed, all of them pooled, and what says whether the seeds differ."""
    found = trainings(cells)
    names = labels(found)
    seeds = sorted({seed for ways in found.values() for rates in ways.values() for seed in rates})
    body = []
    for task, ways in found.items():
        for way, rates in ways.items():
            by_seed = [None if seed not in rates else Value.of(rates[seed]) for seed in seeds]
            chance = Value(differ(list(rates.values())), digits=3)
            body.append(Row((task, names[task, way]), (*by_seed, Value.of(total(rates.values())), chance)))
    columns = (*(f"seed {seed}" for seed in seeds), "all pooled", "p")
    notes = (
        "p: how often shares as far apart or further come of equally good policies (chi-squared test, no correction); "
        "a small one says that the seed made a difference beyond its scenes.",
        "Blank: not run.",
    )
    return Grid("single shots by seed, %", ("tested on", "trained how"), columns, tuple(body), notes)


def differ(rates: Sequence[Rate]) -> float:
    """The chi-squared test's p that these are draws of one share; 1 where all succeed, or none does."""
    counts = [[rate.successes for rate in rates], [rate.trials - rate.successes for rate in rates]]
    if not all(map(any, counts)):
        return 1.0
    return float(chi2_contingency(counts, correction=False).pvalue)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it from files of results; where none backs it, say what makes one, and draw nothing."""
    shipped = [path for folder in (style.RESULTS, OTHERS) for path in sorted(folder.glob("*.jsonl"))]
    recorded.every_task("seeds", panel, COMMAND, (table,), arguments, shipped)


if __name__ == "__main__":
    main()
