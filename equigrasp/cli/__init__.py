"""The command line: one dataclass for each command, imports inside them, so that `--help` costs no torch.

A user's mistake is printed as one sentence and exits with code 2; a defect of ours keeps its traceback.
"""

from __future__ import annotations

import os
import shutil
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
from equigrasp.exits import check_here, exits, open_streams

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

NARROWEST = 40
"""Columns of a terminal that help is broken to."""

RESUMED = (Quickstart, Collect, ImportMinari, Train, Study)
"""Commands that go on where they were stopped."""


def main(arguments: list[str] | None = None) -> None:
    """Run a command; `arguments` defaults to the process's own."""
    open_streams()
    if shutil.get_terminal_size().columns < NARROWEST:
        # in a terminal of five columns and fewer tyro would look for a place to break its lines for ever
        os.environ["COLUMNS"] = str(NARROWEST)
    command = tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="equigrasp",
        description="Language-conditioned equivariant grasping: collect, train, evaluate, look.",
        args=arguments,
    )
    again = f"the same command {'goes on from here' if isinstance(command, RESUMED) else 'begins anew'}"
    with exits("equigrasp", again):
        check_here()
        command.execute()
