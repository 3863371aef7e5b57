"""What was measured of a run's weights, as its folder has it: for the card, and for whoever reads a run.

run/evaluations/*.json, run/tests/*.json -> Measured;  equivariance.json -> Law
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from equigrasp.artefacts import read_json
from equigrasp.errors import InputError
from equigrasp.plan import TESTS, step_of
from equigrasp.success import MeanReward, Rate

PROTOCOLS = {
    "single-shot": "one grasp in each of {scenes} unseen scenes",
    "paper": "the paper's, n + 1 trials for n goals in each of {scenes} unseen scenes",
}
"""A protocol -> how a card says it."""


@dataclass(frozen=True)
class Measured:
    """The rates of one evaluation.

    Attributes:
        step: after how many steps of training the weights were.
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

    step: int
    task: str
    protocol: str
    phrasings: str
    camera: str
    seed: int
    scenes: int
    rates: Mapping[str, Rate]
    reward: MeanReward | None
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
    """What `equigrasp evaluate` and a study's tests measured of a run, each once, of all its weights.

    Raises:
        InputError: if a file is damaged, or is another run's.
    """
    found: list[Measured] = []
    for folder, read in (("evaluations", _of_evaluation), (TESTS, _of_test)):
        for path in sorted((run / folder).glob("*.json")):
            values = read_json(path, "an evaluation")
            try:
                if not (measured := read(values, plan)):
                    raise InputError(f"{path} is not an evaluation of this run; take it out of the folder")
            except (KeyError, TypeError) as error:
                raise InputError(
                    f"{path} is damaged: it is not an evaluation ({error}); take it out of the folder and measure again"
                ) from None
            found += measured
    # a step may have two names, the last one's and its number, and a study asks what `evaluate` asks with the oracle
    beside_oracle = [replace(each, oracle=None) for each in found if each.oracle]
    once: list[Measured] = []
    for each in found:
        if each not in once and each not in beside_oracle:
            once.append(each)
    return once


def _of_evaluation(values: Mapping[str, Any], plan: Mapping[str, Any]) -> list[Measured]:
    """What `equigrasp evaluate` wrote; nothing if it is another run's."""
    return [_measured(values, values["policy"], values["protocol"])] if values.get("run") == plan else []


def _of_test(values: Mapping[str, Any], plan: Mapping[str, Any]) -> list[Measured]:
    """What a study wrote, which measures by both protocols at once; nothing if it is another run's."""
    line, training = values["line"], plan["training"]
    own = {
        "model": plan["model"]["name"],
        "trained_on": plan["task"],
        "camera": plan["camera"],
        "data": plan.get("data"),
        "steps": training["steps"],
        "seed": training.get("seed"),
        "recombination": training.get("recombination"),
    }
    if any(line[key] != value for key, value in own.items()):
        return []
    said = {**line, "task": line["tested_on"], "step": line["checkpoint"]}
    protocols = {"single-shot": "single_shot", "paper": "paper"}
    return [_measured(said, values[key], protocol) for protocol, key in protocols.items() if key in values]


def _measured(values: Mapping[str, Any], result: Mapping[str, Any], protocol: str) -> Measured:
    if protocol not in PROTOCOLS:
        raise KeyError(protocol)
    rates = {
        name: Rate(rate["successes"], rate["trials"])
        for name, rate in result["rates"].items()
        if isinstance(rate, dict)
    }
    oracle = values["oracle"]["rates"]["correct"] if "oracle" in values else None
    reward = result["rates"].get("reward")
    return Measured(
        step=values["step"],
        task=values["task"],
        protocol=protocol,
        phrasings=values["phrasings"],
        camera=values["camera"],
        seed=values["seed"],
        scenes=result["rates"].get("scenes", rates["correct"].trials),
        rates=rates,
        reward=None if reward is None else MeanReward(reward, result["rates"]["scenes"]),
        oracle=None if oracle is None else Rate(oracle["successes"], oracle["trials"]),
    )


def report_folder(run: Path, step: int | None = None) -> Path:
    """Where `equigrasp equivariance` leaves its report on a run's weights."""
    return run / ("equivariance" if step is None else f"equivariance-step-{step}")


def read_laws(report: Path, plan: Mapping[str, Any], step: int) -> list[Law]:
    """The findings of `equigrasp equivariance`, from its equivariance.json; none if there is no such file.

    Args:
        report: the file.
        plan: of the run.
        step: whose weights it must be of.

    Raises:
        InputError: if the file is damaged, or is of another run or step.
    """
    if not report.exists():
        return []
    values = read_json(report, "a report of equivariance")
    if values.get("run") != plan:
        raise InputError(f"{report} is not of this run; `equigrasp equivariance --run` with its folder makes one")
    measured = values.get("step", step_of(plan))
    if measured != step:
        raise InputError(
            f"{report} is of the weights of step {measured}, but those of step {step} are shared; name a report on "
            "these, or leave --equivariance out"
        )
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
