"""Work that several processes share: how much they do a second, without the time in which they start and end."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Generic, TypeVar

from equigrasp.engines import Engine
from equigrasp.errors import InputError

Item = TypeVar("Item")


@dataclass(frozen=True)
class Lap:
    """One item's work: which process did it, when it began and ended, and how much it was."""

    process: int
    began: float
    ended: float
    amount: int


class Watched(Generic[Item]):
    """Work with a stopwatch: from an item to its `Lap`, for any engine.

    Args:
        work: does an item's work and says how much it was; it must pickle where the engine has other processes.
    """

    def __init__(self, work: Callable[[Item], int]) -> None:
        self.work = work

    def __call__(self, item: Item) -> Lap:
        """The item's lap."""
        began = time.monotonic()
        amount = self.work(item)
        return Lap(os.getpid(), began, time.monotonic(), amount)


def laps(work: Callable[[Item], int], items: Sequence[Item], engine: Engine) -> list[Lap]:
    """The laps of all items."""
    with closing(engine(Watched(work), items)) as results:
        return [lap for _, lap in results]


def steady_rate(
    work: Callable[[int], int], seed: int, count: int, seconds: float, engine: Engine, workers: int
) -> float:
    """Amount a second, as `rate`, with so many workers at work for half the seconds or more.

    Processes may take longer to start than all items take: it begins anew with twice as many until that is no matter.

    Args:
        work: from an item to how much it was.
        seed: the first item; the others follow.
        count: items to begin with.
        seconds: the time that they should take.
        engine: where it runs.
        workers: how many processes the engine has.
    """
    while True:
        found = laps(work, range(seed, seed + count), engine)
        began, ended = _at_work(found)
        if len(_processes(found)) == workers and ended - began >= seconds / 2:
            return rate(found)
        count *= 2


def rate(laps: Sequence[Lap]) -> float:
    """Amount a second while all processes were at work: each one's first item is its warm-up, and not counted.

    What is counted are the laps that began when all had warmed up, each by the share of it that lies before the
    first process ran out of items.

    Raises:
        InputError: if some process had fewer than 2 items.
    """
    began, ended = _at_work(laps)
    if ended <= began:
        raise InputError("some process had fewer than 2 items, too few to measure; take more items or fewer processes")
    done = 0.0
    for lap in laps:
        inside = min(lap.ended, ended) - max(lap.began, began)
        done += lap.amount * max(0.0, inside) / (lap.ended - lap.began)
    return done / (ended - began)


def _at_work(laps: Sequence[Lap]) -> tuple[float, float]:
    """From when on all processes were warm, and when the first of them was done."""
    began = max(lap.ended for lap in _firsts(laps))
    ended = min(max(lap.ended for lap in laps if lap.process == process) for process in _processes(laps))
    return began, ended


def _processes(laps: Sequence[Lap]) -> set[int]:
    return {lap.process for lap in laps}


def _firsts(laps: Sequence[Lap]) -> list[Lap]:
    return [
        min((lap for lap in laps if lap.process == process), key=lambda lap: lap.began) for process in _processes(laps)
    ]
