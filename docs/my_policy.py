"""A policy of a user's own, outside the package: a network, its settings, and how the one follows from the other."""

from dataclasses import dataclass

from torch import Tensor, nn
from torch.nn import functional

from equigrasp import language, models
from equigrasp.config import OwnConfig
from equigrasp.encoder import normalise
from equigrasp.policy import DensePolicy, GraspPolicy


class Fcn(nn.Module):
    """Dilated convolutions at half resolution, whose channels the instruction weighs; 36 channels come out."""

    stride = 2

    def __init__(self, embedding_size: int, width: int, dilations: tuple[int, ...]) -> None:
        super().__init__()
        self.stem = nn.Conv2d(16, width, 1)
        self.see = nn.ModuleList(nn.Conv2d(width, width, 3, padding=each, dilation=each) for each in dilations)
        self.hear = nn.ModuleList(nn.Linear(embedding_size, width) for _ in dilations)
        self.score = nn.Conv2d(width, 36, 1)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 4, H, W)`, `(B, D)` -> `(B, 36, H / 2, W / 2)`."""
        x = self.stem(functional.pixel_unshuffle(normalise(observation), 2))
        for see, hear in zip(self.see, self.hear, strict=True):
            weights = 1 + hear(embedding * embedding.shape[1] ** 0.5)
            x = x + functional.relu(see(4 * functional.normalize(x)) * weights[..., None, None])
        return self.score(x)


@dataclass(frozen=True, kw_only=True)
class FcnConfig(OwnConfig):
    """What a run records of it, beside what every config has: name, text encoder, precision."""

    width: int = 32
    dilations: tuple[int, ...] = (1, 2, 4, 8, 16, 1)

    def build(self) -> DensePolicy:
        """The policy, with fresh weights."""
        network = Fcn(language.width(self.encoder), self.width, self.dilations)
        return DensePolicy(network, self.encoder, self.precision)


MY_MODEL = FcnConfig(name="my-fcn", summary="six dilated convolutions and a channel for each angle")


def make() -> GraspPolicy:
    """What `--policy my_policy:make` measures."""
    return models.build(MY_MODEL)
