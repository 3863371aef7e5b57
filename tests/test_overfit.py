"""Every model can learn one demonstration by heart: the right cell and the right bin for all of its grasps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from equigrasp.collection import Collection, draw_goals
from equigrasp.config import ClipConfig
from equigrasp.demonstrations import collect, load
from equigrasp.grasp import Demonstration, Observation
from equigrasp.models import MODELS, build
from equigrasp.policy import GraspPolicy, to_tensor
from equigrasp.training.adam import Adam
from tasks import TASKS
from tasks.env import GraspEnv

QUICK = ("leg-unet", "leg-steerable", "leg-equivariant")
ROTATED = "cliport-rotator"
"""A step of its 36 turned copies takes 35 s (docs/speed.md): it sees windows of its demonstration."""
WINDOW = 88
"""Pixels: every turn of such a window fits on a square of 128."""


def learned(
    policy: GraspPolicy, observations: Tensor, embeddings: Tensor, labels: Tensor, epochs: int, learning_rate: float
) -> Tensor:
    """Which examples have their label as the best score, `(N,)`, after at most so many epochs of single examples."""
    adam = Adam({name: each for name, each in policy.named_parameters() if each.requires_grad}, learning_rate)
    generator = torch.Generator().manual_seed(0)
    for _ in range(epochs):
        on_the_way = 0
        for index in torch.randperm(len(labels), generator=generator).tolist():
            logits = policy.logits(observations[index, None], embeddings[index, None]).flatten(1)
            on_the_way += int(logits.argmax() == labels[index])
            policy.zero_grad()
            torch.nn.functional.cross_entropy(logits, labels[index, None]).backward()
            adam.step()
        # to ask them all again takes a quarter of an epoch: not before most were right when their turn came
        if 4 * on_the_way >= 3 * len(labels) and (best(policy, observations, embeddings) == labels).all():
            break
    return best(policy, observations, embeddings) == labels


def best(policy: GraspPolicy, observations: Tensor, embeddings: Tensor) -> Tensor:
    with torch.no_grad():
        each = zip(observations.split(1), embeddings.split(1), strict=True)
        return torch.cat([policy.logits(*pair).flatten(1).argmax(dim=1) for pair in each])


def examples(policy: GraspPolicy, demonstrations: Sequence[Demonstration]) -> tuple[Tensor, Tensor, Tensor]:
    read_out = policy.read_out(demonstrations[0].observation.shape)
    return (
        torch.stack([to_tensor(each.observation) for each in demonstrations]),
        torch.stack([policy.embed(each.instruction) for each in demonstrations]),
        torch.tensor([read_out.label(each.grasp) for each in demonstrations]),
    )


@pytest.mark.parametrize(
    "name",
    [
        *QUICK,
        *(pytest.param(name, marks=pytest.mark.slow) for name in MODELS if name not in (*QUICK, ROTATED)),
    ],
)
def test_a_model_learns_one_demonstration_to_the_cell_and_bin(name: str, demonstrations: list[Demonstration]) -> None:
    row = replace(MODELS[name], text_encoder="hashing")
    if isinstance(row, ClipConfig):
        row = replace(row, clip_weights="random")
    policy = build(row, seed=0)
    assert len(demonstrations) == 23
    assert learned(policy, *examples(policy, demonstrations), epochs=120, learning_rate=2 * row.learning_rate).all()


@pytest.mark.slow
def test_the_rotator_learns_one_demonstration_by_windows_of_its_scenes(tmp_path: Path) -> None:
    task = TASKS["pick-fruit"]
    fruit = Collection(task.name, draw_goals(task.demonstration_goals, demos=1, seed=0), seed=0, camera="overhead")
    collect(fruit, lambda: GraspEnv(task.name, camera="overhead"), tmp_path / "data")
    rng = np.random.default_rng(0)
    windows = [window(each, rng) for each in load(tmp_path / "data")]
    assert len(windows) == 6
    policy = build(replace(MODELS[ROTATED], text_encoder="hashing", clip_weights="random"), seed=0)
    assert learned(policy, *examples(policy, windows), epochs=120, learning_rate=3e-4).all()


def window(demonstration: Demonstration, rng: np.random.Generator) -> Demonstration:
    """A square of its scene with the grasp somewhere in its middle half."""
    observation, grasp = demonstration.observation, demonstration.grasp
    quarter = WINDOW // 4
    left, top = (
        int(np.clip(round(centre) - rng.integers(quarter, 3 * quarter), 0, side - WINDOW))
        for centre, side in ((grasp.u, observation.shape[1]), (grasp.v, observation.shape[0]))
    )
    part = np.s_[top : top + WINDOW, left : left + WINDOW]
    return replace(
        demonstration,
        observation=Observation(observation.color[part], observation.height[part]),
        grasp=replace(grasp, u=grasp.u - left, v=grasp.v - top),
    )


def test_a_policy_that_hears_nothing_cannot_tell_two_goals_of_one_scene_apart(
    demonstrations: list[Demonstration],
) -> None:
    one = demonstrations[0]
    scene = [one, replace(one, grasp=demonstrations[1].grasp, instruction=demonstrations[1].instruction)]
    row = replace(MODELS["leg-steerable"], text_encoder="hashing", kernel_size=17, maximum_frequency=4)
    deaf = replace(row, kernel_language=False, phi_language=False)
    for config, right in ((row, 2), (deaf, 1)):
        policy = build(config, seed=0)
        found = learned(policy, *examples(policy, scene), epochs=60, learning_rate=1e-3)
        assert int(found.sum()) <= right
        assert found.all() == (config is row)
