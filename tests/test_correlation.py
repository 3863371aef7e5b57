"""The correlation is the sum that it says it is, by either route, with its gradients."""

import math
import subprocess
import sys
from collections.abc import Callable

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from equigrasp.baselines.without_language import KernelWithoutLanguage
from equigrasp.correlation import Correlation, correlate, correlate_even, correlation_of, fast_length
from equigrasp.errors import InputError
from equigrasp.kernel import LiftedKernel, PlainKernel, SteerableKernel
from equivariance_tests.wrapping import kernel_subject

TOLERANCE = {torch.float32: 1e-5, torch.float64: 1e-11}
"""Of the largest value (see `furthest`): the routes do the same sums in another order."""
Kernels = Callable[[Tensor], Tensor]


def even(taps: Tensor) -> Tensor:
    return taps + taps.flip((3, 4))


def direct(features: Tensor, kernel: Tensor) -> Tensor:
    """By the definition, an image at a time."""
    pairs = zip(features, kernel, strict=True)
    return torch.cat([torch.nn.functional.conv2d(f[None], k, padding=k.shape[-1] // 2) for f, k in pairs])


def answers(
    route: Correlation, shape: tuple[int, int, int, int, int], size: int, dtype: torch.dtype, kernels: Kernels
) -> list[Tensor]:
    """The result, and the gradients by features and taps of a fixed functional; shape is (B, C, O, H, W).

    Each is a sum of products of standard normal numbers, in units of that sum's standard deviation.
    """
    batch, channels, outputs, rows, columns = shape
    rng = torch.Generator().manual_seed(size)
    features = torch.randn(batch, channels, rows, columns, dtype=dtype, generator=rng, requires_grad=True)
    taps = torch.randn(batch, outputs, channels, size, size, dtype=dtype, generator=rng, requires_grad=True)
    field = route(features, kernels(taps))
    functional = torch.randn(field.shape, dtype=dtype, generator=rng)
    sums = field.detach(), *torch.autograd.grad(field, (features, taps), functional)
    products = channels * size**2, outputs * size**2, rows * columns
    return [each / math.sqrt(count) for each, count in zip(sums, products, strict=True)]


def furthest(ours: list[Tensor], theirs: list[Tensor]) -> float:
    """Of the largest value; of a standard deviation where that is less: terms cancel, and their rounding stays."""
    return max(float((a - b).abs().max() / max(float(b.abs().max()), 1.0)) for a, b in zip(ours, theirs, strict=True))


shapes = st.tuples(st.integers(1, 3), st.integers(1, 4), st.integers(1, 5), st.integers(1, 40), st.integers(1, 40))
sizes = st.integers(0, 9).map(lambda radius: 2 * radius + 1)
dtypes = st.sampled_from([torch.float32, torch.float64])


@settings(max_examples=60)
@given(shapes, sizes, dtypes)
def test_any_kernel_is_correlated_as_the_direct_sum(shape: tuple, size: int, dtype: torch.dtype) -> None:
    expected = answers(direct, shape, size, dtype, lambda taps: taps)
    assert furthest(answers(correlate, shape, size, dtype, lambda taps: taps), expected) < TOLERANCE[dtype]


@settings(max_examples=60)
@given(shapes, sizes, dtypes)
@example((1, 1, 1, 16, 39), 1, torch.float32)  # a gradient that is one sum, most of which cancels
def test_an_even_kernel_is_correlated_by_half_of_it(shape: tuple, size: int, dtype: torch.dtype) -> None:
    expected = answers(direct, shape, size, dtype, even)
    assert furthest(answers(correlate_even, shape, size, dtype, even), expected) < TOLERANCE[dtype]


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize(("rows", "columns", "size"), [(80, 160, 33), (160, 320, 25), (6, 9, 25)])
def test_the_routes_agree_at_the_sizes_in_use(rows: int, columns: int, size: int, dtype: torch.dtype) -> None:
    shape = (2, 8, 17, rows, columns)
    ours, theirs = (answers(route, shape, size, dtype, even) for route in (correlate_even, correlate))
    assert furthest(ours, theirs) < TOLERANCE[dtype]


def test_a_kernel_that_is_not_even_would_be_noticed() -> None:
    def nearly(taps: Tensor) -> Tensor:
        return even(taps) + 0.01 * taps

    shape = (1, 2, 3, 20, 30)
    ours, theirs = (answers(route, shape, 9, torch.float64, nearly) for route in (correlate_even, direct))
    assert furthest(ours, theirs) > 1e-3


def test_a_wave_that_was_first_met_in_inference_can_be_trained_with() -> None:
    for route in (correlate, correlate_even):
        with torch.inference_mode():
            route(torch.ones(1, 1, 11, 13), torch.ones(1, 1, 1, 7, 7))
        kernel = torch.ones(1, 1, 1, 7, 7, requires_grad=True)
        route(torch.ones(1, 1, 11, 13), kernel).sum().backward()
        assert kernel.grad is not None


EXPORTED_FIRST = """
from dataclasses import replace
import torch
from equigrasp import models
from equigrasp.export import noise
for name in ("leg-steerable", "leg-unet-no-steerability"):
    policy = models.build(replace(models.MODELS[name], text_encoder="hashing", precision="float32")).eval()
    scene = noise(512, (64, 96), seed=0)
    for strict in (False, True):
        program = torch.export.export(policy, scene, strict=strict).module()
        with torch.no_grad():
            assert torch.equal(program(*scene), policy(*scene)), name
    policy(*scene).sum().backward()
"""


def test_a_wave_that_was_first_met_in_an_export_is_a_number() -> None:
    """In a process of its own, which has met no size before."""
    subprocess.run([sys.executable, "-c", EXPORTED_FIRST], check=True)


KERNELS: dict[str, Callable[[], nn.Module]] = {
    "steerable": lambda: SteerableKernel(12, 3, 17, rings="gaussian"),
    "smooth": lambda: SteerableKernel(12, 3, 17),
    "lifted": lambda: LiftedKernel(12, 3, 9, 8, 72, widths=(8, 8, 8)),
    "no language": lambda: KernelWithoutLanguage(SteerableKernel(12, 3, 17), 12),
}


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", KERNELS)
def test_what_says_that_it_is_even_is(name: str, dtype: torch.dtype) -> None:
    torch.manual_seed(0)
    made = KERNELS[name]().to(dtype)
    assert correlation_of(made) is correlate_even
    kernel = made(torch.randn(2, 12, dtype=dtype)).detach()
    assert float((kernel - kernel.flip((3, 4))).abs().max() / kernel.abs().max()) < {4: 1e-6, 8: 1e-14}[dtype.itemsize]


def test_what_is_not_even_does_not_say_so_and_may_not() -> None:
    torch.manual_seed(0)
    plain = PlainKernel(12, 3, 9, 8, widths=(8, 8, 8))
    assert correlation_of(plain) is correlate
    assert correlation_of(KernelWithoutLanguage(plain, 12)) is correlate
    setattr(plain, "even", True)  # noqa: B010
    with pytest.raises(InputError, match="leave `even` out"):
        kernel_subject(plain, 12)


@given(st.integers(1, 3000))
def test_lengths_are_fast_and_long_enough(length: int) -> None:
    fast = fast_length(length)
    assert length <= fast <= 1.25 * length + 2
    assert fast % 2 == 0
    for prime in (2, 3, 5):
        while fast % prime == 0:
            fast //= prime
    assert fast == 1
