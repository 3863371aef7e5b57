"""What was measured: figures with their spread, as JSON and as a table."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from equigrasp.bench.timing import Timing, quartiles


@dataclass(frozen=True)
class Figure:
    """One figure, from repeated blocks.

    Attributes:
        group: what kind: "step", "inference", "observation", "simulator", "start-up", "machine", "growth".
        subject: whose: a model, a camera, a command.
        what: which of its figures.
        unit: of the values.
        values: one for each block; a single one where a repetition gives the same.
        note: what a reader must know.
    """

    group: str
    subject: str
    what: str
    unit: str
    values: tuple[float, ...]
    note: str = ""

    @property
    def median(self) -> float:
        """Of the blocks."""
        return statistics.median(self.values)

    def to_dict(self) -> dict[str, Any]:
        """As JSON takes it."""
        first, third = quartiles(self.values)
        return {
            "group": self.group,
            "subject": self.subject,
            "what": self.what,
            "unit": self.unit,
            "median": self.median,
            "quartiles": [first, third],
            "minimum": min(self.values),
            "maximum": max(self.values),
            "blocks": len(self.values),
            "note": self.note,
        }


def milliseconds(group: str, subject: str, what: str, timing: Timing, note: str = "") -> Figure:
    """A timing as a figure."""
    return Figure(group, subject, what, "ms", tuple(1e3 * each for each in timing.seconds), note)


def ratio(group: str, subject: str, what: str, one: Timing, other: Timing) -> Figure:
    """How many times as long the one took as the other, both timed in turn."""
    return Figure(group, subject, what, "x", one.over(other))


@dataclass
class Report:
    """All figures of a run, and what could not be measured.

    Attributes:
        machine: what `machine.describe` says.
        settings: what was asked for.
        figures: in order.
        skipped: what was not measured, and why.
        fits: of growth, as `growth.PowerLaw.to_dict` gives them.
    """

    machine: dict[str, Any]
    settings: dict[str, Any]
    figures: list[Figure] = field(default_factory=list)
    skipped: dict[str, str] = field(default_factory=dict)
    fits: list[dict[str, Any]] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """As JSON takes it."""
        return {
            "machine": self.machine,
            "settings": self.settings,
            "figures": [each.to_dict() for each in self.figures],
            "skipped": self.skipped,
            "fits": self.fits,
        }


def table(figures: Sequence[Figure]) -> list[str]:
    """Figures as lines of Markdown: median, quartiles, minimum."""
    lines = ["| | whose | what | median | quartiles | least | blocks |", "|---|---|---|---|---|---|---|"]
    for each in figures:
        first, third = quartiles(each.values)
        spread = ["", "", ""]
        if len(each.values) > 1:
            spread = [f"{_short(first)} .. {_short(third)}", _short(min(each.values)), str(len(each.values))]
        what = f"{each.what} ({each.note})" if each.note else each.what
        cells = [each.group, each.subject, what, f"{_short(each.median)} {each.unit}", *spread]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _short(value: float) -> str:
    return f"{value:.3g}" if abs(value) < 1000 else f"{value:.0f}"
