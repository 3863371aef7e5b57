"""One step of training: Adam, the moving average of the weights; and all that it changes, as tensors."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import torch
from torch import Tensor

from equigrasp.config import ModelConfig
from equigrasp.plan import Training
from equigrasp.policy import GraspPolicy
from equigrasp.training.adam import Adam


class State:
    """What a step changes: trainable weights, their moving average, Adam's moments, buffers, the count of steps."""

    def __init__(self, policy: GraspPolicy, training: Training) -> None:
        model = policy.config or ModelConfig  # none of a policy that was put together by hand
        rate = model.learning_rate if training.learning_rate is None else training.learning_rate
        self.policy = policy
        self.parameters = {name: value for name, value in policy.named_parameters() if value.requires_grad}
        self.average = {name: value.detach().clone() for name, value in self.parameters.items()}
        self.adam = Adam(self.parameters, rate)
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
        self.adam.step()

    def forget(self) -> None:
        """Drop the gradients."""
        for parameter in self.parameters.values():
            parameter.grad = None

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
        tensors |= self.adam.tensors()
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
            for name, value in buffers(self.policy).items():
                value.copy_(tensors[f"buffers.{name}"])
        self.adam.restore(tensors)
        self.step = int(tensors["step"])


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
