"""Floating-point operations of a computation by torch's counter, with what it leaves out: FFTs, complex products."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode


def count(function: Callable[[], object]) -> int:
    """Operations of one call, backward passes within it included.

    Convolutions, matrix products, attention; an FFT of n points as 5 n log2 n, half of that where one side is real;
    a complex multiplication as 4 real ones. What works element by element (norms, activations, resizing) is not
    counted, as usual.
    """
    counter = FlopCounterMode(display=False, custom_mapping=_OURS)
    with counter:
        function()
    return counter.get_total_flops()


def _real_fft(image: Tensor, dimensions: list[int], *arguments: Any, out_val: Tensor, **options: Any) -> int:
    longer = max(image, out_val, key=lambda each: math.prod(each.shape))
    points = math.prod(longer.shape[d] for d in dimensions)
    return round(2.5 * longer.numel() * math.log2(points))


def _complex_fft(image: Tensor, dimensions: list[int], *arguments: Any, out_val: Tensor, **options: Any) -> int:
    return round(5 * image.numel() * math.log2(math.prod(image.shape[d] for d in dimensions)))


def _mm(a: Tensor, b: Tensor, *arguments: Any, out_val: Tensor, **options: Any) -> int:
    return _products(out_val.numel() * a.shape[-1], a, b)


def _addmm(c: Tensor, a: Tensor, b: Tensor, *arguments: Any, out_val: Tensor, **options: Any) -> int:
    return _products(out_val.numel() * a.shape[-1], a, b)


def _products(count: int, a: Tensor, b: Tensor) -> int:
    return 2 * count * (4 if a.is_complex() and b.is_complex() else 2 if a.is_complex() or b.is_complex() else 1)


def _raw(formula: Callable[..., int]) -> Callable[..., int]:
    """Have the counter pass tensors, which know their dtype, and not their shapes."""
    formula._get_raw = True  # ty: ignore[missing-attribute]
    return formula


_OURS: dict[Any, Any] = {
    torch.ops.aten._fft_r2c: _raw(_real_fft),
    torch.ops.aten._fft_c2r: _raw(_real_fft),
    torch.ops.aten._fft_c2c: _raw(_complex_fft),
    torch.ops.aten.mm: _raw(_mm),
    torch.ops.aten.bmm: _raw(_mm),
    torch.ops.aten.addmm: _raw(_addmm),
    torch.ops.aten.baddbmm: _raw(_addmm),
}
