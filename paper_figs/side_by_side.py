"""Every model side by side: what the kernel buys, what recombination buys, and what both do.

    uv run equigrasp study --table 6 --recombination 0 0.7
    uv run python paper_figs/side_by_side.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/side-by-side.{png,pdf}`, and
`side-by-side.md` with the same numbers: a row for each model, number of demonstrations and of steps; on the left single
shots with 95% Wilson intervals, on the right the paper's protocol, beside what the paper reports.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import paper
import recorded
import style
from cells import Cell, Way, mean_reward, pooled
from grid import Grid, Row, Value
from matplotlib.figure import Figure

from equigrasp.study.tables import TABLES

COMMAND = "equigrasp study --table 6 --recombination 0 0.7"
APART = 0.16
"""Of a row, between its two points: a policy with recombination is drawn above the one without."""


def rows(cells: Sequence[Cell], task: str) -> dict[Way, dict[Way, list[Cell]]]:
    """Ways that differ in recombination alone, with their cells on the task, under a way that has none."""
    groups: dict[Way, dict[Way, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in cells:
        if cell.task == task and cell.way.phrasings == "seen" and (cell.shots or cell.reward is not None):
            groups[replace(cell.way, recombination=0.0)][cell.way].append(cell)
    return {row: {way: groups[row][way] for way in recorded.in_order(groups[row])} for row in recorded.in_order(groups)}


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
    drawn = rows(cells, task)
    if not drawn:
        return None
    figure = Figure(figsize=(9.0, 1.8 + 0.4 * len(drawn)), layout="constrained")
    shots, rewards = figure.subplots(1, 2, sharey=True)
    looks = recorded.looks(way for ways in drawn.values() for way in ways)
    figures = known(task)
    for place, (row, ways) in enumerate(drawn.items()):
        for way, several in ways.items():
            look = looks[way]
            height = place - APART if way.recombination else place + APART
            style_of = {"color": look.color, "marker": look.marker, "mfc": look.filling, "ls": ""}
            rate = pooled(several)
            if rate is not None:
                shots.errorbar(100 * rate.value, height, xerr=recorded.bars([rate]), capsize=3, **style_of)
            reward = mean_reward(several)
            if reward is not None:
                rewards.plot(100 * reward[0], height, **style_of)
        if (row.model, row.demos) in figures:
            rewards.plot(figures[row.model, row.demos], place, marker="|", ms=14, mew=2, ls="", color=style.GREY)
    for axes, label in (
        (shots, "goal reached (%)\none grasp, no retries"),
        (rewards, "mean reward (%)\nthe paper's protocol"),
    ):
        axes.set_xlim(-3, 103)
        axes.set_xlabel(label)
        axes.grid(alpha=0.25)
        for place in range(1, len(drawn)):
            axes.axhline(place - 0.5, color="0.9", lw=0.8, zorder=0)
    shots.set_yticks(range(len(drawn)), labels=[recorded.label(row) for row in drawn], fontsize=9)
    shots.set_ylim(len(drawn) - 0.5, -0.5)
    figure.suptitle(f"{task}, unseen scenes; {recorded.RECOMBINATION}; bars: 95% Wilson intervals", fontsize=10)
    if any((row.model, row.demos) in figures for row in drawn):
        rewards.plot([], [], marker="|", ms=14, mew=2, ls="", color=style.GREY, label="the paper's own (40,000 steps)")
        figure.legend(loc="outside lower right", fontsize=9, frameon=False)
    return figure


def table(cells: Sequence[Cell], task: str = "pick-by-part") -> Grid:
    """The figure's numbers: single shots with 95% Wilson intervals and mean rewards, percent."""
    body = []
    figures = known(task)
    for row, ways in rows(cells, task).items():
        shots: list[Value | None] = [None, None]
        rewards: list[Value | None] = [None, None]
        for way, several in ways.items():
            place = int(way.recombination > 0)
            rate, reward = pooled(several), mean_reward(several)
            if rate is not None:
                shots[place] = Value.of(rate)
            if reward is not None:
                rewards[place] = Value(100 * reward[0], trials=reward[1])
        reported = figures.get((row.model, row.demos))
        body.append(Row((recorded.label(row),), (*shots, *rewards, None if reported is None else Value(reported))))
    columns = ("goal reached", "recombined: goal", "mean reward", "recombined: reward", "the paper: reward")
    return Grid(f"{task}, %", ("trained how",), columns, tuple(body), ("Blank: not run, or not in the paper.",))


if __name__ == "__main__":
    recorded.main("side-by-side", panels, COMMAND, tabulate=table)
