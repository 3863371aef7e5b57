"""Work in processes whose results come in the order of their items, some ahead of their use."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

from equigrasp.engines.worker import Worker, working

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 3
"""Items that each process has in hand or done."""


def in_order(work: Callable[[Item], Result], items: Iterable[Item], workers: int) -> Generator[Result, None, None]:
    """`work(item)` for each of the items, in their order. The processes end with the generator.

    Args:
        work: pickled once for each process.
        items: taken as they are needed; they may have no end.
        workers: how many processes.

    Raises:
        WorkerLostError: if a process died.
        Exception: what `work` raised.
    """
    waiting: deque[Worker] = deque()
    with working(work, workers) as processes:
        for index, item in enumerate(items):
            worker = processes[index % workers]
            worker.ask(item)
            waiting.append(worker)
            if len(waiting) == AHEAD * workers:
                yield waiting.popleft().answer()
        while waiting:
            yield waiting.popleft().answer()
