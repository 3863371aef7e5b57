"""Failures by kind: what single shots were instead of a success.

    uv run equigrasp study --table 6
    uv run python paper_figs/failures.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/failures.{png,pdf}`: a bar
for each way of making a policy that was tested on the task, in a block for each number of demonstrations.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence

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


VISIBLE = 0.5
"""Percent of a row's single shots, of which a bar is seen."""
HEADING = 1.5
"""Rows that a block's heading takes."""
Counted = Mapping[Way, tuple[Mapping[str, int], int]]
"""Way -> failures by kind, and of how many trials."""


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
    """The figure, a block for each number of demonstrations; None where nothing was run."""
    found = counts(cells, task)
    if not found:
        return None
    blocks = recorded.by_demos(found)
    drawn = {way: found[way] for ways in blocks.values() for way in ways}
    shown = [kind for kind in kinds(drawn) if any(share(drawn[way], kind) >= VISIBLE for way in drawn)]
    sizes = [len(ways) + HEADING for ways in blocks.values()]
    figure = Figure(figsize=(9.0, 1.3 + 0.2 * sum(sizes)), layout="constrained")
    several = figure.subplots(len(blocks), 1, sharex=True, squeeze=False, height_ratios=sizes)[:, 0]
    usual = recorded.usual_steps(drawn)
    for (demos, ways), axes in zip(blocks.items(), several, strict=True):
        for place, way in enumerate(ways):
            start = 0.0
            for kind in kinds(drawn):
                color, hatch = LOOKS.get(kind, OTHER)
                width = share(drawn[way], kind)
                axes.barh(place, width, left=start, color=color, hatch=hatch, edgecolor="white", lw=0.4, height=0.75)
                start += width
            style.columns(axes, place, [f"{start:.1f}"])
        labels = [recorded.label(way, task, drawn, demos=False, steps=way.steps != usual) for way in ways]
        axes.set_yticks(range(len(ways)), labels=labels, fontsize=8)
        axes.set_ylim(len(ways) - 0.4, -0.6)
        axes.set_xlim(0, 100)
        axes.set_title(f"from {recorded.demonstrations(demos)}", loc="left", fontsize=9)
        axes.grid(alpha=0.25, axis="x")
        axes.set_axisbelow(True)
    several[-1].set_xlabel("failed single shots (% of all, at the right their sum)", fontsize=9)
    trials = sorted({count for _, count in drawn.values()})
    each = " to ".join(f"{count:,}" for count in dict.fromkeys((trials[0], trials[-1])))
    said = [f"{task}: what a failed grasp was, unseen scenes, seen phrasings"]
    said.append(f"{usual:,} steps unless said, {each} single shots a row")
    if few := invisible(drawn, shown):
        said.append(f"too few to be seen: {', '.join(few)}")
    said += recorded.left_out(found)
    figure.suptitle("\n".join(said), fontsize=10)
    handles = [
        Patch(facecolor=LOOKS.get(kind, OTHER)[0], hatch=LOOKS.get(kind, OTHER)[1], edgecolor="white", label=kind)
        for kind in shown
    ]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, frameon=False)
    return figure


def kinds(drawn: Counted) -> list[str]:
    """The kinds of failure that occur, in their order; those that only somebody's own environment has stand last."""
    there = {kind for found, _ in drawn.values() for kind, count in found.items() if count}
    return [kind for kind in (*LOOKS, *sorted(there - set(LOOKS))) if kind in there]


def share(counted: tuple[Mapping[str, int], int], kind: str) -> float:
    """How many of its single shots failed in this way, percent."""
    found, trials = counted
    return 100 * found.get(kind, 0) / trials


def invisible(drawn: Counted, shown: Sequence[str]) -> list[str]:
    """Each kind that occurs and is not in the legend, with its number among all single shots."""
    trials = sum(count for _, count in drawn.values())
    return [
        f"{kind} ({sum(found.get(kind, 0) for found, _ in drawn.values())} of {trials:,})"
        for kind in kinds(drawn)
        if kind not in shown
    ]


if __name__ == "__main__":
    recorded.main("failures", bars, COMMAND)
