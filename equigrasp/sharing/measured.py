"""What was measured of a run's last weights, as its folder has it: for the card, and for whoever reads a run.

run/evaluations/*.json -> Measured;  equivariance.json -> Law
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from equigrasp.artefacts import read_json
from equigrasp.errors import InputError
from equigrasp.success import Rate

PROTOCOLS = {
    "single-shot": "one grasp in each of {scenes} unseen scenes",
    "paper": "the paper's, n + 1 trials for n goals in each of {scenes} unseen scenes",
}
"""A protocol -> how a card says it."""


@dataclass(frozen=True)
class Measured:
    """The rates of one evaluation of the shared weights.

    Attributes:
        task: name of the task.
        protocol: "single-shot" or "paper".
        phrasings: "seen" or "unseen".
        camera: "overhead" or "fused".
        seed: which scenes.
        scenes: how many.
        rates: name of a rate -> rate, the policy's.
        reward: the paper's mean reward; None for single shots.
        oracle: the scripted oracle's rate of right grasps on the same scenes; None if it was not measured.
    """

    task: str
    protocol: str
    phrasings: str
    camera: str
    seed: int
    scenes: int
    rates: Mapping[str, Rate]
    reward: float | None
    oracle: Rate | None


@dataclass(frozen=True)
class Law:
    """What one law of symmetry said of the policy or of its kernel."""

    name: str
    subject: str
    status: str
    value: float | None
    tolerance: float
    unit: str
    reason: str | None


def read_evaluations(run: Path, plan: Mapping[str, Any]) -> list[Measured]:
    """The evaluations of a run's last weights, from `run/evaluations/*.json`.

    Raises:
        InputError: if a file is damaged, or is another run's.
    """
    found = []
    for path in sorted((run / "evaluations").glob("*.json")):
        values = read_json(path, "an evaluation")
        if values.get("run") != plan:
            raise InputError(f"{path} is not an evaluation of this run; take it out of the folder")
        try:
            if values["step"] != plan["training"]["steps"]:
                continue
            found.append(_measured(values))
        except (KeyError, TypeError) as error:
            raise InputError(f"{path} is damaged: it is not an evaluation ({error}); evaluate again") from None
    return found


def _measured(values: Mapping[str, Any]) -> Measured:
    PROTOCOLS[values["protocol"]]
    rates = {
        name: Rate(rate["successes"], rate["trials"])
        for name, rate in values["policy"]["rates"].items()
        if isinstance(rate, dict)
    }
    reward = values["policy"]["rates"].get("reward")
    oracle = values["oracle"]["rates"]["correct"] if "oracle" in values else None
    return Measured(
        task=values["task"],
        protocol=values["protocol"],
        phrasings=values["phrasings"],
        camera=values["camera"],
        seed=values["seed"],
        scenes=values["policy"]["rates"].get("scenes", rates["correct"].trials),
        rates=rates,
        reward=reward,
        oracle=None if oracle is None else Rate(oracle["successes"], oracle["trials"]),
    )


def read_laws(report: Path, plan: Mapping[str, Any]) -> list[Law]:
    """The findings of `equigrasp equivariance`, from its equivariance.json; none if there is no such file.

    Raises:
        InputError: if the file is damaged, or is of another run.
    """
    if not report.exists():
        return []
    values = read_json(report, "a report of equivariance")
    if values.get("run") != plan:
        raise InputError(f"{report} is not of this run; `equigrasp equivariance --run` with its folder makes one")
    try:
        return [_law(finding) for finding in values["report"]["laws"]]
    except (KeyError, TypeError) as error:
        raise InputError(f"{report} is damaged: it is no report of equivariance ({error}); measure it again") from None


def _law(finding: Mapping[str, Any]) -> Law:
    verdict: dict[str, Any] = {"value": None, "tolerance": 0.0, "unit": ""}
    verdict.update(finding["verdict"] or {})
    return Law(
        name=finding["law"],
        subject=finding["subject"],
        status=finding["status"],
        value=verdict["value"],
        tolerance=verdict["tolerance"],
        unit=verdict["unit"],
        reason=finding["reason"],
    )
