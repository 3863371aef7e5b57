"""How each law of a kernel is measured: (subject, case) -> Measurement, or None where the law is silent.

A kernel's tap w is in pixels from pixel k // 2, x to the right and y up, as the correlation has it.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from equivariance_tests.law import Case, Measurement
from equivariance_tests.reference import T1FFT
from equivariance_tests.scenes import (
    QUARTER_BAND,
    PlaneMotion,
    Scene,
    blobs,
    lattice,
    moved,
    render,
    waves,
)
from equivariance_tests.subjects import KernelSubject, representation

Shape = tuple[int, int]
"""Rows and columns."""

PROBES = 6
"""Points at which a field is looked at in one case."""
SIDE = 65
"""Pixels a side of the odd square that a whole correlation runs over; of the even oblong, one less and one more."""


def on_each_shape(
    measure: Callable[[KernelSubject, Case, Shape], Measurement],
) -> Callable[[KernelSubject, Case], Measurement]:
    """The worse of an odd square and an even oblong: a policy correlates at even sizes, which have no middle pixel."""

    @functools.wraps(measure)
    def measure_each(subject: KernelSubject, case: Case) -> Measurement:
        # of a large kernel, wide enough that some supports are whole
        side = max(SIDE, 2 * subject.kernel(case.seed).shape[-1] + 1)
        found = []
        for shape in ((side, side), (side - 1, side + 1)):
            each = measure(subject, case, shape)
            found.append(replace(each, message=f"on {shape[0]} x {shape[1]} pixels, {each.message}"))
        return max(found, key=lambda each: each.value)

    return measure_each


def inside(points: Tensor, shape: Shape, margin: int = 0) -> Tensor:
    """Which points `(P, 2)` lie on the image, and `margin` pixels or more from its outermost ones: `(P,)` bool."""
    ends = lattice(*shape)[[0, -1]]
    right, left = ends[:, 0].max() - margin, ends[:, 0].min() + margin
    top, bottom = ends[:, 1].max() - margin, ends[:, 1].min() + margin
    x, y = points.T
    return (x >= left) & (x <= right) & (y >= bottom) & (y <= top)


def respond(kernel: Tensor, scene: Scene, points: Tensor) -> Tensor:
    """f(x) = sum over w of K(w) o(x + w), the scene evaluated at x + w: `(O, P)` in the kernel's dtype."""
    size = kernel.shape[-1]
    taps = lattice(size, size)
    around = (points[:, None] + taps).flatten(0, 1)
    return torch.einsum("ocw,cpw->op", kernel.flatten(2), scene(around).to(kernel).unflatten(1, (len(points), -1)))


def steerability(band: float) -> Callable[[KernelSubject, Case], Measurement | None]:
    """K(g x) = rho_out(g) K(x) rho_in(g)^-1, on what correlations with plane waves up to `band` can tell of K."""

    def measure(subject: KernelSubject, case: Case) -> Measurement | None:
        rho = _representations(subject, case.degrees)
        if rho is None:
            return None
        into, out = rho
        kernel, scene = subject.kernel(case.seed), waves(subject.in_type.size, band, case.seed)
        x = 20 * torch.randn(PROBES, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(case.seed + 1))
        motion = PlaneMotion(case.degrees)
        turned = respond(kernel, lambda points: into @ moved(scene, motion)(points), x)
        expected = out.to(kernel) @ respond(kernel, scene, motion.inverse(x))
        return compare(turned, expected, "f(T_g o)", "rho(g) f(o)")

    return measure


def lemma_1(subject: KernelSubject, case: Case) -> Measurement | None:
    """K(g^-1 x) = rho_out(g)^-1 K(x) rho_in(g), tap by tap: quarter turns move pixels and interpolate nothing."""
    rho = _representations(subject, case.degrees)
    if rho is None:
        return None
    into, out = rho
    kernel = subject.kernel(case.seed)
    turned = torch.rot90(kernel, round(case.degrees / 90), (2, 3))
    expected = torch.einsum("po,pchw,cd->odhw", out.to(kernel), kernel, into.to(kernel))
    return compare(turned.flatten(1), expected.flatten(1), "the turned kernel", "rho(g)^-1 K")


@on_each_shape
def lemma_2(subject: KernelSubject, case: Case, shape: Shape) -> Measurement:
    """(T_g K) * (T_g o) = T_g (K * o): turning both turns the correlation; at quarter turns, pixel by pixel."""
    kernel, quarter = subject.kernel(case.seed)[None], round(case.degrees / 90)
    scene = render(blobs(subject.in_type.size, case.seed), *shape).to(kernel)[None]
    turned = subject.correlate(torch.rot90(scene, quarter, (2, 3)), torch.rot90(kernel, quarter, (3, 4)))
    expected = torch.rot90(subject.correlate(scene, kernel), quarter, (2, 3))
    return compare(turned[0].flatten(1), expected[0].flatten(1), "of both turned", "the turned correlation")


@on_each_shape
def correlation(subject: KernelSubject, case: Case, shape: Shape) -> Measurement:
    """(K * o)(x) = sum over w of K(w) o(x + w), zero outside; a convolution has o(x - w).

    Of two instructions in one batch: each scene has its own kernel.
    """
    seeds = (case.seed, case.seed + 1)
    kernels = [subject.kernel(seed) for seed in seeds]
    things = [waves(subject.in_type.size, QUARTER_BAND, seed) for seed in seeds]
    grid = lattice(*shape)
    images = torch.stack([render(thing, *shape) for thing in things]).to(kernels[0])
    fields = subject.correlate(images, torch.stack(kernels)).flatten(2)
    at = torch.randint(len(grid), (4 * PROBES,), generator=torch.Generator().manual_seed(case.seed + 1))

    def bounded(thing: Scene) -> Scene:
        return lambda points: thing(points) * inside(points, shape)

    sums = [respond(kernel, bounded(thing), grid[at]) for kernel, thing in zip(kernels, things, strict=True)]
    return compare(torch.cat(list(fields[..., at]), dim=1), torch.cat(sums, dim=1), "the correlation", "the sum")


def equivariance(subject: KernelSubject, case: Case) -> Measurement | None:
    """f(T_g o) = T_g rho_out(g) f(o), through the subject's own correlation, at the pixel that g keeps."""
    rho = _representations(subject, case.degrees)
    if rho is None:
        return None
    into, out = rho
    kernel = subject.kernel(case.seed)[None]
    side = kernel.shape[-1] + 2
    middle = side // 2
    fields, turned_fields = [], []
    for probe in range(PROBES):
        scene = waves(subject.in_type.size, QUARTER_BAND, case.seed + probe)
        turned = into @ render(moved(scene, PlaneMotion(case.degrees)), side, side).flatten(1)
        images = torch.stack([render(scene, side, side), turned.unflatten(1, (side, side))]).to(kernel)
        before, after = subject.correlate(images, kernel.expand(2, -1, -1, -1, -1))[:, :, middle, middle]
        fields.append(before)
        turned_fields.append(after)
    expected = out.to(kernel) @ torch.stack(fields, dim=1)
    return compare(torch.stack(turned_fields, dim=1), expected, "f(T_g o)", "T_g rho(g) f(o)")


@on_each_shape
def translation(subject: KernelSubject, case: Case, shape: Shape) -> Measurement:
    """f(T_t o)(x) = f(o)(x - t) for every translation t, whole pixels or not."""
    kernel = subject.kernel(case.seed)
    thing, shift = blobs(subject.in_type.size, case.seed), (case.x, case.y)
    # at the border the table ends and the scene does not: only whole supports are compared
    grid = lattice(*shape)
    image = render(moved(thing, PlaneMotion(0.0, shift)), *shape).to(kernel)
    field = subject.correlate(image[None], kernel[None])[0].flatten(1)
    whole = inside(grid, shape, kernel.shape[-1] // 2).nonzero()[:, 0]
    chosen = torch.randint(len(whole), (4 * PROBES,), generator=torch.Generator().manual_seed(case.seed + 1))
    at = whole[chosen]
    expected = respond(kernel, thing, grid[at] - grid.new_tensor(shift))
    # of a small kernel none of these points may see the object
    return compare(field[:, at], expected, "f(T_t o)(x)", "f(o)(x - t)", float(field.abs().max()))


def mirror(subject: KernelSubject, case: Case) -> Measurement | None:
    """rho_out(pi) = 1: a gripper turned by half a turn is the same gripper."""
    half = representation(subject.out_type, 180.0)
    if half is None:
        return Measurement(math.inf, "the type's group has no half turn")
    return compare(half, torch.eye(len(half), dtype=half.dtype), "rho(pi)", "the identity")


def fourier(subject: KernelSubject, case: Case) -> Measurement | None:
    """Bins are the score at their angles: the read-out is the circle's inverse Fourier transform, lie_learn's."""
    read_out = subject.read_out
    if read_out is None:
        return None
    bins, size = read_out.shape
    if bins < size:
        return Measurement(math.inf, f"{bins} bins carry no frequency {size - 1}, at which its type ends")
    rng = torch.Generator().manual_seed(case.seed)
    c = torch.randn(size, dtype=torch.float64, generator=rng)
    middle = bins // 2
    spectrum = torch.zeros(bins, dtype=torch.complex128)
    spectrum[middle] = c[0]
    for n in range(1, (size - 1) // 2 + 1):
        coefficient = torch.complex(c[2 * n - 1], -c[2 * n]) / 2
        spectrum[middle + n] += coefficient
        spectrum[middle - n] += coefficient.conj()
    expected = torch.from_numpy(T1FFT.synthesize(spectrum.numpy()).real).to(read_out)
    return compare((read_out @ c.to(read_out))[:, None], expected[:, None], "the bins", "lie_learn's T1FFT")


def bins_turn(subject: KernelSubject, case: Case) -> Measurement | None:
    """A turn by j bins moves every score j bins on: read_out rho(g) = shift^j read_out."""
    rho, read_out = representation(subject.out_type, case.degrees), subject.read_out
    if read_out is None or rho is None:
        return None
    steps = case.degrees * len(read_out) / 180
    if abs(steps - round(steps)) > 1e-9:
        return None
    turned = read_out @ rho.to(read_out)
    return compare(turned, torch.roll(read_out, round(steps), 0), "the bins of rho(g) c", "shifted bins")


def compare(measured: Tensor, expected: Tensor, this: str, that: str, scale: float = 0.0) -> Measurement:
    """The largest difference relative to the largest expected value, or a larger scale, and where; rows are outputs."""
    difference = (measured - expected).abs()
    if not difference.isfinite().all():
        return Measurement(math.inf, f"{this} is not finite")
    row, column = divmod(int(difference.argmax()), difference.shape[1])
    scale = max(scale, float(expected.abs().max()))
    value = float(difference.max()) / scale if scale else math.inf
    return Measurement(
        value,
        f"output {row} of {len(expected)}: {this} is {float(measured[row, column]):.4g} where {that} is "
        f"{float(expected[row, column]):.4g}",
    )


def _representations(subject: KernelSubject, degrees: float) -> tuple[Tensor, Tensor] | None:
    into, out = representation(subject.in_type, degrees), representation(subject.out_type, degrees)
    return None if into is None or out is None else (into, out)
