"""The suite's objects: a dict from name to Shape. Another one is a shape of 20 lines, a row here, and a bake."""

from __future__ import annotations

import functools

from equigrasp.errors import unknown
from tasks.objects.asset import ObjectAsset, read
from tasks.objects.shape import Paint, Part, Shape
from tasks.objects.tool import FORK, KNIFE, MEDIUM_CLAMP, MINI_CLAW_HAMMER, MUG, SCISSORS, SPOON
from tasks.objects.toy import DEER, ELEPHANT, GIRAFFE, HIPPO, LION, MONKEY, RHINO, ZEBRA

__all__ = ["OBJECTS", "ObjectAsset", "Paint", "Part", "Shape", "drawing", "load"]

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
