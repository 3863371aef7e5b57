"""How long a command takes to answer, in a process of its own each time."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

STARTS: dict[str, tuple[str, ...]] = {
    "python alone": ("-c", "pass"),
    "import equigrasp": ("-c", "import equigrasp"),
    "equigrasp --help": ("-m", "equigrasp", "--help"),
    "import equigrasp.policy": ("-c", "import equigrasp.policy"),
}
"""What is started -> the interpreter's arguments. The last one brings torch and escnn."""


def start(arguments: tuple[str, ...]) -> Callable[[], object]:
    """The interpreter with these arguments, waited for."""

    def run() -> object:
        return subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)

    return run
