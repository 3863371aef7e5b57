"""How a user's module is asked: as it acts, more than once, and left as it was; and what of its answers is refused."""

from __future__ import annotations

import inspect
import math
from numbers import Integral
from typing import Any

import torch
from torch import Tensor, nn

from equigrasp.correlation import Correlation
from equigrasp.errors import InputError
from equigrasp.policy import GraspPolicy

FLOATS = (torch.float32, torch.float64)


def embedding_size_of(module: Any, given: int | None) -> int:
    """How wide its embeddings are: as given, or as it says itself.

    Raises:
        InputError: if neither is a whole number from 1.
    """
    declared = given if given is not None else getattr(module, "embedding_size", None)
    if not isinstance(declared, Integral) or isinstance(declared, bool) or declared < 1:
        raise InputError(
            f"{type(module).__name__} does not say how wide its embeddings are; give it an attribute embedding_size, "
            "or pass embedding_size="
        )
    return int(declared)


def dtype_of(module: nn.Module) -> torch.dtype:
    """The dtype of its parameters, or of its buffers where it has none; float32 for a module without numbers."""
    tensors = [*module.parameters(), *module.buffers()]
    return next((tensor.dtype for tensor in tensors if tensor.is_floating_point()), torch.float32)


def some_words(size: int, dtype: torch.dtype, seed: int = 0) -> Tensor:
    """An embedding `(1, size)` in which no entry is 0, which would hide what is done to it."""
    return nn.functional.normalize(torch.randn(1, size, generator=torch.Generator().manual_seed(seed))).to(dtype)


def some_scene(rows: int, columns: int, dtype: torch.dtype, seed: int = 0) -> Tensor:
    """Noise as an observation `(1, 4, rows, columns)`: colours from 0 to 255, heights up to 5 cm."""
    noise = torch.rand(1, 4, rows, columns, generator=torch.Generator().manual_seed(seed))
    return (noise * torch.tensor([255.0, 255.0, 255.0, 0.05]).view(4, 1, 1)).to(dtype)


def ask(module: Any, size: int, *inputs: Tensor) -> Any:
    """Call it in eval mode and, for a GraspPolicy, without autocast; leave it as it was.

    Raises:
        InputError: if it raises anything: what it cannot take is the user's mistake, whichever law asked.
    """
    try:
        result = _quietly(module, *inputs)
    except Exception as error:  # what a user's module raises is anybody's guess
        shapes = " and ".join(str(tuple(each.shape)) for each in inputs)
        raise InputError(
            f"{type(module).__name__} does not take {shapes}, of embedding width {size} ({reason_of(error)})"
            f"{taken_for(module)}"
        ) from None
    # copied: a module may write its next answer into the same memory
    return result.clone() if isinstance(result, Tensor) else result


def reason_of(error: Exception) -> str:
    """What an error of a user's own code says first."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def has_types(module: Any) -> bool:
    """Whether it declares what turns how, as kernels do, and escnn's modules of any kind."""
    return hasattr(module, "in_type") and hasattr(module, "out_type")


def is_policy(module: nn.Module) -> bool:
    """Whether it is asked as a policy: it declares no types, or its `forward` has two required arguments."""
    if not has_types(module):
        return True
    try:
        needed = inspect.signature(module.forward).parameters.values()
    except (TypeError, ValueError):
        # compiled code need not say
        return False
    places = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    return sum(each.kind in places and each.default is inspect.Parameter.empty for each in needed) == 2


def taken_for(module: Any) -> str:
    """The end of a sentence about a module that does not do what it should: why that was asked of it."""
    if not has_types(module):
        return ""
    kind, arguments = ("policy", "two, an image and an embedding") if is_policy(module) else ("kernel", "not two")
    return (
        f"; it has in_type and out_type and is taken for a {kind}, its forward's required arguments being {arguments}"
    )


def ask_twice(module: nn.Module, what: str, size: int, *inputs: Tensor) -> Tensor:
    """What it answers, and answers again: a dense tensor of float32 or float64 with numbers in it.

    Args:
        module: is asked.
        what: "kernels" or "scores", for the sentence.
        size: of embeddings.
        inputs: of the module.

    Raises:
        InputError: if it is no such tensor, or another one at the second call.
    """
    name = type(module).__name__
    with torch.no_grad():
        result, again = (ask(module, size, *(each.clone() for each in inputs)) for _ in range(2))
    if not isinstance(result, Tensor):
        raise InputError(f"{name} gives {type(result).__name__}, but a law needs one tensor")
    if result.layout is not torch.strided:
        raise InputError(f"{name} makes {what} as a tensor of layout {result.layout}; make them dense (.to_dense())")
    if result.device.type == "meta":
        raise InputError(f"{name} makes {what} on the device meta, which has shapes and no numbers; make them real")
    if result.dtype not in FLOATS:
        raise InputError(
            f"{name} makes {result.dtype} {what}, too coarse for any law; make them float32 or float64 "
            "(.float(), .double())"
        )
    if not result.numel():
        raise InputError(f"{name} makes {what} of shape {tuple(result.shape)}, which is empty; let it make some")
    # minus infinity is what a policy forbids, and a difference of two is no number
    given, repeated = (each.nan_to_num(neginf=0.0) for each in (result, again))
    largest = float(given.abs().max())
    if result.shape != again.shape or not torch.allclose(given, repeated, 1e-3, 1e-3 * largest):
        raise InputError(
            f"{name} gives another answer when it is asked the same again, so that no law can be measured; draw its "
            "chance from the input, or leave it out (dropout, noise, latents)"
        )
    return result


def check_batches(module: nn.Module, what: str, size: int, first: Tensor, *second: Tensor) -> None:
    """Two inputs in one batch have the answers that each alone has; of what takes one at a time nothing is said.

    Args:
        module: is asked.
        what: "kernels" or "scores", for the sentence.
        size: of embeddings.
        first: its answer to `some_words`, and `some_scene` of the same size, of seed 0.
        second: other inputs of the module.

    Raises:
        InputError: if it is another one.
    """
    name = type(module).__name__
    one = [some_words(size, second[-1].dtype)]
    if len(second) == 2:
        rows, columns = second[0].shape[2:]
        one.insert(0, some_scene(rows, columns, second[0].dtype))
    with torch.no_grad():
        alone = [first, ask(module, size, *(each.clone() for each in second))]
        try:
            together = ask(module, size, *(torch.cat(pair) for pair in zip(one, second, strict=True)))
        except InputError:  # it takes one at a time
            return
    apart = torch.cat(alone).nan_to_num(neginf=0.0)
    if not isinstance(together, Tensor) or together.shape != apart.shape:
        return
    if not torch.allclose(together.nan_to_num(neginf=0.0), apart, 1e-3, 1e-3 * float(apart.abs().max())):
        raise InputError(
            f"{name} gives other {what} for two inputs in one batch than for each alone, and so it would learn others "
            "than it acts by; look for a reshape that mixes the batch's axis with another, or take one at a time"
        )


def checked_correlation(name: str, correlate: Any) -> Correlation:
    """A policy's own correlation, of which every answer is looked at; without gradients, as laws need none.

    Args:
        name: of the kernel, for the sentence.
        correlate: what the policy has under that name.

    Raises:
        InputError: if it cannot be called; so does what is given back, where it raises or answers in another shape.
    """
    way_out = "let it take features (B, C, H, W) and kernels (B, O, C, k, k) to (B, O, H, W), zero beyond the border"
    if not callable(correlate):
        raise InputError(f"{name}'s policy has a `correlate` that is a {type(correlate).__name__}; {way_out}")

    @torch.no_grad()
    def checked(features: Tensor, kernels: Tensor) -> Tensor:
        given = f"{tuple(features.shape)} and {tuple(kernels.shape)}"
        try:
            result = correlate(features, kernels)
        except Exception as error:  # the user's own code
            raise InputError(
                f"{name}'s policy has a `correlate` that does not take {given} ({reason_of(error)}); {way_out}"
            ) from None
        expected = (len(features), kernels.shape[1], *features.shape[2:])
        if not isinstance(result, Tensor) or tuple(result.shape) != expected or not result.is_floating_point():
            made = f"{result.dtype} {tuple(result.shape)}" if isinstance(result, Tensor) else type(result).__name__
            raise InputError(f"{name}'s policy has a `correlate` that makes {made} of {given}; {way_out}")
        # copied: it may write its next answer into the same memory
        return result.clone()

    return checked


def _quietly(module: Any, *inputs: Tensor) -> Any:
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


def check_finite(name: str, kernels: Tensor) -> None:
    """A kernel is made of numbers.

    Raises:
        InputError: if one is none.
    """
    if not kernels.isfinite().all():
        raise InputError(f"{name} makes kernels that are not finite; look at its weights")


def check_scores(name: str, scores: Tensor) -> None:
    """A score may be minus infinity, which forbids a grasp, but not all of them, and none is NaN or infinity.

    Raises:
        InputError: if it is otherwise.
    """
    if scores.isnan().any() or not scores.max() < math.inf:
        raise InputError(f"{name} makes scores that are not finite; look at its weights")
    if scores.max() == -math.inf:
        raise InputError(f"{name} makes scores that are all minus infinity, which forbids every grasp; allow some")
