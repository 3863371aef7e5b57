"""The suite's objects: a dict from name to Shape. Another one is a shape of 20 lines, a row here, and a bake."""

from __future__ import annotations

import functools

from equigrasp.errors import unknown
from tasks.objects.asset import ObjectAsset, read
from tasks.objects.block import (
    ANCHOR_BLOCK,
    FLOWER_BLOCK,
    HEART_BLOCK,
    L_BLOCK,
    LIGHTNING_BLOCK,
    MOON_BLOCK,
    STAR_BLOCK,
)
from tasks.objects.bottle import LETTERS, bottle
from tasks.objects.fruit import APPLE, AVOCADO, BANANA, LEMON, STARFRUIT, STRAWBERRY
from tasks.objects.shape import Mark, Part, Shape
from tasks.objects.tool import BOWL, FORK, KNIFE, MEDIUM_CLAMP, MINI_CLAW_HAMMER, MUG, SCISSORS, SPOON
from tasks.objects.toy import HIPPO, LION, RHINO

__all__ = ["OBJECTS", "Mark", "ObjectAsset", "Part", "Shape", "drawing", "load"]

OBJECTS: dict[str, Shape] = {
    "fork": FORK,
    "knife": KNIFE,
    "spoon": SPOON,
    "medium-clamp": MEDIUM_CLAMP,
    "mini-claw-hammer": MINI_CLAW_HAMMER,
    "mug": MUG,
    "scissors": SCISSORS,
    "lion": LION,
    "hippo": HIPPO,
    "rhino": RHINO,
    "bowl": BOWL,
    "banana": BANANA,
    "apple": APPLE,
    "strawberry": STRAWBERRY,
    "lemon": LEMON,
    "starfruit": STARFRUIT,
    "avocado": AVOCADO,
    "L-block": L_BLOCK,
    "star-block": STAR_BLOCK,
    "heart-block": HEART_BLOCK,
    "moon-block": MOON_BLOCK,
    "lightning-block": LIGHTNING_BLOCK,
    "flower-block": FLOWER_BLOCK,
    "anchor-block": ANCHOR_BLOCK,
    **{f"bottle-{letter}": bottle(letter) for letter in LETTERS},
}


def drawing(name: str) -> Shape:
    """The shape of that name.

    Raises:
        InputError: if there is no such object; it names the nearest.
    """
    if name not in OBJECTS:
        raise unknown("object", name, OBJECTS)
    return OBJECTS[name]


@functools.cache
def load(name: str) -> ObjectAsset:
    """The baked object of that name. Cached: its arrays are shared and read-only.

    Raises:
        InputError: if there is no such object; it names the nearest.
    """
    return read(name, drawing(name))
