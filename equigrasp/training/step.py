"""One step of training: Adam, the moving average of the weights; and all that it changes, as tensors."""

from __future__ import annotations

import contextlib
import ctypes
import hashlib
from collections.abc import Mapping

import torch
from torch import Tensor

from equigrasp.config import ModelConfig
from equigrasp.plan import Training
from equigrasp.policy import GraspPolicy


class State:
    """What a step changes: trainable weights, their moving average, Adam's moments, buffers, the count of steps."""

    def __init__(self, policy: GraspPolicy, training: Training) -> None:
        model = policy.config or ModelConfig  # none of a policy that was put together by hand
        rate = model.learning_rate if training.learning_rate is None else training.learning_rate
        self.policy = policy
        self.parameters = {name: value for name, value in policy.named_parameters() if value.requires_grad}
        self.average = {name: value.detach().clone() for name, value in self.parameters.items()}
        # fused Adam walks memory: it copies what it finds in another order, and is wrong where there are gaps
        self.orders = {name: slowest_first(value) for name, value in self.parameters.items()}
        self.walked = {name: value.detach().permute(self.orders[name]) for name, value in self.parameters.items()}
        dense = [value for value in self.walked.values() if value.is_contiguous()]
        with_gaps = [value for value in self.walked.values() if not value.is_contiguous()]
        groups = [{"params": dense, "fused": True}, {"params": with_gaps, "fused": False}]
        # a count of steps that lies on the GPU, as a CUDA graph needs it
        on_gpu = any(value.is_cuda for value in self.parameters.values())
        self.adam = torch.optim.Adam([each for each in groups if each["params"]], lr=rate, capturable=on_gpu)
        self.frozen = fingerprint(policy)
        self.training = training
        self.step = 0

    def update(self, loss: Tensor) -> None:
        """One step: `descend`, then `follow`."""
        self.descend(loss)
        self.follow()

    def descend(self, loss: Tensor) -> None:
        """The gradient and Adam's step: the same work at every step, as a CUDA graph wants it."""
        self.forget()
        loss.backward()
        self.apply()

    def forget(self) -> None:
        """Drop the gradients."""
        for parameter in self.parameters.values():
            parameter.grad = None

    def apply(self) -> None:
        """Adam's step by the gradients that the weights have."""
        for name, parameter in self.parameters.items():
            gradient = parameter.grad
            self.walked[name].grad = gradient if gradient is None else gradient.permute(self.orders[name]).contiguous()
        self.adam.step()

    def follow(self) -> None:
        """Count the step and let the average follow; its decay warms up, or it would lag at the start."""
        self.step += 1
        decay = min(self.training.average, (1 + self.step) / (10 + self.step))
        with torch.no_grad():
            torch._foreach_lerp_(list(self.average.values()), list(self.parameters.values()), 1 - decay)

    def tensors(self) -> dict[str, Tensor]:
        """All of it, by name."""
        tensors = {f"weights.{name}": value.detach() for name, value in self.parameters.items()}
        tensors |= {f"average.{name}": value for name, value in self.average.items()}
        for name, walked in self.walked.items():
            back = torch.tensor(self.orders[name]).argsort().tolist()
            for key, value in self.adam.state[walked].items():
                tensors[f"adam.{key}.{name}"] = value if key == "step" else value.permute(back)
        tensors |= {f"buffers.{name}": value for name, value in buffers(self.policy).items()}
        tensors["step"] = torch.tensor(self.step)
        if self.frozen is not None:
            tensors["frozen"] = self.frozen
        return tensors

    def averaged(self) -> dict[str, Tensor]:
        """The policy's state dict with the averages in the weights' place, each under all names that its weight has."""
        averages = {id(value): self.average[name] for name, value in self.parameters.items()}
        return {name: averages.get(id(value), value) for name, value in self.policy.state_dict(keep_vars=True).items()}

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `tensors`; KeyError or RuntimeError if they are of another model."""
        if self.frozen is not None and not torch.equal(tensors["frozen"], self.frozen):
            raise RuntimeError("it was trained on other frozen weights")
        with torch.no_grad():
            for name, parameter in self.parameters.items():
                parameter.copy_(tensors[f"weights.{name}"])
                self.average[name].copy_(tensors[f"average.{name}"])
                if f"adam.step.{name}" not in tensors:
                    continue  # no step has had a gradient for it
                walked = self.walked[name]
                moments = {
                    key: torch.empty_like(walked).copy_(tensors[f"adam.{key}.{name}"].permute(self.orders[name]))
                    for key in ("exp_avg", "exp_avg_sq")
                }
                # where fused Adam keeps its count: on a GPU it never asks the host
                self.adam.state[walked] = {"step": tensors[f"adam.step.{name}"].to(parameter.device), **moments}
            for name, value in buffers(self.policy).items():
                value.copy_(tensors[f"buffers.{name}"])
        self.step = int(tensors["step"])


def slowest_first(tensor: Tensor) -> list[int]:
    """Its dimensions in the order in which they lie in memory."""
    strides = tensor.stride()
    return sorted(range(tensor.dim()), key=lambda dimension: -strides[dimension])


def buffers(policy: GraspPolicy, training: bool = True) -> dict[str, Tensor]:
    """What is saved with the weights and is none, by name: batch statistics, as a module of one's own may have.

    Args:
        policy: whose.
        training: those of modules in training mode, which a step may change; or those of the others, as of a frozen
            tower.
    """
    # by every name: a module or a weight may be shared by several parts
    owners = {name: module.training for name, module in policy.named_modules(remove_duplicate=False)}
    weights = {name for name, _ in policy.named_parameters(remove_duplicate=False)}
    return {
        name: value
        for name, value in policy.state_dict().items()
        if name not in weights and owners[name.rpartition(".")[0]] == training
    }


def fingerprint(policy: GraspPolicy) -> Tensor | None:
    """SHA-256 of all that a step does not change, `(32,)` uint8; None where there is nothing of it.

    A checkpoint leaves frozen weights and their batch statistics out: they are made again from the config, and this
    tells whether they are the same.
    """
    weights = [value for value in policy.parameters() if not value.requires_grad]
    frozen = [*weights, *buffers(policy, training=False).values()]
    if not frozen:
        return None
    digest = hashlib.sha256()
    for value in frozen:
        digest.update(value.detach().contiguous().cpu().numpy().tobytes())
    return torch.frombuffer(bytearray(digest.digest()), dtype=torch.uint8)


def keep_freed_memory() -> None:
    """Ask glibc to keep what a step frees: given back and faulted in anew, those pages cost a fifth of a step."""
    mmap_threshold, trim_threshold = -3, -1
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(mmap_threshold, 2**30)
        mallopt(trim_threshold, 2**31 - 1)
