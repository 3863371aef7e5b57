"""How a user's module becomes what laws are aimed at: checked for what it declares, and asked politely.

`subjects.py` says what a kernel and a policy are.
"""

from __future__ import annotations

import math
from dataclasses import replace
from numbers import Real
from typing import Any

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.correlation import correlation_of
from equigrasp.errors import InputError
from equigrasp.naming import attribute
from equigrasp.workspace import WORKSPACE
from equivariance_tests.asking import (
    FLOATS,
    ask,
    ask_twice,
    check_batches,
    check_finite,
    check_scores,
    checked_correlation,
    dtype_of,
    embedding_size_of,
    has_types,
    is_policy,
    some_scene,
    some_words,
    taken_for,
)
from equivariance_tests.subjects import SIDES, KernelSubject, PolicySubject, order_of

WORDS = 8
"""Embeddings that are tried before a kernel is called zero."""


def subjects_of(module: Any, embedding_size: int | None = None) -> list[KernelSubject | PolicySubject]:
    """What can be tested of a module: a kernel, or a policy and, where it has one, its kernel.

    What declares types is a kernel, unless its `forward` takes an image and an embedding, as escnn's modules may.

    Raises:
        InputError: if it is neither, or does not do what it declares; the sentence says what and what to do.
    """
    if isinstance(module, KernelSubject | PolicySubject):
        return [module]
    if isinstance(module, type):
        raise InputError(f"{module.__name__} is a class, not a module; make one: {module.__name__}()")
    _check_module(module)
    if not is_policy(module):
        return [kernel_subject(module, embedding_size)]
    found: list[KernelSubject | PolicySubject] = [policy_subject(module, embedding_size)]
    kappa = getattr(module, "kappa", None)
    if has_types(kappa):
        synthesis = getattr(module, "synthesis", None)
        matrix = getattr(synthesis, "value", synthesis)
        read_out = matrix if isinstance(matrix, Tensor) else None
        # a policy may squeeze the words before its kernel hears them
        width = getattr(kappa, "embedding_size", found[0].embedding_size)
        found.append(kernel_subject(kappa, width, read_out, getattr(module, "correlate", None)))
    return found


def kernel_subject(
    module: Any,
    embedding_size: int | None = None,
    read_out: Tensor | None = None,
    correlate: Any = None,
) -> KernelSubject:
    """Check a kernel and wrap it.

    Args:
        module: has `in_type` and `out_type`; and `embedding_size`, unless the next argument says it.
        embedding_size: D.
        read_out: `(bins, out_type.size)`; by default the module's own `read_out`, or the project's Fourier
            synthesis where `out_type` is `fields.even_type`.
        correlate: what a policy correlates features with its kernels by; by default what `LegPolicy` would.

    Raises:
        InputError: if it does not make finite float32 or float64 kernels of its declared types and an odd size, or
            makes nothing but zeros, or its types and its read-out do not go together, or `correlate` is no correlation.
    """
    name = type(module).__name__
    _check_module(module)
    size, dtype = embedding_size_of(module, embedding_size), dtype_of(module)

    def generate(embedding: Tensor) -> Tensor:
        return ask(module, size, embedding.to(dtype))

    _check_types(name, module.in_type, module.out_type)
    kernel = ask_twice(module, "kernels", size, some_words(size, dtype))
    check_finite(name, kernel)
    shape = tuple(kernel.shape)
    expected = (1, module.out_type.size, module.in_type.size)
    if len(shape) != 5 or shape[:3] != expected or shape[3] != shape[4]:
        declared = ", ".join(map(str, expected))
        raise InputError(
            f"{name} declares kernels of shape ({declared}, k, k) by its in_type and out_type, but makes {shape}"
            f"{taken_for(module)}"
        )
    if shape[3] % 2 == 0:
        raise InputError(
            f"a kernel turns about its centre pixel, so its size is odd, but {name} makes {shape[3]} x {shape[3]}; "
            f"use {shape[3] - 1} or {shape[3] + 1}"
        )
    check_batches(module, "kernels", size, kernel, some_words(size, dtype, 1))
    with torch.no_grad():
        if not any(generate(some_words(size, dtype, seed)).any() for seed in range(WORDS)):
            raise InputError(
                f"{name} makes a kernel of zeros from each of {WORDS} embeddings, of which no law can be measured; "
                "train it, or start its last layer otherwise"
            )
    if getattr(module, "even", False) and not torch.allclose(
        kernel, kernel.flip((3, 4)), 0.0, 1e-5 * float(kernel.abs().max())
    ):
        raise InputError(
            f"{name} declares even kernels, K(-x) = K(x), which are correlated by half of their rows, but its own are "
            "not; leave `even` out"
        )
    if read_out is None:
        read_out = getattr(module, "read_out", None)
    if read_out is None and module.out_type.size <= 35 and _is_even(module.out_type):
        read_out = fields.synthesis(module.out_type.size - 1, WORKSPACE.bins)
    if read_out is not None:
        read_out = _checked_read_out(name, read_out, module.out_type.size).to(kernel.dtype)
    route = correlation_of(module) if correlate is None else checked_correlation(name, correlate)
    subject = KernelSubject(
        name, generate, size, module.in_type, module.out_type, kernel.dtype, read_out, correlate=route
    )
    # of an even oblong, larger than the kernel: what no law could use is said before any is measured
    subject.correlate(kernel.new_zeros(1, subject.in_type.size, shape[3] + 1, shape[3] + 3), kernel)
    return subject


def policy_subject(module: Any, embedding_size: int | None = None) -> PolicySubject:
    """Check a policy and wrap it.

    Raises:
        InputError: if it is no module from observation and embedding to float scores over bins: some finite, the
            others finite or minus infinity.
    """
    name = type(module).__name__
    _check_module(module)
    size, dtype = embedding_size_of(module, embedding_size), dtype_of(module)
    if dtype not in FLOATS:
        raise InputError(f"{name} has {dtype} parameters, too coarse for any law; call .float() or .double() first")

    def scores(observation: Tensor, embedding: Tensor) -> Tensor:
        return ask(module, size, observation.to(dtype), embedding.to(dtype))

    result = ask_twice(module, "scores", size, some_scene(64, 128, dtype), some_words(size, dtype))
    check_scores(name, result)
    shape = tuple(result.shape)
    stride = 64 // shape[2] if len(shape) == 4 and shape[2] else 0
    if len(shape) != 4 or not stride or shape[2:] != (64 // stride, 128 // stride):
        raise InputError(
            f"a policy makes scores (B, bins, H / stride, W / stride), but {name} makes {shape} of a 64 x 128 scene"
            f"{taken_for(module)}"
        )
    # half as much of everything, which statistics of a whole batch tell
    check_batches(module, "scores", size, result, 0.5 * some_scene(64, 128, dtype, 1), some_words(size, dtype, 1))
    # scores of float32 are no more exact for weights of float64
    coarser = torch.float32 if torch.float32 in (dtype, result.dtype) else dtype
    subject = PolicySubject(name, scores, size, coarser, stride, _reach(module), shape[1], _declared(module))
    return replace(subject, sides=_sides(subject))


def load_by_name(name: str) -> Any:
    """Import `my_package.module:make` and call it; the working folder is importable, as with `python -m`.

    Raises:
        InputError: if that cannot be: the form, the module, the name in it, or the call.
    """
    make = attribute(name, "a policy", "make")
    if not callable(make):
        raise InputError(f"{name} is no function that makes a kernel or a policy, but {type(make).__name__}")
    if isinstance(make, nn.Module):
        return make
    try:
        return make()
    except InputError:
        raise
    except Exception as error:  # the user's own code
        raise InputError(
            f"{name}() raises {type(error).__name__} ({error}); it is to make a kernel or a policy"
        ) from None


def _check_module(module: Any) -> None:
    if not isinstance(module, nn.Module):
        raise InputError(
            f"laws are aimed at a torch module, but this is {type(module).__name__}; give a kernel with in_type and "
            "out_type, or a policy from (observation, embedding) to scores"
        )


def _check_types(name: str, into: Any, out: Any) -> None:
    for kind in (into, out):
        if not isinstance(kind, fields.FieldType):
            raise InputError(f"{name} has in_type and out_type, but {kind!r:.80} is no escnn field type")
        # by the space and not by its group's name: two flips are a group C2 as well
        if kind.gspace != fields.gspaces.rot2dOnR2(kind.gspace.fibergroup.order()):
            raise InputError(
                f"{name} has the group {kind.gspace.fibergroup.name} as {kind.gspace.name}; the laws know turns of "
                "the plane alone: SO(2) and C_n, escnn's rot2dOnR2"
            )
    if into.gspace != out.gspace:
        groups = " and ".join(kind.gspace.fibergroup.name for kind in (into, out))
        raise InputError(
            f"{name} has in_type and out_type over different groups, {groups}, so that no turn is said of both; "
            "make one FieldType over the other's gspace"
        )


def _checked_read_out(name: str, read_out: Any, size: int) -> Tensor:
    """Its matrix, if it is one."""
    way_out = f"let it be a dense float tensor (bins, {size}), from out_type to scores, or leave it out"
    if not isinstance(read_out, Tensor):
        raise InputError(f"{name} has a read_out that is a {type(read_out).__name__}; {way_out}")
    shape, right = tuple(read_out.shape), read_out.layout is torch.strided and read_out.device.type != "meta"
    if not right or not read_out.is_floating_point() or len(shape) != 2 or shape[1] != size or not shape[0]:
        raise InputError(f"{name} has a read_out that is a {read_out.dtype} tensor {shape}; {way_out}")
    if not read_out.isfinite().all():
        raise InputError(f"{name} has a read_out with numbers that are not finite; {way_out}")
    return read_out.detach()


def _is_even(kind: fields.FieldType) -> bool:
    return kind.size % 2 == 1 and kind.gspace.fibergroup.continuous and kind == fields.even_type(kind.size - 1)


def _reach(module: nn.Module) -> float | None:
    declared = getattr(module, "reach", None)
    if declared is None:
        return None
    if isinstance(declared, bool) or not isinstance(declared, Real) or not 0 <= declared < math.inf:
        raise InputError(
            f"{type(module).__name__} says that its scores see {declared!r} pixels far; "
            "let reach be a number of pixels, at least 0, or leave it out"
        )
    return float(declared)


def _sides(subject: PolicySubject) -> tuple[int, ...]:
    """Of `SIDES` those that it takes; the first without being asked, as a law that it refuses says so."""
    side = SIDES[-1]
    if side % (2 * subject.stride):
        # its cells do not lie about the middle as those of the laws do
        return SIDES[:1]
    for columns in (side, 2 * side):
        try:
            with torch.no_grad():
                found = subject.scores(
                    some_scene(side, columns, subject.dtype), some_words(subject.embedding_size, subject.dtype)
                )
        except InputError:
            return SIDES[:1]
        if found.shape[2:] != (side // subject.stride, columns // subject.stride):
            return SIDES[:1]
    return SIDES


def _declared(module: nn.Module) -> int:
    """Turns of the first C_n that a type of the policy's, its phi's or its kappa's is over; 0 without one."""
    parts = (module, getattr(module, "phi", None), getattr(module, "kappa", None))
    kinds = [getattr(part, "in_type", None) for part in parts]
    return next((n for kind in kinds if isinstance(kind, fields.FieldType) and (n := order_of(kind))), 0)
