"""Figure 1, the symmetry: the target turns, and the best grasp turns with it (LEG, Eq. 2).

    uv run equigrasp quickstart --steps 2000
    uv run python paper_figs/figure1.py --run quickstart/run

asks a trained policy for a grasp in a scene of the simulator, turns the target alone by g, asks again, and draws
`figures/figure-1.{png,pdf}`. Nothing is told to the policy of g; the dashed hand is g times the first grasp.
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
from matplotlib.image import AxesImage
from matplotlib.patches import FancyArrowPatch
from matplotlib.projections.polar import PolarAxes
from matplotlib.ticker import MultipleLocator

from equigrasp.artefacts import check_folder
from equigrasp.errors import InputError
from equigrasp.exits import exits
from equigrasp.policy import LegPolicy
from equigrasp.workspace import WORKSPACE, Motion

AROUND = 11.0
"""Of the target: half of the score map's side, centimetres."""
WIDE = 50.0
"""The window on the table, centimetres; 1.6 times as wide as high."""
ARC = 12.0
"""Radius of the arrow that shows g, centimetres."""
LOW = 0.004
"""Metres: what is higher stands on the table."""
LIFTED = {
    (True, True): "both lift the object as asked",
    (True, False): "the first lifts as asked, the second does not",
    (False, True): "the second lifts as asked, the first does not",
    (False, False): "neither lifts as asked",
}
RANGE = 20.0
"""The score map goes from the best down to this much less, nats."""


def pair(policy: LegPolicy, env: asked.GraspEnv, seed: int, goal: int | None, degrees: float) -> tuple:
    """The scene as it is and with its target turned by `degrees`: two `Asked`, and the motion.

    Raises:
        InputError: if there is no room to turn it.
    """
    options = None if goal is None else {"goal": goal}
    env.reset(seed=seed, options=options)
    before = asked.ask(policy, env)
    # the same seed lays out the same scene, to the bit
    env.reset(seed=seed, options=options)
    try:
        motion = env.turn_target(math.radians(degrees))
    except ValueError as error:
        raise InputError(f"scene {seed}: {error}; choose another --seed or --degrees") from None
    return before, asked.ask(policy, env), motion


def draw(policy: LegPolicy, before: Asked, after: Asked, motion: Motion, words: str) -> Figure:
    """A row for each of the scenes: the table, the kernel at the best angle, scores, angles."""
    width, height, side = 9.0, 5.2, 1.68
    figure = Figure(figsize=(width, height))

    def place(left: float, bottom: float, wide: float, high: float, projection: str = "rectilinear") -> Axes:
        """Axes at a place in inches."""
        rectangle = (left / width, bottom / height, wide / width, high / height)
        return figure.add_axes(rectangle, projection=projection)

    figure.text(
        0.5, 0.965, f"\u201c{before.instruction}\u201d", fontsize=12, fontweight="bold", ha="center", va="center"
    )
    expected = WORKSPACE.move_grasp(motion, before.grasp)
    channel, degrees = strongest(policy, before), math.degrees(motion.angle)
    window = _window(before)
    for row, each in enumerate((before, after)):
        bottom = (3.02, 0.87)[row]
        there = expected if row else None
        scene = place(0.52, bottom, 1.6 * side, side)
        _scene(scene, each, window)
        if row:
            asked.ghost(scene, before.grasp, "0.75", ":")
            asked.ghost(scene, expected, "white", "--")
            _turn(scene, after, degrees)
        asked.hand(scene, each.grasp, style.YELLOW)
        scene.set_title(f"$g·o$: the target alone turned, {degrees:.0f}°" if row else "scene $o$", fontsize=9.5)
        _kernel(place(3.66, bottom, side, side), policy, each, channel)
        image = _scores(place(5.83, bottom, side, side), each, "g·o" if row else "o", there)
        polar = place(7.83, bottom + 0.22, 0.95, 0.95, projection="polar")
        assert isinstance(polar, PolarAxes)
        turned = np.roll(_profile(before), round(degrees / 5)) if row else None
        _angles(polar, _profile(each), turned)
        polar.set_title(
            "$p(\\theta)$; dashed:\nabove, turned" if row else "$p(\\theta)$ of the\nclosing axis", fontsize=9
        )
        for axes in figure.axes if row == 0 else ():
            axes.set_xlabel("")  # the row below says it
    bar = figure.colorbar(image, cax=place(5.83, 0.27, side, 0.09), orientation="horizontal", ticks=(-20, -10, 0))
    bar.ax.tick_params(labelsize=8, pad=1)
    figure.text(7.6 / width, 0.315 / height, "nats below the best", fontsize=8, va="center")
    off = abs((after.grasp.theta - expected.theta + math.pi / 2) % math.pi - math.pi / 2)
    miss = 1000 * WORKSPACE.pixel * math.hypot(after.grasp.u - expected.u, after.grasp.v - expected.v)
    lifted = LIFTED[before.success, after.success]
    figure.text(
        0.52 / width,
        0.27 / height,
        f"The best grasp moved to {miss:.1f} mm and {math.degrees(off):.1f}° from $g$ times the first (dashed);\n"
        f"{lifted}. {words}.",
        fontsize=8.5,
        va="center",
        linespacing=1.3,
    )
    return figure


def strongest(policy: LegPolicy, one: Asked) -> int:
    """The channel with the most to say at the best grasp: kernel times features there."""
    bin_, row, column = one.best
    kernel = asked.kernel_at(policy, one.kernel, bin_)
    reach = kernel.shape[-1] // 2
    padded = np.pad(one.features, ((0, 0), (reach, reach), (reach, reach)))
    seen = padded[:, row : row + 2 * reach + 1, column : column + 2 * reach + 1]
    return int((kernel * seen).sum(axis=(1, 2)).argmax())


def _scene(axes: Axes, one: Asked, window: tuple[float, float, float, float]) -> None:
    axes.imshow(one.photograph, extent=asked.TABLE)
    axes.set_xlim(*window[:2])
    axes.set_ylim(*window[2:])
    axes.set_xlabel("x (cm)", fontsize=8, labelpad=1)
    axes.set_ylabel("y (cm)", fontsize=8, labelpad=0)
    axes.xaxis.set_major_locator(MultipleLocator(10))
    axes.yaxis.set_major_locator(MultipleLocator(10))
    axes.tick_params(labelsize=8)


def _window(one: Asked) -> tuple[float, float, float, float]:
    """Left, right, bottom and top of a window about the target, shifted to lie on the table, centimetres."""
    sides = []
    for middle, half, (low, high) in zip(one.target, (WIDE / 2, WIDE / 3.2), WORKSPACE.bounds, strict=True):
        start = min(max(100 * middle - half, 100 * low), 100 * high - 2 * half)
        sides += [start, start + 2 * half]
    left, right, bottom, top = sides
    return left, right, bottom, top


def _turn(axes: Axes, after: Asked, degrees: float) -> None:
    """An arrow by g about the target's centre, where least stands in its way."""
    x, y = (100 * each for each in after.target)
    sweep = np.radians(np.linspace(0, degrees, 25))

    def in_the_way(start: float) -> float:
        around = np.add.outer([ARC - 1, ARC, ARC + 2.5], 0 * sweep)
        points = np.stack([x + around * np.cos(start + sweep), y + around * np.sin(start + sweep)], axis=-1)
        u, v = np.rint(WORKSPACE.to_pixel(points / 100)).astype(int).reshape(-1, 2).T
        on_table = (u >= 0) & (v >= 0) & (u < WORKSPACE.columns) & (v < WORKSPACE.rows)
        low, high = axes.get_ylim()
        seen = on_table & (points[..., 1].ravel() > low + 1) & (points[..., 1].ravel() < high - 1)
        return float((~seen).sum() + (after.observation.height[v[seen], u[seen]] > LOW).sum())

    start = min(np.radians(np.arange(0, 360, 5)), key=in_the_way)
    arc = np.stack([x + ARC * np.cos(start + sweep), y + ARC * np.sin(start + sweep)])
    axes.plot(*arc[:, :-1], color="white", lw=1.4)
    arrow = FancyArrowPatch(arc[:, -3], arc[:, -1], arrowstyle="-|>", mutation_scale=11, color="white", lw=1.4)
    axes.add_patch(arrow)
    middle = start + math.radians(degrees) / 2
    at = (x + (ARC + 2) * math.cos(middle), y + (ARC + 2) * math.sin(middle))
    axes.text(*at, "$g$", color="white", fontsize=12, ha="center", va="center")


def _kernel(axes: Axes, policy: LegPolicy, one: Asked, channel: int) -> None:
    bin_ = one.best[0]
    taps = asked.kernel_at(policy, one.kernel, bin_)[channel]
    side = 100 * len(taps) * policy.stride * WORKSPACE.pixel / 2
    largest = float(np.abs(taps).max())
    axes.imshow(taps, cmap="PuOr", vmin=-largest, vmax=largest, extent=(-side, side, -side, side))
    theta = math.radians(5 * bin_)
    c, s = math.cos(theta), math.sin(theta)
    axes.plot([-side * c, side * c], [-side * s, side * s], color="black", lw=0.9, ls=":")
    axes.set_xlim(-side, side)
    axes.set_ylim(-side, side)
    axes.set_xticks([-5, 0, 5])
    axes.set_yticks([-5, 0, 5])
    axes.tick_params(labelsize=8)
    axes.set_xlabel("cm", fontsize=8, labelpad=1)
    axes.set_title(f"$\\kappa(l)$ at {5 * bin_}°", fontsize=9.5)


def _scores(axes: Axes, one: Asked, name: str, expected: asked.Grasp | None) -> AxesImage:
    scores = one.log_probabilities.max(axis=0)
    scores = scores - scores.max()
    x, y = (100 * each for each in one.target)
    image = axes.imshow(scores, cmap="viridis", vmin=-RANGE, vmax=0, extent=asked.TABLE, interpolation="nearest")
    asked.hand(axes, one.grasp, style.YELLOW)
    if expected is not None:
        asked.ghost(axes, expected, "white", "--")
    axes.set_xlim(x - AROUND, x + AROUND)
    axes.set_ylim(y - AROUND, y + AROUND)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("x (cm)", fontsize=8, labelpad=1)
    axes.xaxis.set_major_locator(MultipleLocator(10))
    axes.yaxis.set_major_locator(MultipleLocator(10))
    axes.set_title(f"$f({name}, l)$ at best $\\theta$", fontsize=9.5)
    return image


def _profile(one: Asked) -> np.ndarray:
    """Over the 36 angles at the best cell, relative to the best: `(36,)`."""
    _, row, column = one.best
    profile = one.log_probabilities[:, row, column]
    return np.exp(profile - profile.max())


def _angles(axes: PolarAxes, profile: np.ndarray, turned: np.ndarray | None) -> None:
    theta = np.arange(72) * math.pi / 36
    # the gripper is its own mirror, so the distribution is drawn at theta and at theta + pi
    axes.bar(theta, np.tile(profile, 2), width=math.pi / 36, color=style.YELLOW, edgecolor="none")
    if turned is not None:
        around = np.append(theta, 2 * math.pi)
        axes.plot(around, np.append(np.tile(turned, 2), turned[0]), color="black", lw=0.9, ls="--")
    axes.set_yticks([])
    axes.set_ylim(0, 1.05)
    axes.set_xticks(np.radians([0, 45, 90, 135]))
    axes.tick_params(labelsize=8, pad=-1)


@exits()
def main(chosen: Sequence[str] | None = None) -> None:
    """Ask, turn, ask again, draw."""
    parser = asked.arguments("Figure 1: the target turns, and the best grasp turns with it.", seed=3, goal=12)
    parser.add_argument("--degrees", type=float, default=60.0, help="by how much the target turns, a multiple of 5")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that the figure is written to")
    options = parser.parse_args(chosen)
    check_folder(options.out, "--out")
    policy, env, words = asked.load(options.run)
    try:
        before, after, motion = pair(policy, env, options.seed, options.goal, options.degrees)
    finally:
        env.close()
    print(*style.save(draw(policy, before, after, motion, words), "figure-1", options.out), sep="\n")


if __name__ == "__main__":
    main()
