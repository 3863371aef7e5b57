"""The command line: one dataclass for each command, imports inside them, so that `--help` costs no torch.

A user's mistake is printed as one sentence and exits with code 2; a defect of ours keeps its traceback.
"""

from __future__ import annotations

import errno
import os
import select
import signal
import sys
from collections.abc import Callable
from typing import Any

import tyro

from equigrasp.cli.bench import Bench
from equigrasp.cli.difficulty import Difficulty
from equigrasp.cli.equivariance import Equivariance
from equigrasp.cli.export import Export
from equigrasp.cli.minari import ExportMinari, ImportMinari
from equigrasp.cli.pictures import Quickstart, Show
from equigrasp.cli.policy import Evaluate, Models, Train
from equigrasp.cli.share import Share
from equigrasp.cli.study import Study
from equigrasp.cli.suite import Collect, Tasks
from equigrasp.errors import InputError, WorkerLostError

COMMANDS: dict[str, Callable[..., Any]] = {
    "quickstart": Quickstart,
    "tasks": Tasks,
    "models": Models,
    "difficulty": Difficulty,
    "collect": Collect,
    "export-minari": ExportMinari,
    "import-minari": ImportMinari,
    "train": Train,
    "evaluate": Evaluate,
    "show": Show,
    "study": Study,
    "equivariance": Equivariance,
    "share": Share,
    "export": Export,
    "bench": Bench,
}


NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
NO_PLACE = (
    *(errno.EACCES, errno.EPERM, errno.EROFS),
    *(errno.ENAMETOOLONG, errno.ENOTDIR, errno.EISDIR, errno.EEXIST),
)
"""With `NO_ROOM`, what is wrong with a place on the disk that none of the commands' own checks has seen."""
STDOUT = 1
RESUMED = (Quickstart, Collect, ImportMinari, Train, Study)
"""Commands that go on where they were stopped."""


def main(arguments: list[str] | None = None) -> None:
    """Run a command; `arguments` defaults to the process's own."""
    command = tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="equigrasp",
        description="Language-conditioned equivariant grasping: collect, train, evaluate, look.",
        args=arguments,
    )
    again = f"the same command {'goes on from here' if isinstance(command, RESUMED) else 'begins anew'}"
    try:
        command.execute()
    except BrokenPipeError:
        # a worker's pipe breaks too, and nobody may take that for the end of the work
        if not _nobody_reads():
            raise
        sys.exit(128 + signal.SIGPIPE)
    except InputError as error:
        print(f"equigrasp: {error}", file=sys.stderr)
        sys.exit(2)
    except WorkerLostError as error:
        print(f"equigrasp: {error}; {again}", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        if error.errno not in NO_ROOM + NO_PLACE:
            raise
        way_out = "free some space" if error.errno in NO_ROOM else "choose another place"
        print(f"equigrasp: {error.strerror}: {error.filename or 'the output folder'}; {way_out}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(f"equigrasp: stopped; {again}", file=sys.stderr)
        sys.exit(130)


def _nobody_reads() -> bool:
    """Whether stdout is the pipe that broke, as in `equigrasp tasks | head -1`; the rest goes nowhere then."""
    poll = select.poll()
    poll.register(STDOUT, 0)
    if not any(events & (select.POLLERR | select.POLLHUP) for _, events in poll.poll(0)):
        return False
    # or Python would say so once more when it flushes at the end
    os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)
    return True
