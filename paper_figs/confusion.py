"""What is taken for what: confusion matrices of the best policy of each task.

    uv run equigrasp study --table 1
    uv run python paper_figs/confusion.py --results studies/table-1/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/confusion.{png,pdf}`: for
each task whose goals are few, or are colours of few things, how often something else was lifted in place of what was
asked for (things that have a colour by that: on the diagonal stands the right colour of another thing). A task in which
no pair was confused often is named alone. `confusion.md` has the pairs that were confused most often, of
every task. Which policy is the best is decided as in `by_task.py`, among those whose mistakes were recorded.
"""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Mapping, Sequence

import by_task
import numpy as np
import recorded
from cells import Cell, Way
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from tasks import TASKS
from tasks.objects import PAINTS
from tasks.task import Task

COMMAND = "equigrasp study --table 1"
MOST = 24
"""Goals, or colours: a matrix of more is not read."""
PAIRS = 5
"""How many of a task the table has."""
ANOTHER = "another"
"""What is none of the task's goals: several things at once, or one that is not asked for."""
COLUMNS = 2
WRAP = 56
"""Letters of a panel's title in a line."""
OFTEN = 4
"""A task is drawn where some pair was confused as often: a matrix of ones, twos and threes says little."""


def names(task: Task) -> dict[str, str]:
    """What each goal is called in the matrix, in order: where all have a colour, by that."""
    if all(goal.color for goal in task.goals):
        ordered = sorted(task.goals, key=lambda goal: list(PAINTS).index(str(goal.color)))
        return {str(goal): str(goal.color) for goal in ordered}
    return {str(goal): str(goal) for goal in task.goals}


def matrix(mistaken: Counter[tuple[str, str]], called: dict[str, str]) -> tuple[list[str], NDArray[np.int64]]:
    """The labels, and for each that was asked for (rows) how often each was taken (columns, perhaps `ANOTHER` last)."""
    labels = [*dict.fromkeys(called.values()), ANOTHER]
    counts = np.zeros((len(labels) - 1, len(labels)), dtype=np.int64)
    for (asked, taken), count in mistaken.items():
        first = taken.split(" ")[0]
        # things in colours that the task never asks for lie on the table too
        label = called.get(taken, first if first in labels and " and " not in taken else ANOTHER)
        counts[labels.index(called[asked]), labels.index(label)] += count
    if not counts[:, -1].any():
        return labels[:-1], counts[:, :-1]
    return labels, counts


def pairs(cells: Sequence[Cell]) -> Counter[tuple[str, str]]:
    """How often, over several cells, what (first) was mistaken for what (second)."""
    found: Counter[tuple[str, str]] = Counter()
    for cell in cells:
        for asked, others in (cell.mistaken or {}).items():
            found.update({(asked, taken): count for taken, count in others.items()})
    return found


def best(cells: Sequence[Cell]) -> dict[str, tuple[Way, list[Cell]]]:
    """`by_task.best_ways` among those of the suite's tasks whose mistakes were recorded."""
    return by_task.best_ways([cell for cell in cells if cell.mistaken is not None and cell.task in TASKS])


def panels(cells: Sequence[Cell]) -> Figure | None:
    """The figure; None where no mistakes were recorded."""
    read = {task: found for task, found in best(cells).items() if len(set(names(TASKS[task]).values())) <= MOST}
    if not read:
        return None
    mistaken = {task: pairs(several) for task, (_, several) in read.items()}
    counted = {task: matrix(found, names(TASKS[task])) for task, found in mistaken.items()}
    drawn = [task for task, (_, counts) in counted.items() if counts.max() >= OFTEN]
    few = {task: (mistaken[task].total(), _shots(read[task][1])) for task in read if task not in drawn}
    columns = min(COLUMNS, max(len(drawn), 1))
    rows = math.ceil(len(drawn) / columns)
    figure = Figure(figsize=(4.5 * COLUMNS, 1.0 + 4.0 * rows), layout="constrained")
    figure.suptitle("\n".join(["lifted in place of what was asked for, unseen scenes", *left(few)]), fontsize=9)
    if not drawn:
        return figure
    places = figure.subplots(rows, columns, squeeze=False).flat
    ways = [way for way, _ in read.values()]
    top = max(int(counted[task][1].max()) for task in drawn)
    for task, axes in zip(drawn, places, strict=False):
        _panel(axes, *counted[task], top)
        way, several = read[task]
        label = textwrap.fill(recorded.label(way, task, ways), WRAP, break_on_hyphens=False)
        title = f"{task}: {mistaken[task].total()} of {_shots(several)} single shots"
        axes.set_title(f"{title}\n{label}", fontsize=8)
    for empty in places:
        empty.remove()
    return figure


def left(few: Mapping[str, tuple[int, int]]) -> list[str]:
    """What the figure leaves out, in lines: in how many of how many shots something else was lifted."""
    if not few:
        return []
    said = f"left out, as no number is {OFTEN} or more: " + ", ".join(
        f"{task} ({count} of {shots})" for task, (count, shots) in few.items()
    )
    return textwrap.wrap(said, 2 * WRAP, break_on_hyphens=False)


def short(labels: Sequence[str]) -> tuple[str, list[str]]:
    """What all of them but `ANOTHER` have before their last hyphen, and each without it."""
    own = [label for label in labels if label != ANOTHER]
    heads = {label.rpartition("-")[0] for label in own}
    prefix = f"{heads.pop()}-" if heads != {""} and len(heads) == 1 else ""
    return prefix, [label.removeprefix(prefix) for label in labels]


def _shots(cells: Sequence[Cell]) -> int:
    return sum(cell.shots["correct"].trials for cell in cells)


def _panel(axes: Axes, labels: list[str], counts: NDArray[np.int64], top: int) -> None:
    # by the root, or one mistake would be white beside many
    scale = PowerNorm(0.5, 0, top)
    axes.imshow(np.ma.masked_equal(counts, 0), cmap="Blues", norm=scale, aspect="auto")
    for same in range(len(counts)):
        if not counts[same, same]:
            axes.add_patch(Rectangle((same - 0.5, same - 0.5), 1, 1, color="0.9", lw=0))
    for row, column in np.argwhere(counts):
        dark = scale(counts[row, column]) > 0.6
        axes.text(
            column, row, counts[row, column], ha="center", va="center", fontsize=8, color="white" if dark else "black"
        )
    prefix, ticks = short(labels)
    upright = max(map(len, ticks)) > 2
    axes.set_xticks(range(len(labels)), labels=ticks, rotation=90 if upright else 0, fontsize=8)
    axes.set_yticks(range(len(counts)), labels=ticks[: len(counts)], fontsize=8)
    axes.set_xticks(np.arange(len(labels) - 1) + 0.5, minor=True)
    axes.set_yticks(np.arange(len(counts) - 1) + 0.5, minor=True)
    axes.grid(which="minor", color="0.85", lw=0.6)
    axes.tick_params(which="minor", length=0)
    of = f" ({prefix}\N{HORIZONTAL ELLIPSIS})" if prefix else ""
    axes.set_xlabel(f"lifted{of}", fontsize=9)
    axes.set_ylabel(f"asked for{of}", fontsize=9)


def table(cells: Sequence[Cell]) -> Grid:
    """The pairs that were confused most often, in how many single shots of how many that failed."""
    body = []
    for task, (_, several) in best(cells).items():
        failed = sum(sum(cell.failures.values()) for cell in several)
        often = sorted(pairs(several).items(), key=lambda pair: (-pair[1], pair[0]))[:PAIRS]
        for (asked, taken), count in often:
            body.append(Row((task, asked, taken), (Value(count, digits=0), Value(failed, digits=0))))
    heads = ("tested on", "asked for", "lifted")
    return Grid("what is taken for what", heads, ("single shots", "of all that failed"), tuple(body))


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it from files of results; where none backs it, say what makes one, and draw nothing."""
    recorded.every_task("confusion", panels, COMMAND, (table,), arguments)


if __name__ == "__main__":
    main()
