"""How a training step's time and memory grow, with the fitted power laws, from recorded figures.

    uv run equigrasp bench --only growth --models leg-unet leg-steerable --out paper_figs/results/growth.json
    uv run python paper_figs/growth.py

reads `results/growth.json` and draws `figures/growth.{png,pdf}` and `figures/growth.md`.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import style
from matplotlib.figure import Figure

from equigrasp.artefacts import read_json
from equigrasp.bench.growth import lines
from equigrasp.errors import InputError

RESULTS = style.RESULTS / "growth.json"
LABELS = {
    "pixels": "pixels of the heightmap",
    "batch": "examples a step",
    "kernel size": "side of the kernel, cells",
    "coefficients": "coefficients over angles",
    "group order": "n, turns of the lift",
}


def draw(fits: list[dict[str, Any]]) -> Figure:
    """A column for each axis, times above and memory below; measured points, and the power law through them."""
    axes = list(dict.fromkeys(fit["axis"] for fit in fits))
    figure = Figure(figsize=(3.4 * len(axes), 6), layout="constrained")
    grid = figure.subplots(2, len(axes), squeeze=False)
    for column, axis in enumerate(axes):
        for row, unit in enumerate(("ms", "MiB")):
            chosen = [fit for fit in fits if fit["axis"] == axis and fit["unit"] == unit]
            panel = grid[row, column]
            if not chosen:
                panel.set_axis_off()
                continue
            for index, fit in enumerate(chosen):
                x, y = np.array(fit["points"]).T
                color, _, marker = style.SERIES[index % len(style.SERIES)]
                name = f"{fit['subject']}, {fit['what']}"
                if fit["law"] is not None:
                    law = fit["law"]
                    panel.plot(x, law["coefficient"] * x ** law["exponent"], color=color, lw=1)
                    name += f": power {law['exponent']:.2f}"
                panel.plot(x, y, marker, color=color, label=name)
            panel.set(xscale="log", yscale="log", xlabel=LABELS.get(axis, axis), ylabel=unit)
            panel.grid(alpha=0.25, which="both")
            panel.legend(fontsize=7)
    return figure


def main() -> None:
    """Draw the figure and write the table."""
    try:
        report = read_json(RESULTS, "figures of `equigrasp bench --only growth`")
    except InputError as error:
        sys.exit(f"{error}; see the first lines of this script")
    machine = report["machine"]
    figure = draw(report["fits"])
    figure.suptitle(f"{machine['processor']}, {machine['threads']} threads, load {machine['load']:.1f}", fontsize=9)
    style.save(figure, "growth")
    (style.FIGURES / "growth.md").write_text("\n".join(lines(report["fits"])) + "\n")
    print(*lines(report["fits"]), sep="\n")


if __name__ == "__main__":
    main()
