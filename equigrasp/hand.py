"""The hand that a grasp is for: a parallel gripper that comes down along z, and what would be in its way.

A pose is (u, v, theta), as of a `Grasp`; functions take many at once, `(N, 3)`. Heights are `(H, W)`, metres above the
table; where an array shows one thing alone, 0 is where it is not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from equigrasp.workspace import Workspace

Poses = NDArray[np.float64]
Heights = NDArray[np.float32]

STEP = 0.0025
"""Between two points at which a height is looked up under the fingers, metres; under the palm it is twice that."""
GUARD = 0.003
"""Fingers and palm are taken to be larger than they are, by this on each side, metres."""
TABLE = 0.002
"""Metres: what is lower is table."""


@dataclass(frozen=True)
class Hand:
    """A parallel gripper; all sizes in metres.

    Attributes:
        opening: distance between the open fingers' inner faces.
        finger_thickness: along the closing axis.
        finger_width: across it.
        finger_length: from the fingertips to the palm.
        palm: along the closing axis, across it, and upwards.
        depth: how far below the surface at the grasp's pixel the fingertips go.
        floor: the fingertips stay this high above the table.
    """

    opening: float
    finger_thickness: float
    finger_width: float
    finger_length: float
    palm: tuple[float, float, float]
    depth: float
    floor: float

    def tips(self, height: Heights, poses: Poses) -> NDArray[np.float64]:
        """How high above the table the fingertips close, `(N,)` metres."""
        return np.maximum(self.floor, surface(height, poses) - self.depth)

    def is_free(self, height: Heights, others: Heights, poses: Poses, workspace: Workspace) -> NDArray[np.bool_]:
        """Whether the hand can come down and close without meeting what it is not to take, `(N,)`.

        Args:
            height: of the whole scene, which says how far the fingers go down.
            others: of all but what is to be taken.
            poses: `(N, 3)`.
            workspace: the grid.
        """
        tips = self.tips(height, poses)[:, None]
        fingers = look_up(others, poses, _fingers(self), workspace)
        in_the_way = ((fingers > TABLE) & (fingers > tips)).any(axis=1)
        palm = look_up(others, poses, _palm(self), workspace)
        return ~in_the_way & ~(palm > tips + self.finger_length - GUARD).any(axis=1)

    def section(self, target: Heights, poses: Poses, workspace: Workspace) -> NDArray[np.float64]:
        """What the fingers close on: where they meet the target, and how high it stands.

        Args:
            target: heights of what is to be taken alone.
            poses: `(N, 3)`.
            workspace: the grid.

        Returns:
            `(N, 3)`: from the grasp's point to the first and to the last of the target along the closing axis, and its
            height there, all in metres; NaN where there is nothing between the fingers.
        """
        between = _between(self)
        tips = self.tips(target, poses)
        met = look_up(target, poses, between, workspace) > tips[:, None] + 0.001
        along = np.where(met, between[:, 0], np.nan)
        found = np.full((len(poses), 3), np.nan)
        some = met.any(axis=1)
        found[some, 0], found[some, 1] = np.nanmin(along[some], axis=1), np.nanmax(along[some], axis=1)
        found[some, 2] = surface(target, poses[some])
        return found

    def fingers_on(self, target: Heights, poses: Poses, workspace: Workspace) -> NDArray[np.int64]:
        """At how many points a finger would come down on the target itself, `(N,)`."""
        points = _fingers(self)
        under = points[np.abs(points[:, 0]) > self.opening / 2 - GUARD]
        heights = look_up(target, poses, under, workspace)
        return ((heights > TABLE) & (heights > self.tips(target, poses)[:, None])).sum(axis=1)


HAND = Hand(
    opening=0.08,
    finger_thickness=0.010,
    finger_width=0.020,
    finger_length=0.046,
    palm=(0.204, 0.063, 0.066),
    depth=0.038,
    floor=0.004,
)
"""A Panda's, which the benchmark grasps with."""


def surface(height: Heights, poses: Poses) -> NDArray[np.float64]:
    """How high it is at each pose's own pixel, `(N,)` metres; at the nearest, outside of the heightmap."""
    rows, columns = height.shape
    u = np.clip(np.floor(poses[:, 0] + 0.5).astype(np.int64), 0, columns - 1)
    v = np.clip(np.floor(poses[:, 1] + 0.5).astype(np.int64), 0, rows - 1)
    return height[v, u].astype(np.float64)


def offsets(angles: NDArray[np.float64], points: NDArray[np.float64], workspace: Workspace) -> NDArray[np.float64]:
    """Points `(K, 2)` in metres, along and across a closing axis, as pixels beside the grasp's, `(N, K, 2)`."""
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    along, across = points[:, 0], points[:, 1]
    # v grows as world y falls
    u, v = cosine * along - sine * across, -(sine * along + cosine * across)
    return np.stack([u, v], axis=-1) / workspace.pixel


def look_up(height: Heights, poses: Poses, points: NDArray[np.float64], workspace: Workspace) -> Heights:
    """The heights at points beside each pose, `(N, K)`; 0 outside of the heightmap."""
    places = poses[:, None, :2] + offsets(poses[:, 2], points, workspace)
    columns, rows = np.moveaxis(np.floor(places + 0.5).astype(np.int64), -1, 0)
    inside = (rows >= 0) & (rows < height.shape[0]) & (columns >= 0) & (columns < height.shape[1])
    return np.where(inside, height[np.where(inside, rows, 0), np.where(inside, columns, 0)], np.float32(0))


@cache
def _fingers(hand: Hand) -> NDArray[np.float64]:
    """All that the open fingers come down on or close over."""
    return _grid(hand.opening / 2 + hand.finger_thickness + GUARD, hand.finger_width / 2 + GUARD, STEP)


@cache
def _between(hand: Hand) -> NDArray[np.float64]:
    return _grid(hand.opening / 2 - GUARD, hand.finger_width / 2, STEP)


@cache
def _palm(hand: Hand) -> NDArray[np.float64]:
    return _grid(hand.palm[0] / 2 + GUARD, hand.palm[1] / 2 + GUARD, 2 * STEP)


def _grid(half_along: float, half_across: float, step: float) -> NDArray[np.float64]:
    """Points `(K, 2)` of a rectangle about the grasp's point, its edges among them."""
    along, across = (np.linspace(-half, half, 2 * round(half / step) + 1) for half in (half_along, half_across))
    return np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1).reshape(-1, 2)
