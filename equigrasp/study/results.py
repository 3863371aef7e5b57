"""The file of results: one JSON line for each finished cell, whole or not there, none twice.

The study itself replaces the file as a whole (`artefacts.append_line`), so that its own death never leaves half a
line. A file that was copied while it grew, or filled by `cat` from several machines, may still end in one: it is
dropped, said so, and its cell is made again. A broken line further up is nothing that a death explains, and an error.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from equigrasp.artefacts import write_atomically
from equigrasp.errors import InputError

RESULTS = "results.jsonl"
MEASURED = frozenset(
    {
        "checkpoint",
        "clip_pretrained",
        "data",
        "date",
        "device",
        "equivariance",
        "frozen_parameters",
        "git",
        "memory",
        "paper",
        "parameters",
        "seconds",
        "single_shot",
        "trained_with",
        "validation_successes",
        "versions",
    }
)
"""Keys of a line that were found out; the others are its settings, by which the cell is known."""
CIRCUMSTANCES = frozenset({"date", "device", "git", "memory", "seconds", "trained_with", "versions"})
"""Keys of a line that say when, where and how long; the same cell made again may differ in these alone."""


def known_by(line: Mapping[str, Any]) -> str:
    """What a cell or its line is known by: its settings as one canonical string."""
    return json.dumps({key: value for key, value in line.items() if key not in MEASURED}, sort_keys=True)


def recency(line: Mapping[str, Any]) -> tuple[str, str]:
    """Of lines that are known by the same the one with the greatest counts: the latest, whatever the order of files."""
    return str(line.get("date", "")), json.dumps(line, sort_keys=True)


def read(path: Path) -> tuple[list[dict[str, Any]], str]:
    """The lines of a file of results, each cell once, and what was left of a last line that is not whole.

    Of a cell's lines the latest counts, in the place of the first. A file that is not there has none. Nothing is
    written.

    Raises:
        InputError: if the file cannot be read, or a line that is not the last is no JSON object; it names the line.
    """
    try:
        # an editor may have put a mark of its encoding first
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except FileNotFoundError:
        return [], ""
    except OSError as error:
        raise InputError(f"{path} cannot be read as results: {error.strerror}") from None
    found: dict[str, dict[str, Any]] = {}
    for number, line in enumerate(text.splitlines(keepends=True), 1):
        value = _object(line)
        if value is None and not line.endswith("\n"):
            return list(found.values()), line
        if value is None:
            raise InputError(f"line {number} of {path} is no JSON object; delete it, and its cell is made again")
        key = known_by(value)
        found[key] = max(found.get(key, value), value, key=recency)
    return list(found.values()), ""


def recover(path: Path) -> tuple[list[dict[str, Any]], str]:
    """As `read`, and the file holds these lines alone afterwards; it is not touched where it does already."""
    lines, left = read(path)
    whole = "".join(json.dumps(line, sort_keys=True) + "\n" for line in lines).encode()
    if path.exists() and path.read_bytes() != whole:
        write_atomically(Path(os.path.realpath(path)), whole)
    return lines, left


def without_circumstances(lines: Iterable[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The lines as they must be whoever made them and however often he was killed."""
    return [{key: value for key, value in line.items() if key not in CIRCUMSTANCES} for line in lines]


def _object(line: str) -> dict[str, Any] | None:
    try:
        value = json.loads(line)
    except ValueError:
        return None
    return value if isinstance(value, dict) else None
