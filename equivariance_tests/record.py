"""How equivariant a trained policy is, as a few numbers that stand beside its success rate in a file of results.

A cheap subset of the laws, measured and not judged: a trained network is not expected to hold them to rounding. What
the error costs is seen in the simulator, where the target alone is turned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from equigrasp.policy import GraspPolicy
from equivariance_tests.grasp_laws import smooth_quarter_turn
from equivariance_tests.law import Law, cases
from equivariance_tests.laws import LAWS
from equivariance_tests.simulator import TurnableEnvironment, proposition_1
from equivariance_tests.subjects import KernelSubject, PolicySubject
from equivariance_tests.wrapping import subjects_of

CASES = 4
"""Group elements and scenes a law: these errors differ by orders of magnitude between models, not within one."""
MEASURED: dict[str, Law] = {
    "kernel": LAWS["steerability"],
    # of smooth scenes alone, as in all that was recorded before the law had rough ones
    "scores": replace(LAWS["policy: quarter turn"], measure=smooth_quarter_turn),
}
"""Name in the results -> the law whose worst value it is."""
SIDE = 128
"""Pixels a side of the scenes that turn: one size for all that is recorded."""


def symmetry(policy: GraspPolicy, env: TurnableEnvironment, scenes: int, seed: int = 0) -> dict[str, Any]:
    """What is recorded of a policy's symmetry, as JSON.

    Args:
        policy: ready to act.
        env: of the task that it was trained on.
        scenes: of the simulator, in which the target alone is turned by whole bins.
        seed: of group elements and scenes, from 0 to 999.

    Returns:
        `kernel`: the worst relative violation of Eq. 7 by kappa(l), None without a kernel. `scores`: the worst
        relative change of any score when the whole scene turns by quarter turns. `turned`: of the scenes with room
        to turn the target, how many grasps `followed` g, their median error in `pixels` and `degrees` (None without a
        scene), and how many succeeded `before` and `after`; `crowded` scenes had no room.

    Raises:
        InputError: if there are no scenes.
    """
    errors: dict[str, float | None] = dict.fromkeys(MEASURED)
    subjects = shown_at(subjects_of(policy), SIDE)
    for name, row in MEASURED.items():
        for subject in subjects:
            if isinstance(subject, row.subject) and row.applies(subject) is None:
                errors[name] = row.judge(subject, cases(row.turns, CASES, seed)).to_dict()["value"]
    follow = proposition_1(policy.act, env, scenes, seed)
    trials = follow.trials
    return {
        **errors,
        "turned": {
            "scenes": len(trials),
            "crowded": follow.crowded,
            "followed": follow.followed.successes,
            "pixels": float(np.median([each.pixels for each in trials])) if trials else None,
            "degrees": float(np.median([each.off for each in trials])) if trials else None,
            "before": sum(each.success_before for each in trials),
            "after": sum(each.success_after for each in trials),
        },
    }


def shown_at(subjects: Sequence[KernelSubject | PolicySubject], side: int) -> list[KernelSubject | PolicySubject]:
    """The same, the policies shown squares of that side in pixels in every case."""
    return [replace(each, sides=(side,)) if isinstance(each, PolicySubject) else each for each in subjects]
