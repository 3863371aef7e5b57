"""What cameras see of an object: its visual mesh and its texture, read from what was baked."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from tasks.objects.asset import ObjectAsset


@dataclass(frozen=True, eq=False)
class Surface:
    """A closed mesh of triangles with a texture.

    Attributes:
        vertices: `(V, 3)` metres in the object frame.
        normals: `(V, 3)`, outward; of a length near 1.
        faces: `(F, 3)`, corners counter-clockwise seen from outside.
        texels: `(F, 3, 2)`, column and row in the texture of each corner, in pixels from its upper left corner.
        texture: `(h, w, 3)` uint8.
    """

    vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    faces: NDArray[np.int32]
    texels: NDArray[np.float32]
    texture: NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Visible:
    """A surface somewhere in the world.

    Attributes:
        body: what the segmentation calls it.
        surface: in the object frame.
        position: `(3,)` metres.
        rotation: `(3, 3)`, object -> world.
    """

    body: int
    surface: Surface
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]


@lru_cache(maxsize=512)
def surface(asset: ObjectAsset) -> Surface:
    """How an object looks; read once a process."""
    drawn = _read(asset.visual)
    if asset.paint is None:
        return drawn
    return replace(drawn, texture=np.array([[asset.paint]], dtype=np.uint8), texels=np.zeros_like(drawn.texels))


@lru_cache(maxsize=512)
def _read(path: Path) -> Surface:
    """Read an OBJ as this package bakes it: each corner of a face has a vertex, a texel and a normal."""
    values: dict[str, list[str]] = {"v": [], "vt": [], "vn": [], "f": [], "mtllib": [path.name]}
    for line in path.read_text().splitlines():
        word, _, rest = line.partition(" ")
        if word in values:
            values[word].append(rest)
    material = path.with_name(values["mtllib"][-1])
    [picture] = [line.split()[1] for line in material.read_text().splitlines() if line.startswith("map_Kd")]
    with Image.open(path.with_name(picture)) as image:
        texture = np.asarray(image.convert("RGB"))
    corners = np.fromstring(" ".join(values["f"]).replace("/", " "), dtype=np.int32, sep=" ").reshape(-1, 3, 3) - 1
    vertices, along, normals = (
        np.fromstring(" ".join(values[word]), sep=" ").reshape(-1, size)
        for word, size in (("v", 3), ("vt", 2), ("vn", 3))
    )
    # in an OBJ, texture coordinates go up from the lower left corner
    texels = (along * [1.0, -1.0] + [0.0, 1.0]) * [texture.shape[1], texture.shape[0]]
    aligned = np.empty_like(vertices)
    aligned[corners[..., 0]] = normals[corners[..., 2]]
    return Surface(vertices, aligned, corners[..., 0].copy(), texels[corners[..., 1]].astype(np.float32), texture)
