"""How time and memory grow with the image, kernel, frequencies, bins, batch, and the order of the lift."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from equigrasp.bench.fresh import in_fresh_process
from equigrasp.bench.model_figures import Setting, heads
from equigrasp.bench.report import Figure, milliseconds
from equigrasp.bench.steps import Call, Size, memory_of_steps, ready, step_on_noise
from equigrasp.bench.timing import race
from equigrasp.config import LegConfig, ModelConfig
from equigrasp.errors import unknown
from equigrasp.workspace import WORKSPACE

SHAPES = ((96, 192), (128, 256), (160, 320), (224, 448), (320, 640))
KERNELS = (9, 17, 25, 33)
FREQUENCIES = (4, 8, 16, 32)
BATCHES = (1, 2, 4, 8)
BINS = (36, 72, 144, 288)
GROUP_ORDERS = (36, 72, 144)
LIMIT = 300.0
"""Seconds for the fresh process of one point."""


@dataclass(frozen=True)
class Point:
    """One value of an axis.

    Attributes:
        value: what the power law is fitted over.
        config: the model there.
        size: of what it is trained on.
    """

    value: float
    config: ModelConfig
    size: Size


@dataclass(frozen=True)
class PowerLaw:
    """y = coefficient * x ** exponent, fitted by least squares of the logarithms.

    A cost with a constant share is no power law: then `worst`, the largest factor between a point and the fit, is
    far from 1, and the exponent says what holds in this range alone.
    """

    coefficient: float
    exponent: float
    worst: float

    @classmethod
    def through(cls, x: Sequence[float], y: Sequence[float]) -> PowerLaw:
        """Of at least two different x, all positive."""
        log_x, log_y = np.log(x), np.log(y)
        exponent, intercept = np.polyfit(log_x, log_y, 1)
        residuals = np.abs(log_y - (exponent * log_x + intercept))
        return cls(math.exp(intercept), float(exponent), math.exp(residuals.max()))

    def to_dict(self) -> dict[str, float]:
        """As JSON takes it."""
        return {"coefficient": self.coefficient, "exponent": self.exponent, "worst": self.worst}


def axes(config: ModelConfig, batch: int = 1) -> dict[str, list[Point]]:
    """The axes along which a model can grow, each with its points."""
    shape = WORKSPACE.shape
    found = {
        "pixels": [Point(rows * columns, config, Size(batch, (rows, columns))) for rows, columns in SHAPES],
        "batch": [Point(each, config, Size(each, shape)) for each in BATCHES],
    }
    if isinstance(config, LegConfig):
        # a small kernel carries low frequencies alone
        low = replace(config, maximum_frequency=min(config.maximum_frequency, 4))
        smallest = 15 if config.kernel == "steerable" else 0
        found["kernel size"] = [
            Point(each, replace(low, kernel_size=each), Size(batch, shape)) for each in KERNELS if each >= smallest
        ]
        most = config.maximum_frequency if config.kernel == "steerable" else FREQUENCIES[-1]
        found["coefficients"] = [
            Point(1 + each, replace(config, maximum_frequency=each), Size(batch, shape))
            for each in FREQUENCIES
            if each <= most
        ]
        found["bins"] = [Point(each, config, Size(batch, shape, each)) for each in BINS]
    return found


GROUP_AXIS = "group order"
"""The order n of the lift: our head and the literal one, on the same features."""
AXES = ("pixels", "batch", "kernel size", "coefficients", "bins", GROUP_AXIS)
WORLD_AXES = ("objects", "workers")
"""Of the environment, whichever the model (`equigrasp.bench.world_growth`)."""


def check_axes(names: Sequence[str]) -> None:
    """Raise an InputError unless these are axes."""
    for name in names:
        if name not in (*AXES, *WORLD_AXES):
            raise unknown("axis of growth", name, (*AXES, *WORLD_AXES))


def grow(axis: str, points: Sequence[Point], setting: Setting) -> tuple[list[Figure], list[dict[str, Any]]]:
    """Time of a training step on noise and peak memory at each point, and the power laws through them.

    Times are taken in turn over all points; memory in a fresh process for each.

    Raises:
        DidNotFitError: if a point takes too long or more memory than there is.
    """
    subject, training = points[0].config.name, setting.training
    calls: dict[str, Call] = {}
    memory = []
    for point in points:
        config = ready(point.config, setting.text_encoder)
        used = in_fresh_process(memory_of_steps, config, point.size, training.threads, limit=LIMIT)
        memory.append(used["peak"] - used["before"])
        calls[_named(axis, point.value)] = step_on_noise(config, point.size, training)
    times = race(calls, setting.seconds)
    figures = []
    for name, mebibytes in zip(calls, memory, strict=True):
        figures.append(milliseconds("growth", subject, f"step, {name}", times[name]))
        figures.append(Figure("growth", subject, f"memory of the step, {name}", "MiB", (mebibytes,)))
    values = [point.value for point in points]
    medians = [1e3 * times[name].median for name in calls]
    return figures, [
        fit(subject, axis, "step", "ms", values, medians),
        fit(subject, axis, "memory of the step", "MiB", values, memory),
    ]


def grow_group(
    config: LegConfig, setting: Setting, orders: Sequence[int] = GROUP_ORDERS
) -> tuple[list[Figure], list[dict[str, Any]]]:
    """Time of our head and of the literal one, forward and backward, over n."""
    calls = {}
    for order in orders:
        variant = replace(config, group_order=order)
        made = heads(variant, setting.workload(variant))
        for name in ("ours", "literal"):
            calls[name, order] = made[name]
    names = {key: f"head, {key[0]}, {_named(GROUP_AXIS, key[1])}" for key in calls}
    times = race({names[key]: call for key, call in calls.items()}, setting.seconds)
    figures = [milliseconds("growth", config.name, name, each) for name, each in times.items()]
    fits = []
    for head in ("ours", "literal"):
        medians = [1e3 * times[names[head, order]].median for order in orders]
        fits.append(fit(config.name, GROUP_AXIS, f"head, {head}", "ms", list(orders), medians))
    return figures, fits


def _named(axis: str, value: float) -> str:
    return f"{axis} {value:g}"


def fit(
    subject: str, axis: str, what: str, unit: str, values: Sequence[float], measured: Sequence[float]
) -> dict[str, Any]:
    """The points of one axis and the power law through them, None of a single point, as JSON takes it."""
    points = [list(pair) for pair in zip(values, measured, strict=True)]
    law = PowerLaw.through(values, measured).to_dict() if len(values) > 1 else None
    return {"subject": subject, "axis": axis, "what": what, "unit": unit, "points": points, "law": law}


def lines(fits: Sequence[dict[str, Any]]) -> list[str]:
    """The power laws as lines of Markdown."""
    rows = ["| | what | over | points | exponent | worst factor |", "|---|---|---|---|---|---|"]
    for each in fits:
        points = ", ".join(f"{x:g}: {y:.3g} {each['unit']}" for x, y in each["points"])
        law = each["law"]
        fitted = f"{law['exponent']:.2f} | {law['worst']:.2f}" if law else " | "
        rows.append(f"| {each['subject']} | {each['what']} | {each['axis']} | {points} | {fitted} |")
    return rows
