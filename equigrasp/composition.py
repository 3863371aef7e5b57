"""What makes each family's policy: phi, kappa and networks, put together as a config says.

A LEG policy is composed: any kernel of `KERNELS` with any phi of `PHIS`, each with or without language. A baseline is
a network that puts out the scores itself. `equigrasp.models.build` is the way in.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torch import nn

from equigrasp.baselines.rotator import Rotator
from equigrasp.baselines.vit import VisionTransformer
from equigrasp.baselines.without_language import KernelWithoutLanguage, PhiWithoutLanguage
from equigrasp.config import (
    CliportConfig,
    FcgqConfig,
    LegClipConfig,
    LegConfig,
    ModelConfig,
    RotatorConfig,
    VitConfig,
)
from equigrasp.encoder import LocalSteerableUNet, SteerableUNet, TwoStream, UNet
from equigrasp.encoder.clip_image import ClipImage
from equigrasp.encoder.two_stream import Concatenation, Product
from equigrasp.errors import InputError, unknown
from equigrasp.kernel import LiftedKernel, PlainKernel, SteerableKernel
from equigrasp.policy import DensePolicy, GraspPolicy, LegPolicy
from equigrasp.workspace import WORKSPACE


def _leg(config: LegConfig, embedding_size: int) -> GraspPolicy:
    for kind, name, known in (("phi", config.phi, PHIS), ("kernel", config.kernel, KERNELS)):
        if name not in known:
            raise unknown(kind, name, known)
    phi = PHIS[config.phi](config, embedding_size)
    kappa = KERNELS[config.kernel](config, embedding_size)
    if not config.phi_language:
        phi = PhiWithoutLanguage(phi, embedding_size)
    if not config.kernel_language:
        kappa = KernelWithoutLanguage(kappa, embedding_size)
    return LegPolicy(phi, kappa, config.encoder, config.precision)


def _fcgq(config: FcgqConfig, embedding_size: int) -> GraspPolicy:
    network = UNet(embedding_size, WORKSPACE.bins, config.stride, config.widths)
    return DensePolicy(network, config.encoder, config.precision)


def _vit(config: VitConfig, embedding_size: int) -> GraspPolicy:
    network = VisionTransformer(
        embedding_size,
        config.patch,
        config.width,
        config.depth,
        config.heads,
        config.language_tokens,
        config.widths,
        WORKSPACE.bins,
    )
    return DensePolicy(network, config.encoder, config.precision)


def _cliport(config: CliportConfig, embedding_size: int) -> GraspPolicy:
    return DensePolicy(_pick(config, embedding_size, WORKSPACE.bins), config.encoder, config.precision)


def _rotator(config: RotatorConfig, embedding_size: int) -> GraspPolicy:
    network = Rotator(_pick(config, embedding_size, 1), config.rotations, config.chunk, WORKSPACE.bins)
    return DensePolicy(network, config.encoder, config.precision)


def _pick(config: CliportConfig, embedding_size: int, outputs: int) -> nn.Module:
    image = ClipImage(config.tower, config.clip_weights)
    return TwoStream(embedding_size, image, config.semantic_widths, config.widths, outputs, Concatenation)


def _two_stream(config: LegConfig, embedding_size: int) -> nn.Module:
    if not isinstance(config, LegClipConfig):
        raise InputError(f"the phi 'two-stream' stands on a CLIP, which {config.name} does not name; see leg-cliport")
    if config.stride != TwoStream.stride:
        raise InputError(
            f"{config.name} has stride {config.stride}, but the phi 'two-stream' has {TwoStream.stride} and no other; "
            f"leave its stride at {TwoStream.stride}"
        )

    image = ClipImage(config.tower, config.clip_weights)
    return TwoStream(embedding_size, image, config.semantic_widths, config.widths, config.channels, Product)


def _unet(config: LegConfig, embedding_size: int) -> nn.Module:
    return UNet(embedding_size, config.channels, config.stride, config.widths)


def _steerable_unet(config: LegConfig, embedding_size: int) -> nn.Module:
    return SteerableUNet(embedding_size, config.channels, config.stride, config.widths, config.phi_group_order)


def _local_steerable_unet(config: LegConfig, embedding_size: int) -> nn.Module:
    return LocalSteerableUNet(embedding_size, config.channels, config.stride, config.widths, config.phi_group_order)


def _steerable(config: LegConfig, embedding_size: int) -> nn.Module:
    return SteerableKernel(
        embedding_size, config.channels, config.kernel_size, config.maximum_frequency, rings=config.rings
    )


def _lifted(config: LegConfig, embedding_size: int) -> nn.Module:
    return LiftedKernel(
        embedding_size,
        config.channels,
        config.kernel_size,
        config.maximum_frequency,
        config.group_order,
        config.exact_quarter_turns,
    )


def _plain(config: LegConfig, embedding_size: int) -> nn.Module:
    return PlainKernel(embedding_size, config.channels, config.kernel_size, config.maximum_frequency)


Builder = Callable[[LegConfig, int], nn.Module]
"""From a config and the width of an embedding to fresh weights."""

PHIS: dict[str, Builder] = {
    "unet": _unet,
    "steerable-unet": _steerable_unet,
    "local-steerable-unet": _local_steerable_unet,
    "two-stream": _two_stream,
}
KERNELS: dict[str, Builder] = {"lifted": _lifted, "steerable": _steerable, "plain": _plain}
BUILDERS: dict[type[ModelConfig], Callable[[Any, int], GraspPolicy]] = {
    LegConfig: _leg,
    FcgqConfig: _fcgq,
    VitConfig: _vit,
    LegClipConfig: _leg,
    CliportConfig: _cliport,
    RotatorConfig: _rotator,
}
"""A family's config -> what makes its policy, from it and the width of an embedding."""
