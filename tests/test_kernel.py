"""Kernels turn with their input: the constraint, by scenes that are evaluated and never interpolated.

The law is f(T_g o) = T_g rho(g) f(o) for the correlation f of a scene o with a kernel. Scenes are sums of plane
waves with |k| <= 0.25 pi, so that a turned scene is exact at every point.
"""

import copy
import functools
import math
from collections.abc import Callable

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import jv
from seeded import made
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.baselines.without_language import KernelWithoutLanguage
from equigrasp.constant import Constant
from equigrasp.errors import InputError
from equigrasp.kernel import LiftedKernel, PlainKernel, SteerableKernel
from equigrasp.kernel.image import KernelImage, convolve_tiled
from equigrasp.kernel.lift import HalfTurnLift, QuarterTurnLift, frequency_weights, lift_matrix, soft_disc, turn_matrix
from equigrasp.kernel.rings import RINGS, Rings

TURNS = [math.radians(degrees) for degrees in (5, 23, 45, 67.5, 120, 201, 333)]
BINS = [math.radians(degrees) for degrees in (5, 25, 40, 65, 115, 155, 170)]
QUARTERS = [math.pi / 2, math.pi, -math.pi / 2]
KERNELS = [SteerableKernel, LiftedKernel, PlainKernel]


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


def error(kernel: Tensor, turns: list[float], band: float = 0.25 * math.pi, sign: int = 1, first: int = 0) -> float:
    """The largest relative violation of the law over turns and points; kernel `(O, C, k, k)`, `first` scene's seed."""
    size, channels = kernel.shape[-1], kernel.shape[1]
    taps, points = kernel.flatten(2), fields.grid(size)
    worst = 0.0
    for seed, alpha in enumerate(turns, first):
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
def module(size: int, rings: str = "smooth") -> SteerableKernel:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(size)
        return SteerableKernel(16, channels=3, size=size, rings=rings).double()


def steerable(size: int, rings: str = "smooth", seed: int = 0, dtype: torch.dtype = torch.float64) -> Tensor:
    """A kernel whose coefficients in the exact basis are white, `(O, 3, k, k)`."""
    made = module(size, rings) if dtype == torch.float64 else copy.deepcopy(module(size, rings)).to(dtype)
    return made.expand(torch.randn(1, 3, sum(made.elements), dtype=torch.float64, generator=generator(seed)).to(dtype))[
        0
    ]


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


@pytest.mark.parametrize(("rings", "quarter_band", "half_band"), [("smooth", 1e-5, 1e-4), ("gaussian", 2e-4, 1e-3)])
def test_200_kernels_turn_by_any_angle(rings: str, quarter_band: float, half_band: float) -> None:
    angles = (2 * math.pi * torch.rand(200, generator=generator(7))).tolist()
    kernels = [steerable(33, rings, seed) for seed in range(200)]
    for band, bound in ((0.25 * math.pi, quarter_band), (0.5 * math.pi, half_band)):
        worst = max(
            error(kernel, [angle], band, first=seed)
            for seed, (kernel, angle) in enumerate(zip(kernels, angles, strict=True))
        )
        # a bound that nothing comes near would say nothing
        assert bound / 200 < worst < bound


@pytest.mark.parametrize("size", [17, 25, 49, 65])
def test_every_size_turns_by_any_angle(size: int) -> None:
    assert error(steerable(size), TURNS) < 1e-5
    assert error(steerable(size), TURNS, band=0.5 * math.pi) < 1e-4


@pytest.mark.parametrize("rings", RINGS)
def test_the_exact_basis_is_exact_at_quarter_turns(rings: str) -> None:
    assert error(steerable(33, rings), QUARTERS) < 1e-12
    assert error(steerable(33, rings, dtype=torch.float32), QUARTERS) < 1e-5
    assert error(steerable(33, rings, dtype=torch.float32), TURNS) < 2e-4


@pytest.mark.parametrize("kind", [SteerableKernel, LiftedKernel])
def test_a_module_is_exact_in_float64_wherever_it_was_before(kind: type) -> None:
    with torch.random.fork_rng(devices=[]):
        made = kind(8, channels=3, size=25, maximum_frequency=10)
    embedding = nn.functional.normalize(torch.ones(1, 8, dtype=torch.float64))
    with torch.no_grad():
        assert error(made.to(torch.bfloat16).double()(embedding)[0], QUARTERS) < 1e-12


def test_a_constant_is_rounded_once() -> None:
    exact = torch.rand(50, dtype=torch.float64, generator=generator(0))
    for was in (torch.float32, torch.bfloat16):
        assert torch.equal(copy.deepcopy(Constant(exact)).to(was).double().value, exact)
        buffer = nn.Module()
        buffer.register_buffer("value", exact)
        assert not torch.equal(buffer.to(was).double().get_buffer("value"), exact), "a buffer stays rounded"
    assert Constant(exact).value.dtype == torch.float32
    assert torch.equal(Constant(exact).to(torch.bfloat16).value, exact.to(torch.bfloat16))
    assert not Constant(exact).state_dict()


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


def weighed(family: Rings, maximum_frequency: int) -> Tensor:
    """A white kernel of 33 pixels on rings out to radius 12."""
    rng, parts = generator(0), []
    for m in range(0, maximum_frequency + 1, 2):
        basis = family.basis(33, 12, m)
        parts.append(torch.einsum("cn,ndp->dcp", torch.randn(3, len(basis), dtype=torch.float64, generator=rng), basis))
    return torch.cat(parts).unflatten(2, (33, 33))


def test_rings_that_carry_too_much_fail_the_law() -> None:
    assert error(weighed(RINGS["smooth"], 22), TURNS, band=0.5 * math.pi) < 1e-4
    too_fine = Rings(innermost=0, sigma=0.5, cutoff=2.0, smooth=True)
    assert error(weighed(too_fine, 22), TURNS, band=0.5 * math.pi) > 1e-3
    too_fast = Rings(innermost=0, sigma=1.0, cutoff=6.0, smooth=True)
    assert error(weighed(too_fast, 34), TURNS, band=0.5 * math.pi) > 1e-3


@pytest.mark.parametrize(("rings", "is_one"), [("smooth", True), ("gaussian", False)])
def test_a_smooth_ring_is_a_blurred_circle(rings: str, is_one: bool) -> None:
    family, k, m = RINGS[rings], torch.linspace(0.1, 1.2, 9, dtype=torch.float64), 2
    radii = [radius for radius in family.radii(12) if m <= family.carried(radius)]
    along_x = torch.exp(1j * fields.grid(33)[:, :1] * k)
    # of the two elements of a ring, a wave along x sees the one that is a cosine
    seen = (family.basis(33, 12, m)[:, 0].to(along_x.dtype) @ along_x).abs().unflatten(0, (2, -1)).amax(dim=0)
    # the Fourier transform of a circle is a Bessel function, that of a blur a Gaussian
    bessel = torch.from_numpy(jv(m, k.numpy() * torch.tensor(radii)[:, None].numpy())).abs()
    blurred = torch.exp(-((family.sigma * k) ** 2) / 2) * bessel
    difference = nn.functional.normalize(seen) - nn.functional.normalize(blurred)
    assert bool(difference.abs().max() < 1e-4) is is_one


def test_smooth_rings_carry_at_least_what_gaussian_ones_do() -> None:
    smooth, gaussian = (SteerableKernel(4, 1, 33, 16, rings=rings).elements for rings in ("smooth", "gaussian"))
    assert all(a >= b for a, b in zip(smooth, gaussian, strict=True))
    assert [SteerableKernel(4, 1, size, rings="gaussian").out_type.size for size in (13, 17, 25, 33)] == [1, 5, 11, 17]
    assert [SteerableKernel(4, 1, size).out_type.size for size in (13, 17, 25, 33, 65)] == [3, 7, 15, 23, 35]


def test_a_kernel_carries_every_even_frequency_up_to_its_highest() -> None:
    energy = steerable(33).square().sum(dim=(1, 2, 3))
    assert len(energy) == 23
    assert energy.min() > 0.05 * energy.mean()


# LiftedKernel


def test_a_quarter_turn_moves_pixels_and_interpolates_nothing() -> None:
    turned = turn_matrix(25, math.pi / 2) @ white()[0]
    torch.testing.assert_close(turned.view(25, 25), torch.rot90(white()[0].view(25, 25)), rtol=0, atol=0)


def test_the_lift_turns_as_well_as_its_image_interpolates() -> None:
    for psi, worst in ((smooth(), 1e-2), (white(), 1e-1)):
        kernel = lifted(72, psi)
        assert error(kernel, QUARTERS) < 1e-12
        assert error(kernel, BINS) < worst
        assert 1e-4 < error(kernel, TURNS) < worst
    assert error(lifted(72, smooth()), TURNS, sign=-1) > 0.1


def test_the_papers_order_90_is_not_exact_at_90_degrees() -> None:
    assert error(lifted(90, white()), QUARTERS) > 1e-4


def test_the_module_applies_the_lift_to_psi() -> None:
    module = LiftedKernel(8, channels=3, size=25, maximum_frequency=16)
    with torch.no_grad():
        kernel = module.lift(white().float().view(1, 3, 25, 25))[0]
    reference = lifted(72, white()) * frequency_weights(16)[:, None, None, None]
    torch.testing.assert_close(kernel / kernel.norm(), (reference / reference.norm()).float(), rtol=0, atol=1e-6)
    assert error(kernel, QUARTERS) < 1e-5


@pytest.mark.parametrize("broken", [False, True])
def test_coefficients_may_be_rounded_and_what_they_weigh_is_not(broken: bool) -> None:
    """Under autocast a steerable kernel keeps float32's tolerance; one whose taps are rounded after it does not."""
    kappa = copy.deepcopy(module(33)).float()
    weights = torch.randn(1, 3, sum(kappa.elements), generator=generator(0)).bfloat16()
    with torch.autocast("cpu", torch.bfloat16):
        kernel = kappa.expand(weights)[0]
    assert kernel.dtype == torch.float32
    assert (error(kernel.bfloat16() if broken else kernel, TURNS) < 2e-4) != broken


@pytest.mark.parametrize("broken", [False, True])
def test_an_image_may_be_rounded_and_its_lift_is_not(monkeypatch: pytest.MonkeyPatch, broken: bool) -> None:
    kappa = LiftedKernel(8, channels=3, size=25, maximum_frequency=16)
    psi = white().view(1, 3, 25, 25).bfloat16()
    monkeypatch.setattr(kappa.psi, "forward", lambda embedding: psi)
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        kernel = (kappa.lift(psi) if broken else kappa(torch.ones(1, 8)))[0].float()
    reference = lifted(72, psi.double().flatten(2)[0]) * frequency_weights(16)[:, None, None, None]
    furthest = (kernel / kernel.norm() - (reference / reference.norm()).float()).abs().max()
    assert (furthest < 1e-6) != broken


def amplitudes() -> Tensor:
    """Of the frequencies 0, 2, .. 16 of fresh lifted kernels, in all 1."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        kernels = [LiftedKernel(16)(torch.nn.functional.normalize(torch.randn(8, 16), dim=1)) for _ in range(3)]
    energy = torch.stack(kernels).square().sum(dim=(0, 1, 3, 4, 5)).detach()
    energy = torch.cat([energy[:1], energy[1:].view(-1, 2).sum(dim=1)])
    return (energy / energy.mean()).sqrt()


def test_a_lifted_kernel_can_tell_one_angle_from_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    assert amplitudes().min() > 0.25
    # a smooth image has nothing to turn
    with monkeypatch.context() as patch:
        patch.setattr("equigrasp.kernel.image.WAVES", (1e-6,))
        assert amplitudes().min() < 0.15
    # and without its weight the highest frequency is a fortieth of the lowest
    monkeypatch.setattr("equigrasp.kernel.lifted.frequency_weights", lambda highest: torch.ones(1 + highest))
    assert amplitudes().min() < 0.15


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(
    ("size", "frequency", "order"), [(25, 16, 72), (9, 8, 36), (5, 0, 4), (3, 2, 12), (17, 34, 72)]
)
def test_a_quarter_of_the_pixels_makes_the_same_kernel(
    size: int, frequency: int, order: int, dtype: torch.dtype
) -> None:
    matrix = lift_matrix(size, frequency, order)
    psi = torch.randn(2, 3, size, size, dtype=dtype, generator=generator(1), requires_grad=True)
    weights = torch.randn(2, 1 + frequency, 3, size, size, dtype=dtype, generator=generator(2))
    answers = []
    for lift in (QuarterTurnLift(matrix, size).to(dtype), HalfTurnLift(matrix, size).to(dtype)):
        kernel = lift(psi)
        answers.append([kernel, *torch.autograd.grad(kernel, psi, weights)])
    tolerance = {torch.float32: 1e-5, torch.float64: 1e-11}[dtype]
    for mine, theirs in zip(*answers, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=tolerance * float(theirs.detach().abs().max()))


def test_an_order_without_quarter_turns_needs_half_of_the_pixels() -> None:
    matrix = lift_matrix(25, 16, 90)
    psi = white().view(1, 3, 25, 25)
    half = HalfTurnLift(matrix, 25).double()(psi)
    assert float((QuarterTurnLift(matrix, 25).double()(psi) - half).abs().max() / half.abs().max()) > 1e-4
    made = LiftedKernel(8, channels=3, group_order=90, exact_quarter_turns=False)
    assert isinstance(made.lift, HalfTurnLift)


@given(st.integers(1, 3), st.integers(1, 9), st.integers(1, 9), st.sampled_from([torch.float32, torch.float64]))
def test_a_tiled_vector_is_convolved_without_its_tiles(batch: int, rows: int, columns: int, dtype: torch.dtype) -> None:
    vector = torch.randn(batch, 5, dtype=dtype, generator=generator(1), requires_grad=True)
    weight = torch.randn(4, 5, 3, 3, dtype=dtype, generator=generator(2), requires_grad=True)
    upstream = torch.randn(batch, 4, rows, columns, dtype=dtype, generator=generator(3))
    tiled = vector[:, :, None, None].expand(-1, -1, rows, columns)
    tolerance = {torch.float32: 1e-5, torch.float64: 1e-11}[dtype]
    answers = []
    for image in (convolve_tiled(vector, weight, (rows, columns)), nn.functional.conv2d(tiled, weight, padding=1)):
        answers.append([image, *torch.autograd.grad(image, (vector, weight), upstream)])
    for mine, theirs in zip(*answers, strict=True):
        torch.testing.assert_close(mine, theirs, rtol=0, atol=tolerance * float(theirs.detach().abs().max()))


def test_a_generated_image_turns_too() -> None:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        module = LiftedKernel(8, channels=3)
    with torch.no_grad():
        kernel = module(torch.nn.functional.normalize(torch.ones(1, 8)))[0]
    assert error(kernel, QUARTERS) < 1e-5
    assert error(kernel, TURNS) < 5e-2


# PlainKernel, and a kernel without language


def test_a_plain_kernel_fails_every_turn() -> None:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        made = PlainKernel(8, channels=3)
    with torch.no_grad():
        kernel = made(nn.functional.normalize(torch.ones(1, 8)))[0]
    assert error(kernel, QUARTERS) > 0.1
    assert error(kernel, TURNS) > 0.1


def test_without_language_a_kernel_keeps_its_symmetry_and_says_one_thing() -> None:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        made = KernelWithoutLanguage(SteerableKernel(8, channels=3, size=25), 8).double()
    first, second = made(nn.functional.normalize(torch.randn(2, 8, dtype=torch.float64, generator=generator(0))))
    assert torch.equal(first, second)
    assert error(first.detach(), TURNS) < 1e-5
    first.square().sum().backward()
    assert made.vector.grad is not None
    assert made.vector.grad.abs().min() > 0
    assert (made.in_type, made.out_type) == (made.kernel.in_type, made.kernel.out_type)


# All


def sentences(count: int) -> Tensor:
    """Unit embeddings as wide as MiniLM's, `(count, 384)`."""
    return nn.functional.normalize(torch.randn(count, 384, generator=generator(3)), dim=1)


@pytest.mark.parametrize("kind", KERNELS)
def test_a_fresh_kernel_is_another_for_another_instruction(kind: type) -> None:
    with torch.no_grad():
        kernels = made(kind, 384)(sentences(6)).flatten(1)
    assert (kernels - kernels.mean(dim=0)).norm(dim=1).mean() > 0.2 * kernels.norm(dim=1).mean()


@pytest.mark.parametrize("kind", KERNELS)
def test_a_kernel_ends_within_its_pixels(kind: type) -> None:
    """Features just outside it count as little as those just inside, so that a scene may move by a pixel."""
    with torch.no_grad():
        kernel = made(kind, 384)(sentences(2)).abs()
    assert kernel[..., 1:-1, 1:-1].amax() > 30 * max(kernel[..., edge, :].amax() for edge in (0, -1))
    assert kernel[..., 1:-1, 1:-1].amax() > 30 * max(kernel[..., edge].amax() for edge in (0, -1))


def test_an_image_hears_the_instruction_in_each_of_three_places() -> None:
    """Before the U-Net, at its coarsest scale, and after it: each alone makes a difference, and without all, none."""

    def differs(*silent: str) -> bool:
        image = made(KernelImage, 384, 8, 25, (32, 64, 192))
        with torch.no_grad():
            for name in silent:
                weight = image.get_parameter(name)
                (weight[:, 64:] if name.startswith("bottom") else weight).zero_()
            first, second = image(sentences(2))
        return bool((first - second).abs().max() > 1e-3)

    places = ("tile.weight", "bottom.0.0.weight", "gate.weight")
    for heard in places:
        assert differs(*(name for name in places if name != heard)), heard
    assert not differs(*places)


@pytest.mark.parametrize("kind", KERNELS)
def test_gradients_reach_the_instruction(kind: type) -> None:
    made = kind(8, channels=2, size=17, maximum_frequency=4)
    embedding = nn.functional.normalize(torch.ones(2, 8)).requires_grad_()
    made(embedding).square().sum().backward()
    assert embedding.grad is not None
    assert embedding.grad.abs().min() > 0


@pytest.mark.parametrize("kind", KERNELS)
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


@pytest.mark.parametrize("kind", KERNELS)
def test_a_state_dict_holds_parameters_alone(kind: type) -> None:
    module = kind(8, channels=2, size=21, maximum_frequency=6)
    assert set(module.state_dict()) == {name for name, _ in module.named_parameters()}
    module.half()  # a module's own methods stay callable


@pytest.mark.parametrize("kind", KERNELS)
def test_an_even_size_has_no_centre(kind: type) -> None:
    with pytest.raises(ValueError, match=r"odd, but this is 32; use 31 or 33"):
        kind(8, size=32)


@pytest.mark.parametrize("kind", KERNELS)
@pytest.mark.parametrize("size", [-3, -1, 0, 1, 2, 3, 4])
def test_a_size_without_room_is_refused_with_the_least_that_has_some(kind: type, size: int) -> None:
    with pytest.raises(InputError, match=rf"of {size} pixels a side has no room .* use an odd size of 5 or more"):
        kind(8, 2, size)


def test_of_the_least_size_a_lifted_kernel_has_every_frequency() -> None:
    kernel = LiftedKernel(8, 2, 5, 4)(torch.randn(4, 8, generator=generator(0)))
    assert (kernel.transpose(0, 1).flatten(1).norm(dim=1) > 0.01).all()
    smaller = lift_matrix(3, 4, 72)
    assert smaller[1:3].norm() < 1e-12 < smaller[0].norm(), "three pixels have no frequency 2"


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(ValueError, match="no room for a ring"):
        SteerableKernel(8, size=9)
    with pytest.raises(ValueError, match="carries frequencies up to 22, not 24"):
        SteerableKernel(8, size=33, maximum_frequency=24)
    with pytest.raises(ValueError, match="carries frequencies up to 16, not 18"):
        SteerableKernel(8, size=33, maximum_frequency=18, rings="gaussian")
    with pytest.raises(ValueError, match="no family of rings 'smoth'; did you mean 'smooth'"):
        SteerableKernel(8, rings="smoth")
    with pytest.raises(ValueError, match="multiple of 4"):
        LiftedKernel(8, group_order=90)
    with pytest.raises(ValueError, match="does not carry frequency 16"):
        LiftedKernel(8, group_order=32)
    assert LiftedKernel(8, 1, 9, 4, group_order=90, exact_quarter_turns=False).out_type.size == 5


@pytest.mark.parametrize("rings", RINGS)
@given(margin=st.sampled_from([2.0, 2.5, 3.0, 3.5, 4.0, 4.5]))
def test_the_size_that_a_refusal_recommends_is_the_least_that_is_taken(rings: str, margin: float) -> None:
    with pytest.raises(ValueError, match="no room for a ring") as refusal:
        SteerableKernel(8, channels=1, size=5, margin=margin, rings=rings)
    size = int(str(refusal.value).split("odd size of ")[1].split()[0])
    SteerableKernel(8, channels=1, size=size, margin=margin, rings=rings)
    with pytest.raises(ValueError, match="no room for a ring"):
        SteerableKernel(8, channels=1, size=size - 2, margin=margin, rings=rings)


@pytest.mark.parametrize("kind", KERNELS)
def test_embeddings_that_cannot_be_are_refused(kind: type) -> None:
    made = kind(8, channels=2, size=17, maximum_frequency=4)
    with pytest.raises(ValueError, match=r"made for embeddings \(B, 8\), but this is \(1, 9\)"):
        made(torch.zeros(1, 9))
    with pytest.raises(ValueError, match=r"floating dtype, but this is torch.int64"):
        made(torch.zeros(1, 8, dtype=torch.int64))
