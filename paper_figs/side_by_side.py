"""Every model side by side: what the kernel buys, what recombination buys, and what both do.

    uv run equigrasp study --table 6 --recombination 0 0.7
    uv run python paper_figs/side_by_side.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/side-by-side.{png,pdf}`, and
`side-by-side.md` with the same numbers: a block for each number of demonstrations, a row for each model; on the left
single shots with 95% Wilson intervals, on the right the paper's protocol, beside what the paper reports. A number that
one model alone was given is left out: `efficiency.py` draws it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import paper
import recorded
import style
from cells import Cell, Way, mean_reward, pooled
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from style import FILLED, HOLLOW

from equigrasp.study.tables import TABLES

COMMAND = "equigrasp study --table 6 --recombination 0 0.7"
APART = 0.25
"""Of a row, between its two points: a policy with recombination is drawn above the one without."""
PAPERS = "\N{WHITE DIAMOND}"
"""What stands above the column of the paper's numbers."""
THEIRS: dict[str, Any] = {
    "marker": "D",
    "ms": 5,
    "mew": 1.3,
    "ls": "",
    "color": style.BLACK,
    "mfc": "none",
    "zorder": 5,
    # or it is lost among the points that it lies on
    "path_effects": [withStroke(linewidth=2.6, foreground="white")],
}
"""How the paper's own numbers are drawn."""

Rows = dict[Way, dict[Way, list[Cell]]]
"""Ways that differ in recombination alone, with their cells, under a way that has none; each under itself where the
task was learned with several shares."""


def rows(cells: Sequence[Cell], task: str) -> Rows:
    """What was tested on the task, in the order of `recorded.in_order`."""
    here = [
        cell
        for cell in cells
        if cell.task == task and cell.way.phrasings == "seen" and (cell.shots or cell.reward is not None)
    ]
    names = recorded.named_by({cell.way for cell in here})
    groups: dict[Way, dict[Way, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in here:
        groups[names[cell.way]][cell.way].append(cell)
    return {row: {way: groups[row][way] for way in recorded.in_order(groups[row])} for row in recorded.in_order(groups)}


def blocks(cells: Sequence[Cell], task: str) -> dict[int, Rows]:
    """The rows by their number of demonstrations, as `recorded.by_demos` has them."""
    found = rows(cells, task)
    return {demos: {row: found[row] for row in block} for demos, block in recorded.by_demos(found).items()}


def known(task: str) -> Mapping[tuple[str, int], float]:
    """(model, demonstrations) -> the paper's mean reward on the task, percent, where it is known."""
    return {
        key: by_task[task]
        for table in TABLES
        for key, by_task in paper.REWARDS.get(table, {}).items()
        if task in by_task
    }


def panels(cells: Sequence[Cell], task: str = "pick-by-part") -> Figure | None:
    """The figure; None where nothing was run."""
    drawn = blocks(cells, task)
    if not drawn:
        return None
    sizes = [len(block) for block in drawn.values()]
    figure = Figure(figsize=(9.0, 1.4 + 0.5 * len(drawn) + 0.32 * sum(sizes)), layout="constrained")
    axes = figure.subplots(len(drawn), 2, sharex=True, sharey="row", squeeze=False, height_ratios=sizes)
    ways = [way for block in drawn.values() for ways in block.values() for way in ways]
    looks, usual = recorded.looks(ways), recorded.usual_steps(ways)
    names = labels(drawn, task, usual)
    for (demos, block), pair in zip(drawn.items(), axes, strict=True):
        draw(block, looks, names, pair, known(task))
        pair[0].set_title(f"from {recorded.demonstrations(demos)}", loc="left", fontsize=10)
    for each, label in zip(
        axes[-1], ("goal reached (%)\none grasp, no retries", "mean reward (%)\nthe paper's protocol"), strict=True
    ):
        each.set_xlim(-3, 103)
        each.set_xlabel(label)
    title = f"{task}, {usual:,} steps unless said, unseen scenes, 95% Wilson intervals"
    figure.suptitle(f"{title}\n{HOLLOW} without recombination, {FILLED} with it", fontsize=10)
    if any((row.model, row.demos) in known(task) for block in drawn.values() for row in block):
        axes[0, 1].plot([], [], label=f"the paper's own ({paper.STEPS:,} steps, its own objects and cameras)", **THEIRS)
        figure.legend(loc="outside lower right", fontsize=9, frameon=False)
    return figure


def labels(drawn: Mapping[int, Rows], task: str, usual: int | None = None) -> dict[Way, str]:
    """What each row of the blocks is called: its demonstrations stand above its block, the usual steps in a title."""
    ways = [row for block in drawn.values() for row in block]
    return {row: recorded.label(row, task, ways, demos=False, steps=row.steps != usual) for row in ways}


def draw(
    block: Rows,
    looks: Mapping[Way, recorded.Look],
    names: Mapping[Way, str],
    pair: Sequence[Axes],
    figures: Mapping[tuple[str, int], float],
) -> None:
    """A block of rows: single shots on the left of the pair, mean rewards and the paper's on its right."""
    shots, rewards = pair
    for place, (row, ways) in enumerate(block.items()):
        reached, rewarded = ["", ""], ["", ""]
        for way, several in ways.items():
            look = looks[way]
            height = place - APART if way.recombination else place + APART
            style_of: dict[str, Any] = {"color": look.color, "marker": look.marker, "mfc": look.filling, "ls": ""}
            for axes, measured, texts in (
                (shots, pooled(several), reached),
                (rewards, mean_reward(several), rewarded),
            ):
                if measured is not None:
                    value = 100 * measured.value
                    axes.errorbar(value, height, xerr=recorded.bars([measured]), capsize=2, ms=5.5, lw=1, **style_of)
                    texts[way.recombination > 0] = f"{value:.1f}"
        theirs = figures.get((row.model, row.demos))
        if theirs is not None:
            rewards.plot(theirs, place, **THEIRS)
        style.columns(shots, place, reached)
        style.columns(rewards, place, [*rewarded, "" if theirs is None else f"{theirs:.1f}"])
    for axes, heads in ((shots, (HOLLOW, FILLED)), (rewards, (HOLLOW, FILLED, PAPERS))):
        style.columns(axes, -0.85, heads)
        axes.grid(alpha=0.25)
        for place in range(1, len(block)):
            axes.axhline(place - 0.5, color="0.9", lw=0.8, zorder=0)
    shots.set_yticks(range(len(block)), labels=[names[row] for row in block], fontsize=9)
    shots.set_ylim(len(block) - 0.5, -0.5)


def tables(cells: Sequence[Cell], task: str = "pick-by-part") -> list[Grid]:
    """The figure's numbers, a table a block: single shots and mean rewards with 95% Wilson intervals, percent."""
    drawn = blocks(cells, task)
    names = labels(drawn, task)
    return [table(block, names, demos, task) for demos, block in drawn.items()]


def table(block: Rows, names: Mapping[Way, str], demos: int, task: str) -> Grid:
    """A block's numbers."""
    body = []
    figures = known(task)
    for row, ways in block.items():
        shots: list[Value | None] = [None, None]
        rewards: list[Value | None] = [None, None]
        for way, several in ways.items():
            place = int(way.recombination > 0)
            rate, reward = pooled(several), mean_reward(several)
            if rate is not None:
                shots[place] = Value.of(rate)
            if reward is not None:
                rewards[place] = Value.of(reward)
        reported = figures.get((row.model, row.demos))
        body.append(Row((names[row],), (*shots, *rewards, None if reported is None else Value(reported))))
    columns = ("goal reached", "recombined: goal", "mean reward", "recombined: reward", "the paper: reward")
    title = f"{task} from {recorded.demonstrations(demos)}, %"
    return Grid(title, ("trained how",), columns, tuple(body), ("Blank: not run, or not in the paper.",))


if __name__ == "__main__":
    recorded.main("side-by-side", panels, COMMAND, tabulate=tables)
