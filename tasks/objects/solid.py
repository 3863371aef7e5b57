"""Solids as signed distances: the primitives that objects are drawn with, and how they join.

A `Distance` maps points `(3, N)` in millimetres to `(N,)` millimetres, negative inside. Objects are drawn in
millimetres, as a workshop drawing is; `Shape` is the one place that turns them into metres. Only elementwise
sums, products, quotients, square roots and comparisons are used, which IEEE fixes to the bit on any machine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Distance = Callable[[Points], NDArray[np.float64]]
Vector = tuple[float, float, float]


def _length(*components: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.sqrt(sum(c * c for c in components))


def sphere(centre: Vector, radius: float) -> Distance:
    """A ball."""

    def distance(p: Points) -> NDArray[np.float64]:
        return _length(p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]) - radius

    return distance


def ellipsoid(centre: Vector, radii: Vector) -> Distance:
    """An ellipsoid along the axes. Its distance is exact to first order at the surface, a bound elsewhere."""

    def distance(p: Points) -> NDArray[np.float64]:
        scaled = [(p[i] - centre[i]) / radii[i] for i in range(3)]
        level = _length(*scaled)
        slope = _length(*(s / r for s, r in zip(scaled, radii, strict=True)))
        # Towards the middle the first order overshoots, and is 0/0 in it; nothing inside is deeper than the
        # shortest radius.
        first_order = np.divide(level * (level - 1.0), slope, out=np.full_like(level, -np.inf), where=slope > 0)
        return np.maximum(first_order, -min(radii))

    return distance


def capsule(start: Vector, end: Vector, radius: float, end_radius: float | None = None) -> Distance:
    """A rod with round ends whose radius goes linearly from `radius` to `end_radius` (the same if None)."""
    last = radius if end_radius is None else end_radius
    along = [e - s for s, e in zip(start, end, strict=True)]
    square = sum(a * a for a in along)

    def distance(p: Points) -> NDArray[np.float64]:
        x, y, z = (p[i] - start[i] for i in range(3))
        t = np.clip((x * along[0] + y * along[1] + z * along[2]) / square, 0.0, 1.0)
        return _length(x - t * along[0], y - t * along[1], z - t * along[2]) - (radius + t * (last - radius))

    return distance


def tube(stations: Sequence[tuple[float, float, float, float]]) -> Distance:
    """A bent rod through stations (x, y, z, radius): capsules end to end."""
    return union(*(capsule(a[:3], b[:3], a[3], b[3]) for a, b in pairwise(stations)))


def box(low: Vector, high: Vector, rounding: float = 0.0) -> Distance:
    """A box along the axes between two corners, its edges rounded within it."""

    def distance(p: Points) -> NDArray[np.float64]:
        q = [np.abs(p[i] - 0.5 * (low[i] + high[i])) - (0.5 * (high[i] - low[i]) - rounding) for i in range(3)]
        outside = _length(*(np.maximum(c, 0.0) for c in q))
        return outside + np.minimum(np.maximum(np.maximum(q[0], q[1]), q[2]), 0.0) - rounding

    return distance


def _extruded(flat: NDArray[np.float64], height: NDArray[np.float64]) -> NDArray[np.float64]:
    outside = _length(np.maximum(flat, 0.0), np.maximum(height, 0.0))
    return outside + np.minimum(np.maximum(flat, height), 0.0)


def disc(centre: tuple[float, float], radius: float, low: float, high: float, rounding: float = 0.0) -> Distance:
    """An upright cylinder from z = `low` to `high`, its edges rounded within it."""

    def distance(p: Points) -> NDArray[np.float64]:
        flat = _length(p[0] - centre[0], p[1] - centre[1]) - (radius - rounding)
        height = np.abs(p[2] - 0.5 * (low + high)) - (0.5 * (high - low) - rounding)
        return _extruded(flat, height) - rounding

    return distance


def ring(centre: Vector, radius: float, thickness: float) -> Distance:
    """A torus lying flat: a rod of radius `thickness` bent to a circle of `radius`."""

    def distance(p: Points) -> NDArray[np.float64]:
        flat = _length(p[0] - centre[0], p[1] - centre[1]) - radius
        return _length(flat, p[2] - centre[2]) - thickness

    return distance


def plate(outline: Sequence[tuple[float, float]], low: float, high: float, rounding: float = 0.0) -> Distance:
    """A flat plate: a simple polygon in x and y, from z = `low` to `high`.

    The outline *grows* by `rounding`, which rounds its corners; the top and bottom faces stay where they are.
    """
    corners = [(float(x), float(y)) for x, y in outline]

    def distance(p: Points) -> NDArray[np.float64]:
        nearest = np.full(p.shape[1], np.inf)
        inside = np.zeros(p.shape[1], dtype=bool)
        for (ax, ay), (bx, by) in pairwise([*corners, corners[0]]):
            dx, dy = bx - ax, by - ay
            x, y = p[0] - ax, p[1] - ay
            t = np.clip((x * dx + y * dy) / (dx * dx + dy * dy), 0.0, 1.0)
            nearest = np.minimum(nearest, (x - t * dx) ** 2 + (y - t * dy) ** 2)
            if dy != 0.0:
                inside ^= ((p[1] >= ay) != (p[1] >= by)) & (x < y * (dx / dy))
        flat = np.where(inside, -1.0, 1.0) * np.sqrt(nearest)
        height = np.abs(p[2] - 0.5 * (low + high)) - (0.5 * (high - low) - rounding)
        return _extruded(flat, height) - rounding

    return distance


def stroke(line: Sequence[tuple[float, float]], width: float, low: float, high: float) -> Distance:
    """A wall along a line in x and y, `width` thick and round at its ends, from z = `low` to `high`."""

    def distance(p: Points) -> NDArray[np.float64]:
        flat = np.full(p.shape[1], np.inf)
        for (ax, ay), (bx, by) in pairwise(line):
            dx, dy = bx - ax, by - ay
            x, y = p[0] - ax, p[1] - ay
            t = np.clip((x * dx + y * dy) / (dx * dx + dy * dy), 0.0, 1.0)
            flat = np.minimum(flat, _length(x - t * dx, y - t * dy))
        height = np.abs(p[2] - 0.5 * (low + high)) - 0.5 * (high - low)
        return _extruded(flat - 0.5 * width, height)

    return distance


def union(*solids: Distance, blend: float = 0.0) -> Distance:
    """All of the solids; within `blend` of each other their surfaces run together (at most blend / 4 out)."""

    def distance(p: Points) -> NDArray[np.float64]:
        return joined([solid(p) for solid in solids], blend)

    return distance


def joined(distances: Sequence[NDArray[np.float64]], blend: float) -> NDArray[np.float64]:
    """The distance `(N,)` to the union of solids whose distances `(N,)` are known, blended in their order."""
    result = distances[0]
    for other in distances[1:]:
        nearest = np.minimum(result, other)
        if blend > 0.0:
            overlap = np.maximum(blend - np.abs(result - other), 0.0)
            nearest = nearest - overlap * overlap / (4.0 * blend)
        result = nearest
    return result


def common(*solids: Distance) -> Distance:
    """What is inside all of the solids."""

    def distance(p: Points) -> NDArray[np.float64]:
        result = solids[0](p)
        for solid in solids[1:]:
            result = np.maximum(result, solid(p))
        return result

    return distance


def cut(solid: Distance, *tools: Distance) -> Distance:
    """The solid without what is inside the tools."""

    def distance(p: Points) -> NDArray[np.float64]:
        result = solid(p)
        for tool in tools:
            result = np.maximum(result, -tool(p))
        return result

    return distance


def both_sides(solid: Distance, axis: int = 1, about: float = 0.0) -> Distance:
    """The solid and its mirror image in the plane where coordinate `axis` equals `about`.

    The solid is drawn on the upper side of that plane; what of it lies below is not seen.
    """

    def distance(p: Points) -> NDArray[np.float64]:
        folded = p.copy()
        folded[axis] = about + np.abs(p[axis] - about)
        return solid(folded)

    return distance
