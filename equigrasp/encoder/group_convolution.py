"""Layers between fields of the cyclic group C_N: what a U-Net is made of, when it must turn with the scene.

A regular field has N channels at each point, one for each turn by theta_a = 2 pi a / N; a turn by theta_g moves the
point and takes channel a to a + g (escnn's `regular_repr`). A convolution K from regular to regular fields keeps
the law K(g x)[a, b] = K(x)[a - g, b - g] exactly if K(x)[a, b] = w[b - a](R(-theta_a) x) for any functions w; here
they are harmonics on rings, so that any theta_a can be evaluated (Cohen and Welling 2016; Weiler et al. 2018).

Weights are the only state: filters are made from them in each forward pass, so that a state dict is the same in
training and evaluation, and no layer shares a basis with another. Grids carry turns by 90 degrees alone: for those
all is exact, for the others of C_8 it is as good as pixels allow.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

import torch
from escnn import gspaces
from escnn.nn import FieldType
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.constant import Constant
from equigrasp.errors import InputError

FILTER_RINGS: dict[int, tuple[tuple[float, int], ...]] = {
    1: ((0.0, 0),),
    3: ((0.0, 0), (1.0, 2), (math.sqrt(2), 1)),
    6: ((0.7, 1), (1.6, 3), (2.5, 3)),
}
"""For each size of a filter, its rings: radius in pixels, highest frequency. On 3 x 3 they span all that C_4 allows."""

RESAMPLED: dict[str, Callable[[Tensor, Tensor, int], Tensor]] = {
    "same": lambda x, weight, apart: functional.conv2d(
        x, weight, padding=weight.shape[-1] // 2 * apart, dilation=apart
    ),
    "halve": lambda x, weight, apart: functional.conv2d(x, weight, stride=2, padding=weight.shape[-1] // 2 - 1),
    "double": lambda x, weight, apart: functional.conv_transpose2d(
        x, weight.transpose(0, 1), stride=2, padding=weight.shape[-1] // 2 - 1
    ),
}
"""How a filter is laid on the image, its taps so many pixels apart. Even sizes are centred between pixels: they halve
or double the resolution."""


@functools.cache
def cyclic(order: int) -> gspaces.GSpace2D:
    """The plane with the rotations of C_N.

    Raises:
        InputError: if C_N does not contain the quarter turns that a grid has.
    """
    if order < 4 or order % 4:
        raise InputError(f"C_{order} does not contain a turn by 90 degrees; use a multiple of 4: 4 or 8")
    return gspaces.rot2dOnR2(order)


def regular_type(order: int, count: int) -> FieldType:
    """`count` regular fields of C_N: `count * N` channels, the N of one field together."""
    return FieldType(cyclic(order), [cyclic(order).regular_repr] * count)


def scalar_type(order: int, count: int) -> FieldType:
    """`count` fields that C_N moves and does not turn."""
    return FieldType(cyclic(order), [cyclic(order).trivial_repr] * count)


class GroupConvolution(nn.Module):
    """An equivariant convolution without bias between regular or scalar fields of C_N.

    Args:
        in_type: fields of one kind, `regular_type` or `scalar_type`.
        out_type: likewise, of the same C_N.
        size: of the filter, a key of `FILTER_RINGS`.
        resample: a key of `RESAMPLED`; "same" for odd sizes, "halve" or "double" for even ones.
        dilation: pixels from tap to tap; 1 unless `resample` is "same".

    Raises:
        InputError: if a filter that halves or doubles is dilated, or the dilation is less than 1.
    """

    def __init__(
        self, in_type: FieldType, out_type: FieldType, size: int = 3, resample: str = "same", dilation: int = 1
    ) -> None:
        super().__init__()
        if dilation < 1 or (dilation > 1 and resample != "same"):
            raise InputError(
                f"a filter that keeps the resolution may be dilated by 1, 2, .. pixels, but this one ({resample!r}) "
                f'is dilated by {dilation}; use 1, or resample="same"'
            )
        self.in_type = in_type
        self.out_type = out_type
        self.size = size
        self.resample = resample
        self.dilation = dilation
        order = in_type.gspace.fibergroup.order()
        basis = intertwiners(order, size, in_type.size > len(in_type), out_type.size > len(out_type))
        self.basis = Constant(basis)
        # as torch's own convolution: uniform, for an output of a third of the input's variance
        bound = 1 / math.sqrt(len(in_type) * basis[:, 0].square().sum().item())
        self.weight = nn.Parameter(torch.empty(len(out_type), len(basis), len(in_type)).uniform_(-bound, bound))

    def forward(self, x: Tensor) -> Tensor:
        """`(B, in_type.size, H, W)` -> `(B, out_type.size, H, W)`, or half or double the sides."""
        return RESAMPLED[self.resample](x, self.filter(), self.dilation)

    @property
    def reach(self) -> float:
        """How far along each axis, from the centre of what it puts out, it sees; in pixels of the finer image."""
        return (self.size - 1) / 2 * self.dilation

    def filter(self) -> Tensor:
        """The filter that the weights make, `(out_type.size, in_type.size, k, k)`, in memory channels last."""
        weight = torch.einsum("oei,eapb->oapib", self.weight, self.basis.value)
        weight = weight.reshape(self.out_type.size, self.size, self.size, self.in_type.size)
        return weight.permute(0, 3, 1, 2)


class FieldGain(nn.Module):
    """What normalisations of regular fields share: a gain and an offset for each field, the same for its N channels.

    Args:
        type: regular fields.
    """

    def __init__(self, type: FieldType) -> None:
        super().__init__()
        self.in_type = self.out_type = type
        self.weight = nn.Parameter(torch.ones(len(type)))
        self.bias = nn.Parameter(torch.zeros(len(type)))

    def by_channel(self) -> tuple[Tensor, Tensor]:
        """Gain and offset, each `(type.size,)`."""
        order = self.in_type.size // len(self.in_type)
        return self.weight.repeat_interleave(order), self.bias.repeat_interleave(order)


class FieldNorm(FieldGain):
    """Group normalisation: statistics over whole fields and the whole image. For a multiple of 8 fields."""

    def forward(self, x: Tensor) -> Tensor:
        """`(B, type.size, H, W)` -> the same shape, in the weights' dtype (as `unet.GroupNorm`)."""
        return functional.group_norm(x.to(self.weight.dtype), 8, *self.by_channel())


class CellNorm(FieldGain):
    """Layer normalisation cell by cell: statistics over all fields of one cell, in which no other cell has a part."""

    def forward(self, x: Tensor) -> Tensor:
        """`(B, type.size, H, W)` -> the same shape."""
        # channels last: what is one cell's lies together in memory, and no copy is made
        cells = x.permute(0, 2, 3, 1)
        return functional.layer_norm(cells, cells.shape[3:], *self.by_channel()).permute(0, 3, 1, 2)


def weigh(x: Tensor, weights: Tensor) -> Tensor:
    """Each field times a number of its own: `(B, fields * N, H, W)`, `(B, fields)`; scalars turn nothing."""
    order = x.shape[1] // weights.shape[1]
    return x * weights.repeat_interleave(order, dim=1)[:, :, None, None]


def turned_harmonics(size: int, order: int) -> Tensor:
    """The functions of `FILTER_RINGS[size]`, each turned by every theta_a, `(functions, N, size * size)` float64."""
    points = fields.grid(size)
    radius = points.norm(dim=1)
    angle = torch.atan2(points[:, 1], points[:, 0])
    theta = torch.arange(order, dtype=torch.float64)[:, None] * (2 * math.pi / order)
    functions = []
    for ring, highest in FILTER_RINGS[size]:
        profile = torch.exp(-0.5 * ((radius - ring) / 0.5) ** 2)
        functions.append(profile.expand(order, -1))
        # a frequency has no direction at the centre
        around = torch.where(radius > 0, profile, 0.0)
        for m in range(1, highest + 1):
            functions += [around * torch.cos(m * (angle - theta)), around * torch.sin(m * (angle - theta))]
    stacked = torch.stack(functions)
    return stacked / stacked[:, :1].norm(dim=2, keepdim=True).clamp_min(1e-12)


def intertwiners(order: int, size: int, regular_in: bool, regular_out: bool) -> Tensor:
    """A basis of the kernels from one field to one field, `(elements, N or 1, size * size, N or 1)` float64.

    The second index is the channel a of the field that comes out, the last the channel b of the one that goes in.
    """
    harmonics = turned_harmonics(size, order)
    if not regular_in:
        return harmonics[..., None]
    if not regular_out:
        return harmonics.transpose(1, 2)[:, None]
    channels = torch.arange(order)
    shift = (channels - channels[:, None]) % order
    chosen = (shift == channels[:, None, None]).double()
    return torch.einsum("sab,nap->snapb", chosen, harmonics).flatten(0, 1)
