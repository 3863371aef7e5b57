"""RGB-D cameras -> one orthographic heightmap of the workspace, the observation of every policy here.

Nothing in this file knows a simulator: a real depth camera with known intrinsics and pose is used like this:

    view = Camera(color, depth, intrinsics, pose)
    observation = fuse([view])

Each depth pixel becomes a point in the world; the highest point that falls into a pixel of the heightmap
gives it its height and its colour. Of two cameras that see the same place, the one that sees the higher
surface is the one that is not occluded there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equigrasp.compiled import compiled
from equigrasp.errors import InputError
from equigrasp.grasp import Observation
from equigrasp.workspace import WORKSPACE, Workspace, inverse

UNSEEN = -np.inf
CELLAR = 0.1
"""Metres below the table: what seems to lie deeper is no reading of it."""
RIGID = 0.005
"""By how much R^T R of a pose's rotation may differ from 1: numbers of three digits do by less."""


@dataclass(frozen=True, eq=False)
class Camera:
    """One RGB-D picture, and from where it was taken.

    Attributes:
        color: `(h, w, 3)` uint8, RGB, aligned with the depth.
        depth: `(h, w)` float, metres along the optical axis (not along the ray); 0, NaN or infinity where
            the sensor read nothing.
        intrinsics: `(3, 3)` [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels; pixel centres are whole numbers.
        pose: `(4, 4)` camera -> world, metres. The camera looks along its +z, its x points right in the
            picture and its y down (the convention of OpenCV and ROS).

    Raises:
        ValueError: if a shape or a dtype is another one; as an InputError, if the intrinsics or the pose are none of a
            camera: numbers that are not finite, a focal length that is not above 0, a pose that scales or mirrors, or
            another last row than 0 0 1 and 0 0 0 1.
    """

    color: NDArray[np.uint8]
    depth: NDArray[np.floating]
    intrinsics: NDArray[np.floating]
    pose: NDArray[np.floating]

    def __post_init__(self) -> None:
        if self.color.dtype != np.uint8 or self.color.ndim != 3 or self.color.shape[2] != 3:
            raise ValueError(f"a Camera's color is (h, w, 3) uint8, but this is {self.color.shape} {self.color.dtype}")
        if self.depth.shape != self.color.shape[:2] or not np.issubdtype(self.depth.dtype, np.floating):
            raise ValueError(
                f"a Camera's depth is {self.color.shape[:2]} floats in metres like its color, "
                f"but this is {self.depth.shape} {self.depth.dtype}"
            )
        if np.shape(self.intrinsics) != (3, 3) or np.shape(self.pose) != (4, 4):
            raise ValueError(
                "a Camera's intrinsics are (3, 3) and its pose is (4, 4), "
                f"but these are {np.shape(self.intrinsics)} and {np.shape(self.pose)}"
            )
        _check_calibration(np.asarray(self.intrinsics, dtype=np.float64), np.asarray(self.pose, dtype=np.float64))

    def __repr__(self) -> str:
        h, w = self.depth.shape
        x, y, z = np.asarray(self.pose)[:3, 3]
        return f"Camera({w}x{h} at ({x:.2f}, {y:.2f}, {z:.2f}) m)"


def fuse(
    cameras: Sequence[Camera], workspace: Workspace = WORKSPACE, ceiling: float = 0.3, gap: int = 2
) -> Observation:
    """The heightmap that the cameras see together.

    A pixel that no point falls into is filled from its neighbours in `gap` rounds, each one pixel deep, with
    the height and colour of its *lowest* seen neighbour. There are two reasons for such a hole: the cameras
    sample a slanted surface more coarsely than the heightmap, and then all neighbours are alike; or something
    stands in the way, and then what is hidden is the low side. Wider holes (the inside of a mug) stay at
    height 0 and black, as nothing was seen there.

    Args:
        cameras: one or more pictures; their order does not matter, but where two points are equally high.
        workspace: the grid to fill.
        ceiling: metres; points above it (an arm, a hand) are ignored.
        gap: rounds of filling; holes up to `2 * gap` pixels wide close.

    Returns:
        color `(H, W, 3)` and height `(H, W)`, clipped below at the table, height 0.

    Raises:
        ValueError: if there is no camera; as an InputError, if no point of theirs falls on the table.
    """
    if not cameras:
        raise ValueError("a heightmap needs at least one camera, but none was given")
    # to_pixel is affine: its value at the origin and its two slopes say all that the loop below needs
    origin, along_x, along_y = workspace.to_pixel([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    to_grid = np.eye(4)
    to_grid[:2, :2] = np.stack([along_x - origin, along_y - origin], axis=1)
    to_grid[:2, 3] = origin
    height = np.full(workspace.shape, UNSEEN, dtype=np.float32)
    color = np.zeros((*workspace.shape, 3), dtype=np.uint8)
    for camera in cameras:
        placed = to_grid @ np.asarray(camera.pose, dtype=np.float64)
        _splat(
            height,
            color,
            np.ascontiguousarray(camera.color),
            np.ascontiguousarray(camera.depth, dtype=np.float32),
            placed[:3, :3] @ inverse(np.asarray(camera.intrinsics, dtype=np.float64)),
            placed[:3, 3].copy(),
            ceiling,
        )
    if not (height > -CELLAR).any():
        raise InputError(
            f"no point that was seen falls on the table, {workspace.length:g} m x {workspace.depth:g} m around the "
            "origin with its surface at z = 0; depth and pose are in metres, not millimetres, and the pose leads to "
            "the table, not back, from a camera that looks along its +z with y down (OpenCV's, not OpenGL's)"
        )
    for _ in range(gap):
        height, color = _fill(height, color)
    return Observation(color, np.maximum(height, np.float32(0.0)))


def _check_calibration(intrinsics: NDArray[np.float64], pose: NDArray[np.float64]) -> None:
    """Raise an InputError unless they can be a camera's; a wrong one gives a mirrored or a wrong table in silence."""
    for name, values in (("intrinsics", intrinsics), ("pose", pose)):
        if not np.isfinite(values).all():
            raise InputError(f"a Camera's {name} are finite numbers, but these are {values.tolist()}; calibrate again")
        last = np.eye(len(values))[-1]
        if np.abs(values[-1] - last).max() > 1e-6:
            raise InputError(
                f"the last row of a Camera's {name} is {last.tolist()}, but this is {values[-1].tolist()}; "
                "is it transposed?"
            )
    focal = intrinsics[0, 0], intrinsics[1, 1]
    if min(focal) <= 0:
        raise InputError(f"a Camera's focal lengths are above 0 pixels, but these are {focal[0]:g} and {focal[1]:g}")
    rotation = pose[:3, :3]
    if np.abs(rotation.T @ rotation - np.eye(3)).max() > RIGID:
        lengths = ", ".join(f"{length:.3g}" for length in np.linalg.norm(rotation, axis=0))
        raise InputError(
            "a Camera's pose only turns and moves: its first three columns are unit vectors at right angles, but these "
            f"have lengths {lengths}, or lean; take scale and shear out of it"
        )
    if np.cross(rotation[:, 0], rotation[:, 1]) @ rotation[:, 2] < 0:
        raise InputError(
            "a Camera's pose is right-handed, but this one mirrors (its determinant is -1); the camera's x points "
            "right in the picture, its y down and its z into it"
        )


@compiled
def _splat(
    height: NDArray[np.float32],
    color: NDArray[np.uint8],
    image: NDArray[np.uint8],
    depth: NDArray[np.float32],
    ray: NDArray[np.float64],
    start: NDArray[np.float64],
    ceiling: float,
) -> None:
    """Put each depth pixel into the heightmap `(H, W)`, in place, where it is higher than what is there.

    The point of camera pixel (i, j) is `start + depth * ray @ (i, j, 1)`, as (u, v, metres above the table).
    """
    rows, columns = height.shape
    for j in range(depth.shape[0]):
        ray_u = ray[0, 1] * j + ray[0, 2]
        ray_v = ray[1, 1] * j + ray[1, 2]
        ray_z = ray[2, 1] * j + ray[2, 2]
        for i in range(depth.shape[1]):
            d = depth[j, i]
            if not (d > 0.0 and d < np.inf):
                continue
            z = np.float32(start[2] + d * (ray_z + ray[2, 0] * i))
            u = int(np.floor(start[0] + d * (ray_u + ray[0, 0] * i) + 0.5))
            v = int(np.floor(start[1] + d * (ray_v + ray[1, 0] * i) + 0.5))
            if 0 <= u < columns and 0 <= v < rows and height[v, u] < z <= ceiling:
                height[v, u] = z
                for channel in range(3):
                    color[v, u, channel] = image[j, i, channel]


@compiled
def _fill(height: NDArray[np.float32], color: NDArray[np.uint8]) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """One round of filling: each unseen pixel takes the lowest of its seen neighbours, where it has one."""
    rows, columns = height.shape
    filled, painted = height.copy(), color.copy()
    for v in range(rows):
        for u in range(columns):
            if height[v, u] > UNSEEN:
                continue
            lowest = np.inf
            for j in range(max(v - 1, 0), min(v + 2, rows)):
                for i in range(max(u - 1, 0), min(u + 2, columns)):
                    if height[j, i] > UNSEEN and height[j, i] < lowest:
                        lowest = height[j, i]
                        filled[v, u] = height[j, i]
                        for channel in range(3):
                            painted[v, u, channel] = color[j, i, channel]
    return filled, painted
