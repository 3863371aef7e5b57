"""The suite in three pictures: every object, the parts of those asked for by part, and a scene of each task."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Patch
from matplotlib.patheffects import Normal, Stroke
from numpy.typing import NDArray

from equigrasp.artefacts import write_figure
from equigrasp.workspace import WORKSPACE, Motion
from tasks import TASKS, camera
from tasks.above import NO_PART, PART_COLORS, PIXEL, SHADE, Above, in_parts, photographed
from tasks.combinations import FRUIT, TOOLS, TOYS
from tasks.env import GraspEnv
from tasks.objects import CAPTIONS, LOGOS, PAINTS, ObjectAsset, load, painted
from tasks.scene import Client, Scene

Progress = Callable[[Sequence[Any]], Iterable[Any]]
Color = tuple[int, int, int]

MARGIN = 0.01
"""Metres around an object."""
BRIGHT: Color = (232, 232, 230)
"""The table under parts: on the robot's own, blue and green parts would be dark on dark."""
PART_SHADE = 0.5
"""As `tasks.above.SHADE`, but so that a colour is still told in a hollow."""
LINE, LETTER = 0.045, 0.008
"""Metres from one line of writing to the next, and from one letter."""
LEGEND: dict[str, Any] = {
    "fontsize": 10,
    "frameon": False,
    "columnspacing": 1.2,
    "handletextpad": 0.5,
    "handlelength": 1.2,
}


class Sheet:
    """A strip of table under the other, things laid on them at one scale, and words; metres from the upper left.

    Args:
        width: metres.
    """

    def __init__(self, width: float) -> None:
        self.width = width
        self.strips: list[tuple[float, Color]] = []
        self.laid: list[tuple[Above, float, float]] = []
        self.words: list[tuple[float, float, str, dict[str, Any]]] = []
        self.bars: list[tuple[float, float, str]] = []

    @property
    def bottom(self) -> float:
        """Where the next strip begins."""
        return sum(high for high, _ in self.strips)

    def strip(self, high: float, color: Color = camera.TABLE_COLOR) -> float:
        """Add a strip of that height and colour; gives its upper edge."""
        top = self.bottom
        self.strips.append((high, color))
        return top

    def write(self, x: float, y: float, text: str, **look: Any) -> None:
        """Write, with the middle of the text there unless `look`, matplotlib's, says otherwise."""
        self.words.append((x, y, text, look))

    def bar(self, right: float, y: float, color: str = "white") -> None:
        """A bar of 10 cm, which ends there, and its length before it."""
        self.bars.append((right, y, color))
        self.write(right - 0.11, y, "10 cm", ha="right", color=color)

    def spread(self, widths: Sequence[float]) -> list[float]:
        """Left edges of things of these widths, with equal gaps between and beside them."""
        gap = (self.width - sum(widths)) / (len(widths) + 1)
        return [gap * (i + 1) + sum(widths[:i]) for i in range(len(widths))]

    def figure(self, shade: float, legend: Sequence[Patch] = ()) -> Figure:
        """Draw it; `shade` is as of `Above.shaded`."""
        columns = round(self.width / PIXEL)
        color = np.concatenate(
            [np.full((round(high / PIXEL), columns, 3), paint, dtype=float) for high, paint in self.strips]
        )
        height = np.zeros(color.shape[:2])
        for picture, left, top in self.laid:
            rows, wide = picture.height.shape
            row, column = round(top / PIXEL), round(left / PIXEL)
            color[row : row + rows, column : column + wide] = picture.color
            height[row : row + rows, column : column + wide] = picture.height
        drawn = Figure(figsize=(11.0, 11.0 * len(color) / columns))
        axes = drawn.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.imshow(Above(color, height).shaded(shade), extent=(0.0, self.width, self.bottom, 0.0), aspect="auto")
        for x, y, text, look in self.words:
            everyday: dict[str, Any] = {"ha": "center", "va": "center", "color": "white", "fontsize": 10}
            axes.text(x, y, text, **everyday | look)
        for right, y, color in self.bars:
            axes.plot([right - 0.1, right], [y, y], color=color, lw=3, solid_capstyle="butt")
        if legend:
            axes.legend(handles=legend, loc="lower left", ncols=len(legend), **LEGEND)
        return drawn


def draw_objects(path: Path, progress: Progress = iter) -> None:
    """Draw every object, and the ten colours, all at one scale, to a PNG or a PDF, by the path's ending."""
    rows: list[list[tuple[str, list[tuple[str, ObjectAsset]]]]] = [
        [("tools", [(_said(name), load(name)) for name in TOOLS])],
        [("toys", [(_said(name), load(name)) for name in TOYS])],
        [
            ("fruit", [(name, load(name)) for name in FRUIT]),
            ("blocks with the \u2026 logo", [(logo, load(f"block-{logo}")) for logo in LOGOS]),
        ],
        [
            # a bottle says itself what it is captioned
            ("bottles captioned \u2026", [("", load(f"bottle-{letter}")) for letter in CAPTIONS]),
            ("L blocks", [(color, painted(load("L-block"), color)) for color in PAINTS]),
        ],
    ]
    things = [asset for row in rows for _, group in row for _, asset in group]
    pictures = dict(zip(things, _alone(progress(things), photographed), strict=True))
    widths = [[pictures[asset].size[0] for _, group in row for _, asset in group] for row in rows]
    sheet = Sheet(max(sum(row) for row in widths) + 0.2)
    sheet.bar(sheet.width - 0.02, 0.55 * LINE)
    for row, wide in zip(rows, widths, strict=True):
        lefts = iter(sheet.spread(wide))
        tallest = max(pictures[asset].size[1] for _, group in row for _, asset in group)
        top = sheet.strip(tallest + 2.1 * LINE)
        for title, group in row:
            for index, ((name, asset), left) in enumerate(zip(group, lefts, strict=False)):
                picture = pictures[asset]
                width, high = picture.size
                if index == 0:
                    sheet.write(left + MARGIN, top + 0.55 * LINE, title, ha="left", weight="bold", fontsize=11)
                sheet.laid.append((picture, left, top + LINE + (tallest - high) / 2))
                sheet.write(left + width / 2, top + 1.4 * LINE + tallest, name)
    write_figure(path, sheet.figure(SHADE), dpi=150, colors=256)


def draw_parts(path: Path, progress: Progress = iter) -> None:
    """Draw what pick-by-part asks for, as it looks and with its parts in colours; a PNG or a PDF, by the path.

    A part has the colour of its name, whatever the object, and its name is written below it.
    """
    goals: dict[str, list[str | None]] = {}
    for goal in TASKS["pick-by-part"].goals:
        goals.setdefault(goal.object, []).append(goal.part)
    assets = [load(name) for name in goals]
    seen = [*_alone(assets, photographed)]
    colored = [*_alone(progress(assets), partial(in_parts, table=BRIGHT))]
    half = -(-len(assets) // 2)
    widths = [picture.size[0] for picture in seen]
    sheet = Sheet(max(sum(widths[:half]), sum(widths[half:])) + 0.16)
    for row in (slice(0, half), slice(half, None)):
        tallest = max(picture.size[1] for picture in seen[row])
        lefts = sheet.spread(widths[row])
        upper = sheet.strip(tallest + LINE)
        lower = sheet.strip(tallest + 0.7 * LINE, BRIGHT)
        for asset, picture, (parts, indices), left in zip(assets[row], seen[row], colored[row], lefts, strict=True):
            width, high = picture.size
            sheet.write(left + width / 2, upper + 0.5 * LINE, _said(asset.name), weight="bold", fontsize=11)
            sheet.laid.append((picture, left, upper + 0.8 * LINE + (tallest - high) / 2))
            sheet.laid.append((parts, left, lower + (tallest - high) / 2))
            for x, y, part in _named(parts, indices):
                sheet.write(left + x, lower + (tallest - high) / 2 + y, part, color="black")
    sheet.bar(sheet.width - 0.02, sheet.strip(LINE, BRIGHT) + 0.5 * LINE, "black")
    write_figure(path, sheet.figure(PART_SHADE, part_key()), dpi=150, colors=256)


def _named(picture: Above, indices: NDArray[np.int64]) -> list[tuple[float, float, str]]:
    """Where the parts' names stand below them, metres from the picture's upper left, from left to right."""
    placed: list[tuple[float, float, str]] = []
    for index, part in enumerate(PART_COLORS):
        rows, columns = np.nonzero(indices == index)
        if len(rows):
            x, half = PIXEL * columns.mean(), LETTER * len(part) / 2
            # below the part, and below whatever else is in the way
            near = picture.height[:, max(round((x - half) / PIXEL), 0) : round((x + half) / PIXEL)]
            placed.append((x, PIXEL * max(rows.max(), np.nonzero(near)[0].max()) + 0.4 * LINE, part))
    placed.sort()
    for i, ((x, _, part), (next_x, _, next_part)) in enumerate(itertools.pairwise(placed)):
        if (short := LETTER * (len(part) + len(next_part) + 2) / 2 - (next_x - x)) > 0:
            placed[i : i + 2] = [(x - short / 2, *placed[i][1:]), (next_x + short / 2, *placed[i + 1][1:])]
    lowest = max(y for _, y, _ in placed)
    if lowest - min(y for _, y, _ in placed) < LINE / 2:
        return [(x, lowest, part) for x, _, part in placed]
    return placed


def part_key(*names: str) -> list[Patch]:
    """A legend's patches: the parts of these names, or all of them, and what is on none."""
    rows = [(name, color) for name, color in PART_COLORS.items() if not names or name in names]
    rows.append(("no part, never asked for", NO_PART))
    return [Patch(color=(red / 255, green / 255, blue / 255), label=name) for name, (red, green, blue) in rows]


def draw_tasks(path: Path, seed: int = 0, progress: Progress = iter) -> None:
    """Draw a scene of each task under what is said in it, its target ringed; a PNG or a PDF, by the path."""
    columns = 3
    rows = -(-len(TASKS) // columns)
    figure = Figure(figsize=(4.7 * columns, 2.8 * rows), layout="constrained")
    grid = figure.subplots(rows, columns).ravel()
    for axes in grid:
        axes.set_axis_off()
    for axes, task in zip(grid, progress(list(TASKS.values())), strict=False):
        env = GraspEnv(task, camera="overhead")
        try:
            env.reset(seed=seed)
            _, scene = env.started()
            axes.imshow(
                photographed(scene, np.zeros(2), (WORKSPACE.length, WORKSPACE.depth)).shaded(),
                extent=[side for bounds in WORKSPACE.bounds for side in bounds],
            )
            ring(axes, *around(scene, env.goal.name))
            axes.set_title(f"{task.name}\n\u201c{env.instruction}\u201d", fontsize=10.5)
        finally:
            env.close()
    write_figure(path, figure, dpi=110, colors=256)


def around(scene: Scene, name: str) -> tuple[float, float, float]:
    """The circle around an object, MARGIN away: x and y of its middle and its radius, metres."""
    pose = scene.pose(name)
    outline = scene.asset(name).footprint @ pose.rotation[:2, :2].T + pose.position[:2]
    middle = (outline.min(axis=0) + outline.max(axis=0)) / 2
    return float(middle[0]), float(middle[1]), float(np.hypot(*(outline - middle).T).max()) + MARGIN


def ring(axes: Axes, x: float, y: float, radius: float) -> None:
    """A white ring with dark edges, which no object hides, as none is both."""
    edges = [Stroke(linewidth=3.6, foreground="black"), Normal()]
    axes.add_patch(Circle((x, y), radius, fill=False, color="white", lw=1.6, path_effects=edges))


def _said(name: str) -> str:
    return name.replace("-", " ")


def _alone(assets: Iterable[ObjectAsset], take: Callable[..., Any]) -> Iterable[Any]:
    """What `take`, of `tasks.above`, gives of each object when it lies on the table alone."""
    bullet = Client()
    try:
        for asset in assets:
            scene = Scene(bullet, [asset], [Motion()])
            # a footprint need not be centred on the centre of mass
            low, high = asset.footprint.min(axis=0) - MARGIN, asset.footprint.max(axis=0) + MARGIN
            yield take(scene, (low + high) / 2, (high - low).tolist())
    finally:
        bullet.disconnect()
