"""How long a command takes to answer, in a process of its own each time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

STARTS: dict[str, tuple[str, ...]] = {
    "python alone": ("-c", "pass"),
    "import equigrasp": ("-c", "import equigrasp"),
    "equigrasp --help": ("-m", "equigrasp", "--help"),
    "import equigrasp.policy": ("-c", "import equigrasp.policy"),
}
"""What is started -> the interpreter's arguments. The last one brings torch and escnn."""


def start(arguments: tuple[str, ...]) -> Callable[[], object]:
    """The interpreter with these arguments, waited for."""
    # the folder it runs in comes first on its path, and the user's may have an equigrasp.py of its own
    here = Path(sys.executable).parent

    def run() -> object:
        return subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL, cwd=here)

    return run
