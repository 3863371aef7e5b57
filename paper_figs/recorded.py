"""The command line that figures from recorded results share, and how they name what was run."""

from __future__ import annotations

import argparse
import itertools
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import style
from cells import Cell, Way
from grid import Grid
from loading import load
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from equigrasp.artefacts import check_folder
from equigrasp.errors import InputError
from equigrasp.exits import exits
from equigrasp.models import MODELS
from equigrasp.study.tables import TABLES, TESTED_ON
from equigrasp.success import MeanReward, Rate

RECOMBINATION = "filled: with recombination, hollow: without"
"""What `Look` says, for a reader."""
ALWAYS = ("leg-unet", "leg-steerable", "leg-equivariant", *TABLES[4].models[1:], "fcgq", "vit")
"""Models that look the same in every figure."""

DASHES = {
    (USUAL := "the usual training"): "-",
    (ASKED := "crowded scenes or hard negatives"): "--",
    (OTHERWISE := "another reader or resolution"): ":",
    (LONGER := "more or fewer steps"): "-.",
}
"""What a line's dash says, in every figure of lines: what else is apart stands at its end."""


@dataclass(frozen=True)
class Look:
    """How a way of making a policy is drawn: its model by colour and marker, recombination by filling and dash."""

    color: str
    dash: str
    marker: str
    filling: str


def models(names: Iterable[str]) -> list[str]:
    """Each once: as `equigrasp models` lists them, and then those that it does not have."""
    known = list(MODELS)
    return sorted(
        set(names),
        key=lambda name: (name not in MODELS, known.index(name) if name in known else 0, name),
    )


def series(names: Iterable[str]) -> dict[str, tuple[str, str, str]]:
    """Colour, dash and marker of each: one of `ALWAYS` has its own in every figure, others what is left.

    A model that was chosen otherwise (`Way.otherwise`) has the colour of its row and a star.
    """
    names, found, left = list(names), {}, list(style.SERIES)
    for name in names:
        row, *otherwise = name.split(", ")
        if row in ALWAYS:
            color, dash, marker = style.SERIES[ALWAYS.index(row)]
            found[name] = (color, dash, "*" if otherwise else marker)
            left = [each for each in left if each[0] != color]
    others = itertools.cycle(left or style.SERIES)
    return {name: found.get(name) or next(others) for name in names}


def in_order(ways: Iterable[Way]) -> list[Way]:
    """By model, then who read and how finely, demonstrations, recombination, and what is left."""
    ways = list(ways)
    order = models(way.model for way in ways)
    return sorted(
        ways, key=lambda way: (order.index(way.model), way.otherwise, way.demos, way.recombination, repr(way))
    )


def looks(ways: Iterable[Way]) -> dict[Way, Look]:
    """How each is drawn among the others."""
    ways = list(ways)
    order = models(way.model for way in ways)
    dress = series(order)
    found = {}
    for way in ways:
        color, _, marker = dress[way.model]
        found[way] = Look(color, *("-", marker, color) if way.recombination else ("--", marker, "white"))
    return found


def label(way: Way, task: str, among: Collection[Way], demos: bool = True, steps: bool = True) -> str:
    """How a policy that was tested on a task was made, in a line that none `among` which it stands shares."""
    parts = [way.model]
    if demos:
        parts.append(f"{way.demos} demo" + ("s" if way.demos > 1 else ""))
    if steps:
        parts.append(f"{way.steps:,} steps")
    return ", ".join([*parts, *apart(way, task, among)])


def demonstrations(demos: int) -> str:
    """Words for so many."""
    return f"{demos} demonstration" + ("s" if demos > 1 else "")


def usual_steps(ways: Iterable[Way]) -> int:
    """The number of steps that most have, of several such the greatest: said once of a figure."""
    count = Counter(way.steps for way in ways)
    return max(count, key=lambda steps: (count[steps], steps))


def by_demos(ways: Collection[Way]) -> dict[int, list[Way]]:
    """Ways by their number of demonstrations, the fewest first.

    A number that one model alone was given compares nothing, and is left to `efficiency.py` where there are others.
    """
    every = {demos: [way for way in ways if way.demos == demos] for demos in sorted({way.demos for way in ways})}
    compared = {demos: block for demos, block in every.items() if len({way.model for way in block}) > 1}
    return compared or every


def left_out(ways: Collection[Way]) -> list[str]:
    """What `by_demos` leaves out, a line for a title; nothing where that is nothing."""
    numbers = sorted({way.demos for way in ways} - set(by_demos(ways)))
    if not numbers:
        return []
    return [f"left out, as one model alone had so many demonstrations: {', '.join(map(str, numbers))}"]


def dash(way: Way, usual: int) -> str:
    """Which of `DASHES` a line has among those that mostly had the usual steps."""
    if way.otherwise:
        return OTHERWISE
    return ASKED if way.recombined else USUAL if way.steps == usual else LONGER


def dashes(ways: Iterable[Way], usual: int) -> list[Line2D]:
    """What a legend says of the dashes that occur, in grey; nothing where all lines are usual ones."""
    there = {dash(way, usual) for way in ways}
    if there == {USUAL}:
        return []
    return [Line2D([], [], color="0.4", ls=ls, label=kind) for kind, ls in DASHES.items() if kind in there]


def apart(way: Way, task: str, among: Collection[Way]) -> list[str]:
    """What sets it apart beside model, demonstrations and steps, in words.

    A share is said where there are several `among` these, and what it was trained on where `TESTED_ON` has another task
    for this test.
    """
    shares = [
        name + (f" {share:g}" if len({_shares(each).get(name, share) for each in among}) > 1 else "")
        for name, share in _shares(way).items()
    ]
    usual = next((trained for trained, tests in TESTED_ON.items() if task in tests), task)
    training = [] if way.trained_on == usual else [f"trained on {way.trained_on}"]
    return [*shares, *training, *way.unusual]


def _shares(way: Way) -> Mapping[str, float]:
    return ({"recombination": way.recombination} if way.recombination else {}) | way.recombined


def named_by(ways: Collection[Way]) -> dict[Way, Way]:
    """Each with the way by whose label it goes where its look says whether it has recombination.

    That is the one without, which both share, unless several shares of recombination are among them.
    """
    several = len({way.recombination for way in ways if way.recombination}) > 1
    return {way: way if several else replace(way, recombination=0.0) for way in ways}


def bars(rates: Sequence[Rate | MeanReward]) -> list[list[float]]:
    """How far their 95% Wilson intervals reach down and up from them, percent: matplotlib's error bars."""
    return [
        [100 * (rate.value - rate.interval[0]) for rate in rates],
        [100 * (rate.interval[1] - rate.value) for rate in rates],
    ]


def said(cells: Iterable[Cell], costs: Sequence[Mapping[str, Any]] = ()) -> str:
    """What results are of, in words: what was trained on and tested on, and whether costs are among them."""
    found: dict[str, set[str]] = {}
    for cell in cells:
        found.setdefault(cell.way.trained_on, set()).add(cell.task)
    parts = ["what models cost"] if costs else []
    for trained, tests in sorted(found.items()):
        also = ", ".join(sorted(tests - {trained}))
        parts.append(f"policies trained on {trained}" + (f" and tested on {also}" if also else ""))
    return "; ".join(parts) or "no policy"


def missing(command: str, task: str = "pick-by-part", cells: Sequence[Cell] = ()) -> str:
    """What is said in place of a figure without results: what the results at hand are of, and what makes one."""
    at_hand = f"; the results are of {said(cells)}, and --task names what they were tested on" if cells else ""
    return f"no result of {task} backs this figure, so that it is not drawn; `{command}` makes one{at_hand}"


def command_line(name: str, results: Sequence[Path] | None = None) -> argparse.ArgumentParser:
    """What every figure from recorded results is asked with; by default of all that ship, or of these."""
    parser = argparse.ArgumentParser(description=f"Draw {name}.png and {name}.pdf from recorded results.")
    shipped = sorted(style.RESULTS.glob("*.jsonl")) if results is None else list(results)
    parser.add_argument("--results", type=Path, nargs="+", default=shipped, help="files of results")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that the figure is written to")
    return parser


def check_there(paths: Sequence[Path], command: str) -> None:
    """Raise an InputError if one of these files is not there; it says what writes one."""
    for path in paths:
        if not path.exists():
            raise InputError(f"there is no file {path}; `{command}` writes one")


def asked(parser: argparse.ArgumentParser, arguments: Sequence[str] | None, command: str) -> argparse.Namespace:
    """What was asked for, once it is sure that there are such files and that the figure can be written.

    Raises:
        InputError: if not.
    """
    options = parser.parse_args(arguments)
    check_folder(options.out, "--out")
    check_there(options.results, command)
    return options


def write(name: str, drawn: Figure, grids: Sequence[Grid], folder: Path) -> None:
    """Write the figure, beside it the same as tables in Markdown where there are some, and say where they are."""
    paths = style.save(drawn, name, folder)
    if grids:
        paths.append(folder / f"{name}.md")
        style.save_text("\n".join(grid.markdown() for grid in grids), paths[-1])
    print(*paths, sep="\n")


@exits()
def main(
    name: str,
    draw: Callable[[Sequence[Cell], str], Figure | None],
    command: str,
    arguments: Sequence[str] | None = None,
    tabulate: Callable[[Sequence[Cell], str], Sequence[Grid]] | None = None,
) -> None:
    """Draw a figure of one task from files of results; where none backs it, say what makes one, and draw nothing.

    Args:
        name: of the files.
        draw: from cells and a task's name to the figure, or None where no cell backs it.
        command: makes the results.
        arguments: of the command line.
        tabulate: the same as tables.
    """
    parser = command_line(name)
    parser.add_argument("--task", default="pick-by-part", help="what is tested on")
    options = asked(parser, arguments, command)
    cells, _ = load(options.results)
    drawn = draw(cells, options.task)
    if drawn is None:
        print(f"{name}: {missing(command, options.task, cells)}")
        return
    write(name, drawn, tabulate(cells, options.task) if tabulate else [], options.out)


@exits()
def every_task(
    name: str,
    draw: Callable[[Sequence[Cell]], Figure | None],
    command: str,
    tabulate: Sequence[Callable[[Sequence[Cell]], Grid]],
    arguments: Sequence[str] | None = None,
    results: Sequence[Path] | None = None,
) -> None:
    """The same for a figure of all tasks at once, with its tables; by default of all results that ship, or of these."""
    options = asked(command_line(name, results), arguments, command)
    cells, _ = load(options.results)
    drawn = draw(cells)
    if drawn is None:
        at_hand = f"; the results are of {said(cells)}" if cells else ""
        print(f"{name}: no result backs this figure, so that it is not drawn; `{command}` makes one{at_hand}")
        return
    write(name, drawn, [each(cells) for each in tabulate], options.out)
