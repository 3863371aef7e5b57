"""A user's mesh through the pipeline of the drawn objects: read, solidify, surface, hulls, look, checks.

`python -m tasks.objects.mesh_bake` reads settings as JSON from its input and writes the files of one object into
a folder. `MeshObject.load` runs it as a process of its own, because native code that is given a user's mesh may
take for ever or take the process with it.
"""

from __future__ import annotations

import io
import json
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import igl
import numpy as np
import pybullet
import trimesh
from numpy.typing import NDArray
from PIL import Image

from equigrasp.errors import InputError
from equigrasp.workspace import WORKSPACE
from tasks.objects import bake, mesh_parts
from tasks.objects.mesh_anatomy import MeshAnatomy, packed
from tasks.objects.mesh_file import read_mesh
from tasks.objects.mesh_reference import read_image
from tasks.objects.mesh_solid import Samples, solidify
from tasks.objects.mesh_source import Source, Vertices

HULLS = 64
"""At most: what is hollow and finely divided gets coarser ones."""
TEXELS = 10
"""The look of a face is a square of so many texels, of which it uses half."""
LARGEST = 0.45
"""Metres: the workspace is 0.5 m deep, and an object has to fit in whichever way it is turned."""
SMALLEST = 0.010
THINNEST = 0.0015
TILT = 15.0
"""Degrees that an object may lean over while it settles."""
HOLD = 0.2
"""The oracle's score below which it expects little of a grasp."""
SECONDS = 300
"""Of the processor, for one object."""
MEMORY = 12 * 1024**3

UP: dict[str, list[list[int]]] = {
    "z": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-z": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "y": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    "-y": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "x": [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
    "-x": [[0, 0, 1], [0, 1, 0], [-1, 0, 0]],
}
"""Rotations that bring that axis of the file upwards."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """A mesh in its resting pose, sampled.

    Attributes:
        source: as in the file.
        faces: `(F,)` the faces of the source that have an area.
        vertices: `(V, 3)` those of the source in the frame of the drawing: metres, z up, the table at z = 0.
        samples: the solid in that frame.
    """

    source: Source
    faces: NDArray[np.int64]
    vertices: Vertices
    samples: Samples


def prepare(settings: dict[str, Any]) -> Prepared:
    """Everything before the convex decomposition, which takes most of the time.

    Raises:
        InputError: if no object can be made of it.
    """
    file = Path(settings["file"])
    source = read_mesh(file, settings["look"])
    with np.errstate(all="ignore"):
        if not np.isfinite(source.vertices).all():
            raise InputError(f"{file.name} has vertices that are no numbers or infinite; export it again")
        vertices = source.vertices @ (settings["scale"] * np.array(UP[settings["up"]], dtype=np.float64)).T
        used = vertices[np.unique(source.faces)]
        _check_size(np.ptp(used, axis=0), settings["scale"], file.name)
        # far from its origin a mesh loses digits that the steps below need
        vertices = vertices - used.mean(axis=0)
        a, b, c = (vertices[source.faces[:, i]] for i in range(3))
        faces = np.flatnonzero(np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1)) > 1e-12)
    if not len(faces):
        raise InputError(f"{file.name} is flat: none of its faces has an area; export it as a triangle mesh")
    if settings["pose"] == "rest":
        vertices = vertices @ _rest(_lowered(vertices, source, faces), source, faces, file.name).T
    vertices = _lowered(vertices, source, faces)
    return Prepared(source, faces, vertices, solidify(vertices, source.faces[faces], bake.VOXEL, file.name))


def _check_size(extents: NDArray[np.float64], scale: float, what: str) -> None:
    size = " x ".join(f"{extent:.3g}" for extent in extents)
    longest = float(extents.max())
    if not math.isfinite(longest) or longest == 0.0:
        raise InputError(f"{what} is {size} m in size; export it again")
    fitting = [factor for factor in (0.001, 0.01, 0.0254, 0.1, 10.0, 1000.0) if 0.03 <= longest * factor <= 0.35]
    units = {0.001: "millimetres", 0.01: "centimetres", 0.0254: "inches"}
    factor = fitting[0] if fitting else 0.12 / longest
    way = f"pass scale={scale * factor:.3g}" + (f" if it is in {units[factor]}" if factor in units else "")
    if longest > LARGEST:
        raise InputError(f"{what} is {size} m in size, and {LARGEST} m is the most that fits on the table; {way}")
    if longest < SMALLEST:
        raise InputError(f"{what} is {size} m in size, too small to be grasped; {way}")
    if float(extents.min()) < THINNEST:
        raise InputError(f"{what} is flat: {size} m, and {1000 * THINNEST} mm is the least; give it thickness")


def _lowered(vertices: Vertices, source: Source, faces: NDArray[np.int64]) -> Vertices:
    """Onto the table, its middle above the origin."""
    used = vertices[np.unique(source.faces[faces])]
    low, high = used.min(axis=0), used.max(axis=0)
    return vertices - [*(low + high)[:2] / 2, low[2]]


def _rest(vertices: Vertices, source: Source, faces: NDArray[np.int64], what: str) -> NDArray[np.float64]:
    """The rotation `(3, 3)` to the pose that most ways of dropping it end in."""
    samples = solidify(vertices, source.faces[faces], 2 * bake.VOXEL, what)
    inside = samples.low + samples.step * np.argwhere(samples.distances < 0)
    hull = trimesh.Trimesh(*bake.thinned(vertices[np.unique(source.faces[faces])]), process=False)
    poses, chances = trimesh.poses.compute_stable_poses(hull, center_mass=inside.mean(axis=0), sigma=0.0, threshold=0.0)
    if not len(poses):
        return np.eye(3)
    # of equal chances, as with a cube, the pose that turns it least
    turn = [-float(np.trace(pose[:3, :3])) for pose in poses]
    return np.asarray(poses)[np.lexsort([np.round(turn, 6), -np.round(chances, 4)])[0]][:3, :3]


def bake_mesh(settings: dict[str, Any], out: Path) -> None:
    """Write `object.obj`, `.mtl`, `.png`, `.hulls.obj`, `.json` and `.npz` into a folder.

    Args:
        settings: as `MeshObject` has them: file, look, color, texture, scale, up, pose, parts, mass.
        out: an empty folder.

    Raises:
        InputError: if no object can be made of it; the message says why.
    """
    prepared = prepare(settings)
    file, samples = Path(settings["file"]), prepared.samples
    points = samples.low + samples.step * np.argwhere(samples.distances > bake.POKE)
    blank = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    anatomy = _anatomy((), out / "object.npz", packed(samples.low, samples.step, samples.distances, *blank))
    distances = anatomy.arrays["distances"]
    body = bake.embody(anatomy, samples.low, distances, points, samples.step, HULLS)
    skin, face, where = _skin(prepared, body)
    parts = mesh_parts.from_json(settings["parts"], file.name)
    labels = mesh_parts.label(parts, prepared.source, face, _in_file(prepared, face, where), file.name)
    names = tuple(part.name for part in parts)
    anatomy = _anatomy(names, out / "object.npz", packed(samples.low, samples.step, distances, skin, labels))
    normals, vertices = bake.slope(anatomy, body.vertices), np.round(body.vertices - body.centre, 4)
    colours = _look(settings, prepared, face, where)
    bake.write(out / "object.png", _png(colours, len(body.faces)))
    bake.write(out / "object.mtl", "newmtl object\nKa 1 1 1\nKd 1 1 1\nmap_Kd object.png\n")
    bake.write(out / "object.obj", _obj(vertices, normals, body.faces))
    bake.write(out / "object.hulls.obj", bake.collision_obj(body.pieces))
    numbers = body.numbers(vertices) | {"parts": names}
    _check_stands(out / "object.hulls.obj", body.rest_height, settings)
    _check_graspable(samples, file.name)
    bake.write(out / "object.json", json.dumps(numbers, separators=(",", ":")) + "\n")


def _anatomy(parts: tuple[str, ...], file: Path, arrays: dict[str, NDArray[Any]]) -> MeshAnatomy:
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)  # ty: ignore[invalid-argument-type]
    bake.write(file, content.getvalue())
    return MeshAnatomy(parts, file)


def _lattice() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """The texels of a face: column and row `(T,)` of each in its square, and its barycentric weights `(T, 3)`."""
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(TEXELS), np.arange(TEXELS)))
    used = i + j < TEXELS
    i, j = i[used], j[used]
    return i, j, np.stack([TEXELS - 1 - i - j, i, j], axis=1) / (TEXELS - 1)


def _skin(prepared: Prepared, body: bake.Body) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """A point for each texel of each face, and where it lies on the user's mesh.

    Returns:
        points `(F * T, 3)` in the frame of the drawing, the nearest face `(F * T,)` of the source, and the
        barycentric weights `(F * T, 3)` of the nearest point of it.
    """
    points = (_lattice()[2] @ body.vertices[body.faces]).reshape(-1, 3)
    _, nearest, closest = igl.point_mesh_squared_distance(
        points, prepared.vertices, np.ascontiguousarray(prepared.source.faces[prepared.faces])
    )
    face = prepared.faces[nearest]
    a, b, c = (prepared.vertices[prepared.source.faces[face, i]] for i in range(3))
    ab, ac, ap = b - a, c - a, closest - a
    aa, bb, cc = ((ab * ab).sum(axis=1), (ac * ac).sum(axis=1), (ab * ac).sum(axis=1))
    p, q = (ap * ab).sum(axis=1), (ap * ac).sum(axis=1)
    determinant = np.maximum(aa * bb - cc * cc, 1e-300)
    v, w = (p * bb - q * cc) / determinant, (q * aa - p * cc) / determinant
    weights = np.clip(np.stack([1.0 - v - w, v, w], axis=1), 0.0, 1.0)
    return points, face, weights / weights.sum(axis=1, keepdims=True)


def _in_file(prepared: Prepared, face: NDArray[np.int64], where: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of faces in the units and the frame of the file."""
    return np.einsum("nk,nkd->nd", where, prepared.source.vertices[prepared.source.faces[face]])


def _look(
    settings: dict[str, Any], prepared: Prepared, face: NDArray[np.int64], where: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """The colour `(N, 3)` of each texel."""
    source = prepared.source
    if settings["color"] is not None:
        return np.broadcast_to(np.array(settings["color"], dtype=np.uint8), (len(face), 3))
    if settings["texture"] is not None:
        if not np.isfinite(source.uv).any():
            raise InputError(
                f"{Path(settings['file']).name} has no texture coordinates, so a texture cannot be laid on it; "
                "unwrap it first, or pass color="
            )
        image = read_image(Path(settings["texture"]))
        source = replace(source, images=(image,), texture=np.zeros_like(source.texture))
    return source.colour_at(face, where)


def _columns(faces: int) -> int:
    """Squares in a row of the texture."""
    return math.ceil(math.sqrt(faces))


def _png(colours: NDArray[np.uint8], faces: int) -> bytes:
    """The texture: a square for each face, row by row."""
    i, j, _ = _lattice()
    squares = np.zeros((faces, TEXELS, TEXELS, 3), dtype=np.uint8)
    texels = colours.reshape(faces, len(i), 3)
    # the other half of the square is the mirror image, so that no foreign colour bleeds over the edge
    squares[:, TEXELS - 1 - i, TEXELS - 1 - j] = texels
    squares[:, j, i] = texels
    columns = _columns(faces)
    rows = -(-faces // columns)
    sheet = np.zeros((rows * columns, TEXELS, TEXELS, 3), dtype=np.uint8)
    sheet[:faces] = squares
    picture = sheet.reshape(rows, columns, TEXELS, TEXELS, 3).swapaxes(1, 2).reshape(rows * TEXELS, -1, 3)
    content = io.BytesIO()
    Image.fromarray(picture).save(content, format="PNG", optimize=False, compress_level=9)
    return content.getvalue()


def _obj(vertices: Vertices, normals: Vertices, faces: NDArray[np.int64]) -> str:
    """The visual mesh as OBJ text; corners lie at the middles of their texels."""
    columns = _columns(len(faces))
    rows = -(-len(faces) // columns)
    corners = np.array([[0, 0], [TEXELS - 1, 0], [0, TEXELS - 1]]) + 0.5
    index = np.arange(len(faces))
    uv = np.stack([index % columns, index // columns], axis=1)[:, None] * TEXELS + corners
    uv = (uv / [columns * TEXELS, rows * TEXELS]).reshape(-1, 2)
    lines = ["mtllib object.mtl", "usemtl object"]
    lines += ["v {:.4f} {:.4f} {:.4f}".format(*v) for v in vertices]
    lines += [f"vt {u:.6f} {1.0 - v:.6f}" for u, v in uv]
    lines += ["vn {:.2f} {:.2f} {:.2f}".format(*n) for n in normals]
    for number, (a, b, c) in enumerate((faces + 1).tolist()):
        t = 3 * number + 1
        lines.append(f"f {a}/{t}/{a} {b}/{t + 1}/{b} {c}/{t + 2}/{c}")
    return "\n".join(lines).replace("-0.0000", "0.0000") + "\n"


def _check_stands(hulls: Path, rest_height: float, settings: dict[str, Any]) -> None:
    """Refuse what falls over in its pose: what lies on a table in a scene should lie as it was said to."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, -9.81, client)
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        pybullet.createMultiBody(0, plane, physicsClientId=client)
        shape = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(hulls), physicsClientId=client)
        body = pybullet.createMultiBody(settings["mass"], shape, -1, [0, 0, rest_height], physicsClientId=client)
        for _ in range(480):
            pybullet.stepSimulation(client)
        _, turn = pybullet.getBasePositionAndOrientation(body, client)
        tilt = math.degrees(math.acos(min(1.0, max(-1.0, pybullet.getMatrixFromQuaternion(turn)[8]))))
    finally:
        pybullet.disconnect(client)
    if not tilt < TILT:
        pose = "another up" if settings["pose"] == "rest" else "pose='rest' or another up"
        raise InputError(f"{Path(settings['file']).name} does not stand with {settings['up']} up; pass {pose}")


def _check_graspable(samples: Samples, what: str) -> None:
    """Refuse what the hand can close on nowhere; the oracle looks for the best grasp of the object alone."""
    from tasks.oracle import FREE, GOAL, Truth, best_grasp

    counts = np.array(samples.distances.shape)
    tops = np.where(samples.distances < 0, np.arange(1, counts[2] + 1), 0).max(axis=2)
    u, v = np.meshgrid(np.arange(WORKSPACE.columns), np.arange(WORKSPACE.rows))
    index = np.round((WORKSPACE.to_world(np.stack([u, v], axis=-1)) - samples.low[:2]) / samples.step).astype(np.int64)
    within = ((index >= 0) & (index < counts[:2])).all(axis=-1)
    index[~within] = 0
    top = np.where(within, tops[index[..., 0], index[..., 1]], 0)
    height = np.where(top > 0, samples.low[2] + (top - 0.5) * samples.step, 0.0).astype(np.float32)
    owner = np.where(top > 0, GOAL, FREE).astype(np.int8)
    _, score = best_grasp(Truth(height, owner, top > 0, (0.0, 0.0)))
    if score < HOLD:
        raise InputError(
            f"{what} can be grasped nowhere from above in this pose: the hand opens 80 mm, and its fingers need "
            "room beside what they hold; pass another up, pose='rest' or a smaller scale"
        )


def main() -> None:
    """Bake what the input says; exit 3 and a sentence if it cannot be."""
    request = json.load(sys.stdin)
    try:
        import resource
    except ImportError:  # not on Windows, where only the clock of the parent process limits it
        pass
    else:
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    try:
        bake_mesh(request["settings"], Path(request["out"]))
    except InputError as error:
        print(json.dumps({"error": str(error)}))
        sys.exit(3)
    except MemoryError:
        print(json.dumps({"error": f"{Path(request['settings']['file']).name} takes too much memory; reduce it"}))
        sys.exit(3)


if __name__ == "__main__":
    main()
