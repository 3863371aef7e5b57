"""MODELS: every policy of the paper's tables as one row, and `build`, which makes it.

A config is plain data: rows differ by their fields, a variant is one `dataclasses.replace`, and a run keeps its
config as JSON. Nothing here costs torch until `build`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

from equigrasp.errors import InputError, unknown

if TYPE_CHECKING:
    from torch import nn

    from equigrasp.policy import GraspPolicy


@dataclass(frozen=True)
class ModelConfig:
    """What `build` needs to make a policy, and nothing else.

    Attributes:
        name: the row's name.
        summary: one phrase for listings.
        kernel: "lifted" (the paper's) or "steerable" (the exact basis).
        kernel_size: side of the kernel in read-out cells; odd.
        maximum_frequency: highest frequency of the score over angles; even.
        group_order: n of the lifted kernel's C_n.
        exact_quarter_turns: whether n must be a multiple of 4 (the paper's own 90 is not).
        channels: features of phi for each cell.
        widths: of phi's U-Net, from 1/2 to 1/32 of the resolution.
        stride: heightmap pixels a read-out cell.
        text_encoder: a name from `language.ENCODERS`.
        precision: "auto", "float32" or "bfloat16".
        paper_parameters: what the paper's Table 5 gives for this model, in millions; None where it is ours.
    """

    name: str
    summary: str
    kernel: str
    kernel_size: int
    maximum_frequency: int
    group_order: int = 72
    exact_quarter_turns: bool = True
    channels: int = 8
    widths: tuple[int, ...] = (24, 48, 96, 192, 256)
    stride: int = 2
    text_encoder: str = "minilm"
    precision: str = "auto"
    paper_parameters: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """A dict that JSON takes as it is."""
        return asdict(self) | {"widths": list(self.widths)}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ModelConfig:
        """The config that `to_dict` wrote.

        Raises:
            InputError: if a key is unknown or a needed one is missing.
        """
        known = {field.name for field in fields(cls)}
        for key in values:
            if key not in known:
                raise unknown("setting of a model", key, known)
        try:
            config = cls(**values)
        except TypeError as error:
            raise InputError(f"this model's config is incomplete: {error}") from None
        return replace(config, widths=tuple(config.widths))


MODELS: dict[str, ModelConfig] = {
    row.name: row
    for row in (
        ModelConfig(
            name="leg-unet",
            summary="the paper's: a generated image lifted over C_72, and a U-Net",
            kernel="lifted",
            kernel_size=25,
            maximum_frequency=16,
            paper_parameters=3.3,
        ),
        ModelConfig(
            name="leg-steerable",
            summary="exact: the instruction weighs a steerable basis, and a U-Net",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
        ),
    )
}


def find(name: str) -> ModelConfig:
    """The row of that name.

    Raises:
        InputError: if there is none; it names the nearest.
    """
    if name not in MODELS:
        raise unknown("model", name, MODELS)
    return MODELS[name]


def build(config: ModelConfig | str, seed: int = 0) -> GraspPolicy:
    """Make the policy with fresh weights: same config and seed, same bits; torch's own generator stays as it was.

    Raises:
        InputError: if a name or a setting cannot be.
    """
    if isinstance(config, str):
        config = find(config)

    import torch

    from equigrasp import language
    from equigrasp.encoder import UNet
    from equigrasp.policy import GraspPolicy

    size = language.width(config.text_encoder)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        phi = UNet(size, config.channels, config.stride, config.widths)
        kappa = _kernel(config, size)
        return GraspPolicy(phi, kappa, config.text_encoder, config.precision)


def _kernel(config: ModelConfig, embedding_size: int) -> nn.Module:
    from equigrasp.kernel import LiftedKernel, SteerableKernel

    if config.kernel == "steerable":
        return SteerableKernel(embedding_size, config.channels, config.kernel_size, config.maximum_frequency)
    if config.kernel == "lifted":
        return LiftedKernel(
            embedding_size,
            config.channels,
            config.kernel_size,
            config.maximum_frequency,
            config.group_order,
            config.exact_quarter_turns,
        )
    raise unknown("kernel", config.kernel, ("lifted", "steerable"))
