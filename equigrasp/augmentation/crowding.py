"""Crowded scenes: something stands where a demonstrated grasp wants its fingers, so that the hand goes beside it.

One demonstration shows one grasp of a thing, and recombination puts other things anywhere about it. Where one stands in
the hand's way, the demonstrated grasp is no longer right. The nearest that the hand is free for still is, as long as
it closes on a section like the demonstrated one: a little further along the same handle, a little turned.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from equigrasp.grasp import Grasp
from equigrasp.hand import Hand, Heights, offsets
from equigrasp.workspace import Workspace

UNDER_THE_HAND = 0.07
"""Metres: an object in the hand's way has its middle so near, along each axis, to a side of the hand (`beside`)."""
FURTHEST = 0.032
"""How far along the part, across the closing axis, a grasp may be put off, metres."""
MOST_TURNED = math.radians(45)
"""How far the closing axis may be turned, radians."""
ALIKE = np.array([0.004, 0.004, 0.005])
"""By how much sections may differ, metres: where the fingers meet the target, and how high it is; before the turn."""
_OFF = np.linspace(-FURTHEST, FURTHEST, 17)
_TURNED = np.linspace(-MOST_TURNED, MOST_TURNED, 19)
_CHANGES = np.array(
    sorted(
        itertools.product(range(len(_OFF)), _TURNED),
        key=lambda each: (_OFF[each[0]] / FURTHEST) ** 2 + (each[1] / MOST_TURNED) ** 2,
    )
)
"""(which of _OFF, radians), the least change first."""
_AT_ONCE = 16


def nearest_free(hand: Hand, height: Heights, target: Heights, grasp: Grasp, workspace: Workspace) -> Grasp | None:
    """The grasp nearest to a given one that meets nothing but the target, and the target on a section like its own.

    Sections are compared where the grasp is put off, before it is turned there: a turned one crosses its part aslant
    and may close on a longer one. On a bar 25 mm wide 25 of 174 grasps that were put off did, the worst by 14.8 mm.

    Args:
        hand: whose fingers and palm.
        height: `(H, W)` of the whole scene, metres.
        target: of the target alone, 0 elsewhere.
        grasp: right for the target where nothing else is there.
        workspace: the grid.

    Returns:
        The grasp itself where the hand is free for it; None where it is free for none that is near.
    """
    others = np.where(target > 0, np.float32(0), height)
    own = np.array([[grasp.u, grasp.v, grasp.theta]])
    if hand.is_free(height, others, own, workspace)[0]:
        return grasp
    sections = hand.section(target, _put_off(grasp, _OFF, np.zeros(len(_OFF)), workspace), workspace)
    alike = (np.abs(sections - hand.section(target, own, workspace)) <= ALIKE).all(axis=1)
    which, turned = _CHANGES[:, 0].astype(np.int64), _CHANGES[:, 1]
    poses = _put_off(grasp, _OFF[which[alike[which]]], turned[alike[which]], workspace)
    poses = poses[hand.fingers_on(target, poses, workspace) <= hand.fingers_on(target, own, workspace)]
    # the first that is free is enough, and it is often among the first
    for some in (poses[start : start + _AT_ONCE] for start in range(0, len(poses), _AT_ONCE)):
        for u, v, theta in some[hand.is_free(height, others, some, workspace)]:
            found = Grasp(u, v, theta)
            if workspace.contains(found):
                return found
    return None


def beside(hand: Hand, grasp: Grasp, workspace: Workspace) -> NDArray[np.float64]:
    """(u, v) under the open hand on its two sides, `(2, 2)`: midway between a finger and that end of the palm."""
    reach = ((hand.opening + hand.finger_thickness) / 2 + hand.palm[0] / 2) / 2
    [places] = offsets(np.array([grasp.theta]), np.array([[-reach, 0.0], [reach, 0.0]]), workspace)
    return np.array([grasp.u, grasp.v]) + places


def _put_off(
    grasp: Grasp, off: NDArray[np.float64], turned: NDArray[np.float64], workspace: Workspace
) -> NDArray[np.float64]:
    """The grasp put off across its closing axis, metres, and turned on the spot, radians: `(N, 3)`."""
    [places] = offsets(np.array([grasp.theta]), np.column_stack([np.zeros(len(off)), off]), workspace)
    return np.column_stack([np.array([grasp.u, grasp.v]) + places, grasp.theta + turned])
