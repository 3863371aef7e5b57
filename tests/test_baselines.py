"""The baselines: the same training, the same acting, the same laws as LEG; each can learn one demonstration."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from equigrasp import models
from equigrasp.config import FAMILIES, FcgqConfig, LegConfig, ModelConfig, VitConfig, differences
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Observation
from equigrasp.plan import PLAN, WEIGHTS, Training
from equigrasp.policy import DensePolicy, GraspPolicy, to_tensor
from equigrasp.training import load_policy, train
from equigrasp.workspace import WORKSPACE
from equivariance_tests.check import check_equivariance

SMALL: dict[str, ModelConfig] = {
    "fcgq": FcgqConfig(name="fcgq", summary="", widths=(16, 24, 32, 48, 64), text_encoder="hashing"),
    "vit": VitConfig(
        name="vit",
        summary="",
        width=96,
        depth=2,
        heads=4,
        language_tokens=2,
        widths=(64, 48, 32),
        text_encoder="hashing",
    ),
}
EXACT = {name: replace(config, precision="float32") for name, config in SMALL.items()}


def scenes(count: int, rows: int = 64, columns: int = 96) -> Tensor:
    noise = torch.rand(count, 4, rows, columns, generator=torch.Generator().manual_seed(0))
    return noise * torch.tensor([255, 255, 255, 0.1]).view(4, 1, 1)


def words(count: int, size: int = 512) -> Tensor:
    rows = torch.randn(count, size, generator=torch.Generator().manual_seed(1))
    return torch.nn.functional.normalize(rows)


# Learning


@pytest.mark.parametrize("name", SMALL)
def test_a_baseline_can_learn_a_few_grasps_to_the_pixel_and_bin(name: str, demonstrations: list[Demonstration]) -> None:
    few = demonstrations[:4]
    policy = models.build(SMALL[name], seed=0)
    observations = torch.stack([to_tensor(each.observation) for each in few])
    embeddings = torch.stack([policy.embed(each.instruction) for each in few])
    read_out = policy.read_out(WORKSPACE.shape)
    labels = torch.tensor([read_out.label(each.grasp) for each in few])
    adam = torch.optim.Adam(policy.parameters(), lr=3e-3)
    for _ in range(500):
        scores = policy.logits(observations, embeddings).flatten(1)
        loss = torch.nn.functional.cross_entropy(scores, labels)
        # with something to spare: acting computes the same in another order
        if torch.equal(scores.argmax(dim=1), labels) and loss < 0.1:
            break
        adam.zero_grad()
        loss.backward()
        adam.step()
    acted = [policy.act(each.observation, each.instruction) for each in few]
    assert [read_out.label(grasp) for grasp in acted] == labels.tolist()


@pytest.mark.parametrize("name", SMALL)
def test_one_training_loop_trains_them_all(
    name: str, tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    brief = Training(steps=20, seed=2, recombination=0.5, threads=1)
    policy = train(SMALL[name], brief, demonstrations, data, tmp_path / "run")
    assert json.loads((tmp_path / "run" / PLAN).read_text())["model"]["family"] == name
    again = train(SMALL[name], brief, demonstrations, data, tmp_path / "again")
    assert (tmp_path / "run" / WEIGHTS).read_bytes() == (tmp_path / "again" / WEIGHTS).read_bytes()
    each = demonstrations[0]
    grasp = load_policy(tmp_path / "run").act(each.observation, each.instruction)
    assert grasp == policy.act(each.observation, each.instruction) == again.act(each.observation, each.instruction)


# Laws


def test_a_fully_convolutional_network_moves_with_the_scene_and_does_not_turn() -> None:
    report = check_equivariance(
        models.build(EXACT["fcgq"], seed=0),
        laws=["policy: translation", "policy: quarter turn"],
        expected_failures={"policy: quarter turn": "nothing in it turns"},
    )
    assert report.passed, report


def test_a_transformer_that_is_told_places_owes_neither() -> None:
    report = check_equivariance(
        models.build(EXACT["vit"], seed=0),
        laws=["policy: translation", "policy: quarter turn"],
        expected_failures={
            "policy: translation": "attention is told each patch's place",
            "policy: quarter turn": "nothing in it turns",
        },
    )
    assert report.passed, report


def test_a_network_of_ones_own_is_a_policy() -> None:
    """Every score is the mean of its cell: turned and moved, it turns and moves; and its grasp is the brightest."""

    class Means(nn.Module):
        stride = 2

        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            return torch.nn.functional.avg_pool2d(observation.mean(dim=1, keepdim=True), 2).expand(-1, 36, -1, -1)

    policy = DensePolicy(Means(), "hashing")
    report = check_equivariance(policy, laws=["policy: translation", "policy: quarter turn"])
    assert report.passed, report
    color = np.zeros((64, 96, 3), dtype=np.uint8)
    color[20:22, 50:52] = 200
    grasp = policy.act(Observation(color, np.zeros((64, 96), dtype=np.float32)), "the white one")
    assert (grasp.u, grasp.v) == (50.5, 20.5)


# What every policy owes


@pytest.mark.parametrize("name", EXACT)
def test_the_instruction_and_the_scene_both_matter(name: str) -> None:
    policy = models.build(EXACT[name], seed=0)
    with torch.no_grad():
        a, b = policy(scenes(1).expand(2, -1, -1, -1), words(2))
        c, d = policy(scenes(2), words(1).expand(2, -1))
    assert (a - b).abs().max() > 1e-3
    assert (c - d).abs().max() > 1e-3


@pytest.mark.parametrize("name", EXACT)
def test_bfloat16_gives_float32_scores_that_agree_roughly(name: str) -> None:
    exact, rough = (models.build(replace(SMALL[name], precision=each), 0) for each in ("float32", "bfloat16"))
    with torch.no_grad():
        a, b = exact(scenes(1), words(1)), rough(scenes(1), words(1))
    assert b.dtype == torch.float32
    assert 0 < (a - b).abs().max() < 0.2 * a.abs().max()


def test_a_policy_must_say_how_it_scores() -> None:
    with pytest.raises(TypeError, match="abstract"):
        GraspPolicy(2)  # ty: ignore[abstract-class-instantiation]


# Configs


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_a_row_that_survives_json(family: str) -> None:
    rows = [row for row in models.MODELS.values() if row.family == family]
    assert rows
    for row in rows:
        written = json.loads(json.dumps(row.to_dict()))
        assert written["family"] == family
        assert ModelConfig.from_dict(written) == row
        assert type(replace(row, precision="float32")) is type(row)


def test_a_config_without_a_family_is_a_leg() -> None:
    old = {key: value for key, value in models.MODELS["leg-unet"].to_dict().items() if key != "family"}
    assert ModelConfig.from_dict(old) == models.MODELS["leg-unet"]
    with pytest.raises(InputError, match="no family of models 'fcqg'; did you mean 'fcgq'"):
        ModelConfig.from_dict(old | {"family": "fcqg"})
    with pytest.raises(InputError, match="setting of a model 'kernel'"):
        ModelConfig.from_dict(SMALL["fcgq"].to_dict() | {"kernel": "lifted"})


def test_a_difference_is_what_a_replace_did() -> None:
    row = models.MODELS["leg-unet"]
    assert differences(row, row) == {}
    assert isinstance(row, LegConfig)
    other = replace(row, kernel="plain", stride=1, name="mine", note="labels make no difference")
    assert differences(row, other) == {"kernel": ("lifted", "plain"), "stride": (2, 1)}
    across = differences(SMALL["fcgq"], SMALL["vit"])
    assert across["family"] == ("fcgq", "vit")
    assert across["patch"] == (None, 16)


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"patch": 12}, "power of two"),
        ({"patch": 8}, "2 doublings"),
        ({"widths": (64, 48)}, "3 doublings"),
        ({"widths": (64, 48, 30)}, "multiples of 8"),
        ({"width": 98}, "multiple of 4"),
        ({"heads": 5}, "of the 5 heads"),
        ({"depth": 0}, "has layers"),
    ],
    ids=str,
)
def test_a_transformer_that_cannot_be_is_refused(changes: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        models.build(replace(SMALL["vit"], **changes))


def test_a_scene_that_cannot_be_is_refused() -> None:
    policy = models.build(SMALL["vit"])
    with pytest.raises(InputError, match="multiples of 16, but this is"):
        policy(torch.zeros(1, 4, 60, 96), words(1))
    with pytest.raises(InputError, match="colour and height"):
        policy(torch.zeros(1, 3, 64, 96), words(1))
