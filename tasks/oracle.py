"""The scripted oracle: the best grasp of a goal, computed from the true scene instead of learned.

Every pixel of the goal's part is tried with every angle. For each, the hand is laid over the height map as a
patch of parallel lines along the closing axis, and the score asks what a person would: do the fingers come down
beside everything, do they close on the goal and on nothing else, do they meet its part, squarely, evenly, and
not too far from the centre of mass? No random numbers: of equal scores the first one wins.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equigrasp.grasp import Grasp
from equigrasp.heightmap import compiled
from equigrasp.workspace import WORKSPACE
from tasks.gripper import DEPTH, FINGER_LENGTH, FINGER_THICKNESS, FINGER_WIDTH, FLOOR, OPENING, PALM

TABLE, GOAL, OTHER = 0, 1, 2
"""What a pixel belongs to."""

_CANDIDATES = 160
"""At most about so many pixels of a part are tried; of a bigger part every second, third, ... one."""

_ALONG = 0.002
_ACROSS = 0.0025
"""Between two samples of the patch, along the closing axis and across, metres."""
_GUARD = 0.003
"""The fingers are taken to be wider and thicker than they are, by this on each side, metres."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What the oracle knows of a scene, pixel by pixel; all arrays are `(H, W)`.

    Attributes:
        height: float32, metres.
        owner: int8, TABLE, GOAL or OTHER.
        on_part: bool, the pixels of the goal's object that lie on the goal's part.
        center: x, y of the goal's object's centre of mass, metres.
    """

    height: NDArray[np.float32]
    owner: NDArray[np.int8]
    on_part: NDArray[np.bool_]
    center: tuple[float, float]


def best_grasp(truth: Truth) -> tuple[Grasp, float]:
    """The grasp with the best score, and the score, in [0, 1].

    A score near 0 says that every grasp is bad: something is in the way, or the part is out of sight. Where
    not a pixel of the part is to be seen, the grasp is at the object's centre of mass and its score is 0.
    """
    v, u = np.nonzero(truth.on_part)
    if not len(u):
        middle = WORKSPACE.to_pixel(truth.center)
        return Grasp(float(middle[0]), float(middle[1]), 0.0), 0.0
    stride = -(-len(u) // _CANDIDATES)
    pixels = np.stack([u, v], axis=1)[::stride].astype(np.int64)
    angles = np.array([WORKSPACE.to_angle(index) for index in range(WORKSPACE.bins)])
    # the directions along and across the closing axis, in pixels for each metre
    origin = WORKSPACE.to_pixel([0.0, 0.0])
    along = WORKSPACE.to_pixel(np.stack([np.cos(angles), np.sin(angles)], axis=1)) - origin
    across = WORKSPACE.to_pixel(np.stack([-np.sin(angles), np.cos(angles)], axis=1)) - origin
    tall = np.argwhere(truth.height > FLOOR + FINGER_LENGTH - _GUARD)
    scores = _scores(
        pixels,
        along,
        across,
        truth.height,
        truth.owner,
        truth.on_part,
        tall,
        WORKSPACE.to_pixel(truth.center),
        np.array([u.mean(), v.mean()]),
        WORKSPACE.pixel,
    )
    best = int(np.argmax(scores))
    pixel, index = divmod(best, WORKSPACE.bins)
    grasp = WORKSPACE.to_grasp([*pixels[pixel], index])
    return grasp, float(scores.flat[best])


@compiled
def _scores(
    pixels: NDArray[np.int64],
    along: NDArray[np.float64],
    across: NDArray[np.float64],
    height: NDArray[np.float32],
    owner: NDArray[np.int8],
    on_part: NDArray[np.bool_],
    tall: NDArray[np.int64],
    center: NDArray[np.float64],
    middle: NDArray[np.float64],
    side: float,
) -> NDArray[np.float64]:
    """Scores `(N, bins)` of the pixels `(N, 2)`.

    `along` and `across` are `(bins, 2)` directions in pixels for each metre, `tall` the `(M, 2)` rows and columns
    of what could meet the palm, `center` the centre of mass and `middle` the middle of the part in pixels, and
    `side` metres for each pixel.
    """
    rows, columns = height.shape
    reach = OPENING / 2
    outer = reach + FINGER_THICKNESS + _GUARD
    samples = int(outer / _ALONG)
    lines = int((FINGER_WIDTH / 2 + _GUARD) / _ACROSS)
    count = 2 * lines + 1
    result = np.zeros((len(pixels), len(along)))
    left, right = np.empty(count), np.empty(count)
    left_on, right_on = np.empty(count), np.empty(count)
    for n in range(len(pixels)):
        u0, v0 = pixels[n, 0], pixels[n, 1]
        tip = max(FLOOR, height[v0, u0] - DEPTH)
        for b in range(len(along)):
            blocked = 0
            swept = 0
            swept_on = 0
            for k in range(count):
                t = (k - lines) * _ACROSS
                left[k], right[k] = np.inf, -np.inf
                left_on[k], right_on[k] = 0.0, 0.0
                for m in range(-samples, samples + 1):
                    s = m * _ALONG
                    u = int(np.floor(u0 + s * along[b, 0] + t * across[b, 0] + 0.5))
                    v = int(np.floor(v0 + s * along[b, 1] + t * across[b, 1] + 0.5))
                    if u < 0 or v < 0 or u >= columns or v >= rows:
                        continue
                    h = height[v, u]
                    if h < tip - 0.001 or owner[v, u] == TABLE:
                        continue
                    if abs(s) > reach - _GUARD or owner[v, u] == OTHER:
                        blocked += 1
                    elif abs(t) <= FINGER_WIDTH / 2 and h > tip + 0.001:
                        swept += 1
                        swept_on += on_part[v, u]
                        if s < left[k]:
                            left[k] = s
                            left_on[k] = on_part[v, u]
                        if s > right[k]:
                            right[k] = s
                            right_on[k] = on_part[v, u]
            if swept == 0:
                continue
            first, last = left.min(), right.max()
            # the lines that a finger meets first carry it: how many, where across, on the part or not
            n_left, n_right, t_left, t_right, on_left, on_right = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            slack_left, slack_right = 0.0, 0.0
            met = 0
            for k in range(count):
                if left[k] == np.inf:
                    continue
                met += 1
                t = (k - lines) * _ACROSS
                slack_left += min(left[k] - first, 0.01)
                slack_right += min(last - right[k], 0.01)
                if left[k] < first + 0.0025:
                    n_left += 1.0
                    t_left += t
                    on_left += left_on[k]
                if right[k] > last - 0.0025:
                    n_right += 1.0
                    t_right += t
                    on_right += right_on[k]
            bodies = 0
            for m in range(len(tall)):
                du, dv = tall[m, 1] - u0, tall[m, 0] - v0
                s = (du * along[b, 0] + dv * along[b, 1]) * side * side
                t = (du * across[b, 0] + dv * across[b, 1]) * side * side
                if (
                    abs(s) < PALM[0] / 2 + _GUARD
                    and abs(t) < PALM[1] / 2 + _GUARD
                    and height[tall[m, 0], tall[m, 1]] > tip + FINGER_LENGTH - _GUARD
                ):
                    bodies += 1
            twist = t_left / n_left - t_right / n_right
            slope = (slack_left + slack_right) / met
            offset = 0.5 * (first + last)
            width = last - first
            part = (on_left / n_left) * (on_right / n_right) * (swept_on / swept)
            # where the fingers will meet, which is what should lie near the middle and the centre of mass
            cu, cv = u0 + offset * along[b, 0], v0 + offset * along[b, 1]
            to_center = np.hypot(cu - center[0], cv - center[1]) * side
            to_middle = np.hypot(cu - middle[0], cv - middle[1]) * side
            score = part * part
            score *= np.exp(-((slope / 0.003) ** 2))
            score *= np.exp(-((twist / 0.008) ** 2))
            score *= np.exp(-((offset / 0.012) ** 2))
            score *= np.exp(-((to_center / 0.15) ** 2) - (to_middle / 0.025) ** 2)
            score *= np.exp(-((width / 0.065) ** 8))
            score *= 0.5 + 0.5 * met / count
            if blocked + bodies > 0:
                score *= 0.01 / (blocked + bodies)
            result[n, b] = score
    return result
