"""MODELS: every policy of the paper's tables as one row, and `build`, which makes it.

Rows differ by their fields, a variant is one `dataclasses.replace`, and a run keeps its config as JSON. Nothing here
costs torch until `build`, which lets `equigrasp.composition` make what the config says.
"""

from __future__ import annotations

import json
from dataclasses import fields
from typing import TYPE_CHECKING

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

if TYPE_CHECKING:
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
            summary="exact kernel, a steerable basis that the instruction weighs; and a U-Net",
            kernel="steerable",
            kernel_size=33,
            maximum_frequency=16,
            # runs and results from before this setting existed have these; changed, they would be of another model
            rings="gaussian",
        ),
        LegConfig(
            name="leg-equivariant",
            summary="exact for quarter turns of the whole scene: the steerable basis, and a U-Net that turns by C_4",
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
            summary="exact kernel, the steerable basis; and features of CLIP and of RGB-D, multiplied",
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


def check_kept(config: ModelConfig) -> None:
    """Raise an InputError unless a file that records the config leads any other process back to it."""
    if not isinstance(config, OwnConfig):
        return
    _check_settings(config)
    if type(config).__module__ in ("__main__", "__mp_main__"):
        raise InputError(
            f"{config.family} is a class of the script that runs, where nothing else finds it; put it into a module of "
            "its own, as docs/my_policy.py is, and import it before you train or save"
        )


def _check_settings(config: OwnConfig) -> None:
    """Raise an InputError unless JSON gives the config back as it is."""
    if "<locals>" in config.family:
        raise InputError(
            f"{config.family} is defined inside a function, where nothing finds it again; define it at the top level "
            "of its module"
        )
    allowed = "settings are numbers, strings, booleans and tuples of them"
    try:
        values = json.loads(json.dumps(config.to_dict()))
    except (TypeError, ValueError) as error:
        raise InputError(f"{config.name} cannot be recorded as JSON ({error}); {allowed}") from None
    again = ModelConfig.from_dict(values)
    if type(again) is not type(config):
        raise InputError(f"{config.family} is another class by now; make {config.name} again from that one")
    for key in (field.name for field in fields(config)):
        before, after = getattr(config, key), getattr(again, key)
        if before != after:
            raise InputError(
                f"{config.name} has {key}={before!r:.100}, which a file gives back as {after!r:.100}; {allowed}"
            )


def build(config: ModelConfig | str, seed: int = 0) -> GraspPolicy:
    """Make the policy with fresh weights: same config and seed, same bits; torch's own generators stay as they were.

    Raises:
        InputError: if a name or a setting cannot be, a setting of your own would be another when read from a file, or
            what your own config builds is no policy of that config, or has parts of two dtypes.
    """
    return _build(config, seed, "cpu")


def _build(config: ModelConfig | str, seed: int, device: str) -> GraspPolicy:
    if isinstance(config, str):
        config = find(config)
    config.check()
    if isinstance(config, OwnConfig):
        _check_settings(config)

    import torch

    from equigrasp import language
    from equigrasp.composition import BUILDERS
    from equigrasp.kernel.inputs import check_dtypes
    from equigrasp.policy import GraspPolicy, LegPolicy

    size = language.width(config.encoder)
    # whatever torch's default device is: the bits of a GPU's generator are others
    with torch.random.fork_rng(devices=[]), torch.device(device):
        # not torch.manual_seed, which would seed the generators of all GPUs, too
        torch.default_generator.manual_seed(seed)
        policy = config.build() if isinstance(config, OwnConfig) else BUILDERS[type(config)](config, size)
    if not isinstance(policy, GraspPolicy) or policy.text_encoder != config.encoder:
        made = getattr(policy, "text_encoder", type(policy).__name__)
        raise InputError(
            f"{config.family} builds {made!r}, but it must build a GraspPolicy on the text encoder {config.encoder!r}, "
            "as its config says (self.encoder)"
        )
    if isinstance(config, LegConfig | FcgqConfig) and policy.stride != config.stride:
        raise InputError(
            f"{config.name} has stride {config.stride}, but the policy that it builds has {policy.stride}; build it "
            f"with the config's, or set stride={policy.stride}"
        )
    if isinstance(policy, LegPolicy):
        check_dtypes(policy.phi, policy.kappa)
    policy.config = config
    return policy


def count_parameters(config: ModelConfig) -> tuple[int, int]:
    """Trainable and frozen parameters of a row; asks for no weights. The paper's Table 5 counts the former."""
    # a count needs no numbers, and 100 million of them take seconds; but a steerable basis is computed from some, and
    # a network of a user's own may compute with any
    device = "cpu" if isinstance(config, LegConfig | OwnConfig) else "meta"
    parameters = list(_build(config.untrained(), 0, device).parameters())
    trainable = sum(each.numel() for each in parameters if each.requires_grad)
    return trainable, sum(each.numel() for each in parameters) - trainable
