"""Which clue a policy missed: what it lifted where a colour and a thing were said, by what it has of both.

    uv run equigrasp study --table 2
    uv run python paper_figs/clues.py --results studies/table-2/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/clues.{png,pdf}`, with the
numbers in `clues.md`: for each of the suite's tasks whose goals are several things in several colours, a bar for each
way of making a policy whose mistakes were recorded, from the fewest demonstrations; `clues.md` has the others, too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Sequence

import recorded
import style
from cells import Cell, Way
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from tasks import TASKS
from tasks.task import Task

COMMAND = "equigrasp study --table 2"
COLOR, THING, BOTH, SEVERAL = "the thing, another colour", "the colour, another thing", "neither", "several things"
LOOKS = {COLOR: (style.BLUE, ""), THING: (style.YELLOW, "//"), BOTH: (style.GREY, ".."), SEVERAL: ("0.8", "xx")}
"""What was lifted instead -> colour and hatch."""
Missed = dict[Way, tuple[Counter[str], int]]
"""Way -> what was lifted instead, and of how many single shots."""


def is_told_by_both(task: Task) -> bool:
    """Whether its goals are several things in several colours."""
    colors, things = {goal.color for goal in task.goals}, {goal.object for goal in task.goals}
    return None not in colors and len(colors) > 1 and len(things) > 1


def missed(asked: str, taken: str) -> str:
    """Which clue was missed by what was lifted in place of what was asked for, both "colour thing"."""
    if " and " in taken:
        return SEVERAL
    color, _, thing = asked.partition(" ")
    other_color, _, other = taken.partition(" ")
    if thing == other:
        return COLOR
    return THING if color == other_color else BOTH


def counts(cells: Sequence[Cell], task: str) -> Missed:
    """For each way that was tested on the task and whose mistakes were recorded, in order."""
    found: dict[Way, Counter[str]] = {}
    trials: Counter[Way] = Counter()
    for cell in cells:
        if cell.task != task or cell.mistaken is None:
            continue
        kinds = found.setdefault(cell.way, Counter())
        for asked, others in cell.mistaken.items():
            for taken, count in others.items():
                kinds[missed(asked, taken)] += count
        trials[cell.way] += cell.shots["correct"].trials
    return {way: (found[way], trials[way]) for way in recorded.in_order(found)}


def every(cells: Sequence[Cell]) -> dict[str, Missed]:
    """The same for each of the suite's tasks that is told by both clues, of those that were tested."""
    found = {task: counts(cells, task) for task, row in TASKS.items() if is_told_by_both(row)}
    return {task: ways for task, ways in found.items() if ways}


def bars(cells: Sequence[Cell]) -> Figure | None:
    """The figure, a panel for each task; None where no mistakes were recorded."""
    tested = every(cells)
    if not tested:
        return None
    ways = {way for found in tested.values() for way in found}
    fewest = min(way.demos for way in ways)
    ways = recorded.in_order(way for way in ways if way.demos == fewest)
    figure = Figure(figsize=(3.4 + 1.9 * len(tested), 1.2 + 0.22 * len(ways)), layout="constrained")
    panels = figure.subplots(1, len(tested), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (task, found) in zip(panels, tested.items(), strict=True):
        _panel(axes, [found.get(way) for way in ways])
        axes.set_title(task, fontsize=9)
    panels[0].set_yticks(range(len(ways)), labels=labels(ways), fontsize=8)
    panels[0].set_ylim(len(ways) - 0.4, -0.6)
    figure.suptitle(
        f"lifted in place of what was asked for, from {recorded.demonstrations(fewest)}, unseen scenes", fontsize=10
    )
    panels[len(panels) // 2].set_xlabel(
        "single shots that lifted something else (% of all, at the right their sum)", fontsize=9
    )
    panels[0].set_xlim(0, 100)
    there = [kind for kind in LOOKS if any(kinds[kind] for found in tested.values() for kinds, _ in found.values())]
    handles = [Patch(facecolor=LOOKS[kind][0], hatch=LOOKS[kind][1], edgecolor="white", label=kind) for kind in there]
    if handles:
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), fontsize=9, frameon=False)
    return figure


def labels(ways: Collection[Way]) -> list[str]:
    """How each was made, in a line that no other has."""
    several = len({way.demos for way in ways}) > 1
    return [recorded.label(way, way.trained_on, ways, demos=several) for way in ways]


def _panel(axes: Axes, rows: Sequence[tuple[Counter[str], int] | None]) -> None:
    for place, row in enumerate(rows):
        if row is None:
            continue
        kinds, trials = row
        start = 0.0
        for kind, (color, hatch) in LOOKS.items():
            width = 100 * kinds[kind] / trials
            axes.barh(place, width, left=start, color=color, hatch=hatch, edgecolor="white", lw=0.4, height=0.75)
            start += width
        style.columns(axes, place, [f"{start:.1f}"])
    axes.grid(alpha=0.25, axis="x")
    axes.set_axisbelow(True)
    axes.tick_params(axis="x", labelsize=8)


def table(cells: Sequence[Cell]) -> Grid:
    """The same as numbers of single shots."""
    tested = every(cells)
    ways = {way for found in tested.values() for way in found}
    named = dict(zip(ways, labels(ways), strict=True))
    body = [
        Row((task, named[way]), tuple(Value(count, digits=0) for count in (*(kinds[kind] for kind in LOOKS), trials)))
        for task, found in tested.items()
        for way, (kinds, trials) in found.items()
    ]
    heads = ("tested on", "model")
    return Grid("what was lifted where a colour and a thing were said", heads, (*LOOKS, "single shots"), tuple(body))


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it from files of results; where none backs it, say what makes one, and draw nothing."""
    recorded.every_task("clues", bars, COMMAND, (table,), arguments)


if __name__ == "__main__":
    main()
