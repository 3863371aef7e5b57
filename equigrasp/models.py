"""MODELS: every policy of the paper's tables as one row, and `build`, which makes it.

Rows differ by their fields, a variant is one `dataclasses.replace`, and a run keeps its config as JSON. A LEG policy
is composed: any kernel of `KERNELS` with any phi of `PHIS`, each with or without language. A baseline is a network
that puts out the scores itself. Nothing here costs torch until `build`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from equigrasp.ablations import ablations
from equigrasp.config import (
    CliportConfig,
    FcgqConfig,
    LegClipConfig,
    LegConfig,
    ModelConfig,
    OwnConfig,
    RotatorConfig,
    VitConfig,
    find_family,
)
from equigrasp.errors import InputError, unknown
from equigrasp.naming import attribute
from equigrasp.workspace import WORKSPACE

if TYPE_CHECKING:
    from torch import nn

    from equigrasp.policy import GraspPolicy

LEG_UNET = LegConfig(
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
        LegConfig(
            name="leg-steerable",
            summary="exact: the instruction weighs a steerable basis, and a U-Net",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
            # what runs from before this setting were trained with
            rings="gaussian",
        ),
        LegConfig(
            name="leg-equivariant",
            summary="exact from end to end: the steerable basis, and a U-Net that turns by C_4",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
            rings="smooth",
            phi="steerable-unet",
            widths=(8, 16, 32, 72, 160),
        ),
        LegConfig(
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
        FcgqConfig(
            name="fcgq",
            summary="fully convolutional: 36 channels are the angles, language at the bottleneck",
            widths=(48, 96, 192, 384, 448),
            paper_parameters=6.8,
        ),
        VitConfig(
            name="vit",
            summary="image patches and language tokens through a transformer, then upsampled to 36 channels",
            width=384,
            depth=6,
            heads=6,
            language_tokens=4,
            widths=(384, 192, 96),
            paper_parameters=14.0,
        ),
        LegClipConfig(
            name="leg-cliport",
            summary="exact: the steerable basis, and features of CLIP and of RGB-D, multiplied",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
            rings="smooth",
            tower="clip-rn50",
            semantic_widths=(768, 512, 256, 128),
            widths=(64, 128, 256, 512, 640),
            paper_parameters=63.0,
        ),
        CliportConfig(
            name="cliport-rn50",
            summary="CLIPort's pick module on CLIP's RN50, a channel for each angle",
            tower="clip-rn50",
            semantic_widths=(1024, 512, 256, 128),
            widths=(64, 128, 256, 512, 1152),
            paper_parameters=94.0,
        ),
        CliportConfig(
            name="cliport-vit",
            summary="CLIPort's pick module on CLIP's ViT-B/32, a channel for each angle",
            tower="clip-vit-b-32",
            semantic_widths=(1024, 512, 256, 128),
            widths=(64, 128, 256, 512, 640),
            paper_parameters=61.0,
        ),
        RotatorConfig(
            name="cliport-rotator",
            summary="CLIPort's pick module on CLIP's RN50 that sees the scene turned by 36 angles",
            tower="clip-rn50",
            semantic_widths=(768, 512, 256, 128),
            widths=(64, 128, 256, 512, 640),
            paper_parameters=61.0,
        ),
    )
}


def find(name: str) -> ModelConfig:
    """The row of that name, or the config of your own that "my_package.my_module:MY_MODEL" names.

    Raises:
        InputError: if there is none; it names the nearest, or says what is wrong with the config.
    """
    if ":" in name:
        return _own(name)
    if name not in MODELS:
        raise unknown("model", name, MODELS)
    return MODELS[name]


def _own(name: str) -> ModelConfig:
    config = attribute(name, "a model", "MY_MODEL")
    if not isinstance(config, ModelConfig):
        raise InputError(
            f"{name} is a {type(config).__name__}, but a model is named by its config, an "
            "equigrasp.config.ModelConfig; docs/my_policy.py has one of its own family"
        )
    # a run keeps the family's name alone, so that it must lead back here
    if find_family(config.family) is not type(config):
        raise InputError(
            f"{name} is a {type(config).__name__} of the family {config.family}, which is another class; derive it "
            "from equigrasp.config.OwnConfig, at the top level of its module"
        )
    return config


def build(config: ModelConfig | str, seed: int = 0) -> GraspPolicy:
    """Make the policy with fresh weights: same config and seed, same bits; torch's own generator stays as it was.

    Raises:
        InputError: if a name or a setting cannot be.
    """
    if isinstance(config, str):
        config = find(config)
    config.check()

    import torch

    from equigrasp import language
    from equigrasp.policy import GraspPolicy

    size = language.width(config.encoder)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        policy = config.build() if isinstance(config, OwnConfig) else BUILDERS[type(config)](config, size)
    if not isinstance(policy, GraspPolicy) or policy.text_encoder != config.encoder:
        made = getattr(policy, "text_encoder", type(policy).__name__)
        raise InputError(
            f"{config.family} builds {made!r}, but it must build a GraspPolicy on the text encoder {config.encoder!r}, "
            "as its config says (self.encoder)"
        )
    policy.config = config
    return policy


def count_parameters(config: ModelConfig) -> tuple[int, int]:
    """Trainable and frozen parameters of a row; asks for no weights. The paper's Table 5 counts the former."""
    import torch

    # a count needs no numbers, and 100 million of them take seconds; but a steerable basis is computed from some
    with torch.device("cpu" if isinstance(config, LegConfig) else "meta"):
        parameters = list(build(config.untrained()).parameters())
    trainable = sum(each.numel() for each in parameters if each.requires_grad)
    return trainable, sum(each.numel() for each in parameters) - trainable


def _leg(config: LegConfig, embedding_size: int) -> GraspPolicy:
    from equigrasp.policy import LegPolicy
    from equigrasp.without_language import KernelWithoutLanguage, PhiWithoutLanguage

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
    from equigrasp.encoder import UNet
    from equigrasp.policy import DensePolicy

    network = UNet(embedding_size, WORKSPACE.bins, config.stride, config.widths)
    return DensePolicy(network, config.encoder, config.precision)


def _vit(config: VitConfig, embedding_size: int) -> GraspPolicy:
    from equigrasp.policy import DensePolicy
    from equigrasp.vit import VisionTransformer

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
    from equigrasp.policy import DensePolicy

    return DensePolicy(_pick(config, embedding_size, WORKSPACE.bins), config.encoder, config.precision)


def _rotator(config: RotatorConfig, embedding_size: int) -> GraspPolicy:
    from equigrasp.policy import DensePolicy
    from equigrasp.rotator import Rotator

    network = Rotator(_pick(config, embedding_size, 1), config.rotations, config.chunk, WORKSPACE.bins)
    return DensePolicy(network, config.encoder, config.precision)


def _pick(config: CliportConfig, embedding_size: int, outputs: int) -> nn.Module:
    from equigrasp.clip_image import ClipImage
    from equigrasp.two_stream import Concatenation, TwoStream

    image = ClipImage(config.tower, config.clip_weights)
    return TwoStream(embedding_size, image, config.semantic_widths, config.widths, outputs, Concatenation)


def _two_stream(config: LegConfig, embedding_size: int) -> nn.Module:
    if not isinstance(config, LegClipConfig):
        raise InputError(f"the phi 'two-stream' stands on a CLIP, which {config.name} does not name; see leg-cliport")

    from equigrasp.clip_image import ClipImage
    from equigrasp.two_stream import Product, TwoStream

    image = ClipImage(config.tower, config.clip_weights)
    return TwoStream(embedding_size, image, config.semantic_widths, config.widths, config.channels, Product)


def _unet(config: LegConfig, embedding_size: int) -> nn.Module:
    from equigrasp.encoder import UNet

    return UNet(embedding_size, config.channels, config.stride, config.widths)


def _steerable_unet(config: LegConfig, embedding_size: int) -> nn.Module:
    from equigrasp.steerable_encoder import SteerableUNet

    return SteerableUNet(embedding_size, config.channels, config.stride, config.widths, config.phi_group_order)


def _local_steerable_unet(config: LegConfig, embedding_size: int) -> nn.Module:
    from equigrasp.local_encoder import LocalSteerableUNet

    return LocalSteerableUNet(embedding_size, config.channels, config.stride, config.widths, config.phi_group_order)


def _steerable(config: LegConfig, embedding_size: int) -> nn.Module:
    from equigrasp.kernel import SteerableKernel

    return SteerableKernel(
        embedding_size, config.channels, config.kernel_size, config.maximum_frequency, rings=config.rings
    )


def _lifted(config: LegConfig, embedding_size: int) -> nn.Module:
    from equigrasp.kernel import LiftedKernel

    return LiftedKernel(
        embedding_size,
        config.channels,
        config.kernel_size,
        config.maximum_frequency,
        config.group_order,
        config.exact_quarter_turns,
    )


def _plain(config: LegConfig, embedding_size: int) -> nn.Module:
    from equigrasp.kernel import PlainKernel

    return PlainKernel(embedding_size, config.channels, config.kernel_size, config.maximum_frequency)


Builder = Callable[[LegConfig, int], "nn.Module"]
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
