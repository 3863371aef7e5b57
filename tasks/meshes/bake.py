"""A user's mesh through the pipeline of the drawn objects: read, solidify, surface, hulls, look, checks.

`python -m tasks.meshes.bake` reads settings as JSON from its input and writes the files of one object into
a folder. `MeshObject.load` runs it as a process of its own, because native code that is given a user's mesh may
take for ever or take the process with it.
"""

from __future__ import annotations

import io
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from equigrasp.artefacts import write_atomically
from equigrasp.errors import InputError
from tasks.meshes import formats
from tasks.meshes.anatomy import MeshAnatomy, packed
from tasks.meshes.check import check_graspable, check_height, check_size, check_stands
from tasks.meshes.look import Prepared, in_file, look, skin, texture_png, visual_obj
from tasks.meshes.parts import check_names, from_json, label
from tasks.meshes.solid import solidify
from tasks.meshes.source import Source, Vertices
from tasks.objects import bake
from tasks.objects.body import POKE, VOXEL, Body, Samples, embody, thinned
from tasks.objects.paint import slope

HULLS = 64
"""At most: what is hollow and finely divided gets coarser ones."""
FOOTING = 12
"""Points, at most, of the flank that an object lies on, added to a hull."""
FLANK = 0.0008
"""Metres off the bottom that are cut away, so that what is round or rough gets a flat flank to lie on."""
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


def prepare(settings: dict[str, Any]) -> Prepared:
    """Everything before the convex decomposition, which takes most of the time.

    Raises:
        InputError: if no object can be made of it.
    """
    file = Path(settings["file"])
    source = formats.read(file, settings["look"])
    check_names(from_json(settings["parts"], file.name), source, file.name)
    if settings["texture"] is not None and not np.isfinite(source.uv).any():
        raise InputError(
            f"{file.name} has no texture coordinates, so no texture can be laid on it; unwrap it first, or pass color="
        )
    with np.errstate(all="ignore"):
        if not np.isfinite(source.vertices).all():
            raise InputError(f"{file.name} has vertices that are no numbers or infinite; export it again")
        vertices = source.vertices @ (settings["scale"] * np.array(UP[settings["up"]], dtype=np.float64)).T
        used = vertices[np.unique(source.faces)]
        check_size(np.ptp(used, axis=0), settings["scale"], file.name)
        # far from its origin a mesh loses digits that the steps below need
        vertices = vertices - used.mean(axis=0)
        a, b, c = (vertices[source.faces[:, i]] for i in range(3))
        faces = np.flatnonzero(np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1)) > 1e-12)
    if not len(faces):
        raise InputError(f"{file.name} is flat: none of its faces has an area; export it as a triangle mesh")
    if settings["pose"] == "rest":
        vertices = vertices @ _rest(_lowered(vertices, source, faces), source, faces, file.name).T
    vertices = _lowered(vertices, source, faces) - [0.0, 0.0, FLANK]
    check_height(float(vertices[np.unique(source.faces[faces]), 2].max()), file.name)
    samples = _above_table(solidify(vertices, source.faces[faces], VOXEL, file.name))
    check_graspable(samples, file.name)
    return Prepared(source, faces, vertices, samples)


def _above_table(samples: Samples) -> Samples:
    """What of a solid lies above z = 0."""
    heights = samples.low[2] + samples.step * np.arange(samples.distances.shape[2])
    return replace(samples, distances=np.maximum(samples.distances, -heights))


def _lowered(vertices: Vertices, source: Source, faces: NDArray[np.int64]) -> Vertices:
    """Onto the table, its middle above the origin."""
    used = vertices[np.unique(source.faces[faces])]
    low, high = used.min(axis=0), used.max(axis=0)
    return vertices - np.append((low + high)[:2] / 2, low[2])


def _rest(vertices: Vertices, source: Source, faces: NDArray[np.int64], what: str) -> NDArray[np.float64]:
    """The rotation `(3, 3)` to the pose that most ways of dropping it end in."""
    samples = solidify(vertices, source.faces[faces], 2 * VOXEL, what)
    inside = samples.low + samples.step * np.argwhere(samples.distances < 0)
    hull = trimesh.Trimesh(*thinned(vertices[np.unique(source.faces[faces])]), process=False)
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
    points = samples.low + samples.step * np.argwhere(samples.distances > POKE)
    blank = np.empty((0, 3)), np.empty(0, dtype=np.int64)
    anatomy = _anatomy((), out / "object.npz", packed(samples.low, samples.step, samples.distances, *blank))
    distances = anatomy.arrays["distances"]
    body = _footed(embody(anatomy, replace(samples, distances=distances), points, most=HULLS), file.name)
    points, face, where = skin(prepared, body)
    parts = from_json(settings["parts"], file.name)
    labels = label(parts, prepared.source, face, in_file(prepared, face, where), file.name)
    names = tuple(part.name for part in parts)
    anatomy = _anatomy(names, out / "object.npz", packed(samples.low, samples.step, distances, points, labels))
    normals, vertices = slope(anatomy, body.vertices), np.round(body.vertices - body.centre, 4)
    colours = look(settings, prepared, face, where)
    write_atomically(out / "object.png", texture_png(colours, len(body.faces)))
    write_atomically(out / "object.mtl", b"newmtl object\nKa 1 1 1\nKd 1 1 1\nmap_Kd object.png\n")
    write_atomically(out / "object.obj", visual_obj(vertices, normals, body.faces).encode())
    write_atomically(out / "object.hulls.obj", bake.collision_obj(body.pieces).encode())
    numbers = body.numbers(vertices) | {"parts": names}
    check_stands(out / "object.hulls.obj", body.rest_height, settings)
    write_atomically(out / "object.json", (json.dumps(numbers, separators=(",", ":")) + "\n").encode())


def _footed(body: Body, what: str) -> Body:
    """With hulls that have the whole flank that the surface lies on, not just the few points that suffice its form."""
    skin = body.vertices - body.centre
    ground = skin[skin[:, 2] < skin[:, 2].min() + 0.0002]
    turns = np.linspace(0.0, 2.0 * np.pi, FOOTING, endpoint=False)
    ways = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    pieces = []
    for corners, faces in body.pieces:
        try:
            planes = ConvexHull(corners).equations
        except QhullError:  # to a tenth of a millimetre it is flat
            continue
        mine = ground[(ground @ planes[:, :3].T + planes[:, 3]).max(axis=1) < 0.003]
        if len(mine):
            furthest = mine[np.unique((mine[:, :2] @ ways.T).argmax(axis=0))]
            hull = trimesh.Trimesh(np.concatenate([corners, np.round(furthest, 4)]), process=False).convex_hull
            corners, faces = np.asarray(hull.vertices), np.asarray(hull.faces)
        pieces.append((corners, faces))
    if not pieces:
        raise InputError(f"{what} is too thin everywhere to be touched; give it thickness")
    return replace(body, pieces=pieces)


def _anatomy(parts: tuple[str, ...], file: Path, arrays: dict[str, NDArray[Any]]) -> MeshAnatomy:
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    write_atomically(file, content.getvalue())
    return MeshAnatomy(parts, file)


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
