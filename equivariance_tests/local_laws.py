"""How the laws of locality are measured: Eq. 2 score by score, for policies that say how far their scores see.

Eq. 2 speaks of a maximum, and which object has it is a matter of training. Why it follows the target is a statement
about scores, and can be asked of random weights: a score that sees the target alone turns with it, one that does not
see it stays. Both are exact, and what a score sees is counted pixel by pixel.
"""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from torch import Tensor
from torch.nn import functional

from equivariance_tests.law import Case, Measurement
from equivariance_tests.scenes import PlaneMotion, Scene, moved, render
from equivariance_tests.stage import (
    Stage,
    cells,
    change,
    effect,
    respond_to_scenes,
    scene_and_motion,
    stage,
    without_target,
    words,
)
from equivariance_tests.subjects import PolicySubject

EDGE = 8.0
"""Pixels between an object's centre and the table's edge."""


def field_of_view(subject: PolicySubject, case: Case) -> Measurement:
    """A score within `reach` of no other object is what it is without them.

    Where the target's scores stay as they are when the others are taken away, nothing but pixels within `reach`
    enters: no wider field of view, no statistics of the whole image. And where nothing is seen of an object at the
    table's edge, scores are those of the bare table: no end of it is next to the other.
    """
    scene, _ = scene_and_motion(subject, case)
    table, others = stage(subject, case.seed), without_target(scene)
    edge = replace(scene.target, centre=_at_an_edge(table, case.seed))
    scores = respond_to_scenes(subject, words(subject, case), [scene, scene.target, _bare, edge], table)
    alone, blind = ~sees(subject, _support(others, table)), ~sees(subject, _support(edge, table))
    among, by_itself, bare = (each[:, alone] for each in scores[:3])
    where, size = _centres(subject, table), effect(by_itself, bare)
    found = [
        _worst(change(among, by_itself), size, where[alone.flatten()], "a score that sees no other object changed")
    ]
    if blind.any():
        elsewhere, size = change(scores[3], scores[2])[:, blind], effect(scores[3], scores[2])
        found.append(_worst(elsewhere, size, where[blind.flatten()], "a score that sees no object at the edge changed"))
    return max(found, key=lambda each: each.value)


def _at_an_edge(table: Stage, seed: int) -> tuple[float, float]:
    """A place near the middle of one of the table's four edges, x and y in pixels from the middle."""
    across, along = table.columns // 2 - EDGE, table.rows // 2 - EDGE
    return ((-across, 0.0), (across, 0.0), (0.0, -along), (0.0, along))[seed % 4]


def eq_2_field(subject: PolicySubject, case: Case) -> Measurement | None:
    """f(o with g.b) = T_g rho(g) f(o) at every cell that sees the target alone, = f(o) at every cell that does not."""
    scene, motion = scene_and_motion(subject, case)
    table, others, turned = stage(subject, case.seed), without_target(scene), scene.with_target_moved(motion)
    before, after, without = respond_to_scenes(subject, words(subject, case), [scene, turned, others], table)
    bins = len(before)
    quarter = round(case.degrees / 90)
    if quarter * bins % 2:
        return None

    blind = ~sees(subject, _support(others, table), border=True).flatten()
    source, inside = _source(motion, before.shape[1:], subject.stride)
    # both ends of g must see the target at most
    moves = inside & blind & blind[source]
    touched = _support(scene.target, table) | _support(moved(scene.target, motion), table)
    stays = ~sees(subject, touched).flatten()

    flat_before, flat_after = before.flatten(1), after.flatten(1)
    expected = torch.roll(flat_before[:, source], quarter * bins // 2, 0)
    scale = effect(flat_before[:, moves], without.flatten(1)[:, moves])
    where = _centres(subject, table)
    found = [
        _worst(
            change(flat_after, expected)[:, moves], scale, where[moves], "a score of the target did not turn with it"
        ),
        _worst(change(flat_after, flat_before)[:, stays], scale, where[stays], "a score of what stayed changed"),
    ]
    return max(found, key=lambda each: each.value)


def sees(subject: PolicySubject, support: Tensor, border: bool = False) -> Tensor:
    """Which cells have a pixel of `support` (H, W) within the policy's reach along both axes, `(h, w)` bool.

    Args:
        subject: has a reach.
        support: bool.
        border: whether what lies beyond the table counts as support.
    """
    assert subject.reach is not None
    around = functional.pad(support, (1, 1, 1, 1), value=border)
    rows, columns = (_within(each, subject.stride, subject.reach) for each in support.shape)
    return rows @ around.double() @ columns.T > 0


def _within(length: int, stride: int, reach: float) -> Tensor:
    """Which of the pixels -1 .. length lie within reach of each cell's centre, `(length / stride, length + 2)`."""
    pixels = torch.arange(-1, length + 1, dtype=torch.float64)
    centres = torch.arange(length // stride, dtype=torch.float64) * stride + (stride - 1) / 2
    return ((pixels - centres[:, None]).abs() <= reach).double()


def _source(motion: PlaneMotion, shape: torch.Size, stride: int) -> tuple[Tensor, Tensor]:
    """For each cell the flat index of g^-1 of it, and whether that lies on the table."""
    rows, columns = shape
    origin = cells(1, 1, stride)
    points = (motion.inverse(cells(rows, columns, stride)) - origin) / stride
    column, row = points[:, 0] + columns // 2, rows // 2 - points[:, 1]
    inside = (row > -0.5) & (row < rows - 0.5) & (column > -0.5) & (column < columns - 0.5)
    index = row.round().clamp(0, rows - 1) * columns + column.round().clamp(0, columns - 1)
    return index.long(), inside


def _bare(points: Tensor) -> Tensor:
    """A table with nothing on it."""
    return points.new_zeros(4, len(points))


def _support(scene: Scene, table: Stage) -> Tensor:
    return (render(scene, table.rows, table.columns) != 0).any(dim=0)


def _centres(subject: PolicySubject, table: Stage) -> Tensor:
    return cells(table.rows // subject.stride, table.columns // subject.stride, subject.stride)


def _worst(difference: Tensor, scale: float, where: Tensor, what: str) -> Measurement:
    """The largest error `(bins, cells)` relative to the scale, and where it is; a target without effect is no proof."""
    if not difference.numel() or not scale:
        return Measurement(math.inf, "no score depends on the target, or none sees it alone")
    if not difference.isfinite().all() or not math.isfinite(scale):
        return Measurement(math.inf, "a score is not finite, or forbids what it should allow")
    index, cell = divmod(int(difference.abs().argmax()), difference.shape[1])
    x, y = where[cell].tolist()
    value = float(difference.abs().max()) / scale
    return Measurement(
        value, f"{what}: bin {index}, ({x:.1f}, {y:.1f}) px from the middle, by {value:.2g} of what the target does"
    )
