"""Processes that another one started, by what they run; for tests of what becomes of them."""

from __future__ import annotations

import subprocess
from pathlib import Path


def children(parent: int, command: str) -> list[int]:
    """The ids of a process's children that run the command and have not ended."""
    asked = ["ps", "ww", "-o", "pid=,args=", "--ppid", str(parent)]
    lines = [line.split(None, 1) for line in subprocess.run(asked, capture_output=True, text=True).stdout.splitlines()]
    return [int(pid) for pid, args in lines if command in args and is_alive(int(pid))]


def is_alive(pid: int) -> bool:
    """Whether it has not ended, though nobody may have asked how."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False
