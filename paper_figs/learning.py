"""Learning curves: goals reached in validation scenes at each checkpoint of a study.

    uv run equigrasp study --table 6 --checkpoints 8
    uv run python paper_figs/learning.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/learning.{png,pdf}`: a line
for each way of making a policy that was trained on the task, over all of its seeds. The scenes are those by which a
checkpoint is chosen; none is a test's. (`evaluated.py` draws test scenes, from `equigrasp evaluate --record`.)
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import recorded
from cells import Cell, Way
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

from equigrasp.success import Rate

COMMAND = "equigrasp study --table 6 --checkpoints 8"


def dash(kind: int) -> Any:
    """The dash of the first, second, ... kind of training that a model had; colour and marker are the model's own."""
    # from the fourth on a dash and so many dots
    dots = max(kind - 2, 0)
    return ["-", "--", ":"][kind] if kind < 3 else (0, (5, 2) + (1, 2) * dots)


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
            found[way] = [
                (step, Rate(sum(each.successes for each in several), sum(each.trials for each in several)))
                for step, several in zip(steps, rates, strict=True)
            ]
    return found


def _validated(cell: Cell) -> tuple[int, list[tuple[int, int, int]]]:
    """How much: of tests on several tasks, which training counts must not depend on which stands first."""
    rates = [(step, rate.trials, rate.successes) for step, rate in sorted(cell.checkpoints.items())]
    return len(rates), rates


def curve(cells: Sequence[Cell], task: str = "pick-by-part") -> Figure | None:
    """The figure, with 95% Wilson intervals as bands; None where no training has two checkpoints."""
    drawn = lines(cells, task)
    if not drawn:
        return None
    recombined = sorted({way.recombination > 0 for way in drawn})
    fewest = min(way.demos for way in drawn)
    more = sorted({way.demos > fewest for way in drawn})
    figure = Figure(figsize=(9.0, 1.9 + 3.0 * len(more)), layout="constrained")
    grid = figure.subplots(len(more), len(recombined), sharex=True, sharey=True, squeeze=False)
    places = [(demos, with_recombination) for demos in more for with_recombination in recombined]
    several = dict(zip(places, grid.flat, strict=True))
    looks, names = recorded.looks(drawn), recorded.named_by(drawn)
    lengths: dict[tuple[str, int], set[int]] = defaultdict(set)
    for way in drawn:
        lengths[way.model, way.demos].add(way.steps)
    checkpoints = {step for points in drawn.values() for step, _ in points}
    doubled = [min(checkpoints) * 2**times for times in range((max(checkpoints) // min(checkpoints)).bit_length())]
    named: dict[str, Line2D] = {}
    kinds: dict[str, list[str]] = defaultdict(list)
    for way, points in drawn.items():
        look, axes = looks[way], several[way.demos > fewest, way.recombination > 0]
        steps = [step for step, _ in points]
        values = [100 * rate.value for _, rate in points]
        name = recorded.label(names[way], task, drawn, steps=len(lengths[way.model, way.demos]) > 1)
        if name not in kinds[way.model]:
            kinds[way.model].append(name)
        style = {"color": look.color, "marker": look.marker, "mfc": look.filling}
        (line,) = axes.plot(steps, values, ls=dash(kinds[way.model].index(name)), **style)
        named.setdefault(name, line)
        low, high = ([100 * rate.interval[end] for _, rate in points] for end in (0, 1))
        axes.fill_between(steps, low, high, color=look.color, alpha=0.12, lw=0)
    for (demos, with_recombination), axes in several.items():
        counts = sorted({way.demos for way in drawn if (way.demos > fewest) == demos})
        number = " to ".join(str(each) for each in dict.fromkeys((counts[0], counts[-1])))
        number += " demonstration" + ("s" if counts[-1] > 1 else "")
        axes.set_title(f"{number}, {'with' if with_recombination else 'without'} recombination", fontsize=10)
        axes.set_ylim(-2, 102)
        # most is learned early, and some trainings are many times as long as others
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(FixedLocator(doubled))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(alpha=0.25)
    for axes in grid[-1]:
        axes.set_xlabel("training steps (batch 1), logarithmic")
    for axes in grid[:, 0]:
        axes.set_ylabel("goal reached (%)\none grasp, no retries")
    figure.suptitle(f"{task}: validation scenes, 95% Wilson intervals", fontsize=10)
    figure.legend(
        named.values(),
        named,
        loc="outside lower center",
        ncols=min(len(named), 3),
        handlelength=4.5,
        fontsize=8,
        frameon=False,
    )
    return figure


if __name__ == "__main__":
    recorded.main("learning", curve, COMMAND)
