"""Failures by kind: what single shots were instead of a success.

    uv run equigrasp study --table 6
    uv run python paper_figs/failures.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/failures.{png,pdf}`: a bar
for each way of making a policy that was tested on the task.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import recorded
import style
from cells import FAILURES, UNSPLIT, Cell, Way
from matplotlib.figure import Figure
from matplotlib.patches import Patch

COMMAND = "equigrasp study --table 6"
LOOKS = dict(
    zip(
        (*FAILURES, UNSPLIT),
        ((style.SKY, ""), (style.ORANGE, "//"), (style.PINK, ".."), (style.GREEN, "\\\\"), (style.YELLOW, "xx")),
        strict=True,
    )
)
"""Kind -> colour and hatch."""
OTHER = ("0.7", "--")
"""Of a kind that only somebody's own environment has."""


def counts(cells: Sequence[Cell], task: str) -> dict[Way, tuple[dict[str, int], int]]:
    """For each way that was tested on the task with seen phrasings: failures by kind, and of how many trials."""
    found: dict[Way, dict[str, int]] = defaultdict(lambda: defaultdict(int))
    trials: dict[Way, int] = defaultdict(int)
    for cell in cells:
        if cell.task == task and cell.shots and cell.way.phrasings == "seen":
            trials[cell.way] += cell.shots["correct"].trials
            for kind, count in cell.failures.items():
                found[cell.way][kind] += count
    return {way: (dict(found[way]), trials[way]) for way in recorded.in_order(trials)}


def bars(cells: Sequence[Cell], task: str = "pick-by-part") -> Figure | None:
    """The figure; None where nothing was run."""
    drawn = counts(cells, task)
    if not drawn:
        return None
    kinds = [*LOOKS, *sorted({kind for found, _ in drawn.values() for kind in found} - set(LOOKS))]
    kinds = [kind for kind in kinds if any(found.get(kind) for found, _ in drawn.values())]
    figure, axes = style.figure(9.0, 1.6 + 0.28 * len(drawn))
    longest = 0.0
    for place, (found, trials) in enumerate(drawn.values()):
        start = 0.0
        for kind in kinds:
            share = 100 * found.get(kind, 0) / trials
            color, hatch = LOOKS.get(kind, OTHER)
            axes.barh(place, share, left=start, color=color, hatch=hatch, edgecolor="white", lw=0.5, height=0.7)
            start += share
        axes.text(start, place, f"  {sum(found.values())} of {trials}", va="center", fontsize=9)
        longest = max(longest, start)
    axes.set_yticks(range(len(drawn)), labels=[recorded.label(way, task, drawn) for way in drawn], fontsize=9)
    axes.set_ylim(len(drawn) - 0.4, -0.6)
    axes.set_xlim(0, max(1.25 * longest, 1.0))
    axes.set_xlabel("failed single shots (% of all)")
    figure.suptitle(f"{task}: what a failed grasp was, unseen scenes, seen phrasings", fontsize=10)
    axes.grid(visible=False, axis="y")
    axes.set_axisbelow(True)
    keys = [(kind, *LOOKS.get(kind, OTHER)) for kind in kinds]
    handles = [Patch(facecolor=color, hatch=hatch, edgecolor="white", label=kind) for kind, color, hatch in keys]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, frameon=False)
    return figure


if __name__ == "__main__":
    recorded.main("failures", bars, COMMAND)
