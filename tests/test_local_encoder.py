"""phi that is local as well: its field of view ends where it says, and what turns alone turns alone in its features."""

from dataclasses import replace
from typing import TypeVar

import pytest
import torch
from torch import Tensor, nn

from equigrasp import fields, models
from equigrasp.baselines.without_language import KernelWithoutLanguage, PhiWithoutLanguage
from equigrasp.encoder.group_convolution import CellNorm, FieldNorm, GroupConvolution, cyclic, regular_type, scalar_type
from equigrasp.encoder.local import LocalSteerableUNet
from equigrasp.kernel import SteerableKernel
from equigrasp.policy import LegPolicy
from equivariance_tests.law import Turns, cases
from equivariance_tests.laws import LAWS
from equivariance_tests.local_laws import sees
from equivariance_tests.scenes import render
from equivariance_tests.stage import NEAR, cells, scene_and_motion, stage, without_target
from equivariance_tests.subjects import PolicySubject
from equivariance_tests.wrapping import policy_subject

ORDERS, STRIDES = [4, 8], [1, 2]
M = TypeVar("M", bound=nn.Module)
LOCALITY = ("policy: field of view", "policy: eq. 2, every score")


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def made(
    size: int = 16, channels: int = 3, stride: int = 2, widths: tuple[int, ...] = (8, 8), order: int = 4
) -> LocalSteerableUNet:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return LocalSteerableUNet(size, channels, stride, widths, order).double()


def observation(rows: int, columns: int, seed: int = 0) -> Tensor:
    """Noise of the size of colours and heights, `(1, 4, rows, columns)` float64."""
    noise = torch.rand(1, 4, rows, columns, dtype=torch.float64, generator=generator(seed))
    return noise * torch.tensor([255, 255, 255, 0.1], dtype=torch.float64).view(4, 1, 1)


def words(size: int = 16, count: int = 1) -> Tensor:
    return nn.functional.normalize(torch.randn(count, size, dtype=torch.float64, generator=generator(1)))


def normalised_over_the_image(module: M) -> M:
    """The same layers with group normalisation: what makes `SteerableUNet` global."""
    for name, child in module.named_children():
        setattr(
            module, name, FieldNorm(child.in_type) if isinstance(child, CellNorm) else normalised_over_the_image(child)
        )
    return module.double()


# The layers


def test_a_norm_cell_by_cell_turns_with_the_fields_and_sees_one_cell() -> None:
    type_ = regular_type(4, 6)
    norm, by_channel = CellNorm(type_).double(), nn.LayerNorm(24).double()
    for parameter in (norm.weight, norm.bias, by_channel.weight):
        parameter.data.uniform_(0.5, 1.5, generator=generator(2))
    x = torch.randn(2, 24, 6, 8, dtype=torch.float64, generator=generator())
    rho = torch.from_numpy(type_.representation(cyclic(4).fibergroup.element(1))).double()
    turned = torch.einsum("ij,bjhw->bihw", rho, x)
    with torch.no_grad():
        torch.testing.assert_close(norm(turned), torch.einsum("ij,bjhw->bihw", rho, norm(x)), rtol=0, atol=1e-12)
        # a gain for each channel of a field is not one for the field
        broken = by_channel(turned.movedim(1, 3)) - torch.einsum("ij,bhwj->bhwi", rho, by_channel(x.movedim(1, 3)))
        assert broken.abs().max() > 0.1
        changed = x.clone()
        changed[0, :, 2, 3] += 1 + torch.arange(24)
        moved = (norm(changed) != norm(x)).any(dim=1).nonzero().tolist()
        assert moved == [[0, 2, 3]]
        mean = (
            (norm(x) - norm.bias.repeat_interleave(4)[:, None, None]) / norm.weight.repeat_interleave(4)[:, None, None]
        ).mean(1)
        torch.testing.assert_close(mean, torch.zeros_like(mean), rtol=0, atol=1e-12)


@pytest.mark.parametrize("dilation", [1, 2, 4])
def test_a_dilated_convolution_turns_and_its_reach_is_its_own(dilation: int) -> None:
    layer = GroupConvolution(scalar_type(4, 2), regular_type(4, 2), dilation=dilation).double()
    x = torch.zeros(1, 2, 21, 21, dtype=torch.float64)
    x[:, :, 10, 10] = 1
    rho = torch.from_numpy(layer.out_type.representation(cyclic(4).fibergroup.element(1))).double()
    with torch.no_grad():
        seen = layer(x).abs().amax((0, 1)).nonzero() - 10
        assert seen.abs().max() == layer.reach == dilation
        noise = torch.randn(1, 2, 12, 16, dtype=torch.float64, generator=generator())
        expected = torch.einsum("ij,bjhw->bihw", rho, layer(noise).rot90(1, (2, 3)))
        torch.testing.assert_close(layer(noise.rot90(1, (2, 3))), expected, rtol=0, atol=1e-12)


# The whole of phi


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("stride", STRIDES)
def test_features_turn_with_the_scene(order: int, stride: int) -> None:
    phi, scene = made(stride=stride, order=order), observation(48, 64)
    with torch.no_grad():
        features = phi(scene, words())
        assert features.shape == (1, 3, 48 // stride, 64 // stride)
        for quarter in (1, 2, 3):
            turned = phi(scene.rot90(quarter, (2, 3)), words())
            torch.testing.assert_close(turned, features.rot90(quarter, (2, 3)), rtol=0, atol=1e-12)
        rough = phi.float()(scene.rot90(1, (2, 3)).float(), words().float())
        torch.testing.assert_close(rough.double(), features.rot90(1, (2, 3)), rtol=0, atol=1e-4)


def furthest_change(phi: LocalSteerableUNet, row: int = 60, column: int = 61) -> float:
    """How far from a pixel, along the longer axis, its change moves a feature."""
    scene = observation(128, 128)
    changed = scene.clone()
    changed[:, :, row, column] += torch.tensor([40, -30, 20, 0.05], dtype=torch.float64)
    with torch.no_grad():
        moved = (phi(changed, words()) != phi(scene, words())).any(dim=1)[0]
    pixels = phi.stride * moved.nonzero() + (phi.stride - 1) / 2
    return float((pixels - torch.tensor([row, column])).abs().max())


@pytest.mark.parametrize("stride", STRIDES)
@pytest.mark.parametrize(("widths", "cells_seen"), [((8,), 2), ((8, 4), 5), ((4, 8, 4), 11)])
def test_the_field_of_view_ends_at_the_reach_and_not_before(
    stride: int, widths: tuple[int, ...], cells_seen: int
) -> None:
    phi = made(stride=stride, widths=widths)
    # the stem sees 2.5 pixels; the last filter one cell, or at full resolution 2.5 pixels
    assert phi.reach == 2.5 + 2 * cells_seen + (0.5 if stride == 1 else 0)
    # rows and columns of either parity, so that a cell's both edges are tried
    assert max(furthest_change(phi, row, row + 1) for row in (60, 61)) == phi.reach


def test_a_norm_over_the_image_is_a_field_of_view_without_end() -> None:
    phi = normalised_over_the_image(made())
    assert furthest_change(phi) > phi.reach + 20


def test_the_default_sees_as_far_as_an_object_is_long() -> None:
    with torch.random.fork_rng(devices=[]):
        phi = LocalSteerableUNet(384)
    assert phi.reach == 48.5
    assert phi.out_type == fields.trivial_type(8)
    assert sum(parameter.numel() for parameter in phi.parameters()) < 1e5


def among_others(patch: Tensor, row: int, column: int) -> Tensor:
    """A patch on a bare table, with another object that stays, `(1, 4, 128, 192)`."""
    scene = torch.zeros(1, 4, 128, 192, dtype=torch.float64)
    scene[:, :, 40:60, 130:160] = observation(20, 30, seed=3)
    scene[:, :, row : row + patch.shape[2], column : column + patch.shape[3]] = patch
    return scene


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("stride", STRIDES)
@pytest.mark.parametrize(("row", "column", "exact"), [(56, 60, True), (57, 61, True), (57, 60, False)])
def test_an_object_that_turns_alone_about_a_cells_corner_or_centre_turns_its_features(
    order: int, stride: int, row: int, column: int, exact: bool
) -> None:
    """12 pixels from an even place turn about a cell's corner, from an odd one about its centre, else about an edge."""
    phi, patch, view = made(stride=stride, order=order), observation(12, 12), 18
    assert phi.reach < view
    with torch.no_grad():
        before = phi(among_others(patch, row, column), words())
        after = phi(among_others(patch.rot90(1, (2, 3)), row, column), words())
    # whole cells about the patch's middle
    side = 24 + row % 2
    top, left = (row + 6 - side) // stride, (column + 6 - side) // stride
    bottom, right = top + 2 * side // stride, left + 2 * side // stride
    square = before[..., top:bottom, left:right].rot90(1, (2, 3))
    error = float((after[..., top:bottom, left:right] - square).abs().max() / square.std())
    assert error < 1e-12 if exact else error > 1e-2
    # the other object's features, and all that see none of the first
    clear = (column + 12 + view) // stride
    assert torch.equal(after[..., clear:], before[..., clear:])
    assert before[..., clear:].std() > 1e-2


def test_features_move_with_an_object_by_whole_cells() -> None:
    phi, patch = made(), observation(12, 12)
    with torch.no_grad():
        before = phi(among_others(patch, 56, 60), words())[..., 16:48, 16:50]
        moved = phi(among_others(patch, 58, 56), words())[..., 17:49, 14:48]
        half = phi(among_others(patch, 57, 60), words())[..., 16:48, 16:50]
    torch.testing.assert_close(moved, before, rtol=0, atol=1e-12)
    assert (half - before).abs().max() > 1e-2, "a pixel is half a cell"


# The policy


def test_a_policy_sees_as_far_as_phi_and_its_kernel_together() -> None:
    assert models.build("leg-equivariant-local").reach == 48.5 + 2 * 16
    assert models.build("leg-equivariant").reach is None
    row = replace(models.MODELS["leg-equivariant-local"], phi_language=False, kernel_language=False)
    untold = models.build(row)
    assert isinstance(untold.phi, PhiWithoutLanguage)
    assert isinstance(untold.kappa, KernelWithoutLanguage)
    assert untold.reach == 48.5 + 2 * 16


def policy(phi: nn.Module, dtype: torch.dtype = torch.float64, claim: float = 0.0) -> PolicySubject:
    """A policy with a small kernel as the laws take it; it says that it sees further than it does by `claim`."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(1)
        kappa = SteerableKernel(512, 3, 17, 4)
    subject = policy_subject(LegPolicy(phi, kappa, "hashing", "float32").to(dtype))
    assert subject.reach is not None
    return replace(subject, reach=subject.reach + claim)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("stride", STRIDES)
def test_eq_2_holds_for_the_target_alone_score_by_score(dtype: torch.dtype, stride: int) -> None:
    subject = policy(made(512, stride=stride), dtype)
    for name in LOCALITY:
        verdict = LAWS[name].judge(subject, cases("quarter", 3, seed=1))
        assert verdict.passed, f"{verdict}; {verdict.message}"
        assert verdict.cases == 3


def test_eq_2_holds_for_the_best_grasp_of_the_target() -> None:
    verdict = LAWS["policy: eq. 2, quarter turns"].judge(policy(made(512)), cases("quarter", 4, seed=2))
    assert verdict.value < 1e-6, verdict.message


def test_a_field_of_view_that_is_wider_than_it_says_is_caught() -> None:
    subject = policy(made(512, widths=(8, 8, 8)), claim=-14)
    for name in LOCALITY:
        verdict = LAWS[name].judge(subject, cases("quarter", 2, seed=1))
        assert verdict.value > 1e3 * verdict.tolerance, f"{name} let pass what sees 14 pixels further than it says"


def test_a_norm_over_the_image_is_caught() -> None:
    subject = policy(normalised_over_the_image(made(512)))
    verdict = LAWS["policy: field of view"].judge(subject, cases("quarter", 2, seed=1))
    assert verdict.value > 1e-3
    assert "a score that sees no other object changed" in verdict.message


def test_scores_that_say_nothing_of_the_target_prove_nothing() -> None:
    def flat(scene: Tensor, embedding: Tensor) -> Tensor:
        return torch.zeros(len(scene), 36, scene.shape[2] // 2, scene.shape[3] // 2, dtype=scene.dtype)

    dead = PolicySubject("dead", flat, 8, torch.float64, 2, reach=10.0)
    for name in LOCALITY:
        verdict = LAWS[name].judge(dead, cases("quarter", 1))
        assert not verdict.passed
        assert "no score depends on the target" in verdict.message


@pytest.mark.parametrize("stride", STRIDES)
def test_what_a_score_sees_is_a_square_about_its_cell(stride: int) -> None:
    subject = PolicySubject("any", lambda scene, embedding: scene, 8, torch.float64, stride, reach=4.5)
    support = torch.zeros(32, 48, dtype=torch.bool)
    support[20, 30] = True
    centres = cells(32 // stride, 48 // stride, stride)
    distance = (centres - torch.tensor([30 - 24, 16 - 20])).abs().amax(dim=1)
    assert torch.equal(sees(subject, support).flatten(), distance <= 4.5)
    edge = sees(subject, torch.zeros_like(support), border=True)
    # beyond the border is pixel -1: of cells of one pixel 0 to 3 see it, of cells of two those at 0.5 and 2.5
    assert edge[16 // stride].nonzero()[:, 0].tolist() == {1: [0, 1, 2, 3, 44, 45, 46, 47], 2: [0, 1, 22, 23]}[stride]


@pytest.mark.parametrize("reach", [0.0, 24.5, 80.5])
@pytest.mark.parametrize("turns", ["quarter", "any"])
def test_from_its_grasps_the_target_sees_neither_the_others_nor_the_border(reach: float, turns: Turns) -> None:
    subject = PolicySubject("any", lambda scene, embedding: scene, 8, torch.float64, 2, reach)
    table = stage(subject)
    for case in cases(turns, 4, seed=3):
        scene, motion = scene_and_motion(subject, case)
        others = (render(without_target(scene), table.rows, table.columns) != 0).any(dim=0)
        seen = sees(subject, others, border=True).flatten()
        points = cells(table.rows // 2, table.columns // 2, 2)
        before = torch.tensor([scene.target.centre], dtype=torch.float64)
        assert others.any()
        for centre in (before, motion(before)):
            near = (points - centre).norm(dim=1) <= NEAR
            assert near.any()
            assert not (seen & near).any()
        if turns == "quarter":
            # the grid's own symmetries: cells land on cells
            landed = (motion(points) - cells(1, 1, 2)) / 2
            torch.testing.assert_close(landed, landed.round(), rtol=0, atol=1e-12)


# Bad input


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="C_6 does not contain a turn by 90 degrees; use a multiple of 4"):
        LocalSteerableUNet(16, group_order=6)
    with pytest.raises(ValueError, match="stride 1 or 2, but this is 4"):
        LocalSteerableUNet(16, stride=4)
    for widths in ((), (8, 0)):
        with pytest.raises(ValueError, match="one width a level, each at least 1, but these are"):
            LocalSteerableUNet(16, widths=widths)
    with pytest.raises(
        ValueError, match=r"halves the heightmap once, so its sides are multiples of 2, but this is 61 x 64"
    ):
        made()(torch.zeros(1, 4, 61, 64), words())
    with pytest.raises(ValueError, match=r"\(B, 4, H, W\), colour and height"):
        made()(torch.zeros(1, 3, 64, 64), words())
    for resample, dilation in (("halve", 2), ("same", 0)):
        with pytest.raises(ValueError, match=f"'{resample}'.* is dilated by {dilation}"):
            GroupConvolution(scalar_type(4, 1), scalar_type(4, 1), 6, resample, dilation)
