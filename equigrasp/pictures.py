"""Pictures of what a policy saw, thought and did: scene, heatmap, its peak, angles, outcome, in one row a query."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.projections.polar import PolarAxes
from numpy.typing import NDArray

from equigrasp.artefacts import write_figure
from equigrasp.grasp import Grasp, Observation
from equigrasp.hand import HAND
from equigrasp.workspace import WORKSPACE

RANGE = 30.0
"""The heatmap shows log-probabilities from the best one down to this much less."""
CLOSE = 11.0
"""Half the width of the heatmap's close-up, centimetres."""
STANDING = 0.004
"""Metres: what is higher stands on the table, and is outlined on the heatmap."""
POLICY_COLOR = "#E69F00"
ORACLE_COLOR = "#56B4E9"
COLORS = (POLICY_COLOR, ORACLE_COLOR)


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
    figure = Figure(figsize=(10.5, 1.75 * len(queries) + 1.0), layout="constrained")
    # what a user says or names is no mathematics, whatever is between two dollars
    figure.suptitle(title, fontsize=12, parse_math=False)
    columns = ("scene", "heat", "close", "angles", "photograph")
    mosaic: Any = [[f"{what}{row}" for what in columns] for row in range(len(queries))]
    mosaic.append(["key", "bar", ".", ".", "."])
    polar: Any = {f"angles{row}": {"projection": "polar"} for row in range(len(queries))}
    grid = figure.subplot_mosaic(
        mosaic,
        height_ratios=[*[1.0] * len(queries), 0.06],
        width_ratios=[2.0, 2.0, 1.0, 1.15, 1.33],
        per_subplot_kw=polar,
    )
    for row, query in enumerate(queries):
        _scene(grid[f"scene{row}"], query)
        _heatmap(grid[f"heat{row}"], query)
        _heatmap(grid[f"close{row}"], query, close=True)
        angles = grid[f"angles{row}"]
        assert isinstance(angles, PolarAxes)
        _angles(angles, query)
        _photograph(grid[f"photograph{row}"], query)
    for what, words in (("heat", "log-probability at its best angle"), ("close", "closer")):
        grid[f"{what}0"].set_title(words, fontsize=10)
    scale = ScalarMappable(Normalize(-RANGE, 0), "viridis")
    bar = figure.colorbar(scale, cax=grid["bar"], orientation="horizontal")
    bar.ax.tick_params(labelsize=8)
    labels = ["policy", *(["oracle"] if any(query.oracle for query in queries) else [])]
    hands = [Line2D([], [], color=color, lw=3, label=label) for label, color in zip(labels, COLORS, strict=False)]
    grid["key"].set_axis_off()
    key = grid["key"].legend(handles=hands, loc="center", ncols=2, fontsize=10, frameon=False, handlelength=1.2)
    # it is higher than the bar beside it
    key.set_in_layout(False)
    write_figure(path, figure, dpi=150)


def _table(axes: Axes) -> tuple[float, float, float, float]:
    (x_min, x_max), (y_min, y_max) = WORKSPACE.bounds
    axes.set_xticks([])
    axes.set_yticks([])
    return 100 * x_min, 100 * x_max, 100 * y_min, 100 * y_max


def _scene(axes: Axes, query: Query) -> None:
    left, right, bottom, top = extent = _table(axes)
    axes.imshow(query.observation.color, extent=extent)
    if query.oracle is not None:
        _hand(axes, query.oracle, ORACLE_COLOR, 1.5)
    _hand(axes, query.grasp, POLICY_COLOR, 1.5)
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.plot([left + 3, left + 13], [bottom + 2, bottom + 2], color="white", lw=2, solid_capstyle="butt")
    axes.text(left + 14, bottom + 2, "10 cm", color="white", fontsize=7, va="center")
    axes.set_title("\n".join(textwrap.wrap(f"\u201c{query.instruction}\u201d", 34)), fontsize=10, parse_math=False)


def _heatmap(axes: Axes, query: Query, close: bool = False) -> None:
    """The scores of the best grasp's angle, in the colour bar's own colours, and the outlines of what lies there."""
    scores = query.log_probabilities[WORKSPACE.to_bin(query.grasp.theta)]
    left, right, bottom, top = extent = _table(axes)
    axes.imshow(scores - scores.max(), cmap="viridis", vmin=-RANGE, vmax=0, extent=extent)
    height = query.observation.height
    if height.max() > STANDING:
        axes.contour(height, [STANDING], colors="white", linewidths=0.5, alpha=0.8, extent=extent, origin="upper")
    x, y = 100 * WORKSPACE.to_world([query.grasp.u, query.grasp.v])
    if close:
        left, right, bottom, top = x - CLOSE, x + CLOSE, y - CLOSE, y + CLOSE
        # the fingers alone, beside the peak
        if query.oracle is not None:
            _hand(axes, query.oracle, ORACLE_COLOR, 3, palm=False)
        _hand(axes, query.grasp, POLICY_COLOR, 3, palm=False)
        axes.set_facecolor("0.9")
    else:
        square = Rectangle((x - CLOSE, y - CLOSE), 2 * CLOSE, 2 * CLOSE, fill=False, color="white", lw=0.8)
        axes.add_patch(square)
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)


def _hand(axes: Axes, grasp: Grasp, color: str, width: float, palm: bool = True) -> None:
    x, y = 100 * WORKSPACE.to_world([grasp.u, grasp.v])
    c, s = math.cos(grasp.theta), math.sin(grasp.theta)
    half, finger = 50 * HAND.opening, 1.1
    if palm:
        axes.plot([x - half * c, x + half * c], [y - half * s, y + half * s], color=color, lw=0.7 * width, zorder=4)
    for side in (-half, half):
        ends_x = [x + side * c - finger * s, x + side * c + finger * s]
        ends_y = [y + side * s + finger * c, y + side * s - finger * c]
        axes.plot(ends_x, ends_y, color=color, lw=width, zorder=4)


def _angles(axes: PolarAxes, query: Query) -> None:
    bins, rows, columns = query.log_probabilities.shape
    stride = WORKSPACE.rows / rows
    u = min(max(round((query.grasp.u + 0.5) / stride - 0.5), 0), columns - 1)
    v = min(max(round((query.grasp.v + 0.5) / stride - 0.5), 0), rows - 1)
    profile = query.log_probabilities[:, v, u]
    share = np.exp(profile - profile.max())
    # the gripper is its own mirror: half a turn is all, and what is nearest to its end is drawn at both
    theta = np.arange(bins + 1) * math.pi / bins
    axes.bar(theta, np.append(share, share[0]), width=math.pi / bins, color=POLICY_COLOR, edgecolor="none")
    if query.oracle is not None:
        axes.plot([query.oracle.theta] * 2, [0, 1], color=ORACLE_COLOR, lw=2)
    # a bin further on both sides: what closes along the table's edge would lie on the dial's
    axes.set_thetalim(-math.pi / bins, math.pi + math.pi / bins)
    axes.set_yticks([])
    axes.set_xticks(np.radians([0, 90, 180]))
    axes.tick_params(labelsize=8, pad=0)
    axes.set_title(f"closing axis, {math.degrees(query.grasp.theta):.0f}\u00b0", fontsize=10, y=0.95)


def _photograph(axes: Axes, query: Query) -> None:
    axes.imshow(query.photograph)
    axes.set_xticks([])
    axes.set_yticks([])
    mark = "\u2713" if query.success else "\u2717"
    words = "\n".join(textwrap.wrap(f"{mark} {query.outcome}", 26))
    # the names of objects are their makers'
    axes.set_title(words, fontsize=9, color="#00674F" if query.success else "#B23A00", parse_math=False)
