"""Where things are put down on the table: at random, apart from each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Real

import numpy as np
from scipy.spatial import KDTree

from equigrasp.errors import InputError
from equigrasp.workspace import WORKSPACE, Motion
from tasks.objects import ObjectAsset

MARGIN = 0.02
"""Between an object and the workspace's edge, metres, so that the fingers stay inside with it."""

LEAST_CLEARANCE = 0.001
"""Metres. Footprints are points 3 mm apart, so that objects with less between them may be laid into each other."""


def arrange(assets: Sequence[ObjectAsset], rng: np.random.Generator, clearance: float, tries: int = 50) -> list[Motion]:
    """Random poses on the table, at which no two footprints come nearer to each other than `clearance` metres.

    Objects are placed one after the other, each at the first of up to `tries` uniform draws that is free.
    Where none is, the whole arrangement is drawn again from the same generator, so the result depends on
    nothing but the generator's state.

    Raises:
        ValueError: if the clearance is less than LEAST_CLEARANCE.
        InputError: if no arrangement was found in 200 rounds: these objects do not fit on the table.
    """
    check_clearance(clearance)
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
    raise InputError(
        f"no room was found on the table for {len(assets)} objects with {1000 * clearance:g} mm between them "
        f"({names:.200}); let the task's scenes hold fewer (objects), choose smaller ones, or a smaller clearance"
    )


def check_clearance(clearance: float) -> None:
    """Raise ValueError unless objects may be laid out so far apart, in metres."""
    number = isinstance(clearance, Real) and not isinstance(clearance, bool)
    if not number or not LEAST_CLEARANCE <= clearance < math.inf:
        raise ValueError(
            f"clearance is metres between two objects, a number from {LEAST_CLEARANCE}, but this is {clearance!r}"
        )


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
