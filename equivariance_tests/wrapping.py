"""How a user's module becomes what laws are aimed at: checked for what it declares, and asked politely.

`subjects.py` says what a kernel and a policy are.
"""

from __future__ import annotations

import math
import re
from typing import Any

import torch
from torch import Tensor, nn

from equigrasp import fields
from equigrasp.errors import InputError
from equigrasp.naming import attribute
from equigrasp.policy import GraspPolicy
from equigrasp.workspace import WORKSPACE
from equivariance_tests.subjects import KernelSubject, PolicySubject

FLOATS = (torch.float32, torch.float64)


def subjects_of(module: Any, embedding_size: int | None = None) -> list[KernelSubject | PolicySubject]:
    """What can be tested of a module: a kernel, or a policy and, where it has one, its kernel.

    Raises:
        InputError: if it is neither, or does not do what it declares; the sentence says what and what to do.
    """
    if isinstance(module, KernelSubject | PolicySubject):
        return [module]
    if isinstance(module, type):
        raise InputError(f"{module.__name__} is a class, not a module; make one: {module.__name__}()")
    if hasattr(module, "in_type") and hasattr(module, "out_type"):
        return [kernel_subject(module, embedding_size)]
    found: list[KernelSubject | PolicySubject] = [policy_subject(module, embedding_size)]
    kappa = getattr(module, "kappa", None)
    if hasattr(kappa, "in_type") and hasattr(kappa, "out_type"):
        synthesis = getattr(module, "synthesis", None)
        matrix = getattr(synthesis, "value", synthesis)
        read_out = matrix if isinstance(matrix, Tensor) else None
        # a policy may squeeze the words before its kernel hears them
        width = getattr(kappa, "embedding_size", found[0].embedding_size)
        found.append(kernel_subject(kappa, width, read_out))
    return found


def kernel_subject(module: Any, embedding_size: int | None = None, read_out: Tensor | None = None) -> KernelSubject:
    """Check a kernel and wrap it.

    Args:
        module: has `in_type` and `out_type`; and `embedding_size`, unless the next argument says it.
        embedding_size: D.
        read_out: `(bins, out_type.size)`; by default the module's own `read_out`, or the project's Fourier
            synthesis where `out_type` is `fields.even_type`.

    Raises:
        InputError: if it does not make finite float32 or float64 kernels of its declared types and an odd size.
    """
    name = type(module).__name__
    size, dtype = _embedding_size(module, embedding_size), _dtype(module)

    def generate(embedding: Tensor) -> Tensor:
        return _ask(module, size, embedding.to(dtype))

    for kind in (module.in_type, module.out_type):
        if not isinstance(kind, fields.FieldType):
            raise InputError(f"{name} has in_type and out_type, but {kind!r:.80} is no escnn field type")
        group = kind.gspace.fibergroup.name
        if not re.fullmatch(r"SO\(2\)|C\d+", group):
            raise InputError(f"{name} has the group {group}; the laws know turns alone: SO(2) and C_n")
    kernel = _try(module, size, _some_words(size, dtype))
    _check_float(name, kernel, "kernels")
    shape = tuple(kernel.shape)
    expected = (1, module.out_type.size, module.in_type.size)
    if len(shape) != 5 or shape[:3] != expected or shape[3] != shape[4]:
        declared = ", ".join(map(str, expected))
        raise InputError(
            f"{name} declares kernels of shape ({declared}, k, k) by its in_type and out_type, but makes {shape}"
        )
    if shape[3] % 2 == 0:
        raise InputError(
            f"a kernel turns about its centre pixel, so its size is odd, but {name} makes {shape[3]} x {shape[3]}; "
            f"use {shape[3] - 1} or {shape[3] + 1}"
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
        read_out = read_out.detach().to(kernel.dtype)
    return KernelSubject(name, generate, size, module.in_type, module.out_type, kernel.dtype, read_out)


def policy_subject(module: Any, embedding_size: int | None = None) -> PolicySubject:
    """Check a policy and wrap it.

    Raises:
        InputError: if it is no module from observation and embedding to finite float scores over bins.
    """
    name = type(module).__name__
    if not isinstance(module, nn.Module):
        raise InputError(
            f"laws are aimed at a torch module, but this is {name}; give a kernel with in_type and out_type, "
            "or a policy from (observation, embedding) to scores"
        )
    size, dtype = _embedding_size(module, embedding_size), _dtype(module)
    if dtype not in FLOATS:
        raise InputError(f"{name} has {dtype} parameters, too coarse for any law; call .float() or .double() first")

    def scores(observation: Tensor, embedding: Tensor) -> Tensor:
        return _ask(module, size, observation, embedding)

    noise = torch.rand(1, 4, 64, 128, generator=torch.Generator().manual_seed(0))
    scene = (noise * torch.tensor([255.0, 255.0, 255.0, 0.05]).view(4, 1, 1)).to(dtype)
    result = _try(module, size, scene, _some_words(size, dtype))
    _check_float(name, result, "scores")
    shape = tuple(result.shape)
    stride = 64 // shape[2] if len(shape) == 4 and shape[2] else 0
    if len(shape) != 4 or not stride or shape[2:] != (64 // stride, 128 // stride):
        raise InputError(
            f"a policy makes scores (B, bins, H / stride, W / stride), but {name} makes {shape} of a 64 x 128 scene"
        )
    return PolicySubject(name, scores, size, dtype, stride, _reach(module))


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


def _is_even(kind: fields.FieldType) -> bool:
    return kind.size % 2 == 1 and kind.gspace.fibergroup.continuous and kind == fields.even_type(kind.size - 1)


def _embedding_size(module: Any, given: int | None) -> int:
    declared = given if given is not None else getattr(module, "embedding_size", None)
    if not isinstance(declared, int) or declared < 1:
        raise InputError(
            f"{type(module).__name__} does not say how wide its embeddings are; give it an attribute embedding_size, "
            "or pass embedding_size="
        )
    return declared


def _reach(module: nn.Module) -> float | None:
    declared = getattr(module, "reach", None)
    if declared is None:
        return None
    if isinstance(declared, bool) or not isinstance(declared, int | float) or not 0 <= declared < math.inf:
        raise InputError(
            f"{type(module).__name__} says that its scores see {declared!r} pixels far; "
            "let reach be a number of pixels, at least 0, or leave it out"
        )
    return float(declared)


def _dtype(module: nn.Module) -> torch.dtype:
    tensors = [*module.parameters(), *module.buffers()]
    return next((tensor.dtype for tensor in tensors if tensor.is_floating_point()), torch.float32)


def _some_words(size: int, dtype: torch.dtype) -> Tensor:
    """An embedding `(1, size)` in which no entry is 0, which would hide what is done to it."""
    return nn.functional.normalize(torch.randn(1, size, generator=torch.Generator().manual_seed(0))).to(dtype)


def _quietly(module: Any, *inputs: Tensor) -> Tensor:
    """Call it in eval mode and, for a GraspPolicy, without autocast; leave it as it was."""
    modes = {each: each.training for each in module.modules()}
    precision = module.precision if isinstance(module, GraspPolicy) else None
    module.eval()
    if precision is not None:
        module.precision = "float32"
    try:
        return module(*inputs)
    finally:
        for each, training in modes.items():
            each.training = training
        if precision is not None:
            module.precision = precision


def _ask(module: Any, size: int, *inputs: Tensor) -> Tensor:
    """Call it `_quietly`; what it cannot take is the user's mistake, whichever law asked."""
    try:
        return _quietly(module, *inputs)
    except Exception as error:  # what a user's module raises is anybody's guess
        shapes = " and ".join(str(tuple(each.shape)) for each in inputs)
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise InputError(
            f"{type(module).__name__} does not take {shapes}, of embedding width {size} ({reason})"
        ) from None


def _try(module: nn.Module, size: int, *inputs: Tensor) -> Tensor:
    name = type(module).__name__
    with torch.no_grad():
        result, again = (_ask(module, size, *(each.clone() for each in inputs)) for _ in range(2))
    if not isinstance(result, Tensor):
        raise InputError(f"{name} gives {type(result).__name__}, but a law needs one tensor")
    largest = float(result.abs().max())
    if math.isfinite(largest) and not torch.allclose(result, again, 1e-3, 1e-3 * largest):
        raise InputError(
            f"{name} gives another answer when it is asked the same again, so that no law can be measured; draw its "
            "chance from the input, or leave it out (dropout, noise, latents)"
        )
    return result


def _check_float(name: str, result: Tensor, what: str) -> None:
    if result.dtype not in FLOATS:
        raise InputError(
            f"{name} makes {result.dtype} {what}, too coarse for any law; make them float32 or float64 "
            "(.float(), .double())"
        )
    if not result.isfinite().all():
        raise InputError(f"{name} makes {what} that are not finite; look at its weights")
