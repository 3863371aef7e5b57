"""Examples as the tensors of a step: painted where they are drawn and brought over, or painted where it is done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from equigrasp.augmentation import Augmentation, Example
from equigrasp.augmentation.examples import Recipe, painted, recipe
from equigrasp.policy import GraspPolicy, to_tensor
from equigrasp.training.painter import Painter, recipes
from equigrasp.workspace import WORKSPACE


@dataclass(frozen=True)
class Feed:
    """How a step gets its scenes.

    Attributes:
        make: draws an example with a generator, in a process that may have no torch; an `Example` or a `Recipe`.
        scenes: such examples as tensors of the host.
        observe: what those are on the device of the step -> observations `(B, 4, H, W)` there.
    """

    make: Callable[[Augmentation, np.random.Generator], Any]
    scenes: Callable[[Sequence[Any]], tuple[Tensor, ...]]
    observe: Callable[..., Tensor]


def with_pixels() -> Feed:
    """All pixels come over from the host, which paints them."""
    return Feed(painted, _observations, lambda observations: observations)


def with_recipes(augmentation: Augmentation, device: torch.device) -> Feed:
    """What the demonstrations show lies on the device, which paints; ten numbers an object come over."""
    return Feed(recipe, recipes, Painter(augmentation, device))


def collate(
    feed: Feed, policy: GraspPolicy, drawn: Sequence[Example | Recipe], embeddings: Mapping[str, Tensor]
) -> tuple[Tensor, ...]:
    """Examples as a batch of the host: embeddings `(B, D)`, labels `(B,)` into the read-out, and the feed's scenes."""
    read_out = policy.read_out(WORKSPACE.shape)
    return (
        torch.stack([embeddings[each.instruction] for each in drawn]),
        torch.tensor([read_out.label(each.grasp) for each in drawn]),
        *feed.scenes(drawn),
    )


def _observations(examples: Sequence[Example]) -> tuple[Tensor]:
    return (torch.stack([to_tensor(each.observation) for each in examples]),)
