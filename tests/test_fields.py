"""Bins and even irreps are two coordinates of one function, and turn as escnn and lie_learn say."""

import copy
import math
import pickle
import warnings

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from equigrasp import fields
from equigrasp.errors import InputError

with warnings.catch_warnings():
    # compiling lie_learn for the first time warns of its docstrings' backslashes
    warnings.simplefilter("ignore")
    from escnn import gspaces
    from escnn.group import directsum
    from escnn.nn import FieldType, GeometricTensor, R2Conv
    from lie_learn.spectral.T1FFT import T1FFT

frequencies = st.integers(0, 17).map(lambda half: 2 * half)
angles = st.floats(-7, 7)
seeds = st.integers(0, 2**32 - 1)


def coefficients(maximum_frequency: int, seed: int) -> torch.Tensor:
    return torch.randn(1 + maximum_frequency, dtype=torch.float64, generator=torch.Generator().manual_seed(seed))


@given(frequencies)
def test_the_transforms_undo_each_other(frequency: int) -> None:
    product = fields.analysis(frequency) @ fields.synthesis(frequency)
    torch.testing.assert_close(product, torch.eye(1 + frequency, dtype=torch.float64), rtol=0, atol=1e-13)


@given(frequencies, seeds)
def test_bins_are_the_score_at_their_angles(frequency: int, seed: int) -> None:
    c = coefficients(frequency, seed)
    bins = fields.synthesis(frequency) @ c
    for i in (0, 1, 7, 35):
        theta = i * math.pi / 36
        score = c[0] + sum(
            c[m - 1] * math.cos(m * theta) + c[m] * math.sin(m * theta) for m in range(2, frequency + 1, 2)
        )
        assert abs(float(score - bins[i])) < 1e-12


@given(frequencies, seeds)
def test_the_transform_is_lie_learns_on_the_whole_circle(frequency: int, seed: int) -> None:
    c = coefficients(frequency, seed)
    half = (fields.synthesis(frequency) @ c).numpy()
    # the score has period pi: 36 bins over pi are 72 samples of the circle that repeat once
    spectrum = T1FFT.analyze(np.concatenate([half, half]))
    middle = 36
    assert abs(spectrum[middle] - float(c[0])) < 1e-12
    for m in range(2, frequency + 1, 2):
        assert abs(2 * spectrum[middle + m] - complex(c[m - 1], -c[m])) < 1e-12
    assert np.abs(spectrum[middle + 1 :: 2]).max() < 1e-12


@given(frequencies, angles)
def test_the_type_turns_as_written(frequency: int, alpha: float) -> None:
    kind = fields.even_type(frequency)
    turn = kind.representation(kind.gspace.fibergroup.element(alpha))
    torch.testing.assert_close(torch.from_numpy(turn), fields.rotation(frequency, alpha), rtol=0, atol=1e-12)


@given(frequencies, st.integers(-40, 40), seeds)
def test_a_turn_by_bins_moves_the_bins_counter_clockwise(frequency: int, steps: int, seed: int) -> None:
    c = coefficients(frequency, seed)
    turned = fields.synthesis(frequency) @ fields.rotation(frequency, steps * math.pi / 36) @ c
    expected = torch.roll(fields.synthesis(frequency) @ c, steps)
    torch.testing.assert_close(turned, expected, rtol=0, atol=1e-12)


@given(frequencies.filter(bool), seeds)
def test_the_complex_coefficient_gains_the_phase_exp_minus_i_m_alpha(frequency: int, seed: int) -> None:
    c, alpha = coefficients(frequency, seed), 0.3
    turned = fields.rotation(frequency, alpha) @ c
    for m in range(2, frequency + 1, 2):
        before, after = complex(c[m - 1], -c[m]), complex(turned[m - 1], -turned[m])
        assert abs(after - before * np.exp(-1j * m * alpha)) < 1e-12


def test_the_grid_is_escnns_with_y_up() -> None:
    from escnn.nn.modules.conv.rd_convolution import get_grid_coords

    np.testing.assert_array_equal(fields.grid(5).numpy(), get_grid_coords(2, 5))
    assert fields.grid(5)[0].tolist() == [-2, 2]


def test_a_type_has_one_representation_in_order_of_frequency() -> None:
    kind = fields.even_type(16)
    assert kind.size == 17
    assert kind.representations[0].irreps == [(m,) for m in range(0, 17, 2)]
    assert fields.trivial_type(8).size == 8


@pytest.mark.parametrize("frequency", [3, 36, -2])
def test_a_frequency_that_cannot_be_is_refused(frequency: int) -> None:
    with pytest.raises(ValueError, match=str(frequency)):
        fields.even_type(frequency)
    with pytest.raises(ValueError, match=str(frequency)):
        fields.synthesis(frequency if frequency % 2 == 0 else 36)


@pytest.mark.parametrize("channels", [0, -1])
def test_a_field_without_channels_is_refused(channels: int) -> None:
    with pytest.raises(InputError, match=f"a channel or more, but this is {channels}"):
        fields.trivial_type(channels)


@st.composite
def types_of_rotations(draw: st.DrawFn) -> FieldType:
    """Of SO(2) or a cyclic group: irreps, sums of them in any order, and regular representations."""
    order = draw(st.sampled_from([-1, 2, 3, 4, 8, 12]))
    space = fields.gspace(draw(st.integers(3, 40))) if order < 0 else gspaces.rot2dOnR2(order)
    frequencies = st.integers(0, 6 if order < 0 else order // 2)
    several = st.lists(frequencies, min_size=1, max_size=4)
    parts = several.map(lambda those: directsum([space.irrep(m) for m in those]) if those[1:] else space.irrep(*those))
    others = [st.just(space.regular_repr)] if order > 0 else []
    return FieldType(space, draw(st.lists(st.one_of(parts, *others), min_size=1, max_size=4)))


@given(types_of_rotations(), angles)
def test_a_type_of_rotations_pickles_and_is_copied_as_what_it_is(kind: FieldType, alpha: float) -> None:
    group = kind.gspace.fibergroup
    element = group.element(alpha % (2 * math.pi)) if group.continuous else group.element(round(alpha) % group.order())
    for again in (pickle.loads(pickle.dumps(kind)), copy.deepcopy(kind)):
        assert again == kind
        np.testing.assert_allclose(again.representation(element), kind.representation(element), atol=1e-12)


@pytest.mark.parametrize("order", [1, 4])
def test_a_type_with_reflections_is_copied_as_escnn_does_it(order: int) -> None:
    space = gspaces.flipRot2dOnR2(order) if order > 1 else gspaces.flip2dOnR2()
    kind = FieldType(space, [space.regular_repr, space.trivial_repr])
    assert copy.deepcopy(kind) == kind


@pytest.mark.parametrize("frequencies_in_turn", [(6, 4), (4, 6)])
def test_escnns_own_layers_of_two_frequencies_live_in_one_process(frequencies_in_turn: tuple[int, int]) -> None:
    """It keeps bases by the names of representations."""
    for highest in frequencies_in_turn:
        into, out = fields.trivial_type(2), fields.even_type(highest)
        layer = R2Conv(into, out, 9, bias=False, frequencies_cutoff=lambda radius: int(3 * radius))
        scene = torch.randn(1, 2, 21, 21, generator=torch.Generator().manual_seed(0))
        with torch.no_grad():
            here, there = (layer(GeometricTensor(each, into)).tensor for each in (scene, scene.rot90(1, (2, 3))))
        turn = fields.rotation(highest, math.pi / 2).float()
        turned = torch.einsum("op,bphw->bohw", turn, here.rot90(1, (2, 3)))
        torch.testing.assert_close(there, turned, rtol=0, atol=1e-5)
    assert fields.even_type(4) == fields.even_type(4) != fields.even_type(6)
