"""What a law allows is what its page says, and no more: a loose tolerance would hide what the law is there to see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from equigrasp.correlation import correlate
from equivariance_tests.law import Law, cases
from equivariance_tests.laws import LAWS
from equivariance_tests.mutants import noise
from equivariance_tests.sound import kernel
from equivariance_tests.subjects import KernelSubject

PAGE = Path(__file__).parents[1] / "docs" / "laws.md"
ROUNDING = 1e-9
"""What is left of an exact law in float64, generously."""
SLIGHT = 1e-6
"""Of a kernel's taps: far more than rounding in float64, and less than anybody would see."""


def listed() -> dict[str, str]:
    """The first table of the page: law -> what it says of "at most"."""
    lines = PAGE.read_text().splitlines()
    start = next(index for index, line in enumerate(lines) if line.startswith("| law |"))
    columns = [cell.strip() for cell in lines[start].split("|")]
    table: dict[str, str] = {}
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            break
        row = dict(zip(columns, (cell.strip() for cell in line.split("|")), strict=True))
        table[row["law"]] = row["at most"]
    return table


LISTED = listed()
EXACT = [
    name
    for name, law in LAWS.items()
    if law.unit == "relative" and law.tolerance[torch.float64] != law.tolerance[torch.float32]
]


def test_every_law_of_the_page_is_a_law() -> None:
    assert len(LISTED) >= 18
    assert set(LISTED) <= set(LAWS)


@pytest.mark.parametrize("name", LISTED)
def test_a_law_allows_what_its_page_says(name: str) -> None:
    allowed, unit = LISTED[name].split(maxsplit=1)
    assert LAWS[name].tolerance[torch.float32] == pytest.approx(float(allowed), rel=1e-6)
    assert LAWS[name].unit == unit


@pytest.mark.parametrize("name", LAWS)
def test_in_float64_a_law_allows_no_more_than_in_float32(name: str) -> None:
    assert 0 < LAWS[name].tolerance[torch.float64] <= LAWS[name].tolerance[torch.float32]


def test_what_is_exact_is_exact_to_rounding_in_float64() -> None:
    assert {"fourier", "bins turn", "lemma 1", "correlation", "translation", "lemma 2"} <= set(EXACT)
    assert {
        name: LAWS[name].tolerance[torch.float64] for name in EXACT if LAWS[name].tolerance[torch.float64] > ROUNDING
    } == {}


def of_noisy_taps(features: Tensor, taps: Tensor) -> Tensor:
    """A correlation whose taps are slightly others."""
    return correlate(features, torch.stack([noise(SLIGHT)(each) for each in taps]))


SLIGHTLY_OFF: dict[str, KernelSubject] = {
    "fourier": kernel("read out a little wrongly", read_out=noise(SLIGHT)),
    "bins turn": kernel("read out a little wrongly", read_out=noise(SLIGHT)),
    "lemma 1": kernel("a little noise", change=noise(SLIGHT)),
    "correlation": kernel("correlated a little wrongly", correlation=of_noisy_taps),
    "translation": kernel("correlated a little wrongly", correlation=of_noisy_taps),
    "lemma 2": kernel("correlated a little wrongly", correlation=of_noisy_taps),
}


@pytest.mark.parametrize("name", SLIGHTLY_OFF)
def test_an_exact_law_sees_what_is_off_by_a_millionth(name: str) -> None:
    law: Law = LAWS[name]
    drawn = cases(law.turns, 2, seed=5)
    assert law.judge(kernel(), drawn).passed
    assert not law.judge(SLIGHTLY_OFF[name], drawn).passed
    # in float32 a millionth is rounding
    assert replace(law, tolerance={torch.float64: law.tolerance[torch.float32]}).judge(SLIGHTLY_OFF[name], drawn).passed
