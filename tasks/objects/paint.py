"""Where a mesh changes colour: cut its faces along the borders of pieces and of the marks on them.

A face has one colour. Flat ground leaves decimation in large triangles, which a letter would miss between its
corners: so faces are split along a mark's border first, as far as it takes and no further.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tasks.objects.asset import Anatomy
from tasks.objects.shape import METRE, Shape
from tasks.objects.solid import Distance

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]

WIDE = 0.016  # metres; a longer face near a mark may hide some of it
_ROUNDS = 24
_STEPS = 8
_SAMPLES = np.array([[i, j, _STEPS - i - j] for i in range(_STEPS + 1) for j in range(_STEPS + 1 - i)]) / _STEPS


def slope(shape: Anatomy, points: Vertices) -> Vertices:
    """The outward unit normals `(N, 3)` of the distance at points `(N, 3)` metres."""
    step = 1e-5
    columns = [shape.distance(points + step * axis) - shape.distance(points - step * axis) for axis in np.eye(3)]
    normals = np.stack(columns, axis=1)
    return normals / np.maximum(np.sqrt((normals**2).sum(axis=1, keepdims=True)), 1e-12)


def onto_surface(shape: Anatomy, points: Vertices, reach: float) -> Vertices:
    """Points `(N, 3)` metres, moved to the surface where that is `reach` away at most; at sharp edges they stay."""
    gap = shape.distance(points)
    moved = points - np.clip(gap, -reach, reach)[:, None] * slope(shape, points)
    better = np.abs(shape.distance(moved)) < np.abs(gap)
    return np.where(better[:, None], moved, points)


def cut(vertices: Vertices, faces: Faces, level: NDArray[np.float64]) -> tuple[Vertices, Faces]:
    """Cut faces along the line where a level `(V,)`, linear on each face, is zero. Stays closed."""
    points = list(vertices)
    crossings: dict[tuple[int, int], int] = {}
    result = []
    for face in faces.tolist():
        above = [bool(level[vertex] > 0.0) for vertex in face]
        if all(above) or not any(above):
            result.append(face)
            continue
        alone = next(i for i in range(3) if above.count(above[i]) == 1)
        a, b, c = face[alone], face[alone - 2], face[alone - 1]
        for end in (b, c):
            low, high = min(a, end), max(a, end)
            if (low, high) not in crossings:
                crossings[low, high] = len(points)
                t = level[low] / (level[low] - level[high])
                points.append(vertices[low] + t * (vertices[high] - vertices[low]))
        ab, ac = crossings[min(a, b), max(a, b)], crossings[min(a, c), max(a, c)]
        result += [[a, ab, ac], [ab, b, c], [ab, c, ac]]
    return np.array(points), np.array(result, dtype=np.int64)


def cut_borders(shape: Shape, vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Cut faces where two pieces meet, so that every face lies in one piece and borders are clean lines."""
    for piece in range(len(shape.pieces) if len(shape.pieces) > 1 else 0):
        distances = shape.distances(vertices)
        vertices, faces = cut(vertices, faces, distances[piece] - np.delete(distances, piece, axis=0).min(axis=0))
    return vertices, faces


def cut_marks(shape: Shape, vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Cut faces along the borders of all marks, to within their blur."""
    for mark in [mark for piece in shape.pieces for mark in piece.marks]:

        def level(points: Vertices, solid: Distance = mark.solid) -> NDArray[np.float64]:
            return solid(np.ascontiguousarray(points.T) * METRE) / METRE

        blur = mark.blur / METRE
        for _ in range(_ROUNDS):
            halved = _coarse(level, vertices, faces, blur)
            if not halved:
                break
            count = len(vertices)
            vertices, faces = _halve(vertices, faces, halved)
            vertices[count:] = onto_surface(shape, vertices[count:], blur)
        vertices, faces = cut(vertices, faces, level(vertices))
    return vertices, faces


def _coarse(
    level: Callable[[Vertices], NDArray[np.float64]], vertices: Vertices, faces: Faces, blur: float
) -> set[tuple[int, int]]:
    """The longest edges of the faces on which `cut` would draw a border too far from where the level is zero."""
    corners = vertices[faces]
    lengths = np.sqrt(((corners - np.roll(corners, -1, axis=1)) ** 2).sum(axis=2))
    size = lengths.max(axis=1)
    # A distance grows no faster than one walks, so a face this far from the border has none of it.
    near = np.flatnonzero(np.abs(level(corners.mean(axis=1))) < size)
    samples = np.einsum("sk,fki->fsi", _SAMPLES, corners[near])
    true = level(samples.reshape(-1, 3)).reshape(len(near), len(_SAMPLES))
    linear = level(corners[near].reshape(-1, 3)).reshape(-1, 3) @ _SAMPLES.T
    wrong = (((true > 0.0) != (linear > 0.0)) & (np.abs(true) > blur)).any(axis=1)
    hiding = (size[near] > WIDE) & (np.abs(true).min(axis=1) < size[near] / _STEPS)
    chosen = near[(wrong | hiding) & (size[near] > 2 * blur)]
    longest = lengths[chosen].argmax(axis=1)
    ends = np.stack([faces[chosen, longest], faces[chosen, (longest + 1) % 3]], axis=1)
    return {(min(a, b), max(a, b)) for a, b in ends.tolist()}


def _halve(vertices: Vertices, faces: Faces, edges: set[tuple[int, int]]) -> tuple[Vertices, Faces]:
    """Split these edges in the middle, in every face that has them. Stays closed."""
    order = sorted(edges)
    middle = {edge: len(vertices) + place for place, edge in enumerate(order)}
    ends = np.array(order)
    points = np.concatenate([vertices, vertices[ends].mean(axis=1)])
    result = []
    waiting = faces.tolist()
    while waiting:
        a, b, c = waiting.pop()
        turns = [(a, b, c), (b, c, a), (c, a, b)]
        turns = [turn for turn in turns if (min(turn[:2]), max(turn[:2])) in middle]
        if not turns:
            result.append([a, b, c])
            continue
        a, b, c = max(turns, key=lambda turn: float(((points[turn[0]] - points[turn[1]]) ** 2).sum()))
        m = middle[min(a, b), max(a, b)]
        waiting += [[a, m, c], [m, b, c]]
    return points, np.array(result, dtype=np.int64)
