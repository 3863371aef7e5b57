"""Pictures of what a policy saw, thought and did: scene, heatmap, angles, grasp, outcome, in one row a query."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from equigrasp.artefacts import write_figure
from equigrasp.grasp import Grasp, Observation
from equigrasp.hand import HAND
from equigrasp.workspace import WORKSPACE

RANGE = 30.0
"""The heatmap shows log-probabilities from the best one down to this much less."""
POLICY_COLOR = "#E69F00"
ORACLE_COLOR = "#56B4E9"


@dataclass(frozen=True, eq=False)
class Query:
    """All that one row of the picture shows.

    Attributes:
        observation: what the policy saw.
        instruction: what it was told.
        grasp: what it chose.
        oracle: what the oracle would have chosen, or None.
        log_probabilities: `(bins, h, w)`, the policy's own, at its read-out's resolution.
        photograph: `(rows, columns, 3)` uint8, the hand after lifting.
        outcome: what happened, in words.
        success: whether it was what the instruction asked for.
    """

    observation: Observation
    instruction: str
    grasp: Grasp
    oracle: Grasp | None
    log_probabilities: NDArray[np.float32]
    photograph: NDArray[np.uint8]
    outcome: str
    success: bool


def draw(queries: Sequence[Query], path: Path, title: str) -> None:
    """Draw the queries, one row each, to a PNG (or a PDF, by the path's ending); the file is whole or not there."""
    # narrow, so that letters are read where a page shows the picture 800 pixels wide
    figure = Figure(figsize=(10.5, 2.1 * len(queries) + 0.4), layout="constrained")
    # what a user says or names is no mathematics, whatever is between two dollars
    figure.suptitle(title, fontsize=12, parse_math=False)
    grid = figure.add_gridspec(len(queries), 4, width_ratios=(2.0, 2.0, 1.0, 1.33))
    for row, query in enumerate(queries):
        _scene(figure.add_subplot(grid[row, 0]), query)
        _heatmap(figure.add_subplot(grid[row, 1]), query)
        angles = figure.add_subplot(grid[row, 2], projection="polar")
        assert isinstance(angles, PolarAxes)
        _angles(angles, query)
        _photograph(figure.add_subplot(grid[row, 3]), query)
    write_figure(path, figure, dpi=150)


def _centimetres(axes: Axes) -> tuple[float, float, float, float]:
    (x_min, x_max), (y_min, y_max) = WORKSPACE.bounds
    axes.set_xlabel("x (cm)", fontsize=8, labelpad=1, loc="left")
    axes.set_ylabel("y (cm)", fontsize=8, labelpad=0)
    axes.tick_params(labelsize=7)
    return 100 * x_min, 100 * x_max, 100 * y_min, 100 * y_max


def _scene(axes: Axes, query: Query) -> None:
    axes.imshow(query.observation.color, extent=_centimetres(axes))
    axes.set_title("\n".join(textwrap.wrap(f"\u201c{query.instruction}\u201d", 40)), fontsize=10, parse_math=False)


def _heatmap(axes: Axes, query: Query) -> None:
    scores = query.log_probabilities[WORKSPACE.to_bin(query.grasp.theta)]
    scores = scores - scores.max()
    gray = query.observation.color.mean(axis=-1)
    extent = _centimetres(axes)
    axes.imshow(gray, cmap="gray", vmin=0, vmax=255, extent=extent)
    strength = np.clip(1 + scores / RANGE, 0.0, 1.0)
    axes.imshow(scores, cmap="viridis", vmin=-RANGE, vmax=0, alpha=0.85 * strength, extent=extent, zorder=2)
    axes.set_xlim(extent[0], extent[1])
    axes.set_ylim(extent[2], extent[3])
    if query.oracle is not None:
        _hand(axes, query.oracle, ORACLE_COLOR, "oracle")
    _hand(axes, query.grasp, POLICY_COLOR, "policy")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, fontsize=8, frameon=False, handlelength=1.2)
    axes.set_title(f"log-probability at its best angle, {math.degrees(query.grasp.theta):.0f}\u00b0", fontsize=9)
    scale = ScalarMappable(Normalize(-RANGE, 0), "viridis")
    bar = axes.figure.colorbar(scale, ax=axes, fraction=0.025, pad=0.01)
    bar.ax.tick_params(labelsize=7)


def _hand(axes: Axes, grasp: Grasp, color: str, label: str) -> None:
    x, y = 100 * WORKSPACE.to_world([grasp.u, grasp.v])
    c, s = math.cos(grasp.theta), math.sin(grasp.theta)
    half, finger = 50 * HAND.opening, 1.1
    axes.plot([x - half * c, x + half * c], [y - half * s, y + half * s], color=color, lw=1.2, zorder=4)
    for side in (-half, half):
        ends_x = [x + side * c - finger * s, x + side * c + finger * s]
        ends_y = [y + side * s + finger * c, y + side * s - finger * c]
        axes.plot(ends_x, ends_y, color=color, lw=3, zorder=4, label=label if side > 0 else None)


def _angles(axes: PolarAxes, query: Query) -> None:
    bins, rows, columns = query.log_probabilities.shape
    stride = WORKSPACE.rows / rows
    u = min(max(round((query.grasp.u + 0.5) / stride - 0.5), 0), columns - 1)
    v = min(max(round((query.grasp.v + 0.5) / stride - 0.5), 0), rows - 1)
    profile = query.log_probabilities[:, v, u]
    share = np.exp(profile - profile.max())
    theta = np.arange(2 * bins) * math.pi / bins
    # the gripper is its own mirror, so the distribution is drawn at theta and at theta + pi
    axes.bar(theta, np.tile(share, 2), width=math.pi / bins, color=POLICY_COLOR, edgecolor="none")
    if query.oracle is not None:
        for turn in (0.0, math.pi):
            axes.plot([query.oracle.theta + turn] * 2, [0, 1], color=ORACLE_COLOR, lw=1.5)
    axes.set_yticks([])
    axes.set_xticks(np.radians([0, 90, 180, 270]))
    axes.tick_params(labelsize=7, pad=-2)
    axes.set_title("closing axis", fontsize=9)


def _photograph(axes: Axes, query: Query) -> None:
    axes.imshow(query.photograph)
    axes.set_xticks([])
    axes.set_yticks([])
    mark = "\u2713" if query.success else "\u2717"
    words = "\n".join(textwrap.wrap(f"{mark} {query.outcome}", 26))
    # the names of objects are their makers'
    axes.set_title(words, fontsize=9, color="#00674F" if query.success else "#B23A00", parse_math=False)
