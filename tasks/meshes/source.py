"""Source: triangles with their look and their names, as a file has them, before anything is made of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equigrasp.errors import InputError

Vertices = NDArray[np.float64]
Faces = NDArray[np.int64]

LIMIT = 2_000_000
"""No mesh of a user has more faces than this."""

PLAIN = (190, 190, 190)
"""The colour (sRGB) of what has none."""


@dataclass(frozen=True, eq=False)
class Source:
    """A triangle mesh in the units and the frame of its file. It need not be closed, or make sense.

    Attributes:
        vertices: `(V, 3)`.
        faces: `(F, 3)` indices into `vertices`.
        colors: `(F, 3, 3)` float32, the sRGB colour of each corner, 0 to 255, where there is no texture.
        uv: `(F, 3, 2)` float32, texture coordinates of each corner, v upwards; NaN where there are none.
        texture: `(F,)` index into `images`, -1 for none.
        images: `(h, w, 3)` uint8 each.
        group: `(F,)` index into `names`.
        names: what a face may be called by: its object, its group, its material, its node, its link.
    """

    vertices: Vertices
    faces: Faces
    colors: NDArray[np.float32]
    uv: NDArray[np.float32]
    texture: NDArray[np.int64]
    images: tuple[NDArray[np.uint8], ...]
    group: NDArray[np.int64]
    names: tuple[frozenset[str], ...]

    @property
    def all_names(self) -> tuple[str, ...]:
        """Every name, sorted."""
        return tuple(sorted(set().union(*self.names)))

    def moved(self, transform: NDArray[np.float64]) -> Source:
        """The same mesh under an affine map `(4, 4)`; a mirroring one turns the faces round as well."""
        vertices = self.vertices @ transform[:3, :3].T + transform[:3, 3]
        if np.linalg.det(transform[:3, :3]) >= 0:
            return replace(self, vertices=vertices)
        back = [0, 2, 1]
        return replace(
            self,
            vertices=vertices,
            faces=self.faces[:, back],
            colors=self.colors[:, back],
            uv=self.uv[:, back],
        )

    def colour_at(self, face: NDArray[np.int64], weights: NDArray[np.float64]) -> NDArray[np.uint8]:
        """The look `(N, 3)`, sRGB, at points of faces `(N,)` with barycentric weights `(N, 3)`."""
        result = np.einsum("nk,nkd->nd", weights, self.colors[face].astype(np.float64))
        uv = np.einsum("nk,nkd->nd", weights, self.uv[face].astype(np.float64))
        for index, image in enumerate(self.images):
            mine = (self.texture[face] == index) & np.isfinite(uv).all(axis=1)
            rows, columns, _ = image.shape
            u, v = (uv[mine] - np.floor(uv[mine])).T
            i = np.minimum((u * columns).astype(np.int64), columns - 1)
            j = np.minimum(((1.0 - v) * rows).astype(np.int64), rows - 1)
            result[mine] = image[j, i]
        return np.clip(np.round(result), 0, 255).astype(np.uint8)


def source(
    vertices: Vertices,
    faces: Faces,
    names: frozenset[str] = frozenset(),
    colors: NDArray[np.float64] | tuple[int, int, int] = PLAIN,
    uv: NDArray[np.float64] | None = None,
    image: NDArray[np.uint8] | None = None,
) -> Source:
    """A mesh of one name and at most one texture.

    Args:
        vertices: `(V, 3)`.
        faces: `(F, 3)`.
        names: what it is called.
        colors: sRGB 0 to 255: one, `(F, 3)` for each face, or `(F, 3, 3)` for each corner.
        uv: `(F, 3, 2)` for each corner.
        image: `(h, w, 3)`.
    """
    count = len(faces)
    given = np.asarray(colors, dtype=np.float32)
    corners = given[:, None] if given.ndim == 2 else given
    textured = image is not None and uv is not None
    return Source(
        np.asarray(vertices, dtype=np.float64),
        np.asarray(faces, dtype=np.int64),
        np.ascontiguousarray(np.broadcast_to(corners, (count, 3, 3))),
        np.full((count, 3, 2), np.nan, dtype=np.float32) if uv is None else np.asarray(uv, dtype=np.float32),
        np.full(count, 0 if textured else -1, dtype=np.int64),
        (image,) if textured and image is not None else (),
        np.zeros(count, dtype=np.int64),
        (names,),
    )


def joined(sources: Sequence[Source], what: str) -> Source:
    """All of them as one.

    Raises:
        InputError: if there are none or no faces, or more than LIMIT; `what` names the file.
    """
    count = sum(len(each.faces) for each in sources)
    if not count:
        raise InputError(f"{what} holds no faces, so there is nothing to grasp; export it as a triangle mesh")
    if count > LIMIT:
        raise InputError(f"{what} has {count:,} faces; reduce it to {LIMIT:,} or fewer")
    if len(sources) == 1:
        return sources[0]
    starts = np.cumsum([0, *(len(each.vertices) for each in sources)])
    images = np.cumsum([0, *(len(each.images) for each in sources)])
    names = np.cumsum([0, *(len(each.names) for each in sources)])
    return Source(
        np.concatenate([each.vertices for each in sources]),
        np.concatenate([each.faces + start for each, start in zip(sources, starts, strict=False)]),
        np.concatenate([each.colors for each in sources]),
        np.concatenate([each.uv for each in sources]),
        np.concatenate(
            [np.where(each.texture < 0, -1, each.texture + start) for each, start in zip(sources, images, strict=False)]
        ),
        tuple(image for each in sources for image in each.images),
        np.concatenate([each.group + start for each, start in zip(sources, names, strict=False)]),
        tuple(name for each in sources for name in each.names),
    )
