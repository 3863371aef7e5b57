"""Bottles that differ in nothing but the letter on their cap. Drawn in millimetres, upright."""

from __future__ import annotations

from collections.abc import Sequence

from tasks.objects.shape import Mark, Part, Shape
from tasks.objects.solid import capsule, disc, stroke, union

TOP = 70.0
STROKE = 7.0

# The strokes of each letter's middle line, seen from above with +y up.
LETTERS: dict[str, Sequence[Sequence[tuple[float, float]]]] = {
    "A": (((-12, -15), (0, 16), (12, -15)), ((-8, -6), (8, -6))),
    "B": (
        ((-10, -15.5), (-10, 15.5), (3, 15.5), (8, 13), (9.5, 8.5), (8, 3.5), (3, 1), (-10, 1)),
        ((3, 1), (9, -2), (11, -7.5), (9, -13), (3, -15.5), (-10, -15.5)),
    ),
    "C": ((
        (13, 10), (8, 14.5), (1, 16), (-6, 14), (-11, 8), (-12.5, 0),
        (-11, -8), (-6, -14), (1, -16), (8, -14.5), (13, -10),
    ),),
    "D": ((
        (-11, -15), (-11, 15), (-1, 15), (6, 12.5), (11, 6.5), (12.5, 0),
        (11, -6.5), (6, -12.5), (-1, -15), (-11, -15),
    ),),
    "E": (((11, 15), (-9, 15), (-9, -15), (11, -15)), ((-9, 0), (8, 0))),
    "H": (((-11, -15.5), (-11, 15.5)), ((11, -15.5), (11, 15.5)), ((-11, 0), (11, 0))),
    "K": (((-10, -15.5), (-10, 15.5)), ((11, 15.5), (-9, -1)), ((-3, 3.5), (12, -15.5))),
    "S": ((
        (10.5, 10.5), (6, 14.8), (0, 16), (-6, 14.8), (-9.8, 10.5), (-9, 5), (-4, 2), (4, -1.5), (9.3, -5),
        (10.5, -10), (6.5, -14.8), (0, -16), (-6.5, -14.8), (-11, -10.5),
    ),),
}  # fmt: skip


def bottle(letter: str) -> Shape:
    """A bottle captioned with one of LETTERS."""
    caption = union(*(stroke(line, STROKE, TOP - 4, TOP + 4) for line in LETTERS[letter]))
    return Shape(
        (
            Part("cap", disc((0, 0), 25, 38, TOP, 1.5), "white", (Mark(caption, "ink"),)),
            Part("body", union(disc((0, 0), 24, 0, 42, 4), capsule((0, 0, 30), (0, 0, 40), 20)), "blue"),
        ),
        faces=350,
    )
