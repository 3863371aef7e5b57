"""How every figure looks, and how it is written: one place for colours, markers, sizes and files.

Colours are Okabe and Ito's, told apart by colour-blind readers; with each goes a marker and a dash of its own, so that
a figure says the same in grey.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from statistics import mean

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from equigrasp.artefacts import write_atomically
from equigrasp.fewer_colors import fewer_colors

HERE = Path(__file__).parent
FIGURES = HERE / "figures"
RESULTS = HERE / "results"

ORANGE, BLUE, GREEN, PINK = "#D55E00", "#0072B2", "#009E73", "#CC79A7"
YELLOW, SKY, BLACK, GREY = "#E69F00", "#56B4E9", "#000000", "#7F7F7F"
SERIES = (
    (ORANGE, "-", "o"),
    (BLUE, "--", "s"),
    (GREEN, "-", "^"),
    (PINK, "-.", "D"),
    (YELLOW, ":", "v"),
    (SKY, "--", "P"),
    (BLACK, "-", "X"),
    (GREY, "-.", "p"),
)
"""Colour, dash and marker of the first, second, ... line of a figure."""
HOLLOW, FILLED = "\N{WHITE CIRCLE}", "\N{BLACK CIRCLE}"
"""Points without recombination and with it, in writing."""


def figure(width: float = 7.0, height: float = 4.2) -> tuple[Figure, Axes]:
    """An empty figure of that size in inches, and its axes."""
    made = Figure(figsize=(width, height), layout="constrained")
    axes = made.add_subplot()
    axes.grid(alpha=0.25)
    return made, axes


def columns(axes: Axes, at: float, texts: Sequence[str], width: float = 27.0) -> None:
    """Short texts in columns right of the axes, as numbers beside a row of points.

    Args:
        axes: beside which.
        at: the height, in the units of its vertical axis.
        texts: one for each column; an empty one leaves its place.
        width: of a column, in points.
    """
    for column, text in enumerate(texts):
        axes.annotate(
            text,
            (1.0, at),
            (3.0 + width * (column + 1), 0.0),
            xycoords=axes.get_yaxis_transform(),
            textcoords="offset points",
            fontsize=8,
            ha="right",
            va="center",
            annotation_clip=False,
        )


def label_ends(axes: Axes, ends: Sequence[tuple[float, float, str, str]], gap: float) -> None:
    """Name lines at their right ends, right of the axes, one name below the other, each with a thin line to its own.

    Args:
        axes: that have them.
        ends: of each line the last point, what it is called, and its colour.
        gap: between two names, in the units of the vertical axis.
    """
    ordered = sorted(ends, key=lambda end: end[1])
    low, high = axes.get_ylim()
    places = spread([height for _, height, *_ in ordered], gap, low + gap / 2, high - gap / 2)
    for (across, height, text, color), place in zip(ordered, places, strict=True):
        axes.annotate(
            text,
            (across, height),
            (1.1, place),
            textcoords=axes.get_yaxis_transform(),
            fontsize=7.5,
            va="center",
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": color, "lw": 0.7, "relpos": (0, 0.5), "shrinkA": 1, "shrinkB": 4},
        )


def spread(heights: Sequence[float], gap: float, low: float, high: float) -> list[float]:
    """As near to ascending heights as leaves this gap between any two; within the bounds, if there is room for all."""
    blocks: list[list[float]] = []
    for index, height in enumerate(heights):
        blocks.append([height - gap * index])
        while len(blocks) > 1 and mean(blocks[-2]) > mean(blocks[-1]):
            last = blocks.pop()
            blocks[-1] += last
    highest = max(low, high - gap * (len(heights) - 1))
    levels = [min(max(mean(block), low), highest) for block in blocks for _ in block]
    return [level + gap * index for index, level in enumerate(levels)]


def save(drawn: Figure, name: str, folder: Path = FIGURES, dpi: int = 150, colors: int | None = None) -> list[Path]:
    """Write `name.png` and `name.pdf`, each whole or not at all; the same figure gives the same files.

    Args:
        drawn: the figure.
        name: of the files.
        folder: where they go; it is made.
        dpi: of the PNG, and of pictures within the PDF.
        colors: how many the PNG has at most, for one of many photographs: a third of the bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    png, pdf = folder / f"{name}.png", folder / f"{name}.pdf"
    buffer = io.BytesIO()
    drawn.savefig(buffer, format="png", dpi=dpi)
    image = Image.open(buffer).convert("RGB")
    if colors is not None:
        image = fewer_colors(image, colors)
    smaller, vector = io.BytesIO(), io.BytesIO()
    image.save(smaller, format="png", optimize=True)
    # type 42 keeps letters as letters; without a date the same results give the same file
    with rc_context({"pdf.fonttype": 42}):
        drawn.savefig(vector, format="pdf", dpi=dpi, metadata={"CreationDate": None})
    write_atomically(png, smaller.getvalue())
    write_atomically(pdf, vector.getvalue())
    return [png, pdf]


def save_text(text: str, path: Path) -> Path:
    """Write a table or a page, whole or not at all; its folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, text.encode())
    return path
