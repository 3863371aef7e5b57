"""Sample efficiency: single shots that reach the goal against the number of demonstrations.

    uv run equigrasp study --table 6 --demos 1 2 5 10
    uv run python paper_figs/efficiency.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws
`figures/sample-efficiency.{png,pdf}`: a line for each way of making a policy that was run with at least two numbers of
demonstrations.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import recorded
import style
from cells import Cell, Way, pooled
from matplotlib.figure import Figure

from equigrasp.success import Rate

COMMAND = "equigrasp study --table 6 --demos 1 2 5 10"
GAP = 4.2
"""Percent, between the names of two lines at the right."""


def lines(cells: Sequence[Cell], task: str) -> dict[Way, list[tuple[int, Rate]]]:
    """Way (its demonstrations set to 0) -> rates by number of demonstrations, where there are two of them."""
    groups: dict[Way, dict[int, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in cells:
        if cell.task == task and cell.shots and cell.way.phrasings == "seen":
            groups[replace(cell.way, demos=0)][cell.way.demos].append(cell)
    found: dict[Way, list[tuple[int, Rate]]] = {}
    for way in recorded.in_order(groups):
        by_demos = groups[way]
        points = [(demos, pooled(several)) for demos, several in sorted(by_demos.items())]
        if len(points) > 1:
            found[way] = [(demos, rate) for demos, rate in points if rate is not None]
    return found


def curve(cells: Sequence[Cell], task: str = "pick-by-part") -> Figure | None:
    """The figure, with 95% Wilson intervals as bars; None without a line."""
    drawn = lines(cells, task)
    if not drawn:
        return None
    recombined = sorted({way.recombination > 0 for way in drawn})
    figure = Figure(figsize=(4.5 * max(len(recombined), 1.4), 4.6), layout="constrained")
    looks, names, usual = recorded.looks(drawn), recorded.named_by(drawn), recorded.usual_steps(drawn)
    counts = sorted({demos for points in drawn.values() for demos, _ in points})
    sides = figure.subplots(1, len(recombined), sharey=True, squeeze=False)[0]
    for with_recombination, axes in zip(recombined, sides, strict=True):
        axes.set_title(f"{'with' if with_recombination else 'without'} recombination", fontsize=9)
        # from nothing to all, so that a small difference looks small
        axes.set_ylim(0, 102)
        ends = []
        for way, points in drawn.items():
            if (way.recombination > 0) != with_recombination:
                continue
            look, rates = looks[way], [rate for _, rate in points]
            demos, values = [each for each, _ in points], [100 * rate.value for rate in rates]
            axes.errorbar(
                demos,
                values,
                yerr=recorded.bars(rates),
                color=look.color,
                ls=recorded.DASHES[recorded.dash(way, usual)],
                marker=look.marker,
                mfc=look.filling,
                ms=5,
                lw=1.2,
                capsize=2,
            )
            name = recorded.label(names[way], task, drawn, demos=False, steps=way.steps != usual)
            ends.append((demos[-1], values[-1], f"{values[-1]:.1f}  {name}", look.color))
        style.label_ends(axes, ends, GAP)
        axes.set_xscale("log")
        axes.set_xticks(counts, labels=list(map(str, counts)))
        axes.minorticks_off()
        axes.tick_params(labelsize=8)
        axes.grid(alpha=0.25)
        axes.set_xlabel("demonstrations, logarithmic", fontsize=9)
    sides[0].set_ylabel("goal reached (%)\none grasp, no retries", fontsize=9)
    said = f"{task}: {usual:,} steps unless said, unseen scenes, 95% Wilson intervals"
    figure.suptitle(f"{said}\nat the right what the most demonstrations gave", fontsize=10)
    if keys := recorded.dashes(drawn, usual):
        figure.legend(handles=keys, loc="outside lower center", ncols=2, handlelength=4, fontsize=8, frameon=False)
    return figure


if __name__ == "__main__":
    recorded.main("sample-efficiency", curve, COMMAND)
