"""How a command ends: a user's mistake, a full disk or a stop is one sentence on stderr and an exit code.

A defect of ours keeps its traceback.
"""

from __future__ import annotations

import contextlib
import errno
import io
import os
import select
import signal
import sys
from collections.abc import Generator
from pathlib import Path

from equigrasp.errors import InputError, WorkerLostError

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NO_LEAVE = (errno.EACCES, errno.EPERM)
NO_PLACE = (errno.EROFS, errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.EEXIST)
WAYS_OUT = {
    **dict.fromkeys(NO_ROOM, "free some space"),
    **dict.fromkeys(NO_LEAVE, "choose another place, or change who may use it"),
    **dict.fromkeys(NO_PLACE, "choose another place"),
}
"""Of what is wrong with a place on the disk that none of the commands' own checks has seen."""
STDOUT = 1


def open_streams() -> None:
    """Give a process that was started without stdout or stderr ones that nobody reads; let each say any letter."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # the lowest that is free, so that no file of ours becomes what a library takes for stderr
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def check_here() -> None:
    """Raise an InputError where the current folder was deleted, of which no path can be told."""
    try:
        Path.cwd()
    except FileNotFoundError:
        raise InputError("the current folder is gone; change to another and run it again") from None


@contextlib.contextmanager
def exits(name: str | None = None, again: str = "the same command begins anew") -> Generator[None]:
    """Run a command in it, or put it above a script's `main`; what stdout still has is written before it ends.

    Args:
        name: of the command, which its sentence begins with; by default the file that runs.
        again: what the same command does after a stop, or after a worker's death.

    Raises:
        SystemExit: 2 after an `InputError` or where the disk has no room or no such place, 1 after a worker's death,
            130 after Ctrl-C, and as by SIGPIPE where nobody reads stdout.
    """
    name = name or Path(sys.argv[0]).name
    try:
        try:
            yield
        except SystemExit:  # after `--help`
            _flush()
            raise
        _flush()
    except BrokenPipeError:
        # a worker's pipe breaks too, and nobody may take that for the end of the work
        if not _nobody_reads():
            raise
        sys.exit(128 + signal.SIGPIPE)
    except InputError as error:
        print(f"{name}: {error}", file=sys.stderr)
        sys.exit(2)
    except WorkerLostError as error:
        print(f"{name}: {error}; {again}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        if error.errno not in WAYS_OUT:
            raise
        # of a write nobody says where, and it may be stdout
        place = "the output" if error.filename is None else error.filename
        print(f"{name}: {error.strerror}: {place}; {WAYS_OUT[error.errno]}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(f"{name}: stopped; {again}", file=sys.stderr)
        sys.exit(130)


def _flush() -> None:
    """Write what stdout still has, while an error is a sentence and an exit code."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError:
        _drop_the_rest()
        raise


def _nobody_reads() -> bool:
    """Whether stdout is the pipe that broke, as in `equigrasp tasks | head -1`; the rest goes nowhere then."""
    poll = select.poll()
    poll.register(STDOUT, 0)
    if not any(events & (select.POLLERR | select.POLLHUP) for _, events in poll.poll(0)):
        return False
    _drop_the_rest()
    return True


def _drop_the_rest() -> None:
    """Let go of what stdout did not take, or Python would say so once more when it flushes at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)
