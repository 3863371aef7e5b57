"""The command line: one dataclass for each command, imports inside them, so that `--help` costs no torch.

A user's mistake is printed as one sentence and exits with code 2; a defect of ours keeps its traceback.
"""

from __future__ import annotations

import errno
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


def main(arguments: list[str] | None = None) -> None:
    """Run a command; `arguments` defaults to the process's own."""
    command = tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="equigrasp",
        description="Language-conditioned equivariant grasping: collect, train, evaluate, look.",
        args=arguments,
    )
    try:
        command.execute()
    except InputError as error:
        print(f"equigrasp: {error}", file=sys.stderr)
        sys.exit(2)
    except WorkerLostError as error:
        print(f"equigrasp: {error}; the same command goes on from here", file=sys.stderr)
        sys.exit(1)
    except OSError as error:
        if error.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EACCES, errno.EROFS):
            raise
        print(f"equigrasp: {error.strerror}: {error.filename or 'the output folder'}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("equigrasp: stopped; the same command goes on from here", file=sys.stderr)
        sys.exit(130)
