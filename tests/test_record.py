"""What is recorded of a policy's symmetry tells policies apart by what they are made of, before any training."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from equigrasp.errors import InputError
from equigrasp.models import MODELS, build
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
