"""Trainings that die in the middle, for tests of what goes on from there."""

from __future__ import annotations

from collections.abc import Callable, Iterable


class DiedError(Exception):
    """Stands for a process that dies."""


def die_after(steps: int) -> Callable[[range], Iterable[int]]:
    """A progress bar that dies before the given number of further steps was made."""

    def wrap(items: range) -> Iterable[int]:
        for count, item in enumerate(items):
            if count == steps:
                raise DiedError
            yield item

    return wrap
