"""Toy animals, lying on their side: x towards the nose, y towards the back, z through the flanks; millimetres.

The table cuts their lower flank flat, so that body, legs and head rest on it together.
"""

from __future__ import annotations

from collections.abc import Sequence

from tasks.objects.shape import Mark, Part, Shape
from tasks.objects.solid import Distance, both_sides, capsule, ellipsoid, plate, sphere, tube, union

FLANK = 16.0  # the animal's plane of symmetry, above the table


def _pair(solid: Distance) -> Distance:
    return both_sides(solid, axis=2, about=FLANK)


def _leg(x: float, hip: float, foot: float, radius: float, lean: float = 0.0) -> Distance:
    """The two legs of a pair, side by side, from the hip down to the foot, in millimetres."""
    return _pair(capsule((x, hip, FLANK + 7), (x + lean, foot, FLANK + 7), 1.15 * radius, radius))


def _print(outline: Sequence[tuple[float, float]], bottom: float, colour: str) -> Mark:
    """Paint from above, down to the height `bottom`, within an outline in x and y."""
    return Mark(plate(outline, bottom, 99), colour, blur=2.0)


def _stripes(lines: Sequence[tuple[float, float, float, float]], width: float, colour: str) -> tuple[Mark, ...]:
    """Stripes on the upper flank, from (x, y) to (x, y) each."""
    stripes = []
    for ax, ay, bx, by in lines:
        length = ((bx - ax) ** 2 + (by - ay) ** 2) ** 0.5
        x, y = width / 2 * (by - ay) / length, width / 2 * (ax - bx) / length
        stripes.append(_print(((ax + x, ay + y), (bx + x, by + y), (bx - x, by - y), (ax - x, ay - y)), FLANK, colour))
    return tuple(stripes)


def _spots(places: Sequence[tuple[float, float, float]], colour: str) -> tuple[Mark, ...]:
    """Four-cornered spots on the upper flank: x and y of the middle, and how far the corners are from it."""
    corners = ((0.9, 0.4), (-0.4, 0.9), (-0.9, -0.4), (0.4, -0.9))
    return tuple(_print(tuple((x + r * u, y + r * v) for u, v in corners), FLANK, colour) for x, y, r in places)


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

DEER = Shape(
    (
        Part("head", union(
            tube([(34, 32, FLANK, 11), (44, 42, FLANK, 13), (66, 33, FLANK, 8.5)]),
            _pair(capsule((36, 48, FLANK + 6), (20, 52, FLANK + 8), 5.5, 4)),
            blend=5,
        ), "wood"),
        Part("head", union(
            tube([(42, 50, FLANK, 5), (36, 66, FLANK, 5), (26, 78, FLANK, 5), (28, 94, FLANK, 4.5)]),
            tube([(34, 68, FLANK, 5), (50, 74, FLANK, 4.5), (54, 88, FLANK, 4.5)]),
        ), "cream"),
        Part("head", union(sphere((74, 32, FLANK), 4.5), sphere((50, 45, FLANK + 11), 3)), "ink"),
        Part("body", union(
            tube([(-38, 4, FLANK, 17), (-8, 2, FLANK, 16), (18, 5, FLANK, 17)]),
            tube([(18, 10, FLANK, 14), (34, 32, FLANK, 10)]),
            _leg(-44, -4, -52, 7, lean=-2),
            _leg(22, -4, -52, 7, lean=2),
            blend=8,
        ), "wood", (
            _print(((-36, -9), (-34, -30), (14, -30), (16, -9), (6, -6), (-26, -6)), 8, "cream"),
            *_spots([
                (-44, 12, 4.5), (-30, 13, 4.5), (-16, 12, 4.5), (-2, 12, 4.5), (12, 14, 4.5),
                (-37, 2, 4.5), (-23, 2, 4.5), (-9, 1, 4.5), (5, 2, 4.5),
            ], "cream"),
        )),
        Part("body", tube([(-52, 12, FLANK, 6), (-64, 20, FLANK, 5)]), "cream"),
    ),
    blend=3,
    faces=900,
)  # fmt: skip

ELEPHANT = Shape(
    (
        Part("head", union(
            ellipsoid((38, 18, FLANK), (22, 22, 20)),
            tube([
                (52, 12, FLANK, 12), (64, -4, FLANK, 9.5), (69, -24, FLANK, 8), (70, -40, FLANK, 7),
                (80, -47, FLANK, 6),
            ]),
            blend=8,
        ), "steel", _spots([(50, 24, 4)], "ink")),
        Part("head", ellipsoid((20, 20, FLANK + 19), (18, 23, 7)), "dark steel"),
        Part("head", _pair(tube([
            (54, 2, FLANK + 9, 5), (66, -14, FLANK + 11, 4.5), (76, -18, FLANK + 11, 3.5),
        ])), "ivory"),
        Part("body", union(
            ellipsoid((-20, 6, FLANK), (44, 30, 23)),
            _leg(-42, -6, -44, 11),
            _leg(10, -6, -44, 11),
            tube([(-60, 16, 14, 4.5), (-72, 4, 12, 4.5), (-75, -14, 11, 4.5)]),
            blend=8,
        ), "steel"),
    ),
    blend=4,
)  # fmt: skip

GIRAFFE = Shape(
    (
        Part("head", union(
            tube([(42, 72, FLANK, 10), (48, 80, FLANK, 11), (70, 72, FLANK, 8)]),
            _pair(capsule((42, 84, FLANK + 4), (37, 100, FLANK + 5), 5, 4.5)),
            _pair(capsule((38, 80, FLANK + 6), (26, 84, FLANK + 8), 5, 4)),
            blend=4,
        ), "sand", _spots([(54, 82, 4)], "ink")),
        Part("body", union(
            tube([(-34, -4, FLANK, 16), (-8, 0, FLANK, 17), (14, 4, FLANK, 16)]),
            tube([(14, 8, FLANK, 15), (26, 36, FLANK, 11), (42, 72, FLANK, 9.5)]),
            _leg(-38, -12, -58, 7, lean=-2),
            _leg(16, -12, -58, 7, lean=2),
            tube([(-48, 2, 14, 4.5), (-57, -14, 13, 4.5), (-58, -26, 13, 4.5)]),
            blend=8,
        ), "sand", _spots([
            (-40, 4, 7), (-26, 6, 7), (-12, 8, 7), (2, 11, 7), (15, 17, 7), (-34, -9, 7), (-19, -7, 7), (-4, -5, 7),
            (11, -1, 7), (20, 31, 6), (28, 44, 6), (34, 58, 6), (-39, -26, 6), (-39, -42, 6), (17, -20, 6),
            (17, -38, 6),
        ], "mane")),
    ),
    blend=3,
    faces=900,
)  # fmt: skip

# In profile but for its face, which looks up: from above, two eyes and two ears say "monkey".
MONKEY = Shape(
    (
        Part("head", union(
            ellipsoid((40, 34, FLANK), (21, 20, 18)),
            capsule((20, 46, FLANK + 2), (18, 47, FLANK + 2), 9),
            capsule((56, 52, FLANK + 2), (57, 54, FLANK + 2), 9),
            blend=3,
        ), "mane"),
        Part("head", ellipsoid((45, 30, FLANK + 10.5), (15.5, 13.5, 12)), "cream"),
        Part("head", union(sphere((39, 36, FLANK + 20), 3.6), sphere((52, 36, FLANK + 20), 3.6)), "ink"),
        Part("body", union(
            tube([(-32, -6, FLANK, 17), (-10, 4, FLANK, 15), (16, 12, FLANK, 16)]),
            tube([(18, 6, FLANK, 9), (26, -20, FLANK, 8), (34, -50, FLANK, 8)]),
            tube([(-34, -10, FLANK, 11), (-22, -30, FLANK, 8), (-34, -52, FLANK, 8)]),
            tube([
                (-44, 0, 14, 6), (-64, 2, 12, 5.5), (-76, 16, 11, 5.5), (-76, 36, 11, 5), (-62, 48, 11, 5),
                (-46, 42, 11, 5), (-44, 28, 11, 5), (-56, 24, 11, 5),
            ]),
            blend=6,
        ), "mane", (
            _print(((-28, -13), (-22, -26), (0, -20), (14, -7), (14, 0), (4, 1), (-16, -4)), 8, "cream"),
        )),
    ),
    blend=3,
    faces=900,
)  # fmt: skip

ZEBRA = Shape(
    (
        Part("head", union(
            tube([(40, 42, FLANK, 13), (50, 38, FLANK, 14), (72, 20, FLANK, 10)]),
            _pair(capsule((36, 50, FLANK + 7), (32, 62, FLANK + 8), 5, 4)),
            blend=5,
        ), "ivory", (
            *_stripes([(48, 54, 36, 30), (64, 46, 52, 22)], 5, "ink"),
            *_spots([(51, 41, 4)], "ink"),
            _print(((64, 8), (90, -10), (96, 30), (77, 30)), 6, "ink"),
        )),
        Part("body", tube([(0, 27, FLANK, 6), (14, 38, FLANK, 8), (30, 52, FLANK, 7)]), "ink"),
        Part("body", union(
            tube([(-38, 5, FLANK, 19), (-10, 2, FLANK, 18), (16, 5, FLANK, 19)]),
            tube([(18, 12, FLANK, 18), (38, 40, FLANK, 13)]),
            _leg(-42, -4, -50, 8, lean=-2),
            _leg(20, -4, -50, 8, lean=2),
            blend=8,
        ), "ivory", _stripes([
            (-44, 28, -50, -16), (-29, 28, -30, -20), (-14, 28, -13, -20), (1, 28, 4, -20), (18, 32, 17, -8),
            (12, 46, 44, 14), (24, 56, 54, 28), (-60, -28, -30, -28), (8, -28, 40, -28),
        ], 7, "ink")),
        Part("body", tube([(-54, 14, 13, 4.5), (-66, 0, 11, 4.5), (-69, -18, 11, 6)]), "ink"),
    ),
    blend=3,
    faces=800,
)  # fmt: skip
