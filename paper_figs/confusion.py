"""What is taken for what: confusion matrices of the best policy of each task.

    uv run equigrasp study --table 1
    uv run python paper_figs/confusion.py --results studies/table-1/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/confusion.{png,pdf}`: for
each task whose goals are few, or are colours of few things, how often something else was lifted in place of what was
asked for; those of which nothing was are named alone. `confusion.md` has the pairs that were confused most often, of
every task. Which policy is the best is decided as in `by_task.py`, among those whose mistakes were recorded.
"""

from __future__ import annotations

import math
import textwrap
from collections import Counter
from collections.abc import Sequence

import by_task
import numpy as np
import recorded
from cells import Cell, Way
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
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
WRAP = 48
"""Letters of a panel's title in a line."""
DARKEST = 4
"""The darkest shade stands for this at least, so that a single mistake does not look like many; for the figure's most
otherwise, in all of its panels."""


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
    drawn = {
        task: (way, several, names(TASKS[task]))
        for task, (way, several) in best(cells).items()
        if len(set(names(TASKS[task]).values())) <= MOST
    }
    if not drawn:
        return None
    ways = [way for way, *_ in drawn.values()]
    mistaken = {task: found for task, found in drawn.items() if pairs(found[1])}
    title = ["what was lifted in place of what was asked for, unseen scenes; coloured things by their colour"]
    if never := [f"{task} ({_shots(several)})" for task, (_, several, _) in drawn.items() if task not in mistaken]:
        title += textwrap.wrap(f"no shot lifted another object (of so many): {', '.join(never)}", 2 * WRAP)
    columns = min(COLUMNS, max(len(mistaken), 1))
    rows = math.ceil(len(mistaken) / columns)
    figure = Figure(figsize=(4.4 * columns, 0.9 + 4.0 * rows), layout="constrained")
    figure.suptitle("\n".join(title), fontsize=10)
    if not mistaken:
        return figure
    places = figure.subplots(rows, columns, squeeze=False).flat
    drawn_counts = {task: matrix(pairs(several), called) for task, (_, several, called) in mistaken.items()}
    top = max(DARKEST, *(int(counts.max()) for _, counts in drawn_counts.values()))
    for (task, (way, several, _)), axes in zip(mistaken.items(), places, strict=False):
        _panel(axes, *drawn_counts[task], top)
        label = textwrap.fill(recorded.label(way, task, ways), WRAP)
        axes.set_title(f"{task}, of {_shots(several)} single shots\n{label}", fontsize=8)
    for empty in places:
        empty.remove()
    return figure


def _shots(cells: Sequence[Cell]) -> int:
    return sum(cell.shots["correct"].trials for cell in cells)


def _panel(axes: Axes, labels: list[str], counts: NDArray[np.int64], top: int) -> None:
    # by the root, or one mistake would be white beside many
    scale = PowerNorm(0.5, 0, top)
    axes.imshow(counts, cmap="Blues", norm=scale, aspect="auto")
    for row, column in np.argwhere(counts):
        dark = scale(counts[row, column]) > 0.6
        axes.text(
            column, row, counts[row, column], ha="center", va="center", fontsize=7, color="white" if dark else "black"
        )
    axes.set_xticks(range(len(labels)), labels=labels, rotation=90, fontsize=7)
    axes.set_yticks(range(len(counts)), labels=labels[: len(counts)], fontsize=7)
    axes.set_xlabel("lifted", fontsize=8)
    axes.set_ylabel("asked for", fontsize=8)


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
