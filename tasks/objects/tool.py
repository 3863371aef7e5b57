"""Kitchen and workshop tools. Drawn in millimetres; the business end points along +x, unless said otherwise.

Flat tools are thickened to 12 mm, so that fingertips that stop 4 mm above the table still hold them.
"""

from __future__ import annotations

from tasks.objects.shape import Part, Shape
from tasks.objects.solid import (
    both_sides,
    box,
    capsule,
    common,
    cut,
    disc,
    ellipsoid,
    plate,
    ring,
    tube,
    union,
)

FORK = Shape(
    (
        Part("head", union(
            plate([(34, -5), (46, -14), (58, -14), (58, 14), (46, 14), (34, 5)], 0, 12, 3),
            both_sides(box((50, 2.3, 0), (90, 7.3, 12), 2)),
            both_sides(box((50, 12, 0), (90, 17, 12), 2)),
        ), "steel"),
        Part("middle", box((-22, -5, 0), (38, 5, 11), 2), "steel"),
        Part("end", plate([(-86, -6), (-86, 6), (-20, 4), (-20, -4)], 0, 13, 3), "navy"),
    )
)  # fmt: skip

KNIFE = Shape(
    (
        Part("head", plate([
            (24, 6), (84, 7), (90, 4), (84, -4), (72, -9), (50, -11), (24, -9),
        ], 0, 12, 2), "steel"),
        Part("middle", box((-22, -5, 0), (28, 5, 11), 2), "steel"),
        Part("end", plate([(-86, -7), (-88, 4), (-80, 6), (-20, 5), (-20, -5), (-60, -5)], 0, 13, 4), "black"),
        Part("end", union(*(disc((x, 0), 3, 6, 13.6, 0.5) for x in (-36, -56, -76))), "steel"),
    )
)  # fmt: skip

SPOON = Shape(
    (
        Part("head", cut(
            common(ellipsoid((64, 0, 13), (28, 20, 17)), box((20, -30, -9), (110, 30, 13))),
            ellipsoid((64, 0, 15), (24, 16, 11)),
        ), "steel"),
        Part("middle", box((-22, -5, 0), (42, 5, 11), 2), "steel"),
        Part("end", capsule((-20, 0, 6.5), (-78, 0, 6.5), 5.5, 9), "wood"),
    )
)  # fmt: skip

MEDIUM_CLAMP = Shape(
    (
        Part("head", union(
            disc((4, 0), 15, 0, 17, 3),
            both_sides(tube([(6, 8, 8, 9), (24, 14, 8, 8), (40, 15, 8, 8), (56, 11, 8, 7), (68, 5, 8, 7)])),
            blend=4,
        ), "black"),
        Part("head", both_sides(box((60, -4, 0), (77, 11, 17), 2)), "orange"),
        Part("head", disc((4, 0), 6, 8, 18.5, 1), "steel"),
        Part("handle", both_sides(capsule((2, 8, 8), (-78, 25, 8), 7, 9)), "orange"),
    )
)  # fmt: skip

MINI_CLAW_HAMMER = Shape(
    (
        Part("head", union(
            box((36, -12, 1), (60, 14, 23), 3),
            capsule((48, 10, 12), (48, 24, 12), 9),
            cut(capsule((48, 26, 12), (48, 36, 12), 13), box((0, 38, -9), (99, 99, 40))),
            tube([
                (48, -8, 12, 11), (47, -20, 12, 10.5), (43, -33, 12, 8.5), (36, -44, 12, 6), (28, -52, 12, 3.5),
            ]),
            blend=3,
        ), "steel"),
        Part("handle", tube([
            (42, 0, 12, 8.5), (-20, 0, 11, 9), (-62, 0, 12, 12.5), (-92, 0, 11, 11),
        ]), "wood"),
    )
)  # fmt: skip

MUG = Shape(
    (
        Part("brim", cut(disc((0, 0), 31, 0, 58, 2), disc((0, 0), 26, 6, 99, 3)), "red"),
        Part("brim", cut(disc((0, 0), 27, 4, 56, 1), disc((0, 0), 25.5, 6.5, 99, 3)), "cream"),
        Part("handle", tube([
            (32, 0, 48, 5.5), (44, 0, 48, 5.5), (52, 0, 41, 5.5),
            (52, 0, 24, 5.5), (44, 0, 15, 5.5), (32, 0, 12, 5.5),
        ]), "red"),
    ),
    blend=3,
)  # fmt: skip

_BLADES = both_sides(plate([(-8, -4), (8, -6), (80, 9), (80, 11), (8, 9), (-8, 6)], 0, 11, 1))
SCISSORS = Shape(
    (
        Part("handle", both_sides(union(
            ring((-52, 24, 5.5), 17, 6),
            tube([(-38, 15, 5.5, 6.5), (-18, 7, 5.5, 6.5), (-2, 0, 5.5, 5.5)]),
            blend=4,
        )), "orange"),
        Part("middle", union(
            common(_BLADES, box((-20, -50, 0), (42, 50, 20))),
            disc((2, 0), 12, 0, 12.5, 1),
        ), "steel"),
        Part("middle", disc((2, 0), 5, 6, 14, 1), "dark steel"),
        # Nobody is asked to hold scissors by their points.
        Part(None, common(_BLADES, box((38, -50, 0), (99, 50, 20))), "steel"),
    )
)  # fmt: skip

# The hand does not open as wide as a bowl: it holds the wall. High, so that there the fingertips are above the curve.
_BOWL = union(
    cut(
        common(disc((0, 0), 58, 0, 120, 30), box((-99, -99, -9), (99, 99, 56))),
        disc((0, 0), 51, 8, 120, 28),
    ),
    ring((0, 0, 56), 54.5, 3.5),
)
BOWL = Shape(
    (
        Part("rim", common(_BOWL, box((-99, -99, 30), (99, 99, 99))), "blue"),
        Part("body", common(_BOWL, box((-99, -99, -9), (99, 99, 32))), "blue"),
    ),
    faces=800,
    sectors=12,
)  # fmt: skip
