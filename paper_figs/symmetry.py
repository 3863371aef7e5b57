"""Equivariance error against success: whether a policy that turns with the scene grasps better.

    uv run equigrasp study --table 6
    uv run python paper_figs/symmetry.py --results studies/table-6/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/symmetry.{png,pdf}`: three
errors from left to right, of the kernel alone, of the whole policy, and of its best grasp in the simulator; a point
for each way of making a policy that was trained on the task (over its seeds). What each error is stands in
`equivariance_tests/record.py`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

import recorded
from cells import Cell, Way, pooled
from matplotlib.figure import Figure

from equigrasp.success import Rate

COMMAND = "equigrasp study --table 6"
RANGES = {"kernel": (1e-7, 3.0), "scores": (1e-7, 3.0), "degrees": (0.1, 90.0)}
"""Of the axes; an error below is drawn at the edge, as a logarithm has no zero."""
ERRORS: dict[str, tuple[str, Callable[[Mapping[str, Any]], float | None]]] = {
    "kernel": ("kernel alone, any angle\nrelative error of Eq. 7", lambda found: found["kernel"]),
    "scores": ("whole scene, quarter turns\nrelative error of any score", lambda found: found["scores"]),
    "degrees": ("target alone, in the simulator\nmedian angle off (degrees)", lambda found: found["turned"]["degrees"]),
}
"""Name -> what is measured, and how to read it from a record."""


def points(cells: Sequence[Cell], task: str) -> dict[Way, tuple[dict[str, float | None], Rate]]:
    """Way -> its errors, the median over its seeds (None where it has none), and its single shots on the task.

    The errors are measured on the task that was trained on, so that what was trained on another is left out.
    """
    groups: dict[Way, list[Cell]] = defaultdict(list)
    for cell in cells:
        own = cell.way.trained_on == cell.task == task and cell.way.phrasings == "seen"
        if own and cell.shots and cell.symmetry is not None:
            groups[cell.way].append(cell)
    found = {}
    for way in recorded.in_order(groups):
        several = groups[way]
        errors = {}
        for name, (_, read) in ERRORS.items():
            values = [
                value for cell in several if cell.symmetry is not None and (value := read(cell.symmetry)) is not None
            ]
            errors[name] = median(values) if values else None
        rate = pooled(several)
        assert rate is not None
        found[way] = errors, rate
    return found


def panels(cells: Sequence[Cell], task: str = "pick-by-part") -> Figure | None:
    """The figure; None where no cell has figures of symmetry."""
    drawn = points(cells, task)
    if not drawn:
        return None
    figure = Figure(figsize=(9.0, 4.3), layout="constrained")
    several = figure.subplots(1, len(ERRORS), sharey=True)
    looks = recorded.looks(drawn)
    for axes, (name, (label, _)) in zip(several, ERRORS.items(), strict=True):
        axes.grid(alpha=0.25)
        axes.set_xscale("log")
        axes.set_xlim(RANGES[name][0] / 1.3, RANGES[name][1])
        axes.set_xlabel(label, fontsize=9)
        for way, (errors, rate) in drawn.items():
            error = errors[name]
            if error is None:
                continue
            look = looks[way]
            axes.errorbar(
                max(error, RANGES[name][0]),
                100 * rate.value,
                yerr=recorded.bars([rate]),
                color=look.color,
                marker=look.marker,
                mfc=look.filling,
                capsize=3,
                ls="",
            )
    several[2].set_xticks([0.1, 1, 10, 90], labels=["0.1", "1", "10", "90"])
    several[0].set_ylim(-3, 103)
    several[0].set_ylabel("goal reached (%)\none grasp, no retries")
    shown = {way.model: look for way, look in looks.items()}
    for model, look in shown.items():
        several[0].plot([], [], ls="", color=look.color, marker=look.marker, label=model)
    without = [model for model in shown if all(drawn[way][0]["kernel"] is None for way in drawn if way.model == model)]
    if without:
        said = f"without a kernel, so\nthat no point is here:\n{', '.join(without)}"
        several[0].text(0.03, 0.03, said, transform=several[0].transAxes, fontsize=8, va="bottom")
    each = "one point per training run, its seeds pooled"
    figure.suptitle(f"{task}: {each}; {recorded.RECOMBINATION}; 95% Wilson intervals", fontsize=9.5)
    figure.legend(loc="outside lower center", ncols=min(len(shown), 4), fontsize=9, frameon=False)
    return figure


if __name__ == "__main__":
    recorded.main("symmetry", panels, COMMAND)
