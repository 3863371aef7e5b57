"""The suite's objects: a dict from name to Shape. Another one is a shape of 20 lines, a row here, and a bake."""

from __future__ import annotations

import functools
from dataclasses import replace

from equigrasp.errors import unknown
from tasks.objects.asset import ObjectAsset, read
from tasks.objects.block import L_BLOCK, LOGO_BLOCKS
from tasks.objects.bottle import LETTERS, bottle
from tasks.objects.fruit import APPLE, AVOCADO, BANANA, LEMON, STARFRUIT, STRAWBERRY
from tasks.objects.shape import Mark, Part, Shape
from tasks.objects.tool import BOWL, FORK, KNIFE, MEDIUM_CLAMP, MINI_CLAW_HAMMER, MUG, SCISSORS, SPOON
from tasks.objects.toy import DEER, ELEPHANT, GIRAFFE, HIPPO, LION, MONKEY, RHINO, ZEBRA

__all__ = [
    "CAPTIONS",
    "LOGOS",
    "OBJECTS",
    "PAINTS",
    "Mark",
    "ObjectAsset",
    "Part",
    "Shape",
    "drawing",
    "load",
    "painted",
    "renamed",
]

CAPTIONS = tuple(LETTERS)
"""What the caps of bottles say."""
LOGOS = tuple(LOGO_BLOCKS)
"""What blocks show."""

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
    "deer": DEER,
    "elephant": ELEPHANT,
    "giraffe": GIRAFFE,
    "monkey": MONKEY,
    "zebra": ZEBRA,
    "bowl": BOWL,
    "banana": BANANA,
    "apple": APPLE,
    "strawberry": STRAWBERRY,
    "lemon": LEMON,
    "starfruit": STARFRUIT,
    "avocado": AVOCADO,
    "L-block": L_BLOCK,
    **{f"block-{logo}": shape for logo, shape in LOGO_BLOCKS.items()},
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


PAINTS: dict[str, tuple[int, int, int]] = {
    "blue": (30, 80, 220),
    "red": (205, 30, 35),
    "green": (25, 140, 50),
    "orange": (250, 125, 10),
    "yellow": (250, 220, 40),
    "purple": (120, 40, 170),
    "pink": (255, 140, 190),
    "cyan": (60, 215, 225),
    "brown": (115, 65, 30),
    "gray": (165, 165, 165),
}
"""What a thing may be painted, sRGB."""


@functools.cache
def renamed(asset: ObjectAsset, name: str) -> ObjectAsset:
    """The same thing under another name. Cached, as what is known of an asset is kept by the asset itself."""
    return replace(asset, name=name)


@functools.cache
def painted(asset: ObjectAsset, color: str) -> ObjectAsset:
    """The same thing all in one colour, called by it: "blue mug".

    Raises:
        InputError: if there is no such colour; it names the nearest.
    """
    if color not in PAINTS:
        raise unknown("colour", color, PAINTS)
    return replace(asset, name=f"{color} {asset.name}", paint=PAINTS[color])
