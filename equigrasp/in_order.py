"""Work in processes whose results come in the order of their items, some ahead of their use.

The processes are this Python on this module, and talk through their pipes. So they import what the work needs and no
more, whoever calls needs no `if __name__ == "__main__"`, and they end when the pipe does, however its other end dies.
"""

from __future__ import annotations

import contextlib
import pickle
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Generator, Iterable
from typing import IO, Any, TypeVar

from equigrasp.errors import WorkerLostError

Item = TypeVar("Item")
Result = TypeVar("Result")

AHEAD = 3
"""Items that each process has in hand or done."""
START = "import sys, pickle; sys.path[:] = pickle.load(sys.stdin.buffer); from equigrasp.in_order import serve; serve()"


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
    copied = pickle.dumps(work)
    processes = [_Worker(copied) for _ in range(workers)]
    waiting: deque[_Worker] = deque()
    try:
        for index, item in enumerate(items):
            worker = processes[index % workers]
            worker.ask(item)
            waiting.append(worker)
            if len(waiting) == AHEAD * workers:
                yield waiting.popleft().answer()
        while waiting:
            yield waiting.popleft().answer()
    finally:
        for worker in processes:
            worker.end()


class _Worker:
    def __init__(self, copied: bytes) -> None:
        command = [sys.executable, "-c", START]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._send(sys.path)
        self._send(copied)

    def ask(self, item: Any) -> None:
        self._send(item)

    def answer(self) -> Any:
        try:
            result, error = pickle.load(self._pipe(self._process.stdout))
        except (EOFError, pickle.UnpicklingError):
            raise _lost() from None
        if error is not None:
            raise error
        return result

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            # what was not yet written is written now, to nobody
            with contextlib.suppress(BrokenPipeError):
                self._pipe(pipe).close()

    def _send(self, value: Any) -> None:
        try:
            pickle.dump(value, self._pipe(self._process.stdin))
            self._pipe(self._process.stdin).flush()
        except BrokenPipeError:
            raise _lost() from None

    def _pipe(self, pipe: IO[bytes] | None) -> IO[bytes]:
        assert pipe is not None
        return pipe


def _lost() -> WorkerLostError:
    return WorkerLostError("a worker process was killed from outside (is there memory enough?)")


def serve() -> None:
    """What a process does: read the work, then item after item, and write what becomes of each, until the pipe ends."""
    # a terminal sends Ctrl-C to all processes, and the one that reads ends this one
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    asked, answers = sys.stdin.buffer, sys.stdout.buffer
    # what anything prints must not come among the answers
    sys.stdout = sys.stderr
    try:
        work = pickle.loads(pickle.load(asked))
        while True:
            item = pickle.load(asked)
            try:
                answer = work(item), None
            except Exception as error:
                answer = None, error
            pickle.dump(answer, answers)
            answers.flush()
    except (EOFError, BrokenPipeError):
        return
