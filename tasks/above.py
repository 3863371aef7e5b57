"""The table from straight above, as people are shown it: finer than policies see it, hollows dark, parts in colours.

Nothing here reaches a policy: what those see is drawn by `tasks.camera`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from equigrasp.compiled import compiled
from equigrasp.workspace import WORKSPACE
from tasks import camera
from tasks.scene import Scene
from tasks.surface import surface

ZOOM = 4
"""Pixels of a picture for each of a heightmap's, along each axis."""
PIXEL = WORKSPACE.pixel / ZOOM
"""Of a picture, metres."""
FINER = 2
"""Rays through each of a picture's pixels, along each axis: their mean has smooth edges."""
SHADE = 0.7
"""What share of its light a pixel loses that sees no sky."""
HORIZON = 0.05
"""Metres: what is further away does not stand before the sky."""
DIRECTIONS = 32

PART_COLORS: dict[str, tuple[int, int, int]] = {
    "handle": (213, 94, 0),
    "head": (0, 114, 178),
    "middle": (0, 158, 115),
    "end": (204, 121, 167),
    "brim": (86, 180, 233),
    "body": (240, 228, 66),
}
"""Of each name of a part that pick-by-part asks for, on whatever object: Okabe and Ito's colours, sRGB."""
NO_PART = (165, 165, 165)
"""Of what is on no part that has a colour."""
_WHITE = (255, 255, 255)


@dataclass(frozen=True, eq=False)
class Above:
    """A picture from straight above: color `(h, w, 3)`, 0 to 255, and height `(h, w)` in metres above the table."""

    color: NDArray[np.float64]
    height: NDArray[np.float64]

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, metres."""
        rows, columns = self.height.shape
        return columns * PIXEL, rows * PIXEL

    def shaded(self, shade: float = SHADE) -> NDArray[np.uint8]:
        """The picture `(h, w, 3)` under an overcast sky, so that hollow things look hollow, and things stand.

        Args:
            shade: what share of its light a pixel loses that sees no sky.
        """
        light = 1 - shade * (1 - sky(self.height, PIXEL))
        return np.rint(self.color * light[..., None]).astype(np.uint8)


def seen_from_above(scene: Scene, middle: NDArray[np.float64], size: tuple[float, float]) -> NDArray[np.uint8]:
    """The table from straight above, ZOOM times finer than a policy sees it: `(h, w, 3)` uint8.

    Args:
        scene: what lies on it.
        middle: x and y of the picture's middle, metres.
        size: width and height of the picture, metres.
    """
    return camera.shoot(scene.visible(), _viewpoint(middle, size, ZOOM))[0]


def photographed(scene: Scene, middle: NDArray[np.float64], size: tuple[float, float]) -> Above:
    """The same for `Above.shaded`, with smooth edges; arguments as of `seen_from_above`."""
    color, depth, owner = camera.shoot(scene.visible(), _viewpoint(middle, size, ZOOM * FINER))
    return _coarser(color.astype(float), camera.overhead_viewpoint().pose[2, 3] - depth, owner)


def in_parts(
    scene: Scene, middle: NDArray[np.float64], size: tuple[float, float], table: tuple[int, int, int]
) -> tuple[Above, NDArray[np.int64]]:
    """The same with each part in the colour of its name.

    Args:
        scene: as of `seen_from_above`.
        middle: likewise.
        size: likewise.
        table: its colour, sRGB.

    Returns:
        The picture, and the part at each of its pixels `(h, w)`: a place in PART_COLORS, -1 for none.
    """
    viewpoint = _viewpoint(middle, size, ZOOM * FINER)
    # white things show nothing but the light on them
    plaster = [replace(scene.asset(name), paint=_WHITE) for name in scene.bodies]
    visible = [replace(each, surface=surface(asset)) for each, asset in zip(scene.visible(), plaster, strict=True)]
    light, depth, owner = camera.shoot(visible, viewpoint)
    names, paints = list(PART_COLORS), np.array([*PART_COLORS.values(), NO_PART], dtype=float)
    color, parts = np.empty(light.shape), np.full(owner.shape, -1)
    color[:] = table
    for name, body in scene.bodies.items():
        rows, columns = seen = np.nonzero(owner == body)
        rays = np.stack([columns, rows, np.ones_like(rows)], axis=1) @ np.linalg.inv(viewpoint.intrinsics).T
        points = viewpoint.pose[:3, 3] + depth[seen][:, None] * (rays @ viewpoint.pose[:3, :3].T)
        own = [names.index(part) if part in names else -1 for part in scene.asset(name).parts]
        parts[seen] = np.array([*own, -1])[scene.parts_at(name, points)]
        color[seen] = paints[parts[seen]] * (light[seen] / 255)
    return _coarser(color, viewpoint.pose[2, 3] - depth, owner), parts[::FINER, ::FINER]


def sky(height: NDArray[np.float64], pixel: float) -> NDArray[np.float64]:
    """How much of the sky's light each pixel of `height` `(h, w)` gets, 0 to 1, from what stands around it.

    The horizon is sought in DIRECTIONS directions; what is HORIZON metres away no longer counts, and half as far it
    counts half. Beyond the picture is table. A sky of one brightness lights a level pixel by the squared cosine of the
    horizon's angle.

    Args:
        height: metres.
        pixel: its width, metres.
    """
    reach = int(HORIZON / pixel)
    angles = 2 * np.pi * (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS
    # dense where a wall is near and steep
    distances = np.unique(np.geomspace(1, reach, 32).round())
    down, right = (np.rint(np.outer(turn(angles), distances)).astype(np.int64) for turn in (np.sin, np.cos))
    slope = (1 - distances / reach) / (pixel * distances)
    return _sky(np.pad(height, reach), reach, down, right, slope)


@compiled
def _sky(
    height: NDArray[np.float64],
    margin: int,
    down: NDArray[np.int64],
    right: NDArray[np.int64],
    slope: NDArray[np.float64],
) -> NDArray[np.float64]:
    rows, columns = height.shape[0] - 2 * margin, height.shape[1] - 2 * margin
    directions, steps = down.shape
    light = np.zeros((rows, columns))
    for row in range(rows):
        for column in range(columns):
            here = height[row + margin, column + margin]
            for k in range(directions):
                steepest = 0.0
                for step in range(steps):
                    there = height[row + margin + down[k, step], column + margin + right[k, step]]
                    steepest = max(steepest, (there - here) * slope[step])
                light[row, column] += 1.0 / (1.0 + steepest * steepest)
    return light / directions


def _viewpoint(middle: NDArray[np.float64], size: Sequence[float], zoom: int) -> camera.Viewpoint:
    above = camera.overhead_viewpoint()
    columns, rows = (round(side / WORKSPACE.pixel) * zoom for side in size)
    intrinsics = np.array(above.intrinsics)
    intrinsics[:2] *= zoom
    x, y = middle / WORKSPACE.pixel * zoom
    intrinsics[:2, 2] = (columns - 1) / 2 - x, (rows - 1) / 2 + y
    return replace(above, intrinsics=intrinsics, size=(rows, columns))


def _coarser(color: NDArray[np.float64], height: NDArray[np.float64], owner: NDArray[np.int32]) -> Above:
    # beside the table nothing is seen, and nothing stands
    height = np.where(owner == camera.TABLE, 0.0, height)
    return Above(_means(color), _means(height[..., None])[..., 0])


def _means(fine: NDArray[np.float64]) -> NDArray[np.float64]:
    rows, columns, channels = fine.shape
    return fine.reshape(rows // FINER, FINER, columns // FINER, FINER, channels).mean(axis=(1, 3))
