"""What a mesh looks like once its surface is a new one: each face gets a small square of a texture of its own.

The look is carried over point by point, so that textures, colours of corners and of faces, and several materials
all end in one picture, which is all that PyBullet's renderer knows of.
"""

from __future__ import annotations

import io
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tasks.meshes.reference import read_image
from tasks.meshes.solid import Samples, split
from tasks.meshes.source import Source, Vertices
from tasks.objects.body import Body

TEXELS = 10
"""The look of a face is a square of so many texels, of which it uses half."""


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


def _lattice() -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """The texels of a face: column and row `(T,)` of each in its square, and its barycentric weights `(T, 3)`."""
    i, j = (grid.ravel() for grid in np.meshgrid(np.arange(TEXELS), np.arange(TEXELS)))
    used = i + j < TEXELS
    i, j = i[used], j[used]
    return i, j, np.stack([TEXELS - 1 - i - j, i, j], axis=1) / (TEXELS - 1)


def skin(prepared: Prepared, body: Body) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
    """A point for each texel of each face, and where it lies on the user's mesh.

    Returns:
        points `(F * T, 3)` in the frame of the drawing, the nearest face `(F * T,)` of the source, and the
        barycentric weights `(F * T, 3)` of the nearest point of it.
    """
    points = (_lattice()[2] @ body.vertices[body.faces]).reshape(-1, 3)
    vertices, faces, origin = split(prepared.vertices, prepared.source.faces[prepared.faces], 8 * prepared.samples.step)
    _, nearest, closest = igl.point_mesh_squared_distance(points, vertices, faces)
    face = prepared.faces[origin[np.asarray(nearest, dtype=np.int64)]]
    a, b, c = (prepared.vertices[prepared.source.faces[face, i]] for i in range(3))
    ab, ac, ap = b - a, c - a, closest - a
    aa, bb, cc = ((ab * ab).sum(axis=1), (ac * ac).sum(axis=1), (ab * ac).sum(axis=1))
    p, q = (ap * ab).sum(axis=1), (ap * ac).sum(axis=1)
    determinant = np.maximum(aa * bb - cc * cc, 1e-300)
    v, w = (p * bb - q * cc) / determinant, (q * aa - p * cc) / determinant
    weights = np.clip(np.stack([1.0 - v - w, v, w], axis=1), 0.0, 1.0)
    return points, face, weights / weights.sum(axis=1, keepdims=True)


def in_file(prepared: Prepared, face: NDArray[np.int64], where: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points of faces in the units and the frame of the file."""
    return np.einsum("nk,nkd->nd", where, prepared.source.vertices[prepared.source.faces[face]])


def look(
    settings: dict[str, Any], prepared: Prepared, face: NDArray[np.int64], where: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """The colour `(N, 3)` of each texel."""
    source = prepared.source
    if settings["color"] is not None:
        return np.broadcast_to(np.array(settings["color"], dtype=np.uint8), (len(face), 3))
    if settings["texture"] is not None:
        image = read_image(Path(settings["texture"]))
        source = replace(source, images=(image,), texture=np.zeros_like(source.texture))
    return source.colour_at(face, where)


def _columns(faces: int) -> int:
    """Squares in a row of the texture."""
    return math.ceil(math.sqrt(faces))


def texture_png(colours: NDArray[np.uint8], faces: int) -> bytes:
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


def visual_obj(vertices: Vertices, normals: Vertices, faces: NDArray[np.int64]) -> str:
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
