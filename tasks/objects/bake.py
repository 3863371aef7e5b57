"""Bake the objects: `python -m tasks.objects.bake [--out DIR] [names...]`.

Each shape becomes a coloured mesh (marching cubes, decimated), convex hulls for physics, and a few numbers.
What is baked ships in the package; running this again writes the same bytes. Only this module needs the extra
`bake`.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import ConvexHull

from tasks.objects import OBJECTS, drawing
from tasks.objects.asset import BAKED, PALETTE_SLOTS, Anatomy
from tasks.objects.shape import COLOURS, METRE, Shape

try:
    import coacd
    import fast_simplification
    from skimage.measure import find_contours, marching_cubes
except ModuleNotFoundError as missing:
    raise ModuleNotFoundError(
        f"Baking needs {missing.name}; install the extra `bake`: pip install 'equigrasp[bake]'.",
        name=missing.name,
    ) from missing

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]

VOXEL = 0.0012  # metres
FACES = 1300  # before the borders of pieces are cut in
SPACING = 0.003  # metres between footprint points
CONCAVITIES = (0.05, 0.035, 0.028)  # CoACD's threshold, from few pieces to many
POKE = 0.0025  # metres that a hull may stand out of the object
HULL_VERTICES = 32
HULL_ERROR = 0.0004  # metres of a piece that its hull may leave out
MARGIN = 0.001  # metres that PyBullet keeps convex hulls clear of what they touch


def grid(shape: Shape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Sample a shape on a cubic grid at VOXEL steps: (points `(X, Y, Z, 3)`, distances `(X, Y, Z)`), metres."""
    coarse = np.stack(np.meshgrid(*[np.arange(-0.16, 0.16, 0.005)] * 2, np.arange(-0.01, 0.12, 0.005)), axis=-1)
    near = coarse.reshape(-1, 3)[shape.distance(coarse.reshape(-1, 3)) < 0.008]
    # Half a voxel off, so that the flat base lies between two layers of the grid, not on one.
    low = np.floor(near.min(axis=0) / VOXEL - 1) * VOXEL - VOXEL / 2
    counts = np.ceil((near.max(axis=0) - low) / VOXEL).astype(int) + 2
    axes = [low[i] + VOXEL * np.arange(counts[i]) for i in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return points, shape.distance(points.reshape(-1, 3)).reshape(points.shape[:3])


def slope(shape: Anatomy, points: Vertices) -> Vertices:
    """The outward unit normals `(N, 3)` of the distance at points `(N, 3)` metres."""
    step = 1e-5
    columns = [shape.distance(points + step * axis) - shape.distance(points - step * axis) for axis in np.eye(3)]
    normals = np.stack(columns, axis=1)
    return normals / np.maximum(np.sqrt((normals**2).sum(axis=1, keepdims=True)), 1e-12)


def surface(
    shape: Anatomy,
    low: NDArray[np.float64],
    distances: NDArray[np.float64],
    voxel: float = VOXEL,
) -> tuple[Vertices, Faces]:
    """The closed surface of a sampled shape: vertices `(V, 3)` metres, about FACES faces `(F, 3)` outward."""
    vertices, faces, _, _ = marching_cubes(distances, 0.0, spacing=(voxel,) * 3)
    vertices, faces = fast_simplification.simplify(
        (vertices + low).astype(np.float32) * np.float32(METRE), faces.astype(np.int32), target_count=FACES
    )
    vertices = vertices.astype(np.float64) / METRE
    # Decimation leaves vertices off the surface by a fraction of a voxel: put them back, but at sharp edges.
    gap = shape.distance(vertices)
    moved = vertices - np.clip(gap, -voxel, voxel)[:, None] * slope(shape, vertices)
    better = np.abs(shape.distance(moved)) < np.abs(gap)
    return np.where(better[:, None], moved, vertices), faces.astype(np.int64)


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


def hulls(vertices: Vertices, faces: Faces, empty: Vertices, most: int = -1) -> list[tuple[Vertices, Faces]]:
    """Convex pieces that together fill a closed mesh, each (vertices `(V, 3)` metres, faces `(F, 3)`).

    The coarsest of CONCAVITIES whose pieces keep clear of the points `empty` `(N, 3)`, else the finest. There are
    `most` of them at most, where that is not -1.
    """
    coacd.set_log_level("error")
    pieces: list[tuple[Vertices, Faces]] = []
    for concavity in CONCAVITIES:
        found = coacd.run_coacd(
            coacd.Mesh(vertices, faces),
            threshold=concavity,
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


def footprint(low: NDArray[np.float64], distances: NDArray[np.float64], voxel: float = VOXEL) -> NDArray[np.float64]:
    """The silhouette from above `(K, 2)` metres: its outlines, and a grid inside, SPACING apart."""
    flat = distances.min(axis=2)
    points = []
    for outline in find_contours(flat, 0.0):
        steps = np.sqrt((np.diff(outline, axis=0) ** 2).sum(axis=1)) * voxel
        walked = np.concatenate([[0.0], np.cumsum(steps)])
        stations = np.linspace(0.0, walked[-1], int(np.ceil(walked[-1] / SPACING)), endpoint=False)
        points.append(np.stack([np.interp(stations, walked, outline[:, i]) for i in range(2)], axis=1))
    stride = round(SPACING / voxel)
    inner = np.argwhere(flat[::stride, ::stride] < -SPACING / 2) * stride
    return np.concatenate([*points, inner]) * voxel + low[:2]


def visual_obj(vertices: Vertices, normals: Vertices, faces: Faces, colours: Sequence[int]) -> str:
    """The coloured mesh as OBJ text; face i takes slot `colours[i]` of the palette."""
    lines = ["mtllib palette.mtl", "usemtl palette"]
    lines += ["v {:.4f} {:.4f} {:.4f}".format(*v) for v in vertices]
    lines += [f"vt {(slot + 0.5) / PALETTE_SLOTS:.6f} 0.5" for slot in range(len(COLOURS))]
    lines += ["vn {:.2f} {:.2f} {:.2f}".format(*n) for n in normals]
    for face, slot in zip((faces + 1).tolist(), colours, strict=True):
        lines.append("f " + " ".join(f"{v}/{slot + 1}/{v}" for v in face))
    return "\n".join(lines).replace("-0.0000", "0.0000") + "\n"


def collision_obj(pieces: list[tuple[Vertices, Faces]]) -> str:
    """The hulls as OBJ text, a group each: PyBullet loads it as a compound."""
    lines, start = [], 1
    for number, (vertices, faces) in enumerate(pieces):
        lines.append(f"o hull{number}")
        lines += ["v {:.4f} {:.4f} {:.4f}".format(*v) for v in vertices]
        lines += ["f {} {} {}".format(*f) for f in faces + start]
        start += len(vertices)
    return "\n".join(lines).replace("-0.0000", "0.0000") + "\n"


def write(path: Path, text: str | bytes) -> None:
    """Write a file whole or not at all."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    partial.write_bytes(text.encode() if isinstance(text, str) else text)
    partial.replace(path)


def bake_palette(out: Path) -> None:
    """Write the colours that all objects share: `palette.png`, a square per slot, and its material."""
    pixels = np.zeros((8, 8 * PALETTE_SLOTS, 3), dtype=np.uint8)
    for slot, colour in enumerate(COLOURS.values()):
        pixels[:, 8 * slot : 8 * slot + 8] = colour
    partial = out / f".palette.{os.getpid()}.partial.png"
    Image.fromarray(pixels).save(partial, optimize=False, compress_level=9)
    partial.replace(out / "palette.png")
    write(out / "palette.mtl", "newmtl palette\nKa 1 1 1\nKd 1 1 1\nmap_Kd palette.png\n")


@dataclass(frozen=True, eq=False)
class Body:
    """What a sampled shape becomes, whichever way it was described.

    Attributes:
        vertices: `(V, 3)` metres in the frame of the drawing; with `faces` `(F, 3)` its closed surface.
        faces: outward.
        centre: `(3,)` metres, the centre of mass in the frame of the drawing.
        pieces: convex hulls in the object's frame, each (vertices `(V, 3)` metres, faces `(F, 3)`).
        outline: `(K, 2)` metres, the footprint in the object's frame.
    """

    vertices: Vertices
    faces: Faces
    centre: NDArray[np.float64]
    pieces: list[tuple[Vertices, Faces]]
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
    shape: Anatomy,
    low: NDArray[np.float64],
    distances: NDArray[np.float64],
    empty: Vertices,
    voxel: float = VOXEL,
    most: int = -1,
) -> Body:
    """Surface, hulls, centre of mass and footprint of a shape.

    Args:
        shape: what says the distance between the samples.
        low: `(3,)` metres, where the first sample lies.
        distances: `(X, Y, Z)` metres, samples `voxel` metres apart.
        empty: `(N, 3)` metres, points that the hulls should keep clear of.
        voxel: metres.
        most: at most so many hulls, where it is not -1.
    """
    vertices, faces = surface(shape, low, distances, voxel)
    _, centre = centre_of_mass(vertices, faces)
    centre = np.round(centre, 6)
    pieces = [(np.round(v - centre, 4), f) for v, f in hulls(vertices, faces, empty, most)]
    return Body(vertices, faces, centre, pieces, np.round(footprint(low, distances, voxel) - centre[:2], 4))


def bake(name: str, out: Path) -> dict[str, int]:
    """Bake one object into `out`: NAME.obj, NAME.hulls.obj, NAME.json. Returns its counts and bytes."""
    shape = drawing(name)
    points, distances = grid(shape)
    body = embody(shape, points[0, 0, 0], distances, points[distances > POKE])
    vertices, faces = cut_borders(shape, body.vertices, body.faces)
    slots = [list(COLOURS).index(piece.colour) for piece in shape.pieces]
    colours = [slots[i] for i in shape.piece_at(vertices[faces].mean(axis=1))]
    normals, vertices = slope(shape, vertices), np.round(vertices - body.centre, 4)
    texts = {
        f"{name}.obj": visual_obj(vertices, normals, faces, colours),
        f"{name}.hulls.obj": collision_obj(body.pieces),
        f"{name}.json": json.dumps(body.numbers(vertices), separators=(",", ":")) + "\n",
    }
    for file, text in texts.items():
        write(out / file, text)
    return {"faces": len(faces), "hulls": len(body.pieces), "bytes": sum(len(text) for text in texts.values())}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tasks.objects.bake",
        description="Bake objects from their shapes. Example: python -m tasks.objects.bake --out baked mug",
    )
    parser.add_argument("names", nargs="*", help=f"default: all of {', '.join(OBJECTS)}")
    parser.add_argument("--out", type=Path, default=BAKED, help="folder to write to (default: the package's)")
    arguments = parser.parse_args()
    try:
        for name in arguments.names:
            drawing(name)
    except ValueError as unknown:
        parser.error(str(unknown))
    arguments.out.mkdir(parents=True, exist_ok=True)
    bake_palette(arguments.out)
    for name in arguments.names or OBJECTS:
        start = time.perf_counter()
        report = bake(name, arguments.out)
        print(
            f"{name:18} {time.perf_counter() - start:5.1f} s  {report['faces']:5} faces  "
            f"{report['hulls']:3} hulls  {report['bytes'] / 1024:6.1f} KiB",
            flush=True,
        )


if __name__ == "__main__":
    main()
