"""Hypothesis strategies: group elements, scenes that can be evaluated turned, embeddings, kernels and fields.

    from hypothesis import given
    from equivariance_tests import strategies

    @given(strategies.cases("any"))
    def test_mine_turns(case):
        assert LAWS["steerability"].measure(mine, case).value < 2e-4

Profiles: `dev` (fast), `ci` (the same examples every time), `thorough`; EQUIGRASP_PROFILE chooses, CI means `ci`.
"""

from __future__ import annotations

import os
from typing import Any

import torch
from hypothesis import Phase, settings
from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from torch import Tensor

from equigrasp.errors import unknown
from equigrasp.workspace import Motion
from equivariance_tests.law import BIN, Case, Turns
from equivariance_tests.scenes import HALF_BAND, Arrangement, Blobs, PlaneMotion, Waves, arrangement, blobs, waves

PROFILES: dict[str, dict[str, Any]] = {
    "dev": {"max_examples": 5},
    "ci": {"max_examples": 15, "derandomize": True},
    "thorough": {"max_examples": 300},
}
"""Examples a law; deadlines are off, because shared machines are slow for other reasons."""


def profile(name: str | None = None) -> settings:
    """A profile's settings, to decorate a test with: as told, by EQUIGRASP_PROFILE, or ci where CI is set, else dev.

    Nothing is registered with hypothesis: the profile of your own suite stays what it was.

    Raises:
        InputError: if there is no such profile.
    """
    name = name or os.environ.get("EQUIGRASP_PROFILE") or ("ci" if os.environ.get("CI") else "dev")
    if name not in PROFILES:
        raise unknown("profile", name, PROFILES)
    # a case costs a correlation, and a smaller angle breaks a law no more clearly: no minutes of shrinking
    return settings(deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate), **PROFILES[name])


seeds: SearchStrategy[int] = st.integers(0, 2**31 - 1)

quarter_turns: SearchStrategy[float] = st.sampled_from([90.0, 180.0, 270.0])
"""Degrees; the turns that a pixel grid has."""
bin_turns: SearchStrategy[float] = st.integers(1, 71).map(lambda steps: BIN * steps)
"""Degrees; whole bins of the read-out."""
any_turns: SearchStrategy[float] = st.floats(0.5, 359.5)
"""Degrees."""
whole_shifts: SearchStrategy[float] = st.integers(-4, 4).map(float)
"""Pixels along one axis."""
shifts: SearchStrategy[float] = st.floats(-4, 4)


def cases(turns: Turns) -> SearchStrategy[Case]:
    """Cases for a law: quarter turns, whole bins or any turn, a translation, a seed; shrinks to the smallest."""
    degrees = {"quarter": quarter_turns, "bin": bin_turns, "any": any_turns}[turns]
    shift = shifts if turns == "any" else whole_shifts
    return st.builds(Case, degrees, shift, shift, seeds)


def motions(metres: float = 0.3) -> SearchStrategy[Motion]:
    """Elements of SE(2) in the world: radians and metres."""
    along = st.floats(-metres, metres)
    return st.builds(Motion, st.floats(-10, 10), along, along)


def plane_motions() -> SearchStrategy[PlaneMotion]:
    """Elements of SE(2) in pixels, about any point."""
    pair = st.tuples(shifts, shifts)
    return st.builds(PlaneMotion, st.one_of(quarter_turns, bin_turns, any_turns), pair, pair)


def wave_scenes(channels: int = 3, band: float = HALF_BAND) -> SearchStrategy[Waves]:
    """Sums of 16 plane waves of |k| <= band, radians a pixel."""
    return st.builds(waves, st.just(channels), st.just(band), seeds)


def blob_scenes(channels: int = 3) -> SearchStrategy[Blobs]:
    """Objects made of Gaussians; less than 1e-9 of their energy lies beyond half of Nyquist."""
    return st.builds(blobs, st.just(channels), seeds)


def arrangements(channels: int = 3, gap: float = 60.0) -> SearchStrategy[Arrangement]:
    """One target among three fixed others, `gap` pixels apart."""
    slots = [(gap * i, gap * j) for i in (-0.5, 0.5) for j in (-0.5, 0.5)]
    return st.builds(arrangement, st.just(channels), seeds, st.just(slots))


def embeddings(size: int) -> SearchStrategy[Tensor]:
    """Unit vectors `(1, size)` float64, as instructions have them."""

    def embed(seed: int) -> Tensor:
        drawn = torch.randn(1, size, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
        return torch.nn.functional.normalize(drawn)

    return seeds.map(embed)


frequencies: SearchStrategy[int] = st.integers(0, 17).map(lambda half: 2 * half)
"""The highest even frequency of a field of grasp scores at 36 bins."""


@st.composite
def steerable_settings(draw: st.DrawFn) -> dict[str, int]:
    """Settings of a `SteerableKernel` that can be: odd size, and a frequency that its rings carry."""
    size = draw(st.sampled_from([17, 21, 25, 33]))
    carried = {17: 4, 21: 6, 25: 10, 33: 16}[size]
    return {
        "channels": draw(st.integers(1, 4)),
        "size": size,
        "maximum_frequency": 2 * draw(st.integers(0, carried // 2)),
    }


@st.composite
def lifted_settings(draw: st.DrawFn) -> dict[str, int]:
    """Settings of a `LiftedKernel` that can be: odd size, a multiple of 4 that carries the frequency."""
    frequency = 2 * draw(st.integers(0, 6))
    order = draw(st.sampled_from([each for each in (36, 72) if each > 2 * frequency]))
    return {
        "channels": draw(st.integers(1, 4)),
        "size": draw(st.sampled_from([13, 17, 25])),
        "maximum_frequency": frequency,
        "group_order": order,
    }
