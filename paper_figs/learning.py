"""Learning curves: goals reached in validation scenes at each checkpoint of a study.

    uv run equigrasp study --table 6 --checkpoints 8
    uv run python paper_figs/learning.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/learning.{png,pdf}`: a line
for each way of making a policy that was trained on the task, over all of its seeds, hollow without recombination and
filled with it; a row of panels for each number of demonstrations. The scenes are those by which a checkpoint is chosen;
none is a test's. (`evaluated.py` draws test scenes, from `equigrasp evaluate --record`.)
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Sequence
from dataclasses import replace

import recorded
import style
from cells import Cell, Way, total
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

from equigrasp.success import Rate

COMMAND = "equigrasp study --table 6 --checkpoints 8"
GAP = 5.5
"""Percent, between the names of two lines at the right."""


def lines(cells: Sequence[Cell], task: str) -> dict[Way, list[tuple[int, Rate]]]:
    """Way -> step and rate in validation scenes, pooled over its seeds; those with at least two checkpoints."""
    groups: dict[Way, dict[tuple[int, int], Cell]] = defaultdict(dict)
    for cell in cells:
        # validation is the training's, on seen phrasings, whatever its tests are
        if cell.way.trained_on == task and cell.checkpoints:
            trainings = groups[replace(cell.way, phrasings="seen")]
            trainings[cell.seeds] = max(trainings.setdefault(cell.seeds, cell), cell, key=_validated)
    found = {}
    for way in recorded.in_order(groups):
        trainings = groups[way]
        steps = sorted(set.intersection(*(set(cell.checkpoints) for cell in trainings.values())))
        if len(steps) > 1:
            rates = [[cell.checkpoints[step] for cell in trainings.values()] for step in steps]
            found[way] = [(step, total(several)) for step, several in zip(steps, rates, strict=True)]
    return found


def _validated(cell: Cell) -> tuple[int, list[tuple[int, int, int]]]:
    """How much: of tests on several tasks, which training counts must not depend on which stands first."""
    rates = [(step, rate.trials, rate.successes) for step, rate in sorted(cell.checkpoints.items())]
    return len(rates), rates


def curve(cells: Sequence[Cell], task: str = "pick-by-part") -> Figure | None:
    """The figure, with 95% Wilson intervals as bands; None where no training has two checkpoints."""
    found = lines(cells, task)
    if not found:
        return None
    rows = recorded.by_demos(found)
    drawn = {way: found[way] for ways in rows.values() for way in ways}
    recombined = sorted({way.recombination > 0 for way in drawn})
    figure = Figure(figsize=(4.5 * max(len(recombined), 1.4), 1.2 + 2.9 * len(rows)), layout="constrained")
    grid = figure.subplots(len(rows), len(recombined), sharex="col", sharey=True, squeeze=False)
    places = [(demos, with_recombination) for demos in rows for with_recombination in recombined]
    looks, names, usual = recorded.looks(drawn), recorded.named_by(drawn), recorded.usual_steps(drawn)
    checkpoints = {step for points in drawn.values() for step, _ in points}
    for (demos, with_recombination), axes in zip(places, grid.flat, strict=True):
        axes.set_title(
            f"{recorded.demonstrations(demos)}, {'with' if with_recombination else 'without'} recombination", fontsize=9
        )
        axes.set_ylim(-2, 102)
        ends = []
        for way in rows[demos]:
            if (way.recombination > 0) != with_recombination:
                continue
            look, points = looks[way], drawn[way]
            steps, values = [step for step, _ in points], [100 * rate.value for _, rate in points]
            ls = recorded.DASHES[recorded.dash(way, usual)]
            axes.plot(steps, values, ls=ls, lw=1.2, ms=5, color=look.color, marker=look.marker, mfc=look.filling)
            low, high = ([100 * rate.interval[end] for _, rate in points] for end in (0, 1))
            axes.fill_between(steps, low, high, color=look.color, alpha=0.1, lw=0)
            name = recorded.label(names[way], task, drawn, demos=False, steps=way.steps != usual)
            ends.append((steps[-1], values[-1], f"{values[-1]:.0f}  {name}", look.color))
        style.label_ends(axes, ends, GAP)
        # most is learned early, and some trainings are many times as long as others
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(doubled(checkpoints)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.25)
    for axes in grid[-1]:
        axes.set_xlabel("training steps (batch 1), logarithmic", fontsize=9)
    for axes in grid[:, 0]:
        axes.set_ylabel("goal reached (%)\none grasp, no retries", fontsize=9)
    said = f"{task}: validation scenes, 95% Wilson intervals, at the right the last; {usual:,} steps unless said"
    figure.suptitle("\n".join([said, *recorded.left_out(found)]), fontsize=10)
    if keys := recorded.dashes(drawn, usual):
        figure.legend(handles=keys, loc="outside lower center", ncols=2, handlelength=4, fontsize=8, frameon=False)
    return figure


def doubled(checkpoints: Collection[int]) -> list[int]:
    """Ticks: the first checkpoint, twice and four times as many steps, and so on up to the last."""
    first, last = min(checkpoints), max(checkpoints)
    return [first * 2**times for times in range((last // first).bit_length())]


if __name__ == "__main__":
    recorded.main("learning", curve, COMMAND)
