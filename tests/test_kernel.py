"""Kernels turn with their input: the constraint, by scenes that are evaluated and never interpolated.

The law is f(T_g o) = T_g rho(g) f(o) for the correlation f of a scene o with a kernel. Scenes are sums of plane
waves with |k| <= 0.25 pi, so that a turned scene is exact at every point.
"""

import functools
import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from equigrasp import fields
from equigrasp.kernel import LiftedKernel, SteerableKernel, soft_disc, turn_matrix

TURNS = [math.radians(degrees) for degrees in (5, 23, 45, 67.5, 120, 201, 333)]
QUARTERS = [math.pi / 2, math.pi, -math.pi / 2]


def generator(seed: int) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def scene(channels: int, seed: int, band: float) -> Callable[[Tensor], Tensor]:
    """Sums of 16 plane waves of |k| <= band: points `(P, 2)` -> values `(C, P)`."""
    rng = generator(seed)
    direction = 2 * math.pi * torch.rand(16, 1, dtype=torch.float64, generator=rng)
    length = band * torch.rand(16, 1, dtype=torch.float64, generator=rng).sqrt()
    waves = length * torch.cat([direction.cos(), direction.sin()], dim=1)
    amplitude = torch.randn(channels, 16, dtype=torch.float64, generator=rng)
    phase = 2 * math.pi * torch.rand(channels, 16, 1, dtype=torch.float64, generator=rng)
    return lambda points: torch.einsum("cw,cwp->cp", amplitude, torch.cos((waves @ points.T) + phase))


def error(kernel: Tensor, turns: list[float], band: float = 0.25 * math.pi, sign: int = 1) -> float:
    """The largest relative violation of the law over turns and points; kernel `(O, C, k, k)`."""
    size, channels = kernel.shape[-1], kernel.shape[1]
    taps, points = kernel.flatten(2), fields.grid(size)
    worst = 0.0
    for seed, alpha in enumerate(turns):
        c, s = math.cos(alpha), math.sin(alpha)
        g = torch.tensor([[c, -s], [s, c]], dtype=torch.float64)
        o = scene(channels, seed, band)
        rho = fields.rotation(len(kernel) - 1, sign * alpha).to(kernel)
        differences, scale = [], []
        for x in 20 * torch.randn(6, 2, dtype=torch.float64, generator=generator(100 + seed)):
            # a row vector times g is g inverse on a column
            turned = torch.einsum("ocp,cp->o", taps, o((x + points) @ g).to(kernel))
            expected = rho @ torch.einsum("ocp,cp->o", taps, o(x @ g + points).to(kernel))
            differences.append((turned - expected).abs().max().item())
            scale.append(expected.abs().max().item())
        worst = max(worst, max(differences) / max(scale))
    return worst


@functools.cache
def steerable(size: int, dtype: torch.dtype = torch.float64) -> Tensor:
    """A random kernel in the exact basis, `(O, 3, k, k)`."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(size)
        module = SteerableKernel(16, channels=3, size=size)
    embedding = torch.nn.functional.normalize(torch.randn(1, 16, generator=generator(0)))
    if dtype == torch.float64:
        # bases are kept in float32: sample them again for a float64 kernel
        radii = [float(r) for r in range(2, size // 2 - 3)]
        module.double()
        for m in module.frequencies:
            exact = module._basis(m, radii)
            kept = module.get_buffer(f"basis_{m}")
            torch.testing.assert_close(kept / kept.norm(), exact / exact.norm(), rtol=0, atol=1e-7)
            kept.copy_(exact * (kept.norm() / exact.norm()))
    with torch.no_grad():
        return module(embedding.to(dtype))[0]


def lifted(order: int, psi: Tensor, frequency: int = 16) -> Tensor:
    """The definition, turn by turn: psi `(C, k * k)` lifted over C_order, Fourier-transformed over it, float64."""
    angles = [2 * math.pi * j / order for j in range(order)]
    field = torch.stack([(psi * soft_disc(25)) @ turn_matrix(25, angle).T for angle in angles])
    waves = [[1.0] * order]
    for m in range(2, frequency + 1, 2):
        waves += [[2 * math.cos(m * a) for a in angles], [2 * math.sin(m * a) for a in angles]]
    transform = torch.tensor(waves, dtype=torch.float64) / order
    return torch.einsum("oj,jcp->ocp", transform, field).unflatten(2, (25, 25))


def white(seed: int = 0) -> Tensor:
    return torch.randn(3, 625, dtype=torch.float64, generator=generator(seed))


def smooth(seed: int = 0) -> Tensor:
    blobs = torch.randn(3, 6, 2, 1, dtype=torch.float64, generator=generator(seed)) * 4
    distance = (fields.grid(25).T - blobs).norm(dim=2)
    return torch.exp(-0.5 * (distance / 3) ** 2).sum(dim=1)


# SteerableKernel


@pytest.mark.parametrize("size", [17, 25, 33])
def test_the_exact_basis_turns_by_any_angle(size: int) -> None:
    assert error(steerable(size), TURNS) < 2e-4
    assert error(steerable(size), TURNS, band=0.5 * math.pi) < 1e-3


def test_the_exact_basis_is_exact_at_quarter_turns() -> None:
    assert error(steerable(33), QUARTERS) < 1e-12
    assert error(steerable(33, torch.float32), QUARTERS) < 1e-5
    assert error(steerable(33, torch.float32), TURNS) < 2e-4


def test_the_law_fails_for_broken_kernels() -> None:
    kernel = steerable(33)
    assert error(kernel, TURNS, sign=-1) > 0.3
    assert error(kernel, QUARTERS, sign=-1) < 1e-12, "even frequencies hide a wrong sign at 90 degrees"
    half_a_pixel = (kernel + kernel.roll(1, dims=3)) / 2
    assert error(half_a_pixel, TURNS) > 0.05
    assert error(half_a_pixel, QUARTERS) > 0.05
    assert error(kernel.flip(2), TURNS) > 0.3
    noisy = kernel + 0.01 * kernel.std() * torch.randn(kernel.shape, dtype=torch.float64, generator=generator(1))
    assert error(noisy, TURNS) > 2e-4


def test_a_kernel_carries_every_even_frequency_up_to_its_highest() -> None:
    energy = steerable(33).square().sum(dim=(1, 2, 3))
    assert len(energy) == 17
    assert energy.min() > 0
    assert [SteerableKernel(4, 1, size).out_type.size for size in (13, 17, 25, 33)] == [1, 5, 11, 17]


def test_gradients_reach_the_instruction() -> None:
    module = SteerableKernel(8, channels=2, size=17)
    embedding = torch.nn.functional.normalize(torch.ones(2, 8)).requires_grad_()
    module(embedding).square().sum().backward()
    assert embedding.grad is not None
    assert embedding.grad.abs().min() > 0


# LiftedKernel


def test_a_quarter_turn_moves_pixels_and_interpolates_nothing() -> None:
    turned = turn_matrix(25, math.pi / 2) @ white()[0]
    torch.testing.assert_close(turned.view(25, 25), torch.rot90(white()[0].view(25, 25)), rtol=0, atol=0)


def test_the_lift_turns_as_well_as_its_image_interpolates() -> None:
    assert error(lifted(72, white()), QUARTERS) < 1e-12
    assert error(lifted(72, smooth()), QUARTERS) < 1e-12
    assert error(lifted(72, smooth()), TURNS) < 1e-2
    assert 2e-3 < error(lifted(72, white()), TURNS) < 1e-1
    assert error(lifted(72, smooth()), TURNS, sign=-1) > 0.1


def test_the_papers_order_90_is_not_exact_at_90_degrees() -> None:
    assert error(lifted(90, white()), QUARTERS) > 1e-4


def test_the_module_applies_the_lift_to_psi() -> None:
    module = LiftedKernel(8, channels=3, size=25, maximum_frequency=16)
    with torch.no_grad():
        kernel = module.turn(white().float().view(1, 3, 25, 25))[0]
    reference = lifted(72, white())
    torch.testing.assert_close(kernel / kernel.norm(), (reference / reference.norm()).float(), rtol=0, atol=1e-6)
    assert error(kernel, QUARTERS) < 1e-5


def test_a_generated_image_turns_too() -> None:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        module = LiftedKernel(8, channels=3)
    with torch.no_grad():
        kernel = module(torch.nn.functional.normalize(torch.ones(1, 8)))[0]
    assert error(kernel, QUARTERS) < 1e-5
    assert error(kernel, TURNS) < 5e-2


# Both


@pytest.mark.parametrize("kind", [SteerableKernel, LiftedKernel])
def test_a_batch_is_its_members(kind: type) -> None:
    module = kind(8, channels=2, size=21, maximum_frequency=6)
    embeddings = torch.nn.functional.normalize(torch.randn(3, 8, generator=generator(0)))
    with torch.no_grad():
        together = module(embeddings)
        apart = torch.cat([module(each[None]) for each in embeddings])
    assert together.shape == (3, module.out_type.size, 2, 21, 21)
    torch.testing.assert_close(together, apart, rtol=1e-4, atol=1e-6)
    assert module.in_type == fields.trivial_type(2)
    assert module.out_type == fields.even_type(6)


@pytest.mark.parametrize("kind", [SteerableKernel, LiftedKernel])
def test_a_state_dict_holds_parameters_alone(kind: type) -> None:
    module = kind(8, channels=2, size=21, maximum_frequency=6)
    assert set(module.state_dict()) == {name for name, _ in module.named_parameters()}
    module.half()  # a module's own methods stay callable


@pytest.mark.parametrize("kind", [SteerableKernel, LiftedKernel])
def test_an_even_size_has_no_centre(kind: type) -> None:
    with pytest.raises(ValueError, match=r"odd, but this is 32; use 31 or 33"):
        kind(8, size=32)


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="no room for a ring"):
        SteerableKernel(8, size=9)
    with pytest.raises(ValueError, match="carries frequencies up to 16, not 18"):
        SteerableKernel(8, size=33, maximum_frequency=18)
    with pytest.raises(ValueError, match="multiple of 4"):
        LiftedKernel(8, group_order=90)
    with pytest.raises(ValueError, match="does not carry frequency 16"):
        LiftedKernel(8, group_order=32)
    assert LiftedKernel(8, 1, 9, 4, group_order=90, exact_quarter_turns=False).out_type.size == 5
