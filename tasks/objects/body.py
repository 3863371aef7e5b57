"""Body: what physics and placing need of an object that was sampled as a signed distance, drawn or read from a file.

Surface (marching cubes, decimated), convex hulls, centre of mass, footprint. Only this needs the extra `bake`.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from tasks.objects.asset import Anatomy
from tasks.objects.paint import Faces, Vertices, onto_surface
from tasks.objects.shape import METRE

try:
    import coacd
    import fast_simplification
    from skimage.measure import find_contours, marching_cubes
except ModuleNotFoundError as missing:
    raise ModuleNotFoundError(
        f"Baking needs {missing.name}; install the extra `bake`: pip install -e '.[bake]' in equigrasp's folder.",
        name=missing.name,
    ) from missing

Hull = tuple[Vertices, Faces]
"""Vertices `(V, 3)` in metres and faces `(F, 3)`, outward."""

VOXEL = 0.0012  # metres
FACES = 1300
SPACING = 0.003  # metres between footprint points
CONCAVITIES = (0.05, 0.035, 0.028)  # CoACD's threshold, from few pieces to many
POKE = 0.0025  # metres that a hull may stand out of the object
HULL_VERTICES = 32
HULL_ERROR = 0.0004  # metres of a piece that its hull may leave out
MARGIN = 0.001  # metres that PyBullet keeps convex hulls clear of what they touch


@dataclass(frozen=True, eq=False)
class Samples:
    """A signed distance on a cubic grid.

    Attributes:
        low: `(3,)` metres, where the first sample lies.
        step: metres between two samples.
        distances: `(X, Y, Z)` metres, negative inside; the outermost are positive.
    """

    low: NDArray[np.float64]
    step: float
    distances: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Body:
    """What a sampled object becomes, whichever way it was described.

    Attributes:
        vertices: `(V, 3)` metres in the frame of the drawing; with `faces` `(F, 3)` its closed surface.
        faces: outward.
        centre: `(3,)` metres, the centre of mass in the frame of the drawing.
        pieces: convex hulls in the object's frame.
        outline: `(K, 2)` metres, the footprint in the object's frame.
    """

    vertices: Vertices
    faces: Faces
    centre: NDArray[np.float64]
    pieces: list[Hull]
    outline: NDArray[np.float64]

    @property
    def rest_height(self) -> float:
        """Metres, z of the origin at rest on PyBullet's table."""
        return round(float(MARGIN - min(v[:, 2].min() for v, _ in self.pieces)), 4)

    def numbers(self, vertices: Vertices) -> dict[str, Any]:
        """What `asset.read` reads; `vertices` `(V, 3)` are those of the visual mesh in the object's frame."""
        extent = np.concatenate([self.outline, vertices[:, :2], *(v[:, :2] for v, _ in self.pieces)])
        return {
            "centre": self.centre.tolist(),
            "radius": float(np.ceil(np.sqrt((extent**2).sum(axis=1)).max() * 1e4) / 1e4),
            "rest_height": self.rest_height,
            "footprint": self.outline.tolist(),
        }


def embody(
    shape: Anatomy, samples: Samples, empty: Vertices, faces: int = FACES, sectors: int = 1, most: int = -1
) -> Body:
    """Surface, hulls, centre of mass and footprint of an object.

    Args:
        shape: what says the distance between the samples.
        samples: of its distance.
        empty: `(N, 3)` metres, points that the hulls should keep clear of.
        faces: about how many triangles its surface has.
        sectors: into how many sectors about the z axis it is cut before hulls are sought.
        most: at most so many hulls, where it is not -1.
    """
    vertices, triangles = surface(shape, samples, faces)
    _, centre = centre_of_mass(vertices, triangles)
    centre = np.round(centre, 6)
    if sectors == 1:
        solids = hulls(vertices, triangles, empty, most=most)
    else:
        extent = np.ptp(vertices, axis=0).max()
        solids = [
            solid
            for v, f in wedges(samples, sectors, faces // 4)
            for solid in hulls(v, f, empty, extent / np.ptp(v, axis=0).max())
        ]
    pieces = [(np.round(v - centre, 4), f) for v, f in solids]
    return Body(vertices, triangles, centre, pieces, np.round(footprint(samples) - centre[:2], 4))


def surface(shape: Anatomy, samples: Samples, count: int) -> tuple[Vertices, Faces]:
    """The closed surface of a sampled object: vertices `(V, 3)` metres, about `count` faces `(F, 3)` outward."""
    vertices, faces = _mesh(samples, samples.distances, count)
    # Decimation leaves vertices off the surface by a fraction of a voxel.
    return onto_surface(shape, vertices, samples.step), faces


def wedges(samples: Samples, sectors: int, count: int) -> list[tuple[Vertices, Faces]]:
    """The closed surfaces of a sampled object's sectors about the z axis, side by side, of about `count` faces."""
    axes = [samples.low[i] + samples.step * np.arange(samples.distances.shape[i]) for i in range(2)]
    x, y = np.meshgrid(*axes, indexing="ij")
    turns = 2 * np.pi * np.arange(sectors + 1) / sectors
    walls = [(y * np.cos(turn) - x * np.sin(turn))[..., None] for turn in turns]
    return [
        _mesh(samples, np.maximum(np.maximum(samples.distances, -right), left), count)
        for right, left in pairwise(walls)
    ]


def _mesh(samples: Samples, distances: NDArray[np.float64], count: int) -> tuple[Vertices, Faces]:
    vertices, faces, _, _ = marching_cubes(distances, 0.0, spacing=(samples.step,) * 3)
    vertices, faces = fast_simplification.simplify(
        (vertices + samples.low).astype(np.float32) * np.float32(METRE), faces.astype(np.int32), target_count=count
    )
    return vertices.astype(np.float64) / METRE, faces.astype(np.int64)


def centre_of_mass(vertices: Vertices, faces: Faces) -> tuple[float, NDArray[np.float64]]:
    """Volume in cubic metres and centre of mass `(3,)` in metres of a closed mesh of uniform density."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    volumes = (a * np.cross(b, c)).sum(axis=1) / 6.0
    return float(volumes.sum()), (volumes[:, None] * (a + b + c)).sum(axis=0) / 4.0 / volumes.sum()


def thinned(points: Vertices) -> tuple[Vertices, Faces]:
    """The hull of a few of the points: (vertices `(V, 3)`, faces `(F, 3)` outward), V at most HULL_VERTICES.

    Starts from the extremes along the axes and adds the point furthest outside, until none is more than
    HULL_ERROR out. (CoACD's own decimation to 32 vertices lost up to a quarter of an object's volume.)
    """
    chosen = list(dict.fromkeys([*points.argmin(axis=0).tolist(), *points.argmax(axis=0).tolist()]))
    if len(chosen) == 2:  # a diagonal sliver, whose two ends are its extremes along every axis
        away = np.cross(points - points[chosen[0]], points[chosen[1]] - points[chosen[0]])
        chosen.append(int((away**2).sum(axis=1).argmax()))
    # A flat start has no hull: take the point furthest from the plane of the first three as well.
    across = np.cross(points[chosen[1]] - points[chosen[0]], points[chosen[2]] - points[chosen[0]])
    chosen.append(int(np.abs((points - points[chosen[0]]) @ across).argmax()))
    while True:
        hull = ConvexHull(points[chosen])
        outside = (points @ hull.equations[:, :3].T + hull.equations[:, 3]).max(axis=1)
        worst = int(outside.argmax())
        if outside[worst] <= HULL_ERROR or len(chosen) == HULL_VERTICES:
            break
        chosen.append(worst)
    corners = hull.points[hull.vertices]
    places = {vertex: place for place, vertex in enumerate(hull.vertices.tolist())}
    faces = []
    for (a, b, c), plane in zip(hull.simplices.tolist(), hull.equations, strict=True):
        normal = np.cross(hull.points[b] - hull.points[a], hull.points[c] - hull.points[a])
        faces.append([places[v] for v in ((a, b, c) if normal @ plane[:3] > 0 else (a, c, b))])
    return corners, np.array(faces, dtype=np.int64)


def hulls(vertices: Vertices, faces: Faces, empty: Vertices, scale: float = 1.0, most: int = -1) -> list[Hull]:
    """Convex pieces that together fill a closed mesh, each (vertices `(V, 3)` metres, faces `(F, 3)`).

    The coarsest of CONCAVITIES whose pieces keep clear of the points `empty` `(N, 3)`, else the finest. CoACD
    reads them against the mesh's own size; `scale` is by how much the object is larger. There are `most` of them
    at most, where that is not -1.
    """
    coacd.set_log_level("error")
    pieces: list[Hull] = []
    for concavity in CONCAVITIES:
        found = coacd.run_coacd(
            coacd.Mesh(vertices, faces),
            threshold=concavity * scale,
            max_convex_hull=most,
            # The surface is closed by construction; the check for it aborts the process on thin triangles.
            preprocess_mode="off",
            mcts_iterations=60,
            mcts_nodes=15,
            resolution=1000,
            seed=0,
        )
        pieces = [thinned(corners) for corners in (np.asarray(c, dtype=np.float64) for c, _ in found) if solid(corners)]
        if len(pieces) == most or not any(inside(corners, empty).any() for corners, _ in pieces):
            break
    return pieces


def solid(corners: Vertices) -> bool:
    """Whether the hull of `corners` `(V, 3)` has a volume to speak of; CoACD leaves a flat splinter at times."""
    if len(corners) < 4:
        return False
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    return bool(spread[-1] > 2e-5 * np.sqrt(len(corners)))


def inside(corners: Vertices, points: Vertices) -> NDArray[np.bool_]:
    """Which of the points `(N, 3)` lie in the convex hull of `corners` `(V, 3)`: `(N,)`."""
    near = ((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1)
    planes = ConvexHull(corners).equations
    near[near] = (points[near] @ planes[:, :3].T + planes[:, 3] <= 0.0).all(axis=1)
    return near


def footprint(samples: Samples) -> NDArray[np.float64]:
    """The silhouette from above `(K, 2)` metres: its outlines, and a grid inside, SPACING apart."""
    flat = samples.distances.min(axis=2)
    points = []
    for outline in find_contours(flat, 0.0):
        steps = np.sqrt((np.diff(outline, axis=0) ** 2).sum(axis=1)) * samples.step
        walked = np.concatenate([[0.0], np.cumsum(steps)])
        stations = np.linspace(0.0, walked[-1], int(np.ceil(walked[-1] / SPACING)), endpoint=False)
        points.append(np.stack([np.interp(stations, walked, outline[:, i]) for i in range(2)], axis=1))
    stride = round(SPACING / samples.step)
    inner = np.argwhere(flat[::stride, ::stride] < -SPACING / 2) * stride
    return np.concatenate([*points, inner]) * samples.step + samples.low[:2]
