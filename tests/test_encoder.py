"""phi: the steerable U-Net turns and moves with the scene, the plain one does not; weights survive every mode."""

import copy
import math

import pytest
import torch
from safetensors.torch import load, save
from seeded import made
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.baselines.without_language import PhiWithoutLanguage
from equigrasp.encoder import UNet
from equigrasp.encoder.group_convolution import (
    FILTER_RINGS,
    FieldNorm,
    GroupConvolution,
    cyclic,
    intertwiners,
    regular_type,
    scalar_type,
    turned_harmonics,
)
from equigrasp.encoder.local import LocalSteerableUNet
from equigrasp.encoder.steerable import SteerableUNet
from equigrasp.encoder.unet import GroupNorm

NARROW = (8, 8, 8, 8, 8)
ORDERS = [4, 8]


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def observation(*shape: int, seed: int = 0) -> Tensor:
    """Noise of the size of colours and heights, `(*shape)` with four channels."""
    noise = torch.rand(*shape, generator=generator(seed))
    return noise * torch.tensor([255, 255, 255, 0.1]).view(4, 1, 1)


def embeddings(count: int) -> Tensor:
    return nn.functional.normalize(torch.randn(count, 16, generator=generator(1)))


def turn_error(phi: nn.Module, dtype: torch.dtype = torch.float32, shape: tuple[int, int] = (64, 96)) -> float:
    """How far the features of a turned scene are from the turned features, relative, over all quarter turns."""
    scene, words = observation(2, 4, *shape).to(dtype), embeddings(2).to(dtype)
    phi = copy.deepcopy(phi).to(dtype)
    with torch.no_grad():
        features = phi(scene, words)
        return max(
            float((phi(scene.rot90(k, (2, 3)), words) - features.rot90(k, (2, 3))).abs().max() / features.abs().max())
            for k in (1, 2, 3)
        )


# The layers


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize(("size", "resample"), [(1, "same"), (3, "same"), (6, "halve"), (6, "double")])
@pytest.mark.parametrize(("inputs", "outputs"), [("scalar", "regular"), ("regular", "regular"), ("regular", "scalar")])
def test_a_convolution_turns_by_its_declared_types(
    order: int, size: int, resample: str, inputs: str, outputs: str
) -> None:
    types = {"scalar": scalar_type(order, 2), "regular": regular_type(order, 3)}
    layer = made(GroupConvolution, types[inputs], types[outputs], size, resample).double()
    x = torch.randn(1, layer.in_type.size, 12, 16, dtype=torch.float64, generator=generator())
    with torch.no_grad():
        y = layer(x)
        for quarter in (1, 2, 3):
            g = cyclic(order).fibergroup.element(quarter * order // 4)
            # escnn's own matrices of the declared types
            rho_in, rho_out = (
                torch.from_numpy(each.representation(g)).double() for each in (layer.in_type, layer.out_type)
            )
            turned = torch.einsum("ij,bjhw->bihw", rho_in, x.rot90(quarter, (2, 3)))
            expected = torch.einsum("ij,bjhw->bihw", rho_out, y.rot90(quarter, (2, 3)))
            torch.testing.assert_close(layer(turned), expected, rtol=0, atol=1e-12)
            wrong = torch.einsum("ij,bjhw->bihw", rho_out.T, y.rot90(quarter, (2, 3)))
            # a scalar seen through one pixel has no direction
            if outputs == "regular" and quarter != 2 and (inputs, size) != ("scalar", 1):
                assert (layer(turned) - wrong).abs().max() > 0.01, "channels must shift the right way round"


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("size", [1, 3])
@pytest.mark.parametrize("inputs", ["scalar", "regular"])
def test_a_fresh_convolution_keeps_a_third_of_the_variance(order: int, size: int, inputs: str) -> None:
    """As torch's own does: layers of either kind begin alike, whatever the filter and the group."""
    types = {"scalar": scalar_type(order, 64), "regular": regular_type(order, 32)}
    layer = made(GroupConvolution, types[inputs], types["regular"], size)
    with torch.no_grad():
        y = layer(torch.randn(4, layer.in_type.size, 24, 24, generator=generator()))
    assert float(y[..., 2:-2, 2:-2].var()) == pytest.approx(1 / 3, rel=0.15)


@pytest.mark.parametrize("order", ORDERS)
def test_the_kernels_are_escnns(order: int) -> None:
    space = cyclic(order)
    regular, trivial = space.regular_repr, space.trivial_repr
    for size in (3, 6):
        rings = [ring for ring, _ in FILTER_RINGS[size]]
        limits = dict(FILTER_RINGS[size])
        for into, out in ((trivial, regular), (regular, regular), (regular, trivial)):
            theirs = copy.deepcopy(space.build_kernel_basis(into, out, sigma=0.5, rings=rings, maximum_frequency=3))
            kept = [
                e["irrep:frequency"] <= min(limit for ring, limit in limits.items() if abs(ring - e["radius"]) < 1e-6)
                for e in theirs
            ]
            sampled = theirs.double().sample(fields.grid(size))[:, kept].permute(1, 2, 0, 3).flatten(1)
            mine = intertwiners(order, size, into is regular, out is regular).flatten(1)
            assert mine.shape == sampled.shape
            both = torch.linalg.matrix_rank(torch.cat([mine, sampled]), rtol=1e-6)
            assert both == torch.linalg.matrix_rank(mine, rtol=1e-6) == len(mine)


def test_on_three_pixels_every_kernel_that_turns_by_90_degrees_is_there() -> None:
    assert len(intertwiners(4, 3, True, True)) == 4 * 9
    assert len(intertwiners(4, 3, False, True)) == 9
    assert turned_harmonics(1, 4).flatten().tolist() == [1, 1, 1, 1]


def test_a_norm_of_channels_would_break_the_symmetry() -> None:
    type_ = regular_type(4, 8)
    x = torch.randn(1, 32, 6, 6, dtype=torch.float64, generator=generator())
    by_field = made(FieldNorm, type_).double()
    by_channel = nn.GroupNorm(8, 32).double()
    for parameter in (by_field.weight, by_channel.weight):
        parameter.data.uniform_(0.5, 1.5, generator=generator(2))
    rho = torch.from_numpy(type_.representation(type_.gspace.fibergroup.element(1))).double()
    turned = torch.einsum("ij,bjhw->bihw", rho, x)
    for norm, expected in ((by_field, 0.0), (by_channel, 0.1)):
        with torch.no_grad():
            error = float((norm(turned) - torch.einsum("ij,bjhw->bihw", rho, norm(x))).abs().max())
        assert error < 1e-12 if expected == 0 else error > expected


def test_norms_are_computed_in_their_weights_dtype() -> None:
    """Under bfloat16 too: as of the same numbers in float32, which torch's own is not."""
    rough = (3 * torch.randn(2, 32, 12, 20, generator=generator())).bfloat16()
    for norm, exact in (
        (GroupNorm(8, 32), True),
        (made(FieldNorm, regular_type(4, 8)), True),
        (nn.GroupNorm(8, 32), False),
    ):
        with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
            assert torch.equal(norm(rough).float(), norm(rough.float())) == exact


# The whole of phi


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("stride", [1, 2])
def test_features_turn_with_the_scene(order: int, stride: int) -> None:
    phi = made(SteerableUNet, 16, channels=3, stride=stride, widths=NARROW, group_order=order)
    assert turn_error(phi, torch.float64) < 1e-12
    assert turn_error(phi, torch.float64, (64, 64)) < 1e-12
    assert turn_error(phi) < 1e-5
    assert phi(observation(1, 4, 64, 96), embeddings(1)).shape == (1, 3, 64 // stride, 96 // stride)


def test_the_default_turns_to_rounding_and_has_the_plain_ones_size() -> None:
    phi, plain = made(SteerableUNet, 384), made(UNet, 384)
    count, plain_count = (sum(parameter.numel() for parameter in each.parameters()) for each in (phi, plain))
    assert abs(count - plain_count) < 0.1 * plain_count
    assert phi.out_type == plain.out_type == fields.trivial_type(8)


def test_the_plain_unet_does_not_turn() -> None:
    assert turn_error(made(UNet, 16, widths=NARROW), torch.float64) > 0.05


@pytest.mark.parametrize("layer", ["stem", "bottom", "out"])
def test_one_layer_that_is_not_steerable_breaks_the_whole(layer: str) -> None:
    phi = made(SteerableUNet, 16, channels=3, widths=NARROW)
    convolution = next(each for each in phi.get_submodule(layer).modules() if isinstance(each, GroupConvolution))
    # every channel of a field reads the ring from the same side
    convolution.basis._exact = convolution.basis._exact.roll(1, dims=2)
    convolution.basis.value = convolution.basis._exact.float()
    assert turn_error(phi, torch.float64) > 1e-3


def test_features_move_with_an_object_by_multiples_of_32_pixels() -> None:
    phi = made(SteerableUNet, 16, channels=3, widths=NARROW).double()
    scene = torch.zeros(1, 4, 640, 640, dtype=torch.float64)
    scene[:, :, 280:330, 290:340] = observation(1, 4, 50, 50).double()
    with torch.no_grad():
        features = phi(scene, embeddings(1).double())
        for down, right, same in ((32, -32, True), (16, 0, False)):
            moved = phi(scene.roll((down, right), (2, 3)), embeddings(1).double())
            expected = features.roll((down // 2, right // 2), (2, 3))
            error = (moved - expected)[..., 120:200, 120:200].abs().max() / features.abs().max()
            # pools and upsampling are tied to a grid of 32 pixels: half of that is not a symmetry
            assert error < 1e-4 if same else error > 1e-2


def test_language_changes_the_features_and_reaches_every_parameter() -> None:
    for kind in (UNet, SteerableUNet, LocalSteerableUNet):
        phi = made(kind, 16, widths=NARROW)
        scene = observation(1, 4, 64, 64).expand(2, -1, -1, -1)
        features = phi(scene, embeddings(2))
        assert (features[0] - features[1]).abs().max() > 1e-3
        features.square().sum().backward()
        assert not [name for name, p in phi.named_parameters() if p.grad is None or not p.grad.any()]


def test_without_language_phi_says_one_thing_and_still_turns() -> None:
    phi = PhiWithoutLanguage(made(SteerableUNet, 16, widths=NARROW), 16)
    features = phi(observation(1, 4, 64, 64).expand(2, -1, -1, -1), embeddings(2))
    assert torch.equal(features[0], features[1])
    assert turn_error(phi, torch.float64) < 1e-12
    features[0, 0, 5, 7].backward()
    assert phi.vector.grad is not None
    assert phi.vector.grad.any()
    assert phi.stride == 2
    assert phi.out_type == fields.trivial_type(8)


# Weights, modes and dtypes


@pytest.mark.parametrize("kind", [UNet, SteerableUNet, LocalSteerableUNet])
def test_weights_saved_in_one_mode_load_in_any(kind: type) -> None:
    trained = made(kind, 16, widths=NARROW, seed=1).train()
    scene, words = observation(1, 4, 64, 64), embeddings(1)
    with torch.no_grad():
        expected = trained(scene, words)
        for mode in (True, False):
            state = load(save({name: value.contiguous() for name, value in trained.train(mode).state_dict().items()}))
            for other in (True, False):
                fresh = made(kind, 16, widths=NARROW, seed=2).train(other)
                fresh.load_state_dict(state, strict=True)
                for last in (other, False, True):
                    torch.testing.assert_close(fresh.train(last)(scene, words), expected, rtol=0, atol=1e-6)


def test_a_filter_is_never_stale() -> None:
    phi = made(SteerableUNet, 16, widths=NARROW).eval()
    scene, words = observation(1, 4, 64, 64), embeddings(1)
    with torch.no_grad():
        before = phi(scene, words)
        phi.out.weight.mul_(-2)
        torch.testing.assert_close(phi(scene, words), -2 * before)


def test_one_modules_dtype_is_its_own() -> None:
    first, second = (made(SteerableUNet, 16, widths=NARROW) for _ in range(2))
    with torch.no_grad():
        expected = second(observation(1, 4, 64, 64), embeddings(1))
        first.double()
        assert torch.equal(second(observation(1, 4, 64, 64), embeddings(1)), expected)
        assert first(observation(1, 4, 64, 64).double(), embeddings(1).double()).dtype == torch.float64


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="C_6 does not contain a turn by 90 degrees; use a multiple of 4"):
        SteerableUNet(16, group_order=6)
    with pytest.raises(ValueError, match="stride 1 or 2"):
        SteerableUNet(16, stride=4)
    with pytest.raises(ValueError, match="five widths"):
        SteerableUNet(16, widths=(8, 12, 8, 8, 8))
    with pytest.raises(ValueError, match="multiples of 32"):
        made(SteerableUNet, 16, widths=NARROW)(torch.zeros(1, 4, 60, 64), embeddings(1))


def test_harmonics_turn_by_any_angle_of_the_group() -> None:
    for order in ORDERS:
        turned = turned_harmonics(3, order)
        points, angle = fields.grid(3), 2 * math.pi / order
        cosine = turned[4, :, 5]  # ring 1, cos 2 phi, at the pixel on the right of the centre
        assert points[5].tolist() == [1, 0]
        expected = torch.tensor([math.cos(2 * a * angle) for a in range(order)], dtype=torch.float64)
        torch.testing.assert_close(cosine / cosine[0], expected)
