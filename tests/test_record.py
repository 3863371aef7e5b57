"""What is recorded of a policy's symmetry tells policies apart by what they are made of, before any training."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from typing import Any

import pytest

from equigrasp.errors import InputError
from equigrasp.grasp import Grasp, Observation
from equigrasp.models import MODELS, build
from equigrasp.workspace import Motion
from equivariance_tests.record import symmetry
from tasks.env import GraspEnv

SCENES = 2


@pytest.fixture(scope="module")
def found(env: GraspEnv) -> dict[str, dict[str, Any]]:
    names = ("leg-equivariant", "leg-steerable", "leg-unet-no-steerability", "vit")
    return {
        name: symmetry(build(replace(MODELS[name], text_encoder="hashing"), seed=0), env, SCENES, seed=3)
        for name in names
    }


def test_a_kernel_without_steerability_is_told_from_one_with_it(found: dict[str, dict[str, Any]]) -> None:
    assert found["leg-steerable"]["kernel"] < 1e-3
    assert found["leg-unet-no-steerability"]["kernel"] > 0.1
    assert found["vit"]["kernel"] is None


def test_scores_turn_where_phi_turns_too(found: dict[str, dict[str, Any]]) -> None:
    assert found["leg-equivariant"]["scores"] < 1e-3
    assert found["leg-steerable"]["scores"] > 0.01
    assert found["vit"]["scores"] > 0.01


def test_scenes_are_turned_or_crowded(found: dict[str, dict[str, Any]], env: GraspEnv) -> None:
    for each in found.values():
        turned = each["turned"]
        assert turned["scenes"] + turned["crowded"] == SCENES
        assert max(turned["followed"], turned["before"], turned["after"]) <= turned["scenes"]
    policy = build(replace(MODELS["leg-steerable"], text_encoder="hashing"), seed=0)
    assert symmetry(policy, env, SCENES, seed=3) == found["leg-steerable"]
    with pytest.raises(InputError, match="must be at least 1"):
        symmetry(policy, env, 0)


class Told(GraspEnv):
    """The real environment, which says whether the target was turned since the scene was laid out."""

    turned = False

    def reset(self, **options: Any) -> Any:
        self.turned = False
        return super().reset(**options)

    def turn_target(self, angle: float) -> Motion:
        motion = super().turn_target(angle)
        self.turned = True
        return motion


@pytest.fixture
def told() -> Iterator[Told]:
    with closing(Told("pick-by-part", camera="overhead")) as env:
        yield env


@pytest.mark.parametrize("able", [False, True], ids=["as it was", "turned"])
def test_what_succeeds_before_and_after_is_told_apart(able: bool, told: Told, monkeypatch: pytest.MonkeyPatch) -> None:
    """An actor that knows everything in one of the two scenes, and grasps at a bare corner in the other."""
    policy = build(replace(MODELS["vit"], text_encoder="hashing"), seed=0)

    def act(observation: Observation, instruction: str) -> Grasp:
        return told.oracle()[0] if told.turned == able else Grasp(0, 0, 0)

    monkeypatch.setattr(policy, "act", act)
    monkeypatch.setattr("equivariance_tests.record.MEASURED", {})
    turned = symmetry(policy, told, SCENES, seed=3)["turned"]
    succeeded, failed = ("after", "before") if able else ("before", "after")
    assert turned[succeeded] > 0
    assert turned[failed] == 0
