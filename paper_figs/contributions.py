"""What each part of the method and of its training brings: pairs of policies that differ in one thing.

    uv run equigrasp study --table 4
    uv run python paper_figs/contributions.py --results studies/table-4/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/contributions.{png,pdf}`,
and `contributions.md` with the same numbers: single shots without the part (hollow) and with it (filled), on every task
that policies were trained on and tested on. Both of a pair had the same steps, the most that both had, and of what both
have the same share; of several shares the largest counts.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import recorded
import style
from by_task import place_among
from cells import Cell, Way, pooled
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from equigrasp.success import Rate

COMMAND = "equigrasp study --table 4"
LIFTED = 0.14
"""Of a row, how far the policy that has the part is drawn above the middle, and the other below."""


@dataclass(frozen=True)
class Setup:
    """What a pair's policies are told apart by, and pairs from each other; a `Way` has the rest."""

    model: str = "leg-unet"
    recombination: bool = False
    hard_negatives: bool = False
    crowded: bool = False
    full: bool = False
    demos: int = 1


@dataclass(frozen=True)
class Part:
    """One thing that policies may have or not.

    Attributes:
        name: of it.
        among: what both policies are besides, in words.
        without: the policy that lacks it.
        having: the same with it.
    """

    name: str
    among: str
    without: Setup
    having: Setup


Shares = tuple[float, float, float]
"""Of recombination, of hard negatives and of crowding."""

LEG = Setup()
RECOMBINED = Setup(recombination=True)
EQUIVARIANT = Setup("leg-equivariant", recombination=True)
HARD = Setup("leg-equivariant", recombination=True, hard_negatives=True)
PARTS = (
    Part("a kernel", "fcgq / leg-unet", Setup("fcgq"), LEG),
    Part("a kernel that hears", "leg-unet", Setup("leg-unet-no-kernel-language"), LEG),
    Part("a kernel that turns", "leg-unet", Setup("leg-unet-no-steerability"), LEG),
    Part("a phi that hears", "leg-unet", Setup("leg-unet-no-phi-language"), LEG),
    Part("recombination", "leg-unet", LEG, RECOMBINED),
    Part("ten demonstrations for one", "leg-unet", LEG, Setup(demos=10)),
    Part("ten demonstrations for one", "leg-unet, recombined", RECOMBINED, Setup(recombination=True, demos=10)),
    Part(
        "an exact kernel",
        "leg-unet / leg-steerable, recombined",
        RECOMBINED,
        Setup("leg-steerable", recombination=True),
    ),
    Part(
        "a phi that turns",
        "leg-steerable / leg-equivariant, recombined",
        Setup("leg-steerable", recombination=True),
        EQUIVARIANT,
    ),
    Part("hard negatives", "leg-equivariant, recombined", EQUIVARIANT, HARD),
    Part(
        "crowded scenes",
        "leg-equivariant, recombined",
        EQUIVARIANT,
        Setup("leg-equivariant", recombination=True, crowded=True),
    ),
    Part(
        "a full-resolution read-out",
        "leg-equivariant, hard negatives",
        HARD,
        Setup("leg-equivariant", recombination=True, hard_negatives=True, full=True),
    ),
)


@dataclass(frozen=True)
class Pair:
    """Single shots without a part and with it, after as many steps."""

    steps: int
    without: Rate
    having: Rate


def setup(way: Way) -> Setup | None:
    """Which setup it is; None where something else is unusual about it."""
    full = way.read_out == "full"
    if way.unusual != (["full-resolution read-out"] if full else []) or way.phrasings != "seen":
        return None
    return Setup(way.model, way.recombination > 0, way.hard_negatives > 0, way.crowded > 0, full, way.demos)


def pairs(cells: Sequence[Cell]) -> dict[Part, dict[str, Pair]]:
    """For each part that any task says something of, its pair by task; of tasks that were trained on and tested on."""
    groups: dict[tuple[str, Setup], dict[tuple[int, Shares], list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in cells:
        way = cell.way
        which = setup(way)
        if cell.shots and cell.task == way.trained_on and which is not None:
            shares = way.recombination, way.hard_negatives, way.crowded
            groups[cell.task, which][way.steps, shares].append(cell)
    tasks = sorted({task for task, _ in groups}, key=place_among)
    found: dict[Part, dict[str, Pair]] = {}
    for part in PARTS:
        for task in tasks:
            one, other = groups.get((task, part.without), {}), groups.get((task, part.having), {})
            comparable = [
                (steps, shares, fewer)
                for steps, shares in other
                for as_many, fewer in one
                if steps == as_many and agree(shares, fewer)
            ]
            if comparable:
                steps, shares, fewer = max(comparable)
                without, having = pooled(one[steps, fewer]), pooled(other[steps, shares])
                if without is not None and having is not None:
                    found.setdefault(part, {})[task] = Pair(steps, without, having)
    return found


def agree(one: Shares, other: Shares) -> bool:
    """Whether the two have the same share of all that both have some of."""
    return all(share == same or 0 in (share, same) for share, same in zip(one, other, strict=True))


def tasks_of(found: Mapping[Part, Mapping[str, Pair]]) -> list[str]:
    """The tasks that have pairs, as the tables have them."""
    return sorted({task for by_task in found.values() for task in by_task}, key=place_among)


def panels(cells: Sequence[Cell]) -> Figure | None:
    """The figure, a panel a task; None where there is no pair."""
    found = pairs(cells)
    if not found:
        return None
    tasks = tasks_of(found)
    figure = Figure(figsize=(1.5 + 2.5 * len(tasks), 1.5 + 0.42 * len(found)), layout="constrained")
    sides = figure.subplots(1, len(tasks), sharey=True, squeeze=False)[0]
    for axes, task in zip(sides, tasks, strict=True):
        for height, by_task in enumerate(found.values()):
            axes.axhline(height, color="0.95", lw=14, zorder=0)
            if task not in by_task:
                continue
            draw(axes, height, by_task[task])
        axes.set_xlim(-3, 128)
        axes.set_xticks([0, 25, 50, 75, 100])
        axes.set_xlabel("goal reached (%)")
        axes.set_title(task, fontsize=10)
        axes.grid(alpha=0.25, axis="x")
    sides[0].set_yticks(range(len(found)), labels=[f"{part.name}\n{part.among}" for part in found], fontsize=9)
    sides[0].set_ylim(len(found) - 0.4, -0.6)
    handles = [
        Line2D([], [], color=color, marker=marker, mfc=filling, ls="", label=label)
        for color, marker, filling, label in (
            (style.BLUE, "o", "white", "without it"),
            (style.BLUE, "o", style.BLUE, "with it"),
            (style.ORANGE, "s", style.ORANGE, "with it, where that is less"),
        )
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    figure.suptitle(
        "what each part brings: single shots in unseen scenes, 95% Wilson intervals;\n"
        "on the right the difference in points, bold where the intervals do not meet",
        fontsize=10,
    )
    return figure


def draw(axes: Axes, height: float, pair: Pair) -> None:
    """A pair at that height, and by how many points it differs."""
    worse = pair.having.value < pair.without.value
    color, marker = (style.ORANGE, "s") if worse else (style.BLUE, "o")
    axes.plot([100 * pair.without.value, 100 * pair.having.value], [height, height], color=color, lw=1, alpha=0.5)
    for rate, at, filling in ((pair.without, height + LIFTED, "white"), (pair.having, height - LIFTED, color)):
        bars = recorded.bars([rate])
        axes.errorbar(100 * rate.value, at, xerr=bars, color=color, marker=marker, mfc=filling, ms=6, lw=1.2, ls="")
    (low, high), (lowest, highest) = pair.without.interval, pair.having.interval
    apart = low > highest or lowest > high
    points = 100 * (pair.having.value - pair.without.value)
    text = f"{points:+.1f}".replace("-", "\N{MINUS SIGN}")
    weight, ink = ("bold", style.BLACK) if apart else ("normal", style.GREY)
    axes.text(127, height, text, fontsize=9, va="center", ha="right", weight=weight, color=ink)


def table(cells: Sequence[Cell]) -> Grid:
    """The figure's numbers, percent: three columns for each task."""
    found = pairs(cells)
    tasks = tasks_of(found)
    body = []
    for part, by_task in found.items():
        values: list[Value | None] = []
        for task in tasks:
            pair = by_task.get(task)
            if pair is None:
                values += [None, None, None]
            else:
                values += [Value(pair.steps, digits=0), Value.of(pair.without), Value.of(pair.having)]
        body.append(Row((part.name, part.among), tuple(values)))
    columns = tuple(f"{task}: {what}" for task in tasks for what in ("steps", "without", "with"))
    notes = ("After the most steps that both had; the same demonstrations and test scenes.", "Blank: not run.")
    return Grid("what each part brings, single shots, %", ("part", "of"), columns, tuple(body), notes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it from files of results; where none backs it, say what makes one, and draw nothing."""
    recorded.every_task("contributions", panels, COMMAND, (table,), arguments)


if __name__ == "__main__":
    main()
