"""Every model can learn one demonstration by heart: the right cell and the right bin for all of its grasps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from equigrasp.config import ClipConfig
from equigrasp.grasp import Demonstration
from equigrasp.models import MODELS, build
from equigrasp.policy import GraspPolicy, to_tensor
from equigrasp.workspace import WORKSPACE

QUICK = ("leg-unet", "leg-steerable", "leg-equivariant")
ROTATED = "cliport-rotator"
"""One step of its 72 turned copies takes 853 CPU-seconds (docs/models.md)."""


def learned(
    policy: GraspPolicy, observations: Tensor, embeddings: Tensor, labels: Tensor, epochs: int, learning_rate: float
) -> Tensor:
    """Which examples have their label as the best score, `(N,)`, after at most so many epochs of single examples."""
    adam = torch.optim.Adam([each for each in policy.parameters() if each.requires_grad], lr=learning_rate)
    generator = torch.Generator().manual_seed(0)
    for _ in range(epochs):
        for index in torch.randperm(len(labels), generator=generator).tolist():
            logits = policy.logits(observations[index, None], embeddings[index, None]).flatten(1)
            adam.zero_grad()
            torch.nn.functional.cross_entropy(logits, labels[index, None]).backward()
            adam.step()
        right = best(policy, observations, embeddings) == labels
        if right.all():
            break
    return right


def best(policy: GraspPolicy, observations: Tensor, embeddings: Tensor) -> Tensor:
    with torch.no_grad():
        each = zip(observations.split(1), embeddings.split(1), strict=True)
        return torch.cat([policy.logits(*pair).flatten(1).argmax(dim=1) for pair in each])


def examples(policy: GraspPolicy, demonstrations: Sequence[Demonstration]) -> tuple[Tensor, Tensor, Tensor]:
    read_out = policy.read_out(WORKSPACE.shape)
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
