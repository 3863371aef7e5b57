"""How a training step's time and memory grow, with the fitted power laws, from recorded figures.

    uv run equigrasp bench --only growth --models leg-unet leg-steerable --out paper_figs/results/growth.json
    uv run python paper_figs/growth.py

reads `results/growth.json`, or another by `--results`, and draws `figures/growth.{png,pdf}` and `figures/growth.md`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import recorded
import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, FuncFormatter, LogLocator, NullLocator

from equigrasp.artefacts import check_folder, read_json
from equigrasp.bench.growth import lines
from equigrasp.errors import InputError
from equigrasp.exits import exits

RESULTS = style.RESULTS / "growth.json"
LABELS = {
    "pixels": "pixels of the heightmap",
    "batch": "examples a step",
    "kernel size": "side of the kernel, cells",
    "coefficients": "coefficients over angles",
    "bins": "angles read out",
    "group order": "n, turns of the lift",
}
UNITS = {"ms": "time (ms)", "MiB": "memory of the step (MiB)"}
ACROSS = 3
"""Axes side by side."""
NARROWEST = 6.0
"""Of a panel, its highest over its lowest value: what hardly grows is to look flat."""


def draw(fits: list[dict[str, Any]]) -> Figure:
    """For each axis times above and memory below; measured points, and the power law through them."""
    # the environment's axes are in the table alone
    fits = [fit for fit in fits if fit["axis"] in LABELS]
    axes = list(dict.fromkeys(fit["axis"] for fit in fits))
    dress = recorded.series(dict.fromkeys(_subject(fit) for fit in fits))
    across = min(ACROSS, len(axes))
    blocks = -(-len(axes) // across)
    figure = Figure(figsize=(3 * across, 4.6 * blocks + 0.4), layout="constrained")
    grid = figure.subplots(2 * blocks, across, squeeze=False)
    for panel in grid.ravel():
        panel.set_axis_off()
    named: dict[str, Line2D] = {}
    for place, axis in enumerate(axes):
        block, column = divmod(place, across)
        for row, unit in enumerate(UNITS, 2 * block):
            chosen = [fit for fit in fits if fit["axis"] == axis and fit["unit"] == unit]
            panel = grid[row, column]
            if not chosen:
                continue
            panel.set_axis_on()
            panel.set(xscale="log", yscale="log", xlabel=LABELS[axis])
            for line, fit in enumerate(chosen):
                x, y = np.array(fit["points"]).T
                color, _, marker = dress[_subject(fit)]
                if (law := fit["law"]) is not None:
                    panel.plot(x, law["coefficient"] * x ** law["exponent"], color=color, lw=1)
                    written = f"power {law['exponent']:.2f}"
                    panel.text(
                        0.04, 0.95 - 0.1 * line, written, fontsize=8, color=color, va="top", transform=panel.transAxes
                    )
                (points,) = panel.plot(x, y, ls="", marker=marker, color=color)
                named.setdefault(_subject(fit), points)
            _readable(panel, sorted({x for fit in chosen for x, _ in fit["points"]}))
    for row, label in enumerate([*UNITS.values()] * blocks):
        grid[row, 0].set_ylabel(label)
    figure.legend(named.values(), named, loc="outside lower center", ncols=len(named), fontsize=9, frameon=False)
    return figure


def _subject(fit: dict[str, Any]) -> str:
    """Whose points these are: a model, or a model's head."""
    return f"{fit['what']} ({fit['subject']})" if fit["what"].startswith("head") else fit["subject"]


def _readable(panel: Axes, measured: list[float]) -> None:
    """Plain numbers: along x what was measured, along y ones, twos and fives."""
    panel.xaxis.set_major_locator(FixedLocator(measured))
    panel.xaxis.set_major_formatter(
        FuncFormatter(lambda value, _: f"{value / 1000:.0f}k" if value >= 1e4 else f"{value:g}")
    )
    panel.xaxis.set_minor_locator(NullLocator())
    low, high = (float(np.prod(each)) for each in zip(panel.get_ylim(), (0.9, 1.6), strict=True))
    spread = max(1.0, (NARROWEST * low / high) ** 0.5)
    panel.set_ylim(low / spread, high * spread)
    panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    panel.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    panel.yaxis.set_minor_locator(NullLocator())
    panel.tick_params(labelsize=8)
    panel.grid(alpha=0.25)


@exits()
def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the figure and write the table."""
    parser = argparse.ArgumentParser(description="How a training step grows: figure and table.")
    parser.add_argument("--results", type=Path, default=RESULTS, help="what `equigrasp bench --only growth` wrote")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that they are written to")
    options = parser.parse_args(arguments)
    check_folder(options.out, "--out")
    report = read_json(options.results, "figures of `equigrasp bench --only growth`")
    if not report.get("fits"):
        raise InputError(f"{options.results} holds no growth; `equigrasp bench --only growth --out FILE` writes some")
    machine = report["machine"]
    figure = draw(report["fits"])
    figure.suptitle(f"{machine['processor']}, {machine['threads']} threads, load {machine['load']:.1f}", fontsize=9)
    style.save(figure, "growth", options.out)
    style.save_text("\n".join(lines(report["fits"])) + "\n", options.out / "growth.md")
    print(*lines(report["fits"]), sep="\n")


if __name__ == "__main__":
    main()
