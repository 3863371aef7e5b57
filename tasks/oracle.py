"""The scripted oracle: the best grasp of a goal, computed from the true scene instead of learned.

Every pixel of the goal's part is tried with every angle. For each, the hand is laid over the height map as a
patch of parallel lines along the closing axis, and the score asks what a person would: do the fingers come down
beside everything, do they close on the goal and on nothing else, do they meet its part, squarely, evenly, and
not too far from the centre of mass? No random numbers: of equal scores the first one wins.
"""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equigrasp.compiled import compiled
from equigrasp.grasp import Grasp, Observation
from equigrasp.hand import HAND, Hand
from equigrasp.workspace import WORKSPACE
from tasks.camera import TABLE
from tasks.goal import Goal
from tasks.scene import Scene

FREE, GOAL, OTHER = 0, 1, 2
"""What a pixel belongs to."""

_CANDIDATES = 64
"""At most about so many pixels of a part are tried first; of a bigger part every second, third, ... one."""

_ALONG = 0.002
_ACROSS = 0.0025
"""Between two samples of the patch, along the closing axis and across, metres."""
_GUARD = 0.003
"""The fingers are taken to be wider and thicker than they are, by this on each side, metres."""
_POOR = 0.2
_ALIKE = 0.01
"""Grasps nearer to each other than this, metres, are one and the same to try."""
_HOPELESS = 20
"""A patch with more samples in the way than this scores nothing; up to it, a little."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What the oracle knows of a scene, pixel by pixel; all arrays are `(H, W)`.

    Attributes:
        height: float32, metres.
        owner: int8, FREE (the table), GOAL or OTHER.
        on_part: bool, the pixels of the goal's object that lie on the goal's part.
        center: x, y of the goal's object's centre of mass, metres.
    """

    height: NDArray[np.float32]
    owner: NDArray[np.int8]
    on_part: NDArray[np.bool_]
    center: tuple[float, float]


def see(scene: Scene, goal: Goal, view: Observation, segmentation: NDArray[np.int32]) -> Truth:
    """Label each pixel of the overhead view, of which the segmentation `(H, W)` says whose body it is."""
    mine = segmentation == scene.bodies[goal.name]
    owner = np.where(segmentation == TABLE, FREE, OTHER).astype(np.int8)
    owner[mine] = GOAL
    on_part = mine.copy()
    if goal.part is not None:
        v, u = np.nonzero(mine)
        points = np.column_stack([WORKSPACE.to_world(np.stack([u, v], axis=-1)), view.height[mine]])
        on_part[mine] = scene.parts_at(goal.name, points) == scene.asset(goal.name).parts.index(goal.part)
    x, y, _ = scene.pose(goal.name).position
    return Truth(view.height, owner, on_part, (float(x), float(y)))


def best_grasps(truth: Truth, count: int = 1) -> list[tuple[Grasp, float]]:
    """The grasps with the best scores, and the scores, in [0, 1]; best first, and at least one.

    No two are alike: those within 10 mm and 10 degrees of a better one are left out, and those that score nothing.
    Of a score below _POOR one can expect little: something is in the way, or all but, of every grasp. Where not a
    pixel of the part is to be seen, the grasp is at the object's centre of mass and its score is 0.
    """
    v, u = np.nonzero(truth.on_part)
    if not len(u):
        rows, columns = truth.owner.shape
        middle = np.clip(WORKSPACE.to_pixel(truth.center), 0, [columns - 1, rows - 1])
        return [(Grasp(float(middle[0]), float(middle[1]), 0.0), 0.0)]
    every = np.stack([u, v], axis=1).astype(np.int64)
    arguments = (
        astuple(HAND),
        *_laid(HAND),
        truth.height,
        truth.owner,
        truth.on_part,
        np.argwhere(truth.height > HAND.floor + HAND.finger_length - _GUARD),
        WORKSPACE.to_pixel(truth.center),
        np.array([u.mean(), v.mean()]),
        math.hypot(u.std(), v.std()),
        WORKSPACE.pixel,
    )
    # a few pixels where something good is free; else all; else what is only a little in the way
    for most, pixels in ((0, every[:: -(-len(u) // _CANDIDATES)]), (0, every), (_HOPELESS, every)):
        scores = _scores(most, pixels, *arguments)
        if scores.max() >= _POOR**3:
            break
    found: list[tuple[Grasp, float]] = []
    while len(found) < count:
        pixel, index = divmod(int(np.argmax(scores)), WORKSPACE.bins)
        score = float(scores[pixel, index])
        if found and score <= 0.0:
            break
        # many small penalties multiply: the root spreads the good ones out again
        found.append((WORKSPACE.to_grasp([*pixels[pixel], index]), max(score, 0.0) ** (1 / 3)))
        near = np.hypot(*(pixels - pixels[pixel]).T) * WORKSPACE.pixel < _ALIKE
        scores[np.ix_(near, np.arange(index - 2, index + 3) % WORKSPACE.bins)] = -1.0
    return found


@cache
def _laid(hand: Hand) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """The open hand as a patch of lines along the closing axis, for each bin.

    Returns:
        (u, v) of each sample beside the hand's pixel, `(bins, lines, samples, 2)`, as many on one side of it as on the
        other; the directions along and across the closing axis, `(bins, 2)` each, in pixels for each metre.
    """
    samples = int((hand.opening / 2 + hand.finger_thickness + _GUARD) / _ALONG)
    lines = int((hand.finger_width / 2 + _GUARD) / _ACROSS)
    angles = np.array([WORKSPACE.to_angle(index) for index in range(WORKSPACE.bins)])
    origin = WORKSPACE.to_pixel([0.0, 0.0])
    along = WORKSPACE.to_pixel(np.stack([np.cos(angles), np.sin(angles)], axis=1)) - origin
    across = WORKSPACE.to_pixel(np.stack([-np.sin(angles), np.cos(angles)], axis=1)) - origin
    s = _ALONG * np.arange(-samples, samples + 1)[:, None]
    t = _ACROSS * np.arange(-lines, lines + 1)[:, None, None]
    patch = np.floor(s * along[:, None, None] + t * across[:, None, None] + 0.5).astype(np.int64)
    return patch, along, across


@compiled
def _scores(
    most: int,
    pixels: NDArray[np.int64],
    hand: tuple[Any, ...],
    patch: NDArray[np.int64],
    along: NDArray[np.float64],
    across: NDArray[np.float64],
    height: NDArray[np.float32],
    owner: NDArray[np.int8],
    on_part: NDArray[np.bool_],
    tall: NDArray[np.int64],
    center: NDArray[np.float64],
    middle: NDArray[np.float64],
    spread: float,
    side: float,
) -> NDArray[np.float64]:
    """Scores `(N, bins)` of the pixels `(N, 2)`; nothing for those where more than `most` samples are in the way.

    `hand` is a `Hand`, field by field, and `patch`, `along` and `across` are those of `_laid`; `tall` is `(M, 2)`, rows
    and columns of what could meet the palm; `center` is the centre of mass, `middle` and `spread` are the part's, in
    pixels; `side` is metres for each pixel.
    """
    # an argument, as what numba keeps on disk is not compiled anew when a global of another file changes
    opening, _, width, length, palm, depth, floor = hand
    scores = np.zeros((len(pixels), len(along)))
    edges = np.empty((patch.shape[1], 4))
    for n in range(len(pixels)):
        pixel = pixels[n]
        tip = max(floor, height[pixel[1], pixel[0]] - depth)
        meets = _near(pixel, tip + length - _GUARD, palm, height, tall, side)
        for b in range(len(along)):
            blocked, swept, share = _lay(most, pixel, opening, width, patch[b], tip, height, owner, on_part, edges)
            if swept == 0 or blocked > most:
                continue
            blocked += _under_palm(palm, along[b], across[b], meets, side)
            if blocked > most:
                continue
            score, offset = _rate(edges)
            # where the fingers will meet, which should be near the part's middle and the centre of mass
            met = pixel + offset * along[b]
            to_center = np.hypot(met[0] - center[0], met[1] - center[1]) * side
            to_middle = np.hypot(met[0] - middle[0], met[1] - middle[1]) / (spread + 1.0)
            score *= share**2 * np.exp(-((to_center / 0.2) ** 2) - (to_middle / 1.0) ** 2)
            scores[n, b] = score if blocked == 0 else 0.01 * score / blocked
    return scores


@compiled
def _lay(
    most: int,
    pixel: NDArray[np.int64],
    opening: float,
    width: float,
    patch: NDArray[np.int64],
    tip: float,
    height: NDArray[np.float32],
    owner: NDArray[np.int8],
    on_part: NDArray[np.bool_],
    edges: NDArray[np.float64],
) -> tuple[int, int, float]:
    """Lay the open hand, with fingers of a width, over the heightmap, line by line, at fingertip height `tip`.

    Fills `edges` `(lines, 4)`: for each line the coordinate along the closing axis in metres where the left and
    the right finger meet the goal (infinite where they do not), and 1 or 0 as that is on the part or not.
    Returns how many samples are in the way, how many the fingers sweep, and the part's share of the latter; not
    to the end where more than `most` are in the way.
    """
    rows, columns = height.shape
    lines, samples = patch.shape[0] // 2, patch.shape[1] // 2
    blocked, swept, on = 0, 0, 0
    for k in range(2 * lines + 1):
        between = abs(k - lines) * _ACROSS <= width / 2
        edges[k, 0], edges[k, 1], edges[k, 2], edges[k, 3] = np.inf, -np.inf, 0.0, 0.0
        for m in range(2 * samples + 1):
            u, v = pixel[0] + patch[k, m, 0], pixel[1] + patch[k, m, 1]
            if u < 0 or v < 0 or u >= columns or v >= rows or owner[v, u] == FREE:
                continue
            if height[v, u] < tip - 0.001:
                continue
            s = (m - samples) * _ALONG
            if abs(s) > opening / 2 - _GUARD or owner[v, u] == OTHER:
                blocked += 1
                if blocked > most:
                    return blocked, swept, 0.0
            elif between and height[v, u] > tip + 0.001:
                swept += 1
                on += on_part[v, u]
                if s < edges[k, 0]:
                    edges[k, 0], edges[k, 2] = s, on_part[v, u]
                if s > edges[k, 1]:
                    edges[k, 1], edges[k, 3] = s, on_part[v, u]
    return blocked, swept, on / max(swept, 1)


@compiled
def _near(
    pixel: NDArray[np.int64],
    above: float,
    palm: tuple[float, float, float],
    height: NDArray[np.float32],
    tall: NDArray[np.int64],
    side: float,
) -> NDArray[np.int64]:
    """Of the tall pixels `(M, 2)` those above a height that the palm could meet at some angle, (u, v) beside it."""
    reach = 0.5 * np.hypot(palm[0], palm[1]) + 2 * _GUARD
    near = np.empty_like(tall)
    count = 0
    for m in range(len(tall)):
        du, dv = tall[m, 1] - pixel[0], tall[m, 0] - pixel[1]
        if np.hypot(du, dv) * side < reach and height[tall[m, 0], tall[m, 1]] > above:
            near[count, 0], near[count, 1] = du, dv
            count += 1
    return near[:count]


@compiled
def _under_palm(
    palm: tuple[float, float, float],
    along: NDArray[np.float64],
    across: NDArray[np.float64],
    meets: NDArray[np.int64],
    side: float,
) -> int:
    """How many of the tall pixels, (u, v) beside the hand's, the palm would come down on."""
    hit = 0
    for m in range(len(meets)):
        s = (meets[m, 0] * along[0] + meets[m, 1] * along[1]) * side**2
        t = (meets[m, 0] * across[0] + meets[m, 1] * across[1]) * side**2
        if abs(s) < palm[0] / 2 + _GUARD and abs(t) < palm[1] / 2 + _GUARD:
            hit += 1
    return hit


@compiled
def _rate(edges: NDArray[np.float64]) -> tuple[float, float]:
    """How well the fingers meet the goal, in [0, 1], and the middle between them in metres along the axis.

    The lines that a finger meets first are those that carry it. They should be on the part; lie opposite each
    other, or the object will twist; be many, not a corner's; and be as far from one finger as from the other.
    """
    first, last = edges[:, 0].min(), edges[:, 1].max()
    carried, where, on = np.zeros(2), np.zeros(2), np.zeros(2)
    lines = len(edges) // 2
    slack = 0.0
    met = 0
    for k in range(len(edges)):
        if edges[k, 0] == np.inf:
            continue
        met += 1
        gaps = (edges[k, 0] - first, last - edges[k, 1])
        for finger in range(2):
            slack += min(gaps[finger], 0.01)
            if gaps[finger] < 0.0025:
                carried[finger] += 1.0
                where[finger] += (k - lines) * _ACROSS
                on[finger] += edges[k, 2 + finger]
    twist = where[0] / carried[0] - where[1] / carried[1]
    offset = 0.5 * (first + last)
    score = ((on[0] / carried[0]) * (on[1] / carried[1])) ** 2
    score *= np.exp(-((slack / met / 0.003) ** 2) - (twist / 0.008) ** 2 - (offset / 0.012) ** 2)
    score *= np.exp(-(((last - first) / 0.065) ** 8))
    return score * (0.5 + 0.5 * met / len(edges)), offset
