"""What a law is, on which cases it is measured, and what a verdict says."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np
import torch

Turns = Literal["quarter", "bin", "any"]
BIN = 5.0
"""Degrees of one of the 36 bins."""


@dataclass(frozen=True)
class Case:
    """One group element and one draw of everything else.

    Attributes:
        degrees: angle of g, counter-clockwise with y up.
        x: translation of g to the right, pixels; where a law moves something.
        y: translation of g upwards, pixels.
        seed: of the embedding, the scene and the places that are looked at.
    """

    degrees: float
    x: float = 0.0
    y: float = 0.0
    seed: int = 0

    def __str__(self) -> str:
        shift = f" and a shift by ({self.x:.1f}, {self.y:.1f}) px" if self.x or self.y else ""
        return f"a turn by {self.degrees:g} degrees{shift} (seed {self.seed})"


def cases(turns: Turns, count: int, seed: int = 0) -> list[Case]:
    """`count` random cases: quarter turns, turns by whole bins, or any; none of them the identity."""
    rng = np.random.default_rng([seed, {"quarter": 0, "bin": 1, "any": 2}[turns]])
    drawn = []
    for _ in range(count):
        degrees = {
            "quarter": 90.0 * int(rng.integers(1, 4)),
            "bin": BIN * int(rng.integers(1, 72)),
            "any": float(rng.uniform(1, 359)),
        }[turns]
        whole = turns != "any"
        x, y = (float(rng.integers(-4, 5)) if whole else float(rng.uniform(-4, 4)) for _ in range(2))
        drawn.append(Case(degrees, x, y, int(rng.integers(2**31))))
    return drawn


@dataclass(frozen=True)
class Measurement:
    """What was measured in one case: how far off, and what moved where."""

    value: float
    message: str


@dataclass(frozen=True)
class Verdict:
    """Whether a law holds, measured.

    Attributes:
        law: its name.
        value: the worst value of all cases; NaN where none could be measured.
        tolerance: the largest that passes.
        unit: of both.
        share: of the cases that were measured, those within the tolerance.
        cases: how many were measured.
        drawn: how many there were; the law says nothing in the others.
        message: what moved where in the worst case.
    """

    law: str
    value: float
    tolerance: float
    unit: str
    share: float
    cases: int
    drawn: int
    message: str

    @property
    def passed(self) -> bool:
        """Whether the worst case is within the tolerance; a NaN is not."""
        return self.value <= self.tolerance

    def __str__(self) -> str:
        word = "holds" if self.passed else "FAILS"
        within = "" if self.unit == "relative" else f", {100 * self.share:.0f}% of cases within"
        said = f"{self.law}: {word}, {self.value:.2g} (at most {self.tolerance:.2g} {self.unit}{within})"
        return said if self.silent is None else f"{said}, {self.silent}"

    @property
    def silent(self) -> str | None:
        """In how many cases it could be measured, where that was not in all."""
        if self.cases == self.drawn:
            return None
        return f"in {self.cases} of {self.drawn} cases, the others say nothing"

    def to_dict(self) -> dict[str, Any]:
        """Plain values; a value that is no number is None, which JSON has."""
        value = self.value if math.isfinite(self.value) else None
        return asdict(self) | {"value": value, "passed": self.passed}


@dataclass(frozen=True)
class Law:
    """A statement that can be measured.

    Attributes:
        name: as reports and `expected_failures` have it.
        statement: the law itself.
        source: where the paper has it, or whose law it is.
        subject: the kind of thing it is about, a class of `subjects`.
        turns: on which group elements it is measured.
        tolerance: the largest value that passes, by dtype of what is measured.
        measure: subject and case to a measurement, or None where the law says nothing about that case.
        unit: of value and tolerance.
        count: cases in a check.
        applies: why the law says nothing about a subject, or None where it does.
        of_turns: whether it shows that what is measured turns with the scene; noise obeys the others as well.
        silence: why, where no case could be measured.
    """

    name: str
    statement: str
    source: str
    subject: type
    turns: Turns
    tolerance: Mapping[torch.dtype, float]
    measure: Callable[[Any, Case], Measurement | None]
    unit: str = "relative"
    count: int = 12
    applies: Callable[[Any], str | None] = lambda subject: None
    of_turns: bool = True
    silence: str = "no case of it could be measured, its group having none of these turns"

    def admitted(self, subject: Any, case: Case) -> Case:
        """The case with the nearest turn that the subject has, other than none: C_8 has 45 degrees, not 40.

        Quarter turns are those of its group, as whole bins are, which are its own bins besides.
        """
        order, bins = getattr(subject, "group_order", 0), getattr(subject, "bins", round(180 / BIN))
        order = {"quarter": math.gcd(order, 4), "bin": math.gcd(order, 2 * bins), "any": order}[self.turns]
        # of all turns, C_1 has none but the identity, which shows nothing
        if order < 2:
            return case
        return replace(case, degrees=360 / order * (round(case.degrees * order / 360) % order or 1))

    def judge(self, subject: Any, drawn: Iterable[Case] | None = None) -> Verdict:
        """Measure every case (by default `count` of them) and keep the worst."""
        asked = [self.admitted(subject, each) for each in (cases(self.turns, self.count) if drawn is None else drawn)]
        measured = [(case, result) for case in asked if (result := self.measure(subject, case)) is not None]
        tolerance = self.tolerance[subject.dtype]
        if not measured:
            return Verdict(self.name, math.nan, tolerance, self.unit, 0.0, 0, len(asked), self.silence)
        case, worst = max(measured, key=lambda pair: math.inf if math.isnan(pair[1].value) else pair[1].value)
        within = sum(result.value <= tolerance for _, result in measured)
        share, message = within / len(measured), f"{case}: {worst.message}"
        return Verdict(self.name, worst.value, tolerance, self.unit, share, len(measured), len(asked), message)


def both(value: float) -> dict[torch.dtype, float]:
    """One tolerance for float32 and float64."""
    return {torch.float32: value, torch.float64: value}


def by_dtype(float32: float, float64: float) -> dict[torch.dtype, float]:
    """A tolerance for each."""
    return {torch.float32: float32, torch.float64: float64}
