"""MODELS: every policy of the paper's tables as one row, and `build`, which makes it.

Rows differ by their fields, a variant is one `dataclasses.replace`, and a run keeps its config as JSON. A policy is
composed: any kernel of `KERNELS` with any phi of `PHIS`, each with or without language. Nothing here costs torch
until `build`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from equigrasp.ablations import ablations
from equigrasp.config import ModelConfig
from equigrasp.errors import unknown

if TYPE_CHECKING:
    from torch import nn

    from equigrasp.policy import GraspPolicy

LEG_UNET = ModelConfig(
    name="leg-unet",
    summary="the paper's: a generated image lifted over C_72, and a U-Net",
    kernel="lifted",
    kernel_size=25,
    maximum_frequency=16,
    paper_parameters=3.3,
)

MODELS: dict[str, ModelConfig] = {
    row.name: row
    for row in (
        LEG_UNET,
        ModelConfig(
            name="leg-steerable",
            summary="exact: the instruction weighs a steerable basis, and a U-Net",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
            # what runs from before this setting were trained with
            rings="gaussian",
        ),
        ModelConfig(
            name="leg-equivariant",
            summary="exact from end to end: the steerable basis, and a U-Net that turns by C_4",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
            rings="smooth",
            phi="steerable-unet",
            widths=(8, 16, 32, 72, 160),
        ),
        ModelConfig(
            name="leg-equivariant-local",
            summary="exact for each object alone: the steerable basis, and a U-Net of C_4 whose field of view ends",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
            rings="smooth",
            phi="local-steerable-unet",
            widths=(8, 16, 16, 16),
        ),
        *ablations(LEG_UNET),
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
    for kind, name, known in (("phi", config.phi, PHIS), ("kernel", config.kernel, KERNELS)):
        if name not in known:
            raise unknown(kind, name, known)

    import torch

    from equigrasp import language
    from equigrasp.policy import GraspPolicy
    from equigrasp.without_language import KernelWithoutLanguage, PhiWithoutLanguage

    size = language.width(config.text_encoder)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        phi = PHIS[config.phi](config, size)
        kappa = KERNELS[config.kernel](config, size)
        if not config.phi_language:
            phi = PhiWithoutLanguage(phi, size)
        if not config.kernel_language:
            kappa = KernelWithoutLanguage(kappa, size)
        return GraspPolicy(phi, kappa, config.text_encoder, config.precision)


def _unet(config: ModelConfig, embedding_size: int) -> nn.Module:
    from equigrasp.encoder import UNet

    return UNet(embedding_size, config.channels, config.stride, config.widths)


def _steerable_unet(config: ModelConfig, embedding_size: int) -> nn.Module:
    from equigrasp.steerable_encoder import SteerableUNet

    return SteerableUNet(embedding_size, config.channels, config.stride, config.widths, config.phi_group_order)


def _local_steerable_unet(config: ModelConfig, embedding_size: int) -> nn.Module:
    from equigrasp.local_encoder import LocalSteerableUNet

    return LocalSteerableUNet(embedding_size, config.channels, config.stride, config.widths, config.phi_group_order)


def _steerable(config: ModelConfig, embedding_size: int) -> nn.Module:
    from equigrasp.kernel import SteerableKernel

    return SteerableKernel(
        embedding_size, config.channels, config.kernel_size, config.maximum_frequency, rings=config.rings
    )


def _lifted(config: ModelConfig, embedding_size: int) -> nn.Module:
    from equigrasp.kernel import LiftedKernel

    return LiftedKernel(
        embedding_size,
        config.channels,
        config.kernel_size,
        config.maximum_frequency,
        config.group_order,
        config.exact_quarter_turns,
    )


def _plain(config: ModelConfig, embedding_size: int) -> nn.Module:
    from equigrasp.kernel import PlainKernel

    return PlainKernel(embedding_size, config.channels, config.kernel_size, config.maximum_frequency)


Builder = Callable[[ModelConfig, int], "nn.Module"]
"""From a config and the width of an embedding to fresh weights."""

PHIS: dict[str, Builder] = {
    "unet": _unet,
    "steerable-unet": _steerable_unet,
    "local-steerable-unet": _local_steerable_unet,
}
KERNELS: dict[str, Builder] = {"lifted": _lifted, "steerable": _steerable, "plain": _plain}
