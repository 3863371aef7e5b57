"""Another process of this Python that works on what it is asked, over a connection of its own.

It imports what the work needs and no more, whoever starts it needs no `if __name__ == "__main__"`, and it ends with the
connection, however the other end dies. As no two processes share a connection, one that is killed in the middle of an
answer leaves nobody waiting for the rest of it.
"""

from __future__ import annotations

import contextlib
import functools
import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Generator, Iterable
from multiprocessing.connection import Connection, Pipe, wait
from typing import Any

import cloudpickle

from equigrasp.errors import WorkerLostError

# nothing of the working directory is imported before the path is known
START = (
    "import sys; sys.path.pop(0); "
    "from multiprocessing.connection import Connection; asked = Connection(int(sys.argv[1])); "
    "sys.path[:] = asked.recv(); from equigrasp.engines.worker import serve; serve(asked)"
)


class Worker:
    """A process that has a copy of some work.

    Args:
        copied: the work, pickled.
    """

    def __init__(self, copied: bytes) -> None:
        self.connection, theirs = Pipe()
        with theirs, _interrupts_held():
            self._process = subprocess.Popen(
                [sys.executable, "-c", START, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                # what the work prints is no answer, and no output of whoever asks either
                stdout=2,
                pass_fds=[theirs.fileno()],
            )
        self._send(pickle.dumps(sys.path))
        self._send(copied)

    def ask(self, item: Any) -> None:
        """Hand it one more item; it takes them in turn. That it died is told by `answer`."""
        self._send(pickle.dumps(item))

    def answer(self) -> Any:
        """What the work made of the first item that was not answered yet; waits for it.

        Raises:
            WorkerLostError: if the process died.
            Exception: what the work raised.
        """
        try:
            answer = self.connection.recv_bytes()
        except (EOFError, OSError):
            raise WorkerLostError("a worker process was killed from outside (is there memory enough?)") from None
        result, error = pickle.loads(answer)
        if error is not None:
            raise error
        return result

    def end(self) -> None:
        """Kill the process, whatever it has in hand."""
        self._process.kill()
        self._process.wait()
        self.connection.close()

    def _send(self, content: bytes) -> None:
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):
            self.connection.send_bytes(content)


@contextlib.contextmanager
def working(work: Callable[[Any], Any], count: int) -> Generator[list[Worker]]:
    """So many workers with a copy of the work each, which end with the context.

    Args:
        work: pickles, or is of the main module.
        count: how many.
    """
    copied = cloudpickle.dumps(work)
    workers: list[Worker] = []
    try:
        for _ in range(count):
            workers.append(Worker(copied))
        yield workers
    finally:
        for worker in workers:
            worker.end()


def answering(workers: Iterable[Worker]) -> list[Worker]:
    """Those that have an answer, or died; waits until there is one."""
    ready = wait([worker.connection for worker in workers])
    return [worker for worker in workers if worker.connection in ready]


def call(copied: bytes, item: Any) -> Any:
    """Run in a worker: apply pickled work, which is unpickled when it first comes and kept."""
    return _kept(copied)(item)


@functools.lru_cache(maxsize=1)
def _kept(copied: bytes) -> Callable[[Any], Any]:
    return pickle.loads(copied)


def serve(asked: Connection) -> None:
    """What a worker does: take the work, then item after item, and send what becomes of each, until it is killed."""
    items: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    # takes what is sent while the work goes on, so that neither end waits for the other; and sees the other one die
    threading.Thread(target=_receive, args=(asked, items), daemon=True).start()
    copied = items.get()
    while True:
        content = items.get()
        try:
            answer = pickle.dumps((call(copied, pickle.loads(content)), None))
        except Exception as error:
            answer = _pickled(error)
        asked.send_bytes(answer)


def _receive(asked: Connection, items: queue.SimpleQueue[bytes]) -> None:
    with contextlib.suppress(EOFError, OSError):
        while True:
            items.put(asked.recv_bytes())
    os._exit(1)


def _pickled(error: Exception) -> bytes:
    told = "".join(traceback.format_exception(type(error), error, error.__traceback__))
    # as `add_note` of Python 3.11 keeps it, which shows it
    vars(error).setdefault("__notes__", []).append("in a worker:\n" + told)
    try:
        content = pickle.dumps((None, error))
        pickle.loads(content)
    except Exception:
        return pickle.dumps((None, RuntimeError(told)))
    return content


@contextlib.contextmanager
def _interrupts_held() -> Generator[None]:
    """A terminal sends Ctrl-C to all processes: what is started here inherits that it is held back, and is ended."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
