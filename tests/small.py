"""A model of which a step takes milliseconds, with everything that `leg-steerable` has."""

from __future__ import annotations

from dataclasses import replace

from equigrasp.models import MODELS

SMALL = replace(
    MODELS["leg-steerable"],
    kernel_size=17,
    maximum_frequency=4,
    channels=4,
    widths=(8, 8, 16, 16, 16),
    text_encoder="hashing",
)
