"""A cell, one policy on one task, and the way in which it was made; `loading.py` reads them from recorded results."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from equigrasp.success import MeanReward, Rate


@dataclass(frozen=True, order=True)
class Way:
    """How a policy was made, but for its seed: cells of the same way are pooled.

    Attributes:
        model: the row's name.
        demos: demonstrations.
        steps: gradient steps.
        recombination: share of recombined examples.
        camera: of the observations.
        trained_on: the task.
        pretrained: whether its CLIP had learned anything; None where it has none.
        phrasings: of the tests.
        text_encoder: who read the instructions, where it was not the model's own encoder.
        read_out: "half" or "full", the resolution of the read-out where it was not the model's own.
        hard_negatives: share of recombined examples whose other objects are like the target.
        crowded: share of recombined examples in which objects stand where the hand would come down.
        apart: in words, settings that nothing above says, where the same task and seeds were run with several of them.
    """

    model: str
    demos: int
    steps: int
    recombination: float
    camera: str
    trained_on: str
    pretrained: bool | None = None
    phrasings: str = "seen"
    text_encoder: str | None = None
    read_out: str | None = None
    hard_negatives: float = 0.0
    crowded: float = 0.0
    apart: tuple[str, ...] = ()

    @property
    def recombined(self) -> dict[str, float]:
        """What was asked of its recombined examples, in words, and of which share of them."""
        asked = {"hard negatives": self.hard_negatives, "crowded": self.crowded}
        return {name: share for name, share in asked.items() if share}

    @property
    def otherwise(self) -> list[str]:
        """What is not as the model's row has it, in words."""
        return [*in_words(self.text_encoder, self.read_out), *self.apart]

    @property
    def unusual(self) -> list[str]:
        """The same, and before it the camera that is not overhead and the CLIP that learned nothing."""
        camera = [] if self.camera == "overhead" else [f"{self.camera} camera"]
        return [*camera, *(["CLIP not pretrained"] if self.pretrained is False else []), *self.otherwise]


@dataclass(frozen=True)
class Cell:
    """One policy on one task.

    Attributes:
        way: how it was made.
        task: what it was tested on.
        seeds: of its demonstrations and of its training.
        shots: by "grasped", "correct_object", "correct": single shots; empty without any.
        reward: mean reward in the paper's protocol, from 0 to 1; None without it.
        scenes: over how many scenes.
        failures: how many single shots failed in which way, in the judge's words.
        mistaken: for each goal that something else was lifted in place of, what and in how many single shots; None of
            results that were recorded before this was.
        checkpoints: by training step, single shots in validation scenes that reached the goal; those that a study
            chose its checkpoint by.
        symmetry: how equivariant the policy is, as `equivariance_tests.record` has it; None where it was not measured.
        settings: what else determined the result, by name.
    """

    way: Way
    task: str
    seeds: tuple[int, int]
    shots: Mapping[str, Rate]
    reward: float | None
    scenes: int
    failures: Mapping[str, int] = field(default_factory=dict)
    mistaken: Mapping[str, Mapping[str, int]] | None = None
    checkpoints: Mapping[int, Rate] = field(default_factory=dict)
    symmetry: Mapping[str, Any] | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)


KINDS = ("grasped", "correct_object", "correct")
FAILURES = ("nothing lifted", "wrong object", "several lifted", "wrong part")
"""The judge's words for what a grasp may be instead of a success."""
UNSPLIT = "wrong object or several"
"""Of results that were recorded before failures were counted by kind: their rates do not tell these two apart."""


def in_words(text_encoder: str | None, read_out: str | None) -> list[str]:
    """Who read, and at which resolution it was read out, where that is not None."""
    reader = [f"read by {text_encoder}"] if text_encoder else []
    return reader + ([f"{read_out}-resolution read-out"] if read_out else [])


def total(rates: Iterable[Rate]) -> Rate:
    """Several shares as one."""
    rates = list(rates)
    return Rate(sum(rate.successes for rate in rates), sum(rate.trials for rate in rates))


def pooled(cells: Iterable[Cell], kind: str = "correct") -> Rate | None:
    """One rate over several cells; None if none has single shots."""
    rates = [cell.shots[kind] for cell in cells if cell.shots]
    return total(rates) if rates else None


def mean_reward(cells: Iterable[Cell]) -> MeanReward | None:
    """Mean reward over all scenes of several cells; None if none has any."""
    counted = [(cell.reward, cell.scenes) for cell in cells if cell.reward is not None]
    scenes = sum(count for _, count in counted)
    return MeanReward(sum(reward * count for reward, count in counted) / scenes, scenes) if scenes else None
