"""The stopwatch: repeated blocks of calls for a figure, alternating blocks for a ratio.

A machine that others use is slow for seconds at a time. A median of many blocks outlives some of that; a ratio
outlives nearly all of it if the two were timed in turn, each block beside its partner's.
"""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from equigrasp.errors import InputError

BLOCK = 0.02
"""Seconds that a block of calls takes at the least: no clock's resolution or reading matters in it."""
FEWEST = 3
"""Blocks that are timed even if they take longer than the budget."""

Clock = Callable[[], float]


@dataclass(frozen=True)
class Timing:
    """Seconds a call, one value for each block of calls, in the order in which they were timed.

    Attributes:
        seconds: at least one, each positive.
    """

    seconds: tuple[float, ...]

    @property
    def median(self) -> float:
        """Of the blocks."""
        return statistics.median(self.seconds)

    def over(self, other: Timing) -> tuple[float, ...]:
        """This time over the other's, block by block, for two that were timed in turn by `race`."""
        return tuple(mine / yours for mine, yours in zip(self.seconds, other.seconds, strict=True))


def measure(function: Callable[[], object], seconds: float, clock: Clock = time.perf_counter) -> Timing:
    """Time repeated calls for about so many seconds, after one call that is not counted.

    Raises:
        InputError: if there is no time to measure in.
    """
    return race({"": function}, seconds, clock)[""]


def race(
    functions: Mapping[str, Callable[[], object]], seconds: float, clock: Clock = time.perf_counter
) -> dict[str, Timing]:
    """Time several functions in turn, block by block, and backwards every other round, so that a drift cancels.

    Args:
        functions: by name; each is called once before anything is counted, and twice if that took half of its seconds
            at the most.
        seconds: of all blocks together, for each function.
        clock: gives seconds; another one in tests.

    Raises:
        InputError: if there is no time to measure in.
    """
    check_seconds(seconds)
    calls = {}
    for name, function in functions.items():
        took = _once(function, clock)
        if took <= seconds / 2:
            # the first call was slowed by what is made once
            took = _once(function, clock)
        calls[name] = max(1, round(BLOCK / max(took, 1e-9)))
    blocks: dict[str, list[float]] = {name: [] for name in functions}
    order, until = list(functions), clock() + seconds * len(functions)
    for done in itertools.count():
        if done >= FEWEST and clock() >= until:
            break
        for name in order:
            function, count = functions[name], calls[name]
            began = clock()
            for _ in range(count):
                function()
            # one call may have been slower than those that follow
            while (took := clock() - began) < BLOCK:
                function()
                count += 1
            blocks[name].append(took / count)
        order.reverse()
    return {name: Timing(tuple(each)) for name, each in blocks.items()}


def _once(function: Callable[[], object], clock: Clock) -> float:
    began = clock()
    function()
    return clock() - began


def quartiles(values: Sequence[float]) -> tuple[float, float]:
    """The first and third quartile; the value itself twice where there is one."""
    if len(values) < 2:
        return values[0], values[0]
    first, _, third = statistics.quantiles(values, n=4, method="inclusive")
    return first, third


def check_seconds(seconds: float) -> None:
    """Raise InputError unless there is time to measure in."""
    if not 0 < seconds < float("inf"):
        raise InputError(f"--seconds is {seconds:g}, but each figure needs more than 0 and a finite time; 2 is usual")
