"""MeshAnatomy: what a baked mesh knows of itself: its distance on a grid, and a part for each point of its skin.

It needs numpy and scipy only, and reads its file when it is first asked.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.spatial import KDTree

from tasks.objects.shape import REACH

UNIT = 1e-5
"""Distances are kept in whole hundredths of a millimetre."""


def packed(
    low: NDArray[np.float64],
    step: float,
    distances: NDArray[np.float64],
    skin: NDArray[np.float64],
    labels: NDArray[np.int64],
) -> dict[str, NDArray[Any]]:
    """The arrays of the file.

    Args:
        low: `(3,)` metres, where the first sample lies.
        step: metres between samples.
        distances: `(X, Y, Z)` metres.
        skin: `(N, 3)` metres, points of the surface.
        labels: `(N,)` the part of each, -1 for none.
    """
    units = np.clip(np.round(distances / UNIT), -32767, 32767).astype(np.int16)
    # a sample of zero would be neither inside nor outside
    units[units == 0] = np.where(distances[units == 0] < 0, -1, 1)
    return {
        "low": low,
        "step": np.array(step),
        "distances": units,
        "skin": skin.astype(np.float32),
        "labels": labels.astype(np.int8),
    }


@dataclass(frozen=True, eq=False)
class MeshAnatomy:
    """An `Anatomy` from a file of arrays.

    Frame: that of the drawing, as for `Shape`: z up, the table at z = 0, metres.

    Attributes:
        parts: the names an instruction may use.
        file: `.npz` of what `packed` gives.
    """

    parts: tuple[str, ...]
    file: Path

    @cached_property
    def arrays(self) -> dict[str, NDArray[Any]]:
        """The file's content; `distances` `(X, Y, Z)` in metres."""
        with np.load(self.file, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        arrays["distances"] = arrays["distances"] * UNIT
        return arrays

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.arrays["skin"].astype(np.float64))

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance: points `(N, 3)` metres -> `(N,)` metres, negative inside.

        Linear between samples. Outside the grid, 4 samples away from the object and more, it is an upper bound.
        """
        points = np.asarray(points, dtype=np.float64)
        arrays = self.arrays
        where = (points - arrays["low"]) / float(arrays["step"])
        within = np.clip(where, 0.0, np.array(arrays["distances"].shape) - 1.0)
        beyond = np.sqrt(((where - within) ** 2).sum(axis=1)) * float(arrays["step"])
        return map_coordinates(arrays["distances"], within.T, order=1, mode="nearest") + beyond

    def part_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The part of the nearest point of the skin: points `(N, 3)` metres -> `(N,)` indices into `parts`.

        -1 where that has none, or is further away than REACH.
        """
        points = np.asarray(points, dtype=np.float64)
        if not self.parts or not len(points):
            return np.full(len(points), -1, dtype=np.int64)
        distances, nearest = self._tree.query(points, distance_upper_bound=REACH)
        labels = np.append(self.arrays["labels"].astype(np.int64), -1)
        return np.where(np.isfinite(distances), labels[nearest], -1)

    def __getstate__(self) -> dict[str, Any]:
        # without the arrays: whoever unpickles it reads the file
        return {"parts": self.parts, "file": self.file}
