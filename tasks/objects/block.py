"""Wooden toy blocks: an L that comes in any colour, and cubes with a picture on top. Drawn in millimetres."""

from __future__ import annotations

from tasks.objects.shape import Mark, Part, Shape
from tasks.objects.solid import Distance, both_sides, box, cut, disc, plate, stroke, union

L_BLOCK = Shape(
    (
        Part("body", union(
            box((-46, -50, 0), (-14, 50, 30), 1.5),
            box((-46, -50, 0), (46, -18, 30), 1.5),
        ), "slate", (
            # Its border keeps the shading of the rounded edges off the top.
            Mark(union(
                box((-44, -48, 26), (-16, 48, 34)),
                box((-44, -48, 26), (44, -20, 34)),
            ), "slate"),
        )),
    ),
    faces=400,
)  # fmt: skip

TOP = 32.0
_PAINT = (TOP - 4, TOP + 4)  # marks are on the top face alone


def _picture_block(*marks: tuple[Distance, str]) -> Shape:
    cube = box((-25, -25, 0), (25, 25, TOP), 2)
    return Shape((Part("body", cube, "white", tuple(Mark(*mark) for mark in marks)),), faces=400)


STAR_BLOCK = _picture_block((plate([
    (0, 23), (-6.2, 8.5), (-21.9, 7.1), (-10, -3.2), (-13.5, -18.6),
    (0, -10.5), (13.5, -18.6), (10, -3.2), (21.9, 7.1), (6.2, 8.5),
], *_PAINT), "orange"))  # fmt: skip

HEART_BLOCK = _picture_block((both_sides(union(
    disc((10.2, 8), 10.8, *_PAINT),
    plate([(-1, 0), (-1, 7), (10, 7), (18.9, 1.9), (0, -22)], *_PAINT),
), axis=0), "red"))  # fmt: skip

MOON_BLOCK = _picture_block((cut(
    disc((0, 0), 21, *_PAINT),
    disc((9.5, 3), 16, 0, 99),
), "navy"))  # fmt: skip

LIGHTNING_BLOCK = _picture_block((plate([
    (4, 23), (-17, -5), (-5, -5), (-11, -23), (17, 6), (5, 6), (18, 23),
], *_PAINT), "violet"))  # fmt: skip

FLOWER_BLOCK = _picture_block(
    (union(*(
        disc((x, y), 8, *_PAINT)
        for x, y in ((13.5, 0), (6.75, 11.7), (-6.75, 11.7), (-13.5, 0), (-6.75, -11.7), (6.75, -11.7))
    )), "magenta"),
    (disc((0, 0), 7, *_PAINT), "yellow"),
)  # fmt: skip

ANCHOR_BLOCK = _picture_block((both_sides(union(
    cut(disc((0, 15.5), 6.8, *_PAINT), disc((0, 15.5), 2.4, 0, 99)),
    stroke([(0, 10), (0, -17)], 6, *_PAINT),
    stroke([(0, 5), (10, 5)], 5, *_PAINT),
    stroke([(0, -18), (7, -16.5), (13, -12), (16.5, -6)], 6, *_PAINT),
    plate([(10, -6), (21.5, -9), (18.5, 3)], *_PAINT),
), axis=0), "ink"))  # fmt: skip

LOGO_BLOCKS: dict[str, Shape] = {
    "star": STAR_BLOCK,
    "heart": HEART_BLOCK,
    "moon": MOON_BLOCK,
    "lightning": LIGHTNING_BLOCK,
    "flower": FLOWER_BLOCK,
    "anchor": ANCHOR_BLOCK,
}
"""By what they show on top."""
