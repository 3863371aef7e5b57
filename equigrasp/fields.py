"""The fields of the method and the Fourier transform between them.

A grasp score over angles, s(theta) with period pi, is a vector in two equivalent coordinates:

- *bins*: its values at theta_i = i pi / bins, i = 0 .. bins - 1, which an angle of one bin permutes;
- *even irreps*: s(theta) = a_0 + sum over even m of a_m cos(m theta) + b_m sin(m theta), ordered
  (a_0, a_2, b_2, a_4, b_4, ...). Odd frequencies cannot exist, because the gripper is its own mirror.

Sign: angles are counter-clockwise with world y up. A turn by alpha takes s to theta -> s(theta - alpha), so
that (a_m, b_m) turns by the matrix [[cos m alpha, -sin m alpha], [sin m alpha, cos m alpha]], which is escnn's
`irrep(m)`. The complex coefficient a_m - i b_m of exp(i m theta) gains the phase exp(-i m alpha).

Source: Language-conditioned Equivariant Grasp (LEG), section on steerable kernels: trivial in, irreps out.
"""

from __future__ import annotations

import copyreg
import functools
import math
import pickle
import warnings
from typing import Any

import torch
from torch import Tensor

from equigrasp.errors import InputError
from equigrasp.late import late

LATE = ("scipy.stats", "sklearn.utils.extmath", "pymanopt", "pymanopt.manifolds", "pymanopt.optimizers")
"""A quarter of a start, for escnn's null spaces of sparse matrices, its initialisation by orthogonal ones, and its
search for one in a span; pymanopt cannot be imported by a Python that drops docstrings, as `-OO` does."""

with warnings.catch_warnings(), late(*LATE):
    # escnn says at every start that SO(3) coefficients would be slow without py3nj; only SO(2) is used here
    warnings.simplefilter("ignore")
    from escnn import gspaces
    from escnn.group import Representation, directsum
    from escnn.nn import FieldType

HIGHEST_FREQUENCY = 34
"""At 36 bins the sine of frequency 36 samples to zero: even frequencies stop here."""


@functools.cache
def gspace(maximum_frequency: int = HIGHEST_FREQUENCY) -> gspaces.GSpace2D:
    """The plane with the continuous rotations SO(2), irreps up to the given frequency at hand."""
    return gspaces.rot2dOnR2(-1, maximum_frequency=maximum_frequency)


def trivial_type(channels: int) -> FieldType:
    """Scalars that move with the scene and do not turn: the type of phi's features and of an observation.

    Raises:
        InputError: if there is no channel.
    """
    if channels < 1:
        raise InputError(f"a field has a channel or more, but this is {channels}")
    space = gspace()
    return FieldType(space, [space.trivial_repr] * channels)


def even_irreps(maximum_frequency: int) -> Representation:
    """The representation 0 + 2 + 4 + .. + maximum_frequency of SO(2), of size 1 + maximum_frequency.

    Raises:
        InputError: if the frequency is odd, negative or above 34.
    """
    if maximum_frequency % 2 or not 0 <= maximum_frequency <= HIGHEST_FREQUENCY:
        raise InputError(
            f"the highest frequency of a grasp score is even and within 0 .. {HIGHEST_FREQUENCY} "
            f"(36 bins carry no more), but this is {maximum_frequency}"
        )
    group = gspace().fibergroup
    # one directsum, never a list of irreps: escnn sorts separate irreps as text, 10 before 2
    irreps: list[Representation] = [group.irrep(m) for m in range(0, maximum_frequency + 1, 2)]
    # escnn keeps bases by name, for the whole process
    return directsum(irreps, name=f"even-{maximum_frequency}")


def even_type(maximum_frequency: int) -> FieldType:
    """A grasp score over angles at each point, in even irreps: what the correlation puts out."""
    return FieldType(gspace(), [even_irreps(maximum_frequency)])


def synthesis(maximum_frequency: int, bins: int = 36) -> Tensor:
    """Even irreps -> bins: the inverse Fourier transform, `(bins, 1 + maximum_frequency)` float64.

    Raises:
        InputError: if the bins cannot carry that frequency without aliasing.
    """
    if not 0 <= maximum_frequency < bins or maximum_frequency % 2:
        raise InputError(f"{bins} bins over pi carry even frequencies below {bins}, but this is {maximum_frequency}")
    theta = torch.arange(bins, dtype=torch.float64) * (math.pi / bins)
    columns = [torch.ones_like(theta)]
    for m in range(2, maximum_frequency + 1, 2):
        columns += [torch.cos(m * theta), torch.sin(m * theta)]
    return torch.stack(columns, dim=1)


def analysis(maximum_frequency: int, bins: int = 36) -> Tensor:
    """Bins -> even irreps: the Fourier transform, `(1 + maximum_frequency, bins)` float64.

    It undoes `synthesis`: analysis @ synthesis = 1, and synthesis @ analysis projects onto the frequencies kept.
    """
    # columns of `synthesis` are orthogonal with squared norms bins, bins/2, bins/2, ...
    matrix = synthesis(maximum_frequency, bins).T * (2 / bins)
    matrix[0] /= 2
    return matrix


def rotation(maximum_frequency: int, alpha: float) -> Tensor:
    """rho(alpha) on even irreps, `(1 + maximum_frequency,) * 2` float64; alpha counter-clockwise, radians.

    Written out, so that escnn's representation can be tested against it (and the other way round).
    """
    blocks = [torch.ones(1, 1, dtype=torch.float64)]
    for m in range(2, maximum_frequency + 1, 2):
        c, s = math.cos(m * alpha), math.sin(m * alpha)
        blocks.append(torch.tensor([[c, -s], [s, c]], dtype=torch.float64))
    return torch.block_diag(*blocks)


def grid(size: int) -> Tensor:
    """Centres of a `size` x `size` kernel's pixels, `(size * size, 2)` x, y float64, rows first, y up.

    In pixels from the kernel's centre; row 0 lies at the top, at y = +(size - 1) / 2: escnn's own convention.
    """
    line = torch.arange(size, dtype=torch.float64) - (size - 1) / 2
    y, x = torch.meshgrid(-line, line, indexing="ij")
    return torch.stack([x.reshape(-1), y.reshape(-1)], dim=1)


def _rotations(order: int) -> gspaces.GSpace2D:
    return gspace() if order < 0 else gspaces.rot2dOnR2(order)


def _again(order: int, names: list[str], irreps: list[list[tuple[int, ...]]]) -> FieldType:
    """The field type of rotations of the plane: its representations by their names, or as sums of irreps."""
    space = _rotations(order)
    known = space.fibergroup.representations
    return FieldType(
        space,
        [
            known[name] if name in known else directsum([space.irrep(*each) for each in parts], name=name)
            for name, parts in zip(names, irreps, strict=True)
        ],
    )


def _reduced(field_type: FieldType) -> str | tuple[Any, ...]:
    """What a field type pickles as; if it is not of rotations of the plane, what it does without this."""
    order = field_type.gspace.fibergroup.order()
    if order != 1 and field_type.gspace == _rotations(order):
        parts = field_type.representations
        made = (order, [each.name for each in parts], [list(each.irreps) for each in parts])
        if _again(*made) == field_type:
            return _again, made
    return field_type.__reduce_ex__(pickle.HIGHEST_PROTOCOL)


# escnn's groups hold functions that do not pickle, and with them no module that says its types would
copyreg.pickle(FieldType, _reduced)
