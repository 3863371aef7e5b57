"""What the robot sees: the two ways to a heightmap, the oracle's segmentation, and a picture for humans.

`fused` is the paper's way: three RGB-D cameras around the table, fused by `equigrasp.heightmap`. `overhead`
is the fast one: a single camera so far up that it sees the workspace orthographically. Both fill the same
grid.

Both look at the objects alone: the table is a plane of one colour, whose depth is known in closed form, and the
hand is out of the way. The picture for humans, hand included, is PyBullet's own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
import pybullet
from numpy.typing import NDArray

from equigrasp.grasp import Observation
from equigrasp.heightmap import Camera, fuse
from equigrasp.workspace import WORKSPACE
from tasks.rasterizer import draw
from tasks.surface import Visible

CameraKind = Literal["fused", "overhead"]

TABLE = -1
"""What the segmentation calls a pixel where no body is seen."""

TABLE_COLOR = (96, 98, 104)
AMBIENT, DIFFUSE = 0.5, 0.5
"""Shares of the light that comes from everywhere and from the lamp."""


@dataclass(frozen=True, eq=False)
class Viewpoint:
    """A camera that has not taken its picture yet.

    Attributes:
        intrinsics: `(3, 3)` in pixels, pixel centres are whole numbers.
        pose: `(4, 4)` camera -> world; +z forward, x right, y down in the picture.
        size: rows and columns.
        near: metres; TinyRenderer cuts off what is nearer.
        far: metres; and what is further. Close planes keep its depth buffer exact.
        light: where the light comes from, (x, y, z). The robot works under a lamp on the ceiling: an object's
            shading then turns with it, as Proposition 1 supposes of an observation.
    """

    intrinsics: NDArray[np.float64]
    pose: NDArray[np.float64]
    size: tuple[int, int]
    near: float
    far: float
    light: tuple[float, float, float] = (0.0, 0.0, 1.0)

    @cached_property
    def view_matrix(self) -> list[float]:
        """World -> OpenGL's eye (y up, looking along -z), column by column."""
        eye = self.pose @ np.diag([1.0, -1.0, -1.0, 1.0])
        return np.linalg.inv(eye).T.ravel().tolist()

    @cached_property
    def projection_matrix(self) -> list[float]:
        """OpenGL's frustum, column by column.

        TinyRenderer samples a pixel at its lower left corner where everybody else samples the centre: the
        frustum is half a pixel off, right and up, to make up for it.
        """
        rows, columns = self.size
        fx, fy, cx, cy = self.intrinsics[[0, 1, 0, 1], [0, 1, 2, 2]]
        left, right = -cx / fx * self.near, (columns - cx) / fx * self.near
        bottom, top = (cy + 1.0 - rows) / fy * self.near, (cy + 1.0) / fy * self.near
        return pybullet.computeProjectionMatrix(left, right, bottom, top, self.near, self.far)

    @cached_property
    def table(self) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Depth of the plane z = 0 `(h, w)` in metres, and whether the table reaches to that pixel."""
        rows, columns = self.size
        i, j = np.meshgrid(np.arange(columns), np.arange(rows))
        rays = np.stack([i, j, np.ones_like(i)], axis=-1) @ np.linalg.inv(self.intrinsics).T
        rays = rays @ self.pose[:3, :3].T
        depth = np.where(rays[..., 2] < -1e-6, -self.pose[2, 3] / np.minimum(rays[..., 2], -1e-6), np.inf)
        points = self.pose[:2, 3] + np.minimum(depth, 1e3)[..., None] * rays[..., :2]
        on_table = (np.abs(points) <= [0.6 * WORKSPACE.length, 0.65 * WORKSPACE.depth]).all(axis=-1)
        return depth.astype(np.float32), on_table & np.isfinite(depth)

    @cached_property
    def blank(self) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
        """The picture `(h, w, 3)` of the empty table, white beside it, and which pixels `(h, w)` are beside it."""
        beside = ~self.table[1]
        color = np.empty((*self.size, 3), dtype=np.uint8)
        color[:] = TABLE_COLOR
        color[beside] = 255
        return color, beside


def looking_at(position: tuple[float, float, float], target: tuple[float, float, float]) -> NDArray[np.float64]:
    """Pose `(4, 4)` of an upright camera at `position` that looks at `target`, both in metres."""
    forward = np.subtract(target, position)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = position
    return pose


@lru_cache(maxsize=1)
def overhead_viewpoint(altitude: float = 50.0) -> Viewpoint:
    """Straight down from `altitude` metres, one camera pixel a heightmap pixel.

    An orthographic TinyRenderer camera reads wrong depths; from 50 m the perspective of a 10 cm object
    moves its edge by 1 mm at most, a third of a pixel, and at table height by nothing.
    """
    rows, columns = WORKSPACE.shape
    focal = altitude / WORKSPACE.pixel
    cx, cy = WORKSPACE.to_pixel([0.0, 0.0])
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = altitude
    intrinsics = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    return Viewpoint(intrinsics, pose, (rows, columns), altitude - 0.5, altitude + 0.2)


@lru_cache(maxsize=1)
def fused_viewpoints() -> tuple[Viewpoint, ...]:
    """One camera in front of the table and one at each side: CLIPort's and Ravens' three RealSense cameras.

    They are 640x480 with a focal length of 450 pixels, 0.75 m up, and stand to the table as in Ravens, whose
    workspace is ours turned by 90 degrees: the front one at the middle of the long side, the others at the
    corners across.
    """
    intrinsics = np.array([[450.0, 0.0, 320.0], [0.0, 450.0, 240.0], [0.0, 0.0, 1.0]])
    poses = [
        looking_at((0.0, -0.5, 0.75), (0.0, 0.25, 0.0)),
        looking_at((-0.5, 0.5, 0.75), (-0.055, 0.055, 0.0)),
        looking_at((0.5, 0.5, 0.75), (0.055, 0.055, 0.0)),
    ]
    return tuple(windowed(Viewpoint(intrinsics, pose, (480, 640), 0.3, 2.0)) for pose in poses)


def windowed(viewpoint: Viewpoint, height: float = 0.15) -> Viewpoint:
    """The part of a picture in which the workspace is seen up to `height` metres; the rest costs time to render."""
    (x_min, x_max), (y_min, y_max) = WORKSPACE.bounds
    corners = np.array([[x, y, z] for x in (x_min, x_max) for y in (y_min, y_max) for z in (0.0, height)])
    seen = (corners - viewpoint.pose[:3, 3]) @ viewpoint.pose[:3, :3] @ viewpoint.intrinsics.T
    pixels = seen[:, :2] / seen[:, 2:]
    rows, columns = viewpoint.size
    left, top = (int(each) for each in np.maximum(np.floor(pixels.min(axis=0)), 0))
    right, bottom = (int(each) for each in np.minimum(np.ceil(pixels.max(axis=0)) + 1, (columns, rows)))
    intrinsics = viewpoint.intrinsics.copy()
    intrinsics[:2, 2] -= (left, top)
    return replace(viewpoint, intrinsics=intrinsics, size=(bottom - top, right - left))


@lru_cache(maxsize=1)
def portrait_viewpoint() -> Viewpoint:
    """Three quarters from above, for humans, who see shapes better under a slanting light."""
    intrinsics = np.array([[760.0, 0.0, 320.0], [0.0, 760.0, 240.0], [0.0, 0.0, 1.0]])
    pose = looking_at((0.4, -1.1, 0.95), (0.02, -0.02, 0.03))
    return Viewpoint(intrinsics, pose, (480, 640), 0.2, 3.0, light=(0.3, -0.4, 1.0))


def shoot(
    visible: Sequence[Visible], viewpoint: Viewpoint
) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:
    """A picture of objects, with the table behind them.

    Returns:
        color `(h, w, 3)`; depth `(h, w)` in metres along the optical axis, infinite beside the table;
        segmentation `(h, w)`, the body's id or TABLE.
    """
    color, depth = viewpoint.blank[0].copy(), viewpoint.table[0].copy()
    owner = np.full(viewpoint.size, TABLE, dtype=np.int32)
    light = np.array(viewpoint.light) / np.linalg.norm(viewpoint.light)
    eye = viewpoint.intrinsics @ viewpoint.pose[:3, :3].T
    for each in visible:
        matrix, offset = eye @ each.rotation, eye @ (each.position - viewpoint.pose[:3, 3])
        draw(color, depth, owner, each.body, each.surface, matrix, offset, each.rotation.T @ light, AMBIENT, DIFFUSE)
    depth[viewpoint.blank[1] & (owner == TABLE)] = np.inf
    return color, depth, owner


def overhead(visible: Sequence[Visible]) -> tuple[Observation, NDArray[np.int32]]:
    """The heightmap from straight above, and which body each of its pixels `(H, W)` shows."""
    viewpoint = overhead_viewpoint()
    color, depth, segmentation = shoot(visible, viewpoint)
    height = np.maximum(np.float32(viewpoint.pose[2, 3]) - depth, np.float32(0.0))
    return Observation(color, height), segmentation


def fused(visible: Sequence[Visible]) -> Observation:
    """The heightmap of the three cameras around the table."""
    cameras = []
    for viewpoint in fused_viewpoints():
        color, depth, _ = shoot(visible, viewpoint)
        cameras.append(Camera(color, depth, viewpoint.intrinsics, viewpoint.pose))
    # the hand is in none of these pictures: what is high is an object
    return fuse(cameras, ceiling=math.inf)


def portrait(bullet: Any) -> NDArray[np.uint8]:
    """A picture `(480, 640, 3)` of table, objects and hand, for humans."""
    return photograph(bullet, portrait_viewpoint())[0]


def photograph(bullet: Any, viewpoint: Viewpoint) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.int32]]:
    """What `shoot` gives, of all bodies of a PyBullet client, the hand's links too, by PyBullet's TinyRenderer."""
    rows, columns = viewpoint.size
    _, _, rgba, buffer, segmentation = bullet.getCameraImage(
        columns,
        rows,
        viewpoint.view_matrix,
        viewpoint.projection_matrix,
        renderer=pybullet.ER_TINY_RENDERER,
        lightDirection=viewpoint.light,
        lightAmbientCoeff=AMBIENT,
        lightDiffuseCoeff=DIFFUSE,
        lightSpecularCoeff=0.0,
        shadow=0,
    )
    near, far = viewpoint.near, viewpoint.far
    depth = (far * near / (far - (far - near) * np.asarray(buffer, dtype=np.float32))).astype(np.float32)
    table, on_table = viewpoint.table
    body = (np.asarray(segmentation) != TABLE) & (depth < table)
    color = np.where(body[..., None], np.asarray(rgba, dtype=np.uint8)[..., :3], viewpoint.blank[0])
    shown = np.where(body, depth, np.where(on_table, table, np.float32(np.inf)))
    return color, shown, np.where(body, np.asarray(segmentation), TABLE).astype(np.int32)
