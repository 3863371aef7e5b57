"""The report as one picture: error against angle, how far the best grasp lands, every law against its tolerance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from equigrasp.artefacts import write_figure
from equivariance_tests.check import Report
from equivariance_tests.comparison import ANGLES
from equivariance_tests.laws import LAWS

# Okabe and Ito's colours, told apart by colour-blind readers; line styles and markers say the same once more
STYLES = (("#009E73", "-", "o"), ("#0072B2", "--", "s"), ("#CC79A7", "-.", "D"), ("#56B4E9", ":", "^"))
YOURS = ("#D55E00", "-", "*")
HOLDS, FAILS, EXPECTED = "#0072B2", "#D55E00", "0.45"
TURNED, LANDED = (LAWS[name].tolerance[torch.float32] for name in ("steerability", "eq. 2, any turn"))
"""What the two figures on the left allow."""
FLOOR = 1e-8
"""Errors below this are drawn at it: float32 rounds at 1e-7."""
NEAREST = 1e-7
"""Cells or bins: so near is drawn what is nearer, and there is room for names beside the curves."""


def draw(
    report: Report,
    curves: Mapping[str, Sequence[float]],
    landings: Mapping[str, Sequence[float]],
    path: Path,
) -> None:
    """Draw the report to a PNG (or a PDF, by the path's ending).

    Args:
        report: of the module looked at.
        curves: name -> error of Eq. 7 at each of ANGLES; the module's own by its name.
        landings: name -> errors of Eq. 2 at any turn, cells or bins.
        path: where.
    """
    rows = [finding for finding in report.findings if finding.verdict is not None]
    figure = Figure(figsize=(11, max(6.5, 0.34 * len(rows) + 1.8)), layout="constrained")
    good = sum(finding.sound for finding in rows)
    figure.suptitle(f"{report.name}: {good} of {len(rows)} laws as they should be", fontsize=13)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.0, 1.15))
    _angles(figure.add_subplot(grid[0, 0]), curves, report.name)
    _landings(figure.add_subplot(grid[1, 0]), landings, report.name)
    _laws(figure.add_subplot(grid[:, 1]), report)
    write_figure(path, figure, dpi=140)


def _styles(names: Sequence[str], mine: str) -> dict[str, tuple[str, str, str]]:
    others = [name for name in names if name != mine]
    return dict(zip(others, STYLES, strict=False)) | {mine: YOURS}


def _angles(axes: Axes, curves: Mapping[str, Sequence[float]], mine: str) -> None:
    for name, (color, line, marker) in _styles(list(curves), mine).items():
        # its group may have none of these turns
        if name not in curves or not np.isfinite(curves[name]).any():
            continue
        values = np.maximum(np.array(curves[name], dtype=float), FLOOR)
        width = 2.2 if name == mine else 1.4
        axes.semilogy(ANGLES, values, line, color=color, marker=marker, ms=4, lw=width, label=name)
    axes.axhline(TURNED, color="0.35", lw=1, ls=(0, (1, 1)))
    axes.annotate("allowed", (1.01, TURNED), xycoords=("axes fraction", "data"), fontsize=8, color="0.3", va="center")
    axes.set_xticks(range(0, 181, 45))
    axes.set_xlabel("turn of the scene (degrees)", fontsize=9)
    axes.set_ylabel("largest relative error of Eq. 7", fontsize=9)
    axes.set_ylim(FLOOR / 2, 10)
    axes.set_title("the kernel: K(g x) = \u03c1(g) K(x) (colours as below)", fontsize=10)
    axes.grid(alpha=0.25)


def _landings(axes: Axes, landings: Mapping[str, Sequence[float]], mine: str) -> None:
    for name, (color, line, _) in _styles(list(landings), mine).items():
        if not landings.get(name):
            continue
        errors = np.sort(np.maximum(np.array(landings[name]), NEAREST))
        share = 100 * np.arange(1, len(errors) + 1) / len(errors)
        width = 2.2 if name == mine else 1.4
        axes.step([NEAREST, *errors, 50], [0, *share, 100], line, where="post", color=color, lw=width, label=name)
    axes.axvline(LANDED, color="0.35", lw=1, ls=(0, (1, 1)))
    axes.annotate("allowed", (1.1 * LANDED, 4), fontsize=8, color="0.3")
    axes.set_xscale("log")
    axes.set_xlim(NEAREST, 50)
    axes.set_ylim(0, 103)
    count = max((len(each) for each in landings.values()), default=0)
    axes.set_xlabel("distance of the best grasp from where g takes it\n(cells, or bins of 5\u00b0)", fontsize=9)
    axes.set_ylabel(f"share of {count} scenes (%)", fontsize=9)
    axes.set_title("Eq. 2: the target alone turns, by any angle", fontsize=10)
    axes.grid(alpha=0.25)
    axes.legend(fontsize=8, loc="upper left")


def _laws(axes: Axes, report: Report) -> None:
    rows = [(finding, finding.verdict) for finding in report.findings if finding.verdict is not None]
    for index, (finding, verdict) in enumerate(rows):
        measured = verdict.value if math.isfinite(verdict.value) else 1e6 * verdict.tolerance
        ratio = min(max(measured / verdict.tolerance, 1e-6), 1e6)
        color = FAILS if not finding.sound else EXPECTED if finding.reason else HOLDS
        marker = "o" if verdict.passed else "X"
        axes.plot([1e-6, ratio], [index, index], color=color, lw=1, alpha=0.5)
        axes.plot([ratio], [index], marker, color=color, ms=7)
        word = {"fails as expected": " (expected)", "holds unexpectedly": " (unexpectedly)"}.get(finding.status, "")
        few = "" if verdict.silent is None else f", {verdict.cases} of {verdict.drawn} cases"
        text = f"{verdict.value:.2g} of {verdict.tolerance:.2g}{word}{few}"
        axes.annotate(text, (1.02, index), xycoords=("axes fraction", "data"), fontsize=8, va="center", color=color)
    axes.axvline(1, color="0.35", lw=1, ls=(0, (1, 1)))
    axes.set_yticks(range(len(rows)), [finding.law.name for finding, _ in rows], fontsize=9)
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.set_xscale("log")
    axes.set_xlim(7e-7, 2e6)
    axes.set_xlabel("measured error / tolerance (a cross is a broken law)", fontsize=9)
    axes.set_title("every law against its tolerance", fontsize=10)
    axes.grid(alpha=0.25, axis="x")
