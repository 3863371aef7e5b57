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
    # as high as its legend, of two lines an entry
    figure, axes = style.figure(9.0, max(4.2, 0.6 + 0.42 * len(drawn)))
    looks = recorded.looks(drawn)
    for way, points in drawn.items():
        look = looks[way]
        rates = [rate for _, rate in points]
        axes.errorbar(
            [demos for demos, _ in points],
            [100 * rate.value for rate in rates],
            yerr=recorded.bars(rates),
            color=look.color,
            ls=look.dash,
            marker=look.marker,
            mfc=look.filling,
            capsize=3,
            label=f"{way.model}, {way.steps:,} steps,\n"
            + ", ".join([*([] if way.recombination else ["no recombination"]), *recorded.apart(way, task, drawn)]),
        )
    counts = sorted({demos for points in drawn.values() for demos, _ in points})
    axes.set_xscale("log")
    axes.set_xticks(counts, labels=list(map(str, counts)))
    axes.minorticks_off()
    # from nothing to all, so that a small difference looks small
    axes.set_ylim(0, 102)
    axes.set_xlabel("demonstrations")
    axes.set_ylabel("goal reached (%)\none grasp, no retries")
    axes.set_title(f"{task}: unseen scenes, 95% Wilson intervals", fontsize=10)
    figure.legend(loc="outside right upper", fontsize=9, frameon=False)
    return figure


if __name__ == "__main__":
    recorded.main("sample-efficiency", curve, COMMAND)
