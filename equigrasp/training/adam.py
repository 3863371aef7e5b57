"""Adam, on weights as they lie in memory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor
from torch.optim.adam import adam

BETAS, EPSILON = (0.9, 0.999), 1e-8
MOMENTS = ("exp_avg", "exp_avg_sq")


class Adam:
    """Adam by torch's function; torch's class would import its compiler, which takes longer than all of torch.

    A weight without a gradient is left alone, and has no moments until it has had one.

    Args:
        parameters: weights by name, whose gradients it reads.
        learning_rate: of all of them.

    Source: Kingma and Ba, Adam (2015), Algorithm 1, without the weight decay that it does not have.
    """

    def __init__(self, parameters: Mapping[str, Tensor], learning_rate: float) -> None:
        self.parameters = parameters
        self.learning_rate = learning_rate
        # fused Adam walks memory: it copies what it finds in another order, and is wrong where there are gaps
        self.orders = {name: slowest_first(value) for name, value in parameters.items()}
        self.walked = {name: value.detach().permute(self.orders[name]) for name, value in parameters.items()}
        self.moments: dict[str, dict[str, Tensor]] = {}
        # a count of steps that lies on the GPU, as a CUDA graph needs it
        self.capturable = any(value.is_cuda for value in parameters.values())

    def step(self) -> None:
        """One step by the gradients that the weights have."""
        moved = [name for name, parameter in self.parameters.items() if parameter.grad is not None]
        self._move([name for name in moved if self.walked[name].is_contiguous()], fused=True)
        self._move([name for name in moved if not self.walked[name].is_contiguous()], fused=False)

    @torch.no_grad()
    def _move(self, names: Sequence[str], fused: bool) -> None:
        if not names:
            return
        for name in names:
            if name not in self.moments:
                self.moments[name] = self._at_rest(name)
        moments = [self.moments[name] for name in names]
        adam(
            [self.walked[name] for name in names],
            [self._gradient(name) for name in names],
            *([each[key] for each in moments] for key in MOMENTS),
            max_exp_avg_sqs=[],
            state_steps=[each["step"] for each in moments],
            fused=fused,
            capturable=self.capturable,
            amsgrad=False,
            beta1=BETAS[0],
            beta2=BETAS[1],
            lr=self.learning_rate,
            weight_decay=0.0,
            eps=EPSILON,
            maximize=False,
        )

    def _at_rest(self, name: str) -> dict[str, Tensor]:
        walked = self.walked[name]
        count = torch.zeros((), dtype=torch.float32, device=walked.device)
        return {"step": count, **{key: torch.zeros_like(walked) for key in MOMENTS}}

    def _gradient(self, name: str) -> Tensor:
        gradient = self.parameters[name].grad
        assert gradient is not None
        return gradient.permute(self.orders[name]).contiguous()

    def tensors(self) -> dict[str, Tensor]:
        """What it keeps of each weight that had a gradient, by name: moments in the weight's shape, count of steps."""
        tensors = {}
        for name, moments in self.moments.items():
            back = torch.tensor(self.orders[name]).argsort().tolist()
            for key, value in moments.items():
                tensors[f"adam.{key}.{name}"] = value if key == "step" else value.permute(back)
        return tensors

    def restore(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `tensors`, which may have others; KeyError or RuntimeError if they are of other weights."""
        self.moments = {}
        for name, parameter in self.parameters.items():
            if f"adam.step.{name}" not in tensors:
                continue  # no step has had a gradient for it
            walked, order = self.walked[name], self.orders[name]
            self.moments[name] = {
                # where fused Adam keeps its count: on a GPU it never asks the host
                "step": tensors[f"adam.step.{name}"].to(parameter.device),
                **{
                    key: torch.empty_like(walked).copy_(tensors[f"adam.{key}.{name}"].permute(order)) for key in MOMENTS
                },
            }


def slowest_first(tensor: Tensor) -> list[int]:
    """Its dimensions in the order in which they lie in memory."""
    strides = tensor.stride()
    return sorted(range(tensor.dim()), key=lambda dimension: -strides[dimension])
