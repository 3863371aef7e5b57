"""Triangles, closed or not -> a solid, sampled as signed distances on a grid.

What is inside is what the faces wind around (Jacobson et al., "Robust inside-outside segmentation using
generalized winding numbers", 2013): holes are closed, overlapping bodies are united, and a mesh that is inside
out is what it would be the right way round. Cavities that nothing can reach are filled.
"""

from __future__ import annotations

import igl
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage

from equigrasp.errors import InputError
from tasks.meshes.source import Faces, Vertices
from tasks.objects.body import Samples

SAMPLES = 4_000_000
"""At most about so many; of a larger object they are further apart."""
_BORDER = 4
"""Samples around the object on each side."""
_BAND = 3
"""So far from the faces, in samples, distances are exact; further off they are to within one step."""
_NEAR = 1_200_000
_UNSURE = 200_000
"""Samples that are measured, and that are wound around one by one, at most: of more, they are _COARSER."""
_COARSER = 1.6
_MARKS = 8_000_000
"""Points on faces that are looked at, at most."""
_CROWDED = 8.0
"""Times the surface of its bounding box: no object has more."""
_SPOT = 64
"""Samples of a region that must agree for all of it to be inside or outside."""
_SPECK = 0.02
"""A separate body smaller than this share of the largest is dropped."""
_LOST = 0.25
"""The share of the surface that may bound no solid, as thin fins and sheets do not."""
_FEWEST = 100
"""Samples that a solid takes at least."""


def solidify(vertices: Vertices, faces: Faces, step: float, what: str) -> Samples:
    """Sample the solid that faces enclose.

    Args:
        vertices: `(V, 3)` metres, the lowest at z = 0.
        faces: `(F, 3)`, none without area.
        step: metres between samples, or more where the object is large.
        what: names it in the error.

    Raises:
        InputError: if the faces enclose nothing, or overlap beyond measure.
    """
    vertices, faces = _oriented(vertices, faces)
    extents = np.ptp(vertices, axis=0)
    x, y, z = extents
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    area = np.sqrt((np.cross(b - a, c - a) ** 2).sum(axis=1)).sum() / 2.0
    if area > _CROWDED * 2.0 * (x * y + y * z + z * x):
        raise _crossing(len(faces), what)
    step = max(step, float(np.cbrt(extents.prod() / SAMPLES)), float(extents.max()) / 400)
    while True:
        # half a step off, so that a flat base lies between two layers of the grid, not on one
        low = (np.floor(vertices.min(axis=0) / step) - _BORDER + 0.5) * step
        shape = np.ceil((vertices.max(axis=0) - low) / step).astype(np.int64) + _BORDER
        marked = _marked(vertices, faces, low, step, shape, what)
        near = ndimage.binary_dilation(marked, np.ones((3, 3, 3)), _BAND)
        inside = None
        if near.sum() <= _NEAR:
            small = split(vertices, faces, 8 * step)[:2]
            far = np.full(shape, np.inf)
            squares, _, _ = igl.point_mesh_squared_distance(low + step * np.argwhere(near), *small)
            far[near] = np.sqrt(squares)
            inside = _inside(*small, low, step, near, far)
        if inside is not None:
            break
        step *= _COARSER
    inside = _bodies(inside)
    if inside.sum() < _FEWEST:
        raise InputError(
            f"{what} encloses no volume that is {1000 * step:.1f} mm thick or more: it is flat, open or a "
            "sheet; give it thickness"
        )
    lost = marked & ~ndimage.binary_dilation(inside, np.ones((3, 3, 3)), 2)
    if lost.sum() > _LOST * marked.sum():
        raise InputError(
            f"{what} is open: {100 * lost.sum() / marked.sum():.0f}% of its surface encloses nothing that is "
            f"{1000 * step:.1f} mm thick or more; give it thickness"
        )
    # the distance to the nearest sample of the other kind bounds the distance to the surface, and is all there
    # is where a hole was closed or a cavity filled
    steps = np.where(inside, ndimage.distance_transform_edt(inside), ndimage.distance_transform_edt(~inside))
    distance = np.clip(np.where(near, far / step, steps - 0.5), np.maximum(steps - 1.0, 1e-3), steps) * step
    return Samples(low, step, np.where(inside, -distance, distance))


def _crossing(faces: int, what: str) -> InputError:
    return InputError(f"{what} has {faces:,} faces that cross each other all over; export its outer surface")


def split(vertices: Vertices, faces: Faces, longest: float) -> tuple[Vertices, Faces, NDArray[np.int64]]:
    """Cut faces until no edge is longer: large faces that cross each other would make every search a long one.

    Returns:
        vertices, faces, and which face `(F,)` each is a piece of.
    """
    vertices, faces, origin = trimesh.remesh.subdivide_to_size(vertices, faces, longest, max_iter=20, return_index=True)
    return (
        np.array(vertices, dtype=np.float64, order="C"),
        np.array(faces, dtype=np.int64, order="C"),
        np.asarray(origin, dtype=np.int64),
    )


def _oriented(vertices: Vertices, faces: Faces) -> tuple[Vertices, Faces]:
    """Vertices at one place merged, each face once, and faces that disagree turned to agree."""
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.unique_faces() & mesh.nondegenerate_faces(height=0.0))
    if len(mesh.faces) and len(mesh.faces) <= 100_000 and not mesh.is_winding_consistent:
        trimesh.repair.fix_winding(mesh)
    if not len(mesh.faces):
        return vertices, faces
    return np.array(mesh.vertices, dtype=np.float64, order="C"), np.array(mesh.faces, dtype=np.int64, order="C")


def _marked(
    vertices: Vertices, faces: Faces, low: NDArray[np.float64], step: float, shape: NDArray[np.int64], what: str
) -> NDArray[np.bool_]:
    """The samples that a face comes near to: within a step or so."""
    corners = vertices[faces]
    longest = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2)).max(axis=1)
    cuts = np.maximum(np.ceil(longest / step).astype(np.int64), 1)
    if ((cuts + 1) * (cuts + 2) // 2).sum() > _MARKS:
        raise _crossing(len(faces), what)
    marked = np.zeros(shape, dtype=bool)
    for cut in np.unique(cuts):
        i, j = np.meshgrid(np.arange(cut + 1), np.arange(cut + 1))
        weights = np.stack([i, j, cut - i - j], axis=-1)[i + j <= cut] / cut
        group = corners[cuts == cut]
        size = max(1, 1_000_000 // len(weights))
        for start in range(0, len(group), size):
            points = (weights @ group[start : start + size]).reshape(-1, 3)
            index = np.round((points - low) / step).astype(np.int64)
            marked[index[:, 0], index[:, 1], index[:, 2]] = True
    return marked


def _inside(
    vertices: Vertices,
    faces: Faces,
    low: NDArray[np.float64],
    step: float,
    near: NDArray[np.bool_],
    distance: NDArray[np.float64],
) -> NDArray[np.bool_] | None:
    """Which samples the faces wind around; None if too many would have to be asked.

    A winding number takes some ten microseconds, and there are millions of samples; but where two neighbours are
    both more than half a step from every face, no face passes between them. So one looks at a few samples of a
    region, and at all of them only if those disagree, as they do where a hole joins inside and outside.
    """

    def wound(where: NDArray[np.int64]) -> NDArray[np.bool_]:
        return np.abs(igl.fast_winding_number(vertices, faces, low + step * where)) > 0.5

    clear = distance > 0.51 * step
    regions, count = ndimage.label(clear)
    inside = np.zeros(near.shape, dtype=bool)
    unsure = near & ~clear
    members = np.argsort(regions, axis=None, kind="stable")
    ends = np.cumsum(np.bincount(regions.ravel(), minlength=count + 1))
    spots, owners, mixed = [], [], np.zeros(0, dtype=bool)
    for region in range(1, count + 1):
        mine = members[ends[region - 1] : ends[region]]
        chosen = mine[:: max(1, len(mine) // _SPOT)]
        spots.append(chosen)
        owners.append(np.full(len(chosen), region))
    if spots:
        owner = np.concatenate(owners)
        votes = wound(np.stack(np.unravel_index(np.concatenate(spots), near.shape), axis=1))
        share = np.bincount(owner, votes, minlength=count + 1) / np.maximum(np.bincount(owner, minlength=count + 1), 1)
        inside = (share == 1.0)[regions]
        unsure |= near & ((share > 0.0) & (share < 1.0))[regions]
        mixed = ((share > 0.0) & (share < 1.0))[regions] & ~near
    if unsure.sum() > _UNSURE:
        return None
    if spots and mixed.any():
        # far from every face the winding number is smooth: every third sample will do
        coarse, back = np.unique(np.argwhere(mixed) // 3, axis=0, return_inverse=True)
        inside[mixed] = wound(coarse * 3 + 1)[back.ravel()]
    where = np.argwhere(unsure)
    if len(where):
        inside[unsure] = wound(where)
    for axis in range(3):
        inside.swapaxes(0, axis)[[0, 1, -2, -1]] = False
    return inside


def _bodies(inside: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """With cavities filled, and without specks."""
    inside = ndimage.binary_fill_holes(inside)
    bodies, count = ndimage.label(inside)
    if count <= 1:
        return inside
    sizes = np.bincount(bodies.ravel())[1:]
    return np.concatenate([[False], sizes >= _SPECK * sizes.max()])[bodies]
