"""What a user's mistake raises, and what ends a command from outside: one sentence that names the way out."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """A mistake in what the user passed; the command line prints it alone and exits with code 2."""


class BusyError(InputError):
    """Another process is at work where this one should be."""


class WorkerLostError(RuntimeError):
    """A worker process died; nothing that was finished is lost, and the same command goes on from there."""


def unknown(kind: str, name: str, known: Iterable[str]) -> InputError:
    """Say that there is no such thing, with the nearest names (or all of them, where none is near).

    Args:
        kind: what it should have been, as in "task" or "model".
        name: what the user wrote.
        known: the names there are.
    """
    names = sorted(known)
    lowered = {each.lower(): each for each in names}
    near = [lowered[each] for each in difflib.get_close_matches(name.lower(), lowered, n=3, cutoff=0.5)]
    if near:
        return InputError(f"there is no {kind} {name!r}; did you mean {' or '.join(map(repr, near))}?")
    return InputError(f"there is no {kind} {name!r}; there are {', '.join(names)}")
