"""The 220 combinations of a shape and a colour, and the 45 of them that no training data ever shows.

22 shapes in 10 colours. Each shape is held out in two colours, the lemon in three; each colour in four or five
shapes, and no two shapes in the same two colours, so that neither a shape nor a colour is new when
pick-novel-v2 asks for them together.
"""

from __future__ import annotations

from collections.abc import Iterable

from tasks.goal import Goal
from tasks.objects import PAINTS

FRUIT = ("banana", "apple", "strawberry", "lemon", "starfruit", "avocado")
TOOLS = ("fork", "knife", "medium-clamp", "mini-claw-hammer", "mug", "scissors", "spoon", "bowl")
TOYS = ("deer", "elephant", "giraffe", "hippo", "lion", "monkey", "rhino", "zebra")

HELD_OUT: dict[str, tuple[str, ...]] = {
    "banana": ("blue", "purple"),
    "apple": ("green", "orange"),
    "strawberry": ("brown", "gray"),
    "lemon": ("red", "yellow", "cyan"),
    "starfruit": ("red", "pink"),
    "avocado": ("cyan", "gray"),
    "fork": ("green", "yellow"),
    "knife": ("blue", "red"),
    "medium-clamp": ("purple", "pink"),
    "mini-claw-hammer": ("orange", "brown"),
    "mug": ("green", "purple"),
    "scissors": ("yellow", "brown"),
    "spoon": ("blue", "gray"),
    "bowl": ("pink", "cyan"),
    "deer": ("red", "orange"),
    "elephant": ("red", "green"),
    "giraffe": ("cyan", "brown"),
    "hippo": ("blue", "pink"),
    "lion": ("orange", "gray"),
    "monkey": ("yellow", "purple"),
    "rhino": ("blue", "cyan"),
    "zebra": ("yellow", "pink"),
}
"""For each shape the colours that it never has in training."""


def combinations(shapes: Iterable[str]) -> tuple[Goal, ...]:
    """A goal for each shape in each colour that may be trained on."""
    return tuple(Goal(shape, color=color) for shape in shapes for color in PAINTS if color not in HELD_OUT[shape])


def held_out() -> tuple[Goal, ...]:
    """The 45 goals that are for testing alone."""
    return tuple(Goal(shape, color=color) for shape, colors in HELD_OUT.items() for color in colors)
