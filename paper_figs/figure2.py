"""Figure 2, the architecture, with the real tensors of one grasp.

    uv run equigrasp quickstart --steps 2000
    uv run python paper_figs/figure2.py --run quickstart/run

asks a trained policy for a grasp in a scene of the simulator and draws `figures/figure-2.{png,pdf}`: observation,
features, instruction, kernel, their correlation in even irreps, the 36 bins, the grasp. Every picture is a tensor
that was computed, at its own resolution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import asked
import numpy as np
import style
from asked import Asked
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from numpy.typing import NDArray

from equigrasp.artefacts import check_folder
from equigrasp.exits import exits
from equigrasp.policy import LegPolicy
from equigrasp.workspace import WORKSPACE

WIDTH, HEIGHT = 9.8, 4.9
"""Of the figure, inches; all places below are inches from its lower left corner."""
WIDE = 64.0
"""Of the part of the table that is drawn, twice as wide as high, centimetres."""
Window = tuple[float, float, float, float]
SHOWN = 4
"""Channels, angles and frequencies that are drawn of each tensor."""
RANGE = 20.0
"""Scores are drawn from the best down to this much less, nats."""


class Sheet:
    """A figure on which pictures, words and arrows have their places in inches."""

    def __init__(self) -> None:
        self.figure = Figure(figsize=(WIDTH, HEIGHT))

    def picture(self, left: float, bottom: float, wide: float, high: float) -> Axes:
        """Axes without ticks."""
        axes = self.figure.add_axes((left / WIDTH, bottom / HEIGHT, wide / WIDTH, high / HEIGHT))
        axes.set_xticks([])
        axes.set_yticks([])
        for spine in axes.spines.values():
            spine.set_linewidth(0.6)
        return axes

    def words(self, x: float, y: float, text: str, size: float = 8.5, **how: str) -> None:
        """Text centred on a place."""
        how = {"ha": "center", "va": "center", **how}
        self.figure.text(x / WIDTH, y / HEIGHT, text, fontsize=size, linespacing=1.25, **how)  # ty: ignore

    def arrow(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """A straight arrow."""
        tail, head = ((x / WIDTH, y / HEIGHT) for x, y in (start, end))
        arrow = FancyArrowPatch(tail, head, arrowstyle="-|>", mutation_scale=11, shrinkA=0, shrinkB=0)
        arrow.set(color="0.25", linewidth=1.2)
        self.figure.add_artist(arrow)

    def box(self, left: float, bottom: float, wide: float, high: float, text: str, color: str) -> None:
        """A module: a rounded box with its name."""
        patch = FancyBboxPatch(
            (left / WIDTH, bottom / HEIGHT),
            wide / WIDTH,
            high / HEIGHT,
            boxstyle="round,pad=0.004",
            mutation_aspect=WIDTH / HEIGHT,
            transform=self.figure.transFigure,
            fc=color,
            ec="0.25",
            lw=0.8,
        )
        self.figure.add_artist(patch)
        self.words(left + wide / 2, bottom + high / 2, text, 9)


def draw(policy: LegPolicy, one: Asked, words: str) -> Figure:
    """The figure: language above, vision below, the kernel meets the features in the middle."""
    sheet = Sheet()
    high = 0.62
    wide = 2 * high
    channels = _largest((one.features**2).sum(axis=(1, 2)), SHOWN)
    lows = [0.42 + each * (high + 0.12) for each in range(SHOWN)]

    # vision: observation -> phi -> features
    window = _window(one)
    _observation(sheet, one, window, 0.2, 1.12, wide)
    sheet.arrow((1.48, 1.75), (1.66, 1.75))
    sheet.box(1.7, 1.3, 0.62, 0.9, "$\\phi$\nU-Net", "#DCEBF5")
    sheet.arrow((2.36, 1.75), (2.54, 1.75))
    for low, channel in zip(lows, channels, strict=True):
        axes = sheet.picture(2.58, low, wide, high)
        _signed(axes, one.features[channel] - np.median(one.features[channel]), asked.TABLE)
        _cut(axes, window)
    sheet.words(2.58 + wide / 2, 0.2, f"features $\\phi(o,l)$\n{_shape(one.features)}")

    # language: instruction -> embedding -> kappa -> kernel
    sheet.words(0.2, 4.62, f"\u201c{one.instruction}\u201d", 10.5, ha="left", fontweight="bold")
    sheet.arrow((0.82, 4.47), (0.82, 4.26))
    _signed(sheet.picture(0.2, 4.06, wide, 0.18), _strip(one.embedding))
    sheet.words(0.2, 3.9, f"embedding $l$: {len(one.embedding)}", ha="left")
    sheet.words(0.2, 3.73, f"({policy.text_encoder})", ha="left")
    sheet.arrow((1.48, 4.15), (2.54, 4.15))
    sheet.arrow((2.01, 4.15), (2.01, 2.26))
    sheet.box(2.58, 3.9, wide, 0.5, "generator of $\\kappa$", "#FBE9D0")
    sheet.arrow((3.86, 4.15), (4.16, 4.15))
    _kernel(sheet, one, channels, 4.2, 3.52)

    # where they meet, and what comes of it
    middle = lows[0] + (lows[-1] + high - lows[0]) / 2
    sheet.arrow((3.86, middle), (4.14, middle))
    sheet.words(4.27, middle, "$\\star$", 20)
    sheet.arrow((4.27, 3.5), (4.27, middle + 0.15))
    sheet.arrow((4.4, middle), (4.6, middle))
    for low, (name, values) in zip(reversed(lows), _frequencies(one.field), strict=True):
        axes = sheet.picture(4.64, low, wide, high)
        if name == "m = 0":
            _signed(axes, values, asked.TABLE)
        else:
            axes.imshow(values, cmap="cividis", extent=asked.TABLE)
        _cut(axes, window)
        _corner(axes, name)
    sheet.words(4.64 + wide / 2, 0.2, f"even irreps of $\\theta$\n{_shape(one.field)}")

    sheet.arrow((5.92, middle), (6.5, middle))
    sheet.words(6.2, middle + 0.3, "inverse\nFourier")
    bins = one.log_probabilities - one.log_probabilities.max()
    for low, index in zip(reversed(lows), _angles(one.best[0]), strict=True):
        axes = sheet.picture(6.54, low, wide, high)
        image = axes.imshow(bins[index], cmap="viridis", vmin=-RANGE, vmax=0, extent=asked.TABLE)
        _cut(axes, window)
        _corner(axes, f"{5 * index}°")
    sheet.words(6.54 + wide / 2, 0.2, f"$\\log\\,p$ of 36 angles\n{_shape(bins)}")

    sheet.arrow((7.82, middle), (8.34, middle))
    sheet.words(8.07, middle + 0.14, "argmax")
    _grasp(sheet, one, 8.38, middle - 0.66)
    cax = sheet.picture(8.45, 0.75, 1.18, 0.08)
    bar = sheet.figure.colorbar(image, cax=cax, orientation="horizontal", ticks=(-20, -10, 0))
    bar.ax.tick_params(labelsize=8, pad=1)
    sheet.words(9.04, 0.36, "nats below the best")
    sheet.words(9.7, 4.74, words.replace(", ", "\n"), 8, ha="right", va="top")
    return sheet.figure


def _observation(sheet: Sheet, one: Asked, window: Window, left: float, bottom: float, wide: float) -> None:
    color = sheet.picture(left, bottom + wide / 2 + 0.08, wide, wide / 2)
    color.imshow(one.observation.color, extent=asked.TABLE)
    _cut(color, window)
    sheet.arrow((left + wide / 2, bottom + wide + 0.18), (left + wide, bottom + wide + 0.18))
    sheet.arrow((left + wide / 2, bottom + wide + 0.18), (left, bottom + wide + 0.18))
    sheet.words(left + wide / 2, bottom + wide + 0.3, f"{window[1] - window[0]:.0f} cm")
    height = sheet.picture(left, bottom, wide, wide / 2)
    image = height.imshow(100 * one.observation.height, cmap="cividis", vmin=0, vmax=6, extent=asked.TABLE)
    _cut(height, window)
    bar = sheet.figure.colorbar(
        image, cax=sheet.picture(left, bottom - 0.16, wide, 0.07), orientation="horizontal", ticks=(0, 2, 4, 6)
    )
    bar.ax.tick_params(labelsize=8, pad=1)
    sheet.words(left + wide / 2, bottom - 0.46, "height (cm)")
    channels, rows, columns = 4, *one.observation.shape
    sheet.words(left + wide / 2, 0.2, f"observation $o$\n{channels}×{rows}×{columns}")


def _kernel(sheet: Sheet, one: Asked, channels: Sequence[int], left: float, bottom: float) -> None:
    """kappa(l): a column for each channel, a row for each of three of its irreps."""
    side, gap = 0.4, 0.05
    rows = [(0, "$m=0$"), (1, "$m=2$"), (3, "$m=4$")]
    largest = float(np.abs(one.kernel[:, channels]).max())
    for row, (index, name) in enumerate(rows):
        low = bottom + (2 - row) * (side + gap)
        for place, channel in enumerate(channels):
            axes = sheet.picture(left + 0.48 + place * (side + gap), low, side, side)
            axes.imshow(one.kernel[index, channel], cmap="PuOr", vmin=-largest, vmax=largest)
        sheet.words(left + 0.44, low + side / 2, name, 8.5, ha="right")
    wide = 0.48 + SHOWN * (side + gap)
    text = f"steerable kernel $\\kappa(l)$\n{_shape(one.kernel)}\nchannels across,\nirreps down"
    sheet.words(left + wide + 0.1, bottom + 1.5 * side + gap, text, ha="left")


def _grasp(sheet: Sheet, one: Asked, left: float, bottom: float) -> None:
    """The grasp on the table, to scale, with a window of 24 cm about it."""
    side, half = 1.32, 12.0
    axes = sheet.picture(left, bottom, side, side)
    axes.imshow(one.photograph, extent=asked.TABLE)
    asked.hand(axes, one.grasp, style.YELLOW)
    x, y = 100 * WORKSPACE.to_world([one.grasp.u, one.grasp.v])
    axes.set_xlim(x - half, x + half)
    axes.set_ylim(y - half, y + half)
    axes.plot([x - half + 1.5, x - half + 6.5], [y - half + 1.5] * 2, color="white", lw=2)
    axes.text(x - half + 4, y - half + 2.2, "5 cm", color="white", fontsize=8, ha="center")
    sheet.words(
        left + side / 2,
        bottom + side + 0.2,
        f"grasp: $\\theta$ {math.degrees(one.grasp.theta):.0f}°,\nx {x:.1f}, y {y:.1f} cm".replace("-", "\u2212"),
    )


def _window(one: Asked) -> Window:
    """Left, right, bottom and top of a part of the table about the target, centimetres."""
    sides: list[float] = []
    for middle, half, (low, high) in zip(one.target, (WIDE / 2, WIDE / 4), WORKSPACE.bounds, strict=True):
        # shifted to lie on the table
        start = min(max(100 * middle - half, 100 * low), 100 * high - 2 * half)
        sides += [start, start + 2 * half]
    left, right, bottom, top = sides
    return left, right, bottom, top


def _cut(axes: Axes, window: Window) -> None:
    axes.set_xlim(*window[:2])
    axes.set_ylim(*window[2:])


def _signed(axes: Axes, values: NDArray[np.float32], extent: Window | None = None) -> None:
    """Values of both signs, zero white; the largest 5 in 1000 are cut off, or one corner would take all the colour."""
    largest = float(np.quantile(np.abs(values), 0.995))
    axes.imshow(values, cmap="PuOr", vmin=-largest, vmax=largest, aspect="auto", extent=extent)


def _corner(axes: Axes, name: str) -> None:
    axes.text(0.02, 0.94, name, fontsize=8, va="top", transform=axes.transAxes, color="white", bbox=BOX)


BOX = {"boxstyle": "square,pad=0.15", "fc": "black", "ec": "none", "alpha": 0.55}


def _strip(embedding: NDArray[np.float32], rows: int = 4) -> NDArray[np.float32]:
    """The embedding as a picture of a few rows."""
    return embedding[: len(embedding) // rows * rows].reshape(rows, -1)


def _shape(tensor: NDArray[np.float32]) -> str:
    return "×".join(map(str, tensor.shape))


def _largest(sizes: NDArray[np.float32], count: int) -> list[int]:
    """Indices of the largest, in their order."""
    return sorted(int(each) for each in np.argsort(sizes)[-count:])


def _frequencies(field: NDArray[np.float32]) -> list[tuple[str, NDArray[np.float32]]]:
    """The part that does not turn, and the sizes of the next frequencies: what a turn of the angle leaves alone."""
    found = [("m = 0", field[0])]
    for index in range(1, SHOWN):
        found.append((f"|m = {2 * index}|", np.hypot(field[2 * index - 1], field[2 * index])))
    return found


def _angles(best: int) -> list[int]:
    """The best bin, and three others evenly between."""
    return [(best + 9 * each) % WORKSPACE.bins for each in range(SHOWN)]


@exits()
def main(chosen: Sequence[str] | None = None) -> None:
    """Ask once and draw what was computed."""
    parser = asked.arguments("Figure 2: the architecture, with the real tensors of one grasp.", seed=3, goal=12)
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that the figure is written to")
    options = parser.parse_args(chosen)
    check_folder(options.out, "--out")
    policy, env, words = asked.load(options.run)
    try:
        env.reset(seed=options.seed, options={"goal": options.goal})
        one = asked.ask(policy, env)
    finally:
        env.close()
    print(*style.save(draw(policy, one, words), "figure-2", options.out), sep="\n")


if __name__ == "__main__":
    main()
