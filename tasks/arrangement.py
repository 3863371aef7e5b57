"""Where things are put down on the table: at random, apart from each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from equigrasp.workspace import WORKSPACE, Motion
from tasks.objects import ObjectAsset

MARGIN = 0.02
"""Between an object and the workspace's edge, metres, so that the fingers stay inside with it."""


def arrange(assets: Sequence[ObjectAsset], rng: np.random.Generator, clearance: float, tries: int = 50) -> list[Motion]:
    """Random poses on the table, at which no two footprints come nearer to each other than `clearance` metres.

    Objects are placed one after the other, each at the first of up to `tries` uniform draws that is free.
    Where none is, the whole arrangement is drawn again from the same generator, so the result depends on
    nothing but the generator's state.

    Raises:
        ValueError: if no arrangement was found in 200 rounds: these objects do not fit on the table.
    """
    for _ in range(200):
        poses: list[Motion] = []
        placed: list[KDTree] = []
        for asset in assets:
            pose = _place(asset, placed, rng, clearance, tries)
            if pose is None:
                break
            poses.append(pose)
            placed.append(KDTree(pose(asset.footprint)))
        if len(poses) == len(assets):
            return poses
    names = ", ".join(asset.name for asset in assets)
    raise ValueError(f"no room on the table for {names} with {1000 * clearance:.0f} mm between them")


def _place(
    asset: ObjectAsset,
    placed: Sequence[KDTree],
    rng: np.random.Generator,
    clearance: float,
    tries: int,
) -> Motion | None:
    (x_min, x_max), (y_min, y_max) = WORKSPACE.bounds
    low = np.array([x_min, y_min]) + MARGIN
    high = np.array([x_max, y_max]) - MARGIN
    for _ in range(tries):
        pose = Motion(rng.uniform(0.0, 2.0 * math.pi), rng.uniform(low[0], high[0]), rng.uniform(low[1], high[1]))
        outline = pose(asset.footprint)
        if (outline < low).any() or (outline > high).any():
            continue
        nearest = (tree.query(outline, distance_upper_bound=clearance)[0].min() for tree in placed)
        if all(distance > clearance for distance in nearest):
            return pose
    return None
