"""How scores of a whole policy are measured at turns that a grid does not have: at the cell about which a scene turns.

A turn by whole bins takes bins to bins, and the cell that it is about to itself. So every score of that cell has its
twin, whatever the turn, and nothing is interpolated: the scene is a formula and is evaluated turned. All of it lies on
the table, before and after.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from equivariance_tests.law import Case, Measurement
from equivariance_tests.scenes import PlaneMotion, Scene, blobs, moved, render
from equivariance_tests.stage import are_scores, cells, change, effect, observe, respond, seen, visible, words
from equivariance_tests.subjects import PolicySubject

PROBES = 3
"""Scenes in a case: one of them may do little to the scores, beside which an error is no measure."""
SPREAD, WIDTH = 12.0, 4.0
"""How far Gaussians lie from the cell, and how wide they are, pixels."""
EXACT = 1e-3
"""Relative error at quarter turns, which a grid has: a policy that is off by more there is asked for no others."""


def whole_bins(subject: PolicySubject, case: Case) -> Measurement | None:
    """f(T_g o)(x) = rho(g) f(o)(x) for turns by whole bins about a cell x: every bin of that cell.

    Relative to the most that an object does to one of them. Nothing is said of a policy that is off at quarter turns
    about the cell as well: it turns by none, or about other points, as one that halves its image more than once.
    """
    embedding = words(subject, case)
    things: list[Scene] = [
        visible(blobs(4, case.seed + i, spread=SPREAD, width=WIDTH, positive=True)) for i in range(PROBES)
    ]
    # at least what the policy sees: the border does not turn
    side = max(subject.side(case.seed), 32 * math.ceil((2 * (seen(subject) or 0) + subject.stride) / 32))
    bare = _answers(subject, embedding, [lambda points: points.new_zeros(4, len(points))], side)
    before = _answers(subject, embedding, things, side)
    # an odd number of bins has no quarter turn
    grid = 180.0 if subject.bins % 2 else 90.0
    done = effect(before, bare.expand_as(before))
    found = []
    for degrees in (grid, case.degrees):
        motion = PlaneMotion(degrees, about=_middle(subject))
        after = _answers(subject, embedding, [moved(each, motion) for each in things], side)
        if not are_scores(before) or not are_scores(after):
            return Measurement(math.inf, "a score is not finite")
        # that any does is asked at quarter turns, of all cells
        if not done:
            return None
        found.append(_compare(after, torch.roll(before, round(degrees * subject.bins / 180), 1), done))
        if found[0].value > EXACT:
            return None
    return found[-1]


def _middle(subject: PolicySubject) -> tuple[float, float]:
    """The centre of the middle cell, x and y in pixels from the middle pixel, y up."""
    x, y = cells(1, 1, subject.stride)[0].tolist()
    return x, y


def _answers(subject: PolicySubject, embedding: Tensor, scenes: list[Scene], side: int) -> Tensor:
    """Scores of the middle cell of a square table, `(len(scenes), bins)` float64."""
    middle = side // 2 // subject.stride
    return respond(subject, embedding, [observe(render(each, side, side)) for each in scenes])[
        ..., middle, middle
    ].double()


def _compare(after: Tensor, expected: Tensor, done: float) -> Measurement:
    """The largest error of `(scenes, bins)` relative to what the objects do, and where it is."""
    error = change(after, expected).abs()
    if not error.isfinite().all():
        return Measurement(math.inf, "a grasp is forbidden, minus infinity, where its turned twin is allowed")
    scene, index = divmod(int(error.argmax()), error.shape[1])
    return Measurement(
        float(error.max()) / done,
        f"bin {index} of {error.shape[1]}: f(T_g o) is {float(after[scene, index]):.4g} where rho(g) f(o) is "
        f"{float(expected[scene, index]):.4g}",
    )
