"""ModelConfig: all that makes a policy, as plain data. Costs no torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any

from equigrasp.errors import InputError, unknown


@dataclass(frozen=True)
class ModelConfig:
    """What `build` needs to make a policy, and nothing else.

    Attributes:
        name: the row's name.
        summary: one phrase for listings.
        kernel: "lifted" (the paper's), "steerable" (the exact basis) or "plain" (no symmetry).
        kernel_size: side of the kernel in read-out cells; odd.
        maximum_frequency: highest frequency of the score over angles; even.
        group_order: n of the lifted kernel's C_n.
        exact_quarter_turns: whether n must be a multiple of 4 (the paper's own 90 is not).
        rings: of the steerable kernel, "gaussian" or "smooth" (`equigrasp.rings`).
        kernel_language: whether the kernel is told the instruction, or keeps one trained vector in its place.
        phi: "unet"; "steerable-unet", which turns with the scene; or "local-steerable-unet", with each object alone.
        phi_group_order: N of the steerable U-Nets' C_N.
        phi_language: whether phi is told the instruction, or keeps one trained vector in its place.
        channels: features of phi for each cell.
        widths: of phi's U-Net, from 1/2 to 1/32 of the resolution: channels, or regular fields of N channels; of the
            local one, a level each.
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
    rings: str = "gaussian"
    kernel_language: bool = True
    phi: str = "unet"
    phi_group_order: int = 4
    phi_language: bool = True
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
        """The config that `to_dict` wrote; a setting that was not there yet has its default, which is what it meant.

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
