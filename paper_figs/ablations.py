"""Ablations of leg-unet: what the kernel's language, its steerability and phi's language each bring.

    uv run equigrasp study --table 4 --recombination 0 0.7
    uv run python paper_figs/ablations.py --results studies/table-4/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/ablations.{png,pdf}`, and
`ablations.md` with the same numbers: single shots with 95% Wilson intervals on the task that was trained on, a row for
each row of Table 4 under its training task, hollow without recombination and filled with it; a panel for each number of
demonstrations. Of several numbers of steps it is the one that most of the rows share, of such the greatest.
"""

from __future__ import annotations

from collections.abc import Sequence

import by_task
import recorded
import style
from by_task import WITH, WITHOUT, Place, Rates
from cells import Cell
from grid import Grid, Row, Value
from matplotlib.figure import Figure
from style import FILLED, HOLLOW

from equigrasp.study.tables import TABLES

COMMAND = "equigrasp study --table 4 --recombination 0 0.7"
FULL, *LESS = TABLES[4].models
ROWS = (FULL, *LESS)
APART = 0.15
"""Of a row, by how much its two points are off its middle."""


def chosen(cells: Sequence[Cell]) -> dict[tuple[str, int], tuple[Place, Rates]]:
    """(training task, demonstrations) -> where, and the rates of Table 4's rows on that task; where one is ablated."""
    found: dict[tuple[str, int], tuple[Place, Rates]] = {}
    for place, row in by_task.rates(cells).items():
        kept = {key: rate for key, rate in row.items() if key[0] in ROWS and key[1] in (WITHOUT, WITH)}
        if place.tested_on != place.trained_on or not {model for model, _ in kept}.intersection(LESS):
            continue
        other = found.get((place.trained_on, place.demos))
        if other is None or (len(kept), place.steps) > (len(other[1]), other[0].steps):
            found[place.trained_on, place.demos] = place, kept
    return found


def panels(cells: Sequence[Cell]) -> Figure | None:
    """The figure; None where nothing was ablated."""
    found = chosen(cells)
    if not found:
        return None
    tasks, numbers = list(dict.fromkeys(task for task, _ in found)), sorted({demos for _, demos in found})
    dress = recorded.series(ROWS)
    pitch = len(ROWS) + 1
    figure = Figure(figsize=(9.0, 1.3 + 0.23 * pitch * len(tasks)), layout="constrained")
    sides = figure.subplots(1, len(numbers), sharey=True, squeeze=False)[0]
    for demos, axes in zip(numbers, sides, strict=True):
        axes.set_title(f"from {recorded.demonstrations(demos)}", loc="left", fontsize=10)
        style.columns(axes, -0.9, (HOLLOW, FILLED))
        for index, task in enumerate(tasks):
            place, rates = found.get((task, demos), (None, {}))
            if place is not None:
                said = f" {task}, {place.length}"
                axes.text(-3, pitch * index, said, fontsize=8.5, weight="bold", va="center")
            for row, model in enumerate(ROWS, 1):
                height = pitch * index + row
                axes.axhspan(height - 0.42, height + 0.42, color="0.95", lw=0, zorder=0)
                color, _, marker = dress[model]
                texts = []
                for kind, off, filling in ((WITHOUT, APART, "white"), (WITH, -APART, color)):
                    rate = rates.get((model, kind))
                    texts.append("" if rate is None else f"{100 * rate.value:.1f}")
                    if rate is not None:
                        look = {"color": color, "marker": marker, "mfc": filling, "ms": 5.5, "lw": 1, "ls": ""}
                        axes.errorbar(100 * rate.value, height + off, xerr=recorded.bars([rate]), capsize=2, **look)
                style.columns(axes, height, texts)
        axes.set_xlim(-3, 103)
        axes.set_xlabel("goal reached (%)\none grasp, no retries")
        axes.grid(alpha=0.25, axis="x")
    ticks = [pitch * index + row for index in range(len(tasks)) for row in range(1, pitch)]
    sides[0].set_yticks(ticks, labels=[*ROWS] * len(tasks), fontsize=9)
    sides[0].set_ylim(pitch * len(tasks) - 0.4, -0.7)
    said = f"{FULL} and what is left without a part of it: on the task trained on, unseen scenes, 95% Wilson intervals"
    figure.suptitle(f"{said}\n{HOLLOW} without recombination, {FILLED} with it", fontsize=10)
    return figure


def table(cells: Sequence[Cell]) -> Grid:
    """The figure's numbers, percent."""
    body = []
    for place, rates in chosen(cells).values():
        for model in ROWS:
            values = [rates.get((model, kind)) for kind in (WITHOUT, WITH)]
            if any(values):
                numbers = tuple(None if each is None else Value.of(each) for each in values)
                body.append(Row((place.training, model), numbers))
    return Grid("ablations, single shots, %", ("trained on", "model"), (WITHOUT, WITH), tuple(body))


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it from files of results; where none backs it, say what makes one, and draw nothing."""
    recorded.every_task("ablations", panels, COMMAND, (table,), arguments)


if __name__ == "__main__":
    main()
