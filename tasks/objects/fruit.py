"""Fruit, drawn in millimetres. Each is cut flat at the table, so that none of it rolls away."""

from __future__ import annotations

from tasks.objects.shape import Mark, Part, Shape
from tasks.objects.solid import Distance, box, capsule, common, cut, ellipsoid, plate, sphere, tube, union

BANANA = Shape(
    (
        Part("stem", tube([(62, -10, 13, 8), (73, -22, 12, 5.5), (84, -36, 11, 5)]), "yellow", (
            Mark(sphere((88, -41, 11), 12), "mane"),
        )),
        Part("body", tube([
            (-80, -34, 12, 6), (-72, -22, 13, 10.5), (-56, -4, 14, 15), (-34, 10, 15, 17.5), (-10, 17, 16, 18.5),
            (14, 17, 16, 18.5), (36, 10, 15, 17), (52, 0, 14, 14), (66, -14, 13, 8),
        ]), "yellow", (
            Mark(sphere((-85, -41, 12), 12), "mane"),
        )),
    ),
    blend=3,
    faces=900,
)  # fmt: skip

APPLE = Shape(
    (
        Part("body", cut(
            union(ellipsoid((0, 0, 32), (32.5, 32.5, 26)), ellipsoid((0, 0, 20), (26, 26, 24)), blend=10),
            sphere((0, 0, 66), 16),
        ), "red", (
            Mark(sphere((0, 0, 50), 7), "mane"),
        )),
        Part("body", tube([(0, 0, 44, 3), (0, 0, 56, 2.5), (-7, -3, 66, 3.5)]), "mane"),
        Part("body", common(
            ellipsoid((18, 5, 57), (16, 8.5, 5)),
            ellipsoid((18, 5, 50), (30, 20, 10)),
        ), "leaf"),
    ),
    blend=1,
    faces=1000,
    sectors=6,
)  # fmt: skip

# Seeds are where rods from the core come out, one every 60 degrees about it.
_SEEDS = union(*(
    capsule((x, 0, z), (x - 6, 30 * across, z + 30 * up), 1.9)
    for row, (x, z) in enumerate(((-24, 13), (-14, 16), (-4, 18), (6, 19), (16, 19)))
    for across, up in (((0, 1), (0.87, 0.5), (-0.87, 0.5)), ((0.5, 0.87), (-0.5, 0.87), (1, 0), (-1, 0)))[row % 2]
))  # fmt: skip
STRAWBERRY = Shape(
    (
        Part("body", union(
            ellipsoid((6, 0, 19), (26, 24, 22)),
            ellipsoid((-10, 0, 16), (27, 17, 17)),
            blend=12,
        ), "red", (
            Mark(_SEEDS, "cream"),
        )),
        Part("leaves", union(
            tube([(31, 0, 19, 7), (40, 0, 19, 4), (47, 3, 19, 3.5)]),
            *(
                tube([(32, 0, 19, 6), (25, 18 * across, 19 + 18 * up, 6), (12, 24 * across, 19 + 24 * up, 2)])
                for across, up in ((0, 1), (0.87, 0.3), (-0.87, 0.3))
            ),
        ), "leaf"),
    ),
    blend=2,
    faces=900,
)  # fmt: skip

LEMON = Shape(
    (
        Part("body", union(
            ellipsoid((0, 0, 19), (32, 23.5, 23)),
            tube([(-22, 0, 19, 13), (-38, 0, 18, 5)]),
            tube([(22, 0, 19, 13), (36, 0, 18, 6), (43, 0, 18, 4)]),
            blend=10,
        ), "yellow", (
            Mark(sphere((-46, 0, 18), 6), "leaf"),
        )),
    ),
    faces=900,
    sectors=4,
)  # fmt: skip

_STAR = ((0, 1), (-0.59, 0.81), (-0.95, 0.31), (-0.95, -0.31), (-0.59, -0.81))  # tips and hollows, counter-clockwise
_STAR = (*_STAR, *((-x, -y) for x, y in _STAR))


def _star(tip: float, hollow: float) -> list[tuple[float, float]]:
    """The outline of a star with five points, one of them along +y."""
    return [(x * r, y * r) for (x, y), r in zip(_STAR, (tip, hollow) * 5, strict=True)]


STARFRUIT = Shape(
    (
        Part("body", plate(_star(27, 11), 0, 27, 6), "lime", (
            Mark(plate(_star(25, 9), 20, 40, 2), "flesh"),
            Mark(union(*(
                capsule((8 * x, 8 * y, 27), (12 * x, 12 * y, 27), 1.8) for x, y in _STAR[::2]
            )), "mane"),
        )),
    ),
    faces=1000,
)  # fmt: skip


def _pear(inset: float) -> Distance:
    return tube([(-12, 0, 25, 30 - inset), (4, 0, 25, 27 - inset), (30, 0, 25, 16 - inset), (38, 0, 25, 13 - inset)])


# Half of one, its stone left in.
AVOCADO = Shape(
    (
        Part("body", common(_pear(0), box((-60, -60, -20), (70, 60, 25), 1)), "rind", (
            Mark(common(_pear(4), box((-60, -60, 22), (70, 60, 40))), "flesh"),
        )),
        Part("pit", sphere((-12, 0, 23), 13), "wood"),
    ),
    faces=900,
    sectors=6,
)  # fmt: skip
