"""A function in a process of its own, and that process's memory.

The peak of a process that has done other things before says nothing about the last of them.
"""

from __future__ import annotations

import multiprocessing
import pickle
import resource
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, TypeVar

Result = TypeVar("Result")


class DidNotFitError(RuntimeError):
    """The process was killed, by the system for its memory or by us for its time; the message says which."""


def in_fresh_process(function: Callable[..., Result], *arguments: Any, limit: float) -> Result:
    """Call a function that pickles by name, with arguments that pickle, in a process that is spawned for it.

    Args:
        function: whose result pickles.
        arguments: its own.
        limit: seconds after which the process is killed.

    Raises:
        DidNotFitError: if the process was killed, or took longer than the limit.
        Exception: what the function raised; a RuntimeError that says it, where that cannot be sent.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(theirs, function, arguments), daemon=True)
    process.start()
    theirs.close()
    try:
        if not ours.poll(limit):
            raise DidNotFitError(f"took longer than {limit:.0f} s")
        try:
            succeeded, result = ours.recv()
        except EOFError:
            process.join()
            raise DidNotFitError(f"its process was killed (exit code {process.exitcode}); was memory short?") from None
    finally:
        process.kill()
        process.join()
        ours.close()
    if not succeeded:
        raise result
    return result


def _send(connection: Connection, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        message = True, function(*arguments)
    except Exception as error:  # it is raised again where it was asked for
        message = False, _travelling(error)
    connection.send(message)


def _travelling(error: Exception) -> Exception:
    """The error, or what it says where it does not pickle or, of a class with arguments of its own, not unpickle."""
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


def peak_memory() -> float:
    """The most memory that this process had resident so far, MiB."""
    status = Path("/proc/self/status")
    if status.exists():
        # getrusage's maximum outlives exec: a child would begin with its parent's
        for line in status.read_text().splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) / 2**10
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / 2**20 if sys.platform == "darwin" else most / 2**10
