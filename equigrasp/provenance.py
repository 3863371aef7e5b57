"""What a result was measured with: versions, the state of the source, the machine."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from equigrasp.precision import multiplies_bfloat16

PACKAGES = ("equigrasp", "torch", "numpy", "scipy", "escnn", "pybullet", "open_clip_torch")


def circumstances() -> dict[str, Any]:
    """Date, versions, git and device, as JSON."""
    return {
        "date": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "versions": versions(),
        "git": git(),
        "device": device(),
    }


def versions() -> dict[str, str | None]:
    """Of Python and of each package that a result depends on; None where one is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = None
    return found


def git() -> dict[str, Any] | None:
    """The commit that the source is at, and whether files were changed since; None where it is in no repository."""
    here = Path(__file__)
    try:
        # an installed package may lie in a repository that is not its own
        _git(here.parent, "ls-files", "--error-unmatch", here.name)
        commit = _git(here.parent, "rev-parse", "HEAD")
        changed = _git(here.parent, "status", "--porcelain", "--untracked-files=no")
    except (OSError, subprocess.CalledProcessError):
        return None
    return {"commit": commit, "changed": bool(changed)}


def device() -> dict[str, Any]:
    """What computes, everything here on the processor, and which precision `auto` is there."""
    return {
        "kind": "cpu",
        "processor": processor(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "auto": "bfloat16" if multiplies_bfloat16("auto", "cpu") else "float32",
    }


def processor() -> str:
    """Its name, as the system has it."""
    listed = Path("/proc/cpuinfo")
    if listed.exists():
        for line in listed.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
