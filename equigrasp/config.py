"""All that makes a policy, as plain data: a config for each family of models. Costs no torch.

A config is a row of `MODELS`, is changed by `dataclasses.replace`, and is kept with a run as JSON.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

from equigrasp import clip
from equigrasp.errors import InputError, unknown
from equigrasp.naming import attribute, checksum_of
from equigrasp.setting import check_setting

if TYPE_CHECKING:
    from equigrasp.policy import GraspPolicy


@dataclass(frozen=True, kw_only=True)
class ModelConfig:
    """What the configs of all families say.

    Attributes:
        family: which of `FAMILIES` it is; a key of the JSON, without which it is a LEG.
        learning_rate: Adam's, where a training names no other; a family whose networks need another says so.
        name: the row's name.
        summary: one phrase for listings.
        text_encoder: a name from `language.ENCODERS`.
        precision: "auto", "float32" or "bfloat16".
        paper_parameters: what the paper's Table 5 gives for this model, in millions; None where it is ours.
        note: one line for listings, where there is more to say.
    """

    family: ClassVar[str]
    learning_rate: ClassVar[float] = 5e-4
    name: str
    summary: str
    text_encoder: str = "minilm"
    precision: str = "auto"
    paper_parameters: float | None = None
    note: str = ""

    @property
    def encoder(self) -> str:
        """Who reads the instruction, as `language.embed` takes it."""
        return self.text_encoder

    def check(self) -> None:
        """Raise an InputError, soon and before any work, unless this machine has what the config names."""

    def untrained(self) -> ModelConfig:
        """The config of the same modules, whose weights are all about to be loaded or do not matter."""
        return self

    def to_dict(self) -> dict[str, Any]:
        """A dict that JSON takes as it is."""
        values = {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(self).items()}
        return {"family": self.family} | values

    @staticmethod
    def from_dict(values: Mapping[str, Any]) -> ModelConfig:
        """The config that `to_dict` wrote; a setting that was not there yet has its default, which is what it meant.

        Raises:
            InputError: if the family or a key is unknown, a needed one is missing, or a setting is of another type;
                those that a family of your own adds are its own affair.
        """
        settings = dict(values)
        family = str(settings.pop("family", LegConfig.family))
        kind = find_family(family)
        known = {field.name for field in fields(kind)}
        for key, value in settings.items():
            if key not in known:
                raise unknown("setting of a model", key, known)
            if isinstance(value, list):
                settings[key] = tuple(value)
        for field in fields(ModelConfig if issubclass(kind, OwnConfig) else kind):
            if field.name in settings:
                check_setting(field.name, settings[field.name], str(field.type))
        try:
            return kind(**settings)
        except TypeError as error:
            raise InputError(f"this model's config is incomplete: {error}") from None


@dataclass(frozen=True, kw_only=True)
class LegConfig(ModelConfig):
    """A kernel kappa(l) that is correlated with features phi(o, l).

    Attributes:
        kernel: "lifted" (the paper's), "steerable" (the exact basis) or "plain" (no symmetry).
        kernel_size: side of the kernel in read-out cells; odd.
        maximum_frequency: highest frequency of the score over angles; even.
        group_order: n of the lifted kernel's C_n.
        exact_quarter_turns: whether n must be a multiple of 4 (the paper's own 90 is not).
        rings: of the steerable kernel, "gaussian" or "smooth" (`equigrasp.kernel.rings`).
        kernel_language: whether the kernel is told the instruction, or keeps one trained vector in its place.
        phi: "unet"; "steerable-unet", which turns with the scene; or "local-steerable-unet", with each object alone.
        phi_group_order: N of the steerable U-Nets' C_N.
        phi_language: whether phi is told the instruction, or keeps one trained vector in its place.
        channels: features of phi for each cell.
        widths: of phi's U-Net, from 1/2 to 1/32 of the resolution: channels, or regular fields of N channels; of the
            local one, a level each.
        stride: heightmap pixels a read-out cell.
    """

    family = "leg"
    kernel: str
    kernel_size: int
    maximum_frequency: int
    group_order: int = 72
    exact_quarter_turns: bool = True
    rings: str = "gaussian"
    kernel_language: bool = True
    phi: str = "unet"
    phi_group_order: int = 4
    phi_language: bool = True
    channels: int = 8
    widths: tuple[int, ...] = (24, 48, 96, 192, 256)
    stride: int = 2


@dataclass(frozen=True, kw_only=True)
class FcgqConfig(ModelConfig):
    """A fully convolutional network whose channels are the angles (`equigrasp.encoder.UNet`).

    Attributes:
        widths: channels of its U-Net, from 1/2 to 1/32 of the resolution.
        stride: heightmap pixels a read-out cell.
    """

    family = "fcgq"
    # 5e-4 was behind by 0.8 in loss after 3,000 steps (docs/learning.md)
    learning_rate = 2e-4
    widths: tuple[int, ...]
    stride: int = 2


@dataclass(frozen=True, kw_only=True)
class VitConfig(ModelConfig):
    """A transformer over image patches and language tokens (`equigrasp.baselines.vit`).

    Attributes:
        patch: side of a patch, heightmap pixels.
        width: of a token.
        depth: layers.
        heads: of each layer's attention.
        language_tokens: tokens that the instruction becomes.
        widths: channels of the upsampling network, from a patch's resolution to half of the heightmap's.
    """

    family = "vit"
    # at 5e-4 it does not learn even one demonstration by heart, one example a step
    learning_rate = 1e-4
    patch: int = 16
    width: int
    depth: int
    heads: int
    language_tokens: int
    widths: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class ClipConfig(ModelConfig):
    """What the models on CLIP say beside their own: which CLIP, and whose weights it has.

    Attributes:
        tower: a name from `clip.TOWERS`; the image tower is frozen.
        clip_weights: "openai" (from the Hugging Face cache or the network), a `.safetensors` file, or "random", which
            is no CLIP but its layers, and is never chosen for you.
        text_encoder: "clip" for the text tower of the same CLIP by the same weights, or a name from
            `language.ENCODERS`.
        semantic_widths: channels of the semantic stream at 1/32, 1/16, 1/8 and 1/4 of the resolution.
    """

    tower: str
    clip_weights: str = clip.OPENAI
    text_encoder: str = "clip"
    semantic_widths: tuple[int, ...]

    @property
    def encoder(self) -> str:
        """The same tower's text side, unless another encoder is named."""
        if self.text_encoder != "clip":
            return self.text_encoder
        return self.tower if self.clip_weights == clip.OPENAI else f"{self.tower}:{self.clip_weights}"

    def check(self) -> None:
        """Raise an InputError unless the tower exists and its weights are on this machine or can be fetched."""
        clip.find(self.tower)
        if self.clip_weights != clip.RANDOM:
            clip.find_weights(self.tower, self.clip_weights)

    def untrained(self) -> ModelConfig:
        """The same modules and the same reader of instructions, without asking for CLIP's image weights."""
        return replace(self, text_encoder=self.encoder, clip_weights=clip.RANDOM)


@dataclass(frozen=True, kw_only=True)
class LegClipConfig(ClipConfig, LegConfig):
    """A LEG whose phi has two streams, one of them on CLIP; `widths` are the spatial stream's."""

    family = "leg-clip"
    phi: str = "two-stream"


@dataclass(frozen=True, kw_only=True)
class CliportConfig(ClipConfig):
    """CLIPort's pick module with a channel for each angle (`equigrasp.encoder.two_stream`).

    Attributes:
        widths: channels of the spatial stream, from 1/2 to 1/32 of the resolution.
    """

    family = "cliport"
    widths: tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class RotatorConfig(CliportConfig):
    """CLIPort's pick module that sees the scene turned by every angle (`equigrasp.baselines.rotator`).

    Attributes:
        rotations: 36, one for each bin, or 72, one for each of the two ways in which a bin's gripper can stand.
        chunk: rotations that are in memory at a time; changes nothing but memory.
    """

    family = "cliport-rotator"
    rotations: int = 36
    chunk: int = 2


@dataclass(frozen=True, kw_only=True)
class OwnConfig(ModelConfig, ABC):
    """A family of your own: derive from it, add settings as fields, and say in `build` how they become a policy.

    Its `family` is its name in Python, "my_package.my_module:MyConfig". A run keeps it with the settings, and finds
    the class again by it, at the top level of a module. Settings are numbers, strings, booleans and tuples of them.
    `module_checksum` is of the file that it is in, as it was when the class was made: of the code that runs.
    """

    module_checksum: ClassVar[str]

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        cls.family, cls.module_checksum = f"{cls.__module__}:{cls.__qualname__}", checksum_of(cls.__module__)

    @abstractmethod
    def build(self) -> GraspPolicy:
        """The policy with fresh weights from torch's generator; its text encoder is `self.encoder`."""


FAMILIES: dict[str, type[ModelConfig]] = {
    each.family: each for each in (LegConfig, FcgqConfig, VitConfig, LegClipConfig, CliportConfig, RotatorConfig)
}
"""Name of a family -> its config."""


def find_family(name: str) -> type[ModelConfig]:
    """The config of a family, or the class of your own that "my_package.my_module:MyConfig" names.

    Raises:
        InputError: if there is none; it names the nearest, or says what is wrong with the name.
    """
    if ":" in name:
        kind = attribute(name, "a family of models", "MyConfig")
        if not (isinstance(kind, type) and issubclass(kind, OwnConfig)):
            raise InputError(f"{name} is no family of models; one of your own derives from equigrasp.config.OwnConfig")
        return kind
    if name not in FAMILIES:
        raise unknown("family of models", name, FAMILIES)
    return FAMILIES[name]


READ_OUTS = {"full": 1, "half": 2}
"""Heightmap pixels a read-out cell, by its resolution's name; a grasp lies between cells by a parabola in both."""


def read_out_at(config: ModelConfig, resolution: str) -> ModelConfig:
    """The model with a read-out at another resolution. A kernel keeps its size in cells, and so halves in metres.

    Raises:
        InputError: if the resolution is unknown, or the model cannot choose.
    """
    if resolution not in READ_OUTS:
        raise unknown("resolution of a read-out", resolution, READ_OUTS)
    if not isinstance(config, LegConfig | FcgqConfig) or isinstance(config, LegClipConfig):
        raise InputError(f"{config.name} has its own resolution of the read-out; leg and fcgq models choose")
    return replace(config, stride=READ_OUTS[resolution])


LABELS = frozenset({"name", "summary", "paper_parameters", "note"})
"""What is said about a model, and does not make it another one."""


def differences(one: ModelConfig, other: ModelConfig) -> dict[str, tuple[Any, Any]]:
    """The settings in which two configs differ, each with both values; None where one has no such setting."""
    a, b = one.to_dict(), other.to_dict()
    keys = [key for key in {**a, **b} if key not in LABELS]
    return {key: (a.get(key), b.get(key)) for key in keys if a.get(key) != b.get(key)}
