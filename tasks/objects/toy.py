"""Toy animals, lying on their side: x towards the nose, y towards the back, z through the flanks; millimetres.

The table cuts their lower flank flat, so that body, legs and head rest on it together.
"""

from __future__ import annotations

from tasks.objects.shape import Part, Shape
from tasks.objects.solid import Distance, both_sides, capsule, ellipsoid, sphere, tube, union

FLANK = 16.0  # the animal's plane of symmetry, above the table


def _pair(solid: Distance) -> Distance:
    return both_sides(solid, axis=2, about=FLANK)


def _leg(x: float, hip: float, foot: float, radius: float, lean: float = 0.0) -> Distance:
    """The two legs of a pair, side by side, from the hip down to the foot, in millimetres."""
    return _pair(capsule((x, hip, FLANK + 7), (x + lean, foot, FLANK + 7), 1.15 * radius, radius))


LION = Shape(
    (
        Part("head", ellipsoid((38, 24, FLANK), (24, 27, 21)), "mane"),
        Part("head", union(
            ellipsoid((54, 24, FLANK), (16, 17, 19)),
            ellipsoid((68, 18, FLANK), (13, 10, 13)),
            blend=5,
        ), "sand"),
        Part("head", union(sphere((79, 21, FLANK), 4.5), _pair(sphere((60, 32, FLANK + 15), 3))), "ink"),
        Part("body", union(
            tube([(-40, 4, FLANK, 20), (-5, 4, FLANK, 18), (24, 6, FLANK, 20)]),
            _leg(-44, -4, -44, 8.5, lean=-3),
            _leg(24, -4, -44, 8.5, lean=3),
            tube([(-56, 14, 12, 5), (-70, 18, 10, 4.5), (-78, 36, 9, 4.5)]),
            blend=8,
        ), "sand"),
        Part("body", ellipsoid((-80, 44, 9), (7, 10, 7)), "mane"),
    ),
    blend=3,
)  # fmt: skip

HIPPO = Shape(
    (
        Part("head", union(
            ellipsoid((34, 14, FLANK), (22, 21, 20)),
            ellipsoid((62, 6, FLANK), (19, 20, 21)),
            _pair(sphere((26, 35, FLANK + 9), 5.5)),
            blend=9,
        ), "mauve"),
        Part("head", union(
            _pair(sphere((44, 24, FLANK + 16), 3.2)),
            _pair(sphere((71, 18, FLANK + 13), 3.2)),
        ), "ink"),
        Part("body", union(
            ellipsoid((-18, 2, FLANK), (48, 28, 23)),
            _leg(-42, -10, -38, 10.5),
            _leg(8, -10, -38, 10.5),
            capsule((-62, 12, FLANK), (-72, 0, FLANK - 4), 4.5, 3.5),
            blend=8,
        ), "mauve"),
    ),
    blend=6,
)  # fmt: skip

RHINO = Shape(
    (
        Part("head", union(
            tube([(36, 14, FLANK, 19), (56, 2, FLANK, 16), (74, -8, FLANK, 13)]),
            _pair(capsule((32, 30, FLANK + 9), (29, 42, FLANK + 11), 5, 3)),
            blend=6,
        ), "slate"),
        Part("head", union(
            tube([(76, 0, FLANK, 8), (84, 14, FLANK, 5.5), (86, 32, FLANK, 2)]),
            capsule((62, 10, FLANK, ), (66, 24, FLANK), 6, 2.5),
        ), "ivory"),
        Part("head", _pair(sphere((56, 10, FLANK + 14.5), 3)), "ink"),
        Part("body", union(
            ellipsoid((-16, 4, FLANK), (48, 25, 22)),
            ellipsoid((14, 12, FLANK), (22, 22, 20)),
            _leg(-42, -6, -42, 10),
            _leg(14, -6, -42, 10),
            tube([(-60, 12, 14, 4), (-70, 4, 12, 3.5), (-72, -10, 11, 3.5)]),
            blend=8,
        ), "slate"),
    ),
    blend=4,
)  # fmt: skip
