"""Cutting a mesh where colours meet, so that every face lies in one piece, under one paint.

Meshes are vertices `(V, 3)` in metres and faces `(F, 3)`; what is closed stays closed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tasks.objects.shape import Shape

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]

SNAP = 0.0004  # metres; a border passes through a vertex that is as near, instead of cutting slivers off


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


def cut_paints(shape: Shape, vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Cut faces where paints end, so that every face has one colour.

    The sides of a paint are planes, so the cuts are exact however large the faces are, but for SNAP. Each side cuts
    only what lies on the paint's piece and within the other sides; elsewhere its plane leaves no trace.
    """
    for index, piece in enumerate(shape.pieces):
        for paint in piece.paints:
            beyond = (paint.levels(vertices)[:, faces] > 0.0).all(axis=2).any(axis=0)
            within = ~beyond & (shape.piece_at(vertices[faces].mean(axis=1)) == index)
            for side in range(len(paint.levels(vertices))):
                level = paint.levels(vertices)[side]
                level[np.abs(level) < SNAP] = 0.0
                vertices, faces, within = _cut_within(vertices, faces, within, level)
                within &= paint.levels(vertices[faces].mean(axis=1))[side] < 0.0
    return vertices, faces


def _cut_within(
    vertices: Vertices, faces: Faces, within: NDArray[np.bool_], level: NDArray[np.float64]
) -> tuple[Vertices, Faces, NDArray[np.bool_]]:
    """Cut the faces `within` `(F,)` where a level `(V,)` is zero, and their neighbours at the shared edges only."""
    sides = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    edges, places = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    places = places.reshape(-1, 3)
    crossed = np.zeros(len(edges), dtype=bool)
    crossed[places[within]] = True
    low, high = edges.T
    crossed &= level[low] * level[high] < 0.0
    low, high = low[crossed], high[crossed]
    t = level[low] / (level[low] - level[high])
    fresh = np.where(crossed, len(vertices) + np.cumsum(crossed) - 1, -1)
    result, kept = [], []
    for face, new, chosen in zip(faces.tolist(), fresh[places].tolist(), within.tolist(), strict=True):
        parts = _pieces(face, new)
        result += parts
        kept += [chosen] * len(parts)
    vertices = np.concatenate([vertices, vertices[low] + t[:, None] * (vertices[high] - vertices[low])])
    return vertices, np.array(result, dtype=np.int64), np.array(kept)


def _pieces(face: list[int], new: list[int]) -> list[list[int]]:
    """The triangles that a face becomes when up to two of its edges get a vertex: `new[i]` after corner i, or -1."""
    # Turned so that the first edge has one; of two, the corner between them comes first.
    turn = next((i for i in range(3) if new[i] >= 0 and new[i - 2] < 0), None)
    if turn is None:
        return [face]
    a, b, c = face[turn], face[turn - 2], face[turn - 1]
    ab, ca = new[turn], new[turn - 1]
    return [[a, ab, c], [ab, b, c]] if ca < 0 else [[a, ab, ca], [ab, b, c], [ab, c, ca]]
