"""A weight or a module that two parts share is one: in a training, in its files, in what is loaded from them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import pytest
import torch
from deaths import DiedError, die_after
from folders import contents
from safetensors.torch import load, load_file
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import language, models
from equigrasp.config import OwnConfig
from equigrasp.encoder import normalise
from equigrasp.grasp import Demonstration
from equigrasp.plan import WEIGHTS, Training
from equigrasp.policy import DensePolicy, GraspPolicy
from equigrasp.sharing.shareable import packed
from equigrasp.training import CHECKPOINT, load_policy, train
from equigrasp.training.step import State, buffers

BRIEF = Training(steps=70, seed=3, threads=1, checkpoint_every=50, keep_every=50)
TWICE = {"one.weight": "two.weight", "norm.weight": "again.weight", "norm.running_mean": "again.running_mean"}
"""Name of what is shared -> its other name, in the network."""


class Shared(nn.Module):
    """Two layers of one weight, and one layer with statistics of its own that is met twice."""

    stride = 2

    def __init__(self, embedding_size: int) -> None:
        super().__init__()
        self.stem, self.hear = nn.Conv2d(16, 8, 1), nn.Linear(embedding_size, 8)
        self.one, self.two = nn.Conv2d(8, 8, 3, padding=1), nn.Conv2d(8, 8, 3, padding=1)
        self.two.weight = self.one.weight
        self.norm = self.again = nn.BatchNorm2d(8)
        self.out = nn.Conv2d(8, 36, 1)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        x = self.norm(self.stem(functional.pixel_unshuffle(normalise(observation), 2)))
        x = functional.relu(self.one(x)) * (1 + self.hear(embedding * embedding.shape[1] ** 0.5))[..., None, None]
        return self.out(functional.relu(self.again(self.two(x))))


@dataclass(frozen=True, kw_only=True)
class SharedConfig(OwnConfig):
    def build(self) -> DensePolicy:
        return DensePolicy(Shared(language.width(self.encoder)), self.encoder, self.precision)


SHARED = SharedConfig(name="shared", summary="", text_encoder="hashing", precision="float32")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, data: Path, demonstrations: list[Demonstration]) -> Path:
    run = tmp_path_factory.mktemp("shared") / "run"
    train(SHARED, BRIEF, demonstrations, data, run)
    return run


def is_one(policy: GraspPolicy) -> bool:
    network = policy.get_submodule("network")
    assert isinstance(network, Shared)
    return network.one.weight is network.two.weight and network.norm is network.again


def scores(policy: GraspPolicy) -> Tensor:
    generator = torch.Generator().manual_seed(0)
    with torch.no_grad():
        return policy.eval().logits(
            torch.rand(1, 4, 64, 64, generator=generator), torch.randn(1, 512, generator=generator)
        )


def test_what_is_shared_is_trained_as_one_and_averaged_under_both_names(run: Path) -> None:
    checkpoint = load_file(run / CHECKPOINT)
    for weights in (run / WEIGHTS, run / "model-000050.safetensors"):
        tensors = load_file(weights)
        for name, other in TWICE.items():
            assert torch.equal(tensors[f"network.{name}"], tensors[f"network.{other}"])
    averages = {name.removeprefix("average."): each for name, each in checkpoint.items() if name.startswith("average.")}
    policy = load_policy(run)
    assert is_one(policy)
    # batch statistics are no average; a weight has one, by its first name
    assert averages.keys() == {name for name, _ in policy.named_parameters()}
    for name, weight in policy.named_parameters():
        assert torch.equal(weight, averages[name])
        assert not torch.equal(weight, checkpoint[f"weights.{name}"])


def test_an_interrupted_training_of_what_is_shared_ends_with_the_same_bytes(
    tmp_path: Path, run: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    with pytest.raises(DiedError):
        train(SHARED, BRIEF, demonstrations, data, tmp_path / "run", die_after(60))
    train(SHARED, BRIEF, demonstrations, data, tmp_path / "run")
    assert contents(tmp_path / "run") == contents(run)


def test_a_saved_policy_of_shared_weights_is_the_policy(run: Path, tmp_path: Path) -> None:
    policy = load_policy(run)
    policy.save_pretrained(tmp_path)
    loaded = GraspPolicy.from_pretrained(tmp_path)
    assert is_one(loaded)
    assert torch.equal(scores(loaded), scores(policy))
    assert (tmp_path / WEIGHTS).read_bytes() == (run / WEIGHTS).read_bytes()


def test_a_weight_is_no_buffer_under_its_other_name() -> None:
    policy = models.build(SHARED).train()
    statistics = {"running_mean", "running_var", "num_batches_tracked"}
    assert {name.rpartition(".")[2] for name in buffers(policy)} == statistics
    frozen = models.build(SHARED).train()
    frozen.get_submodule("network.norm").eval()
    assert not buffers(frozen)
    assert len(buffers(frozen, training=False)) == len(buffers(policy))


def test_what_is_averaged_has_the_names_of_the_policy() -> None:
    state = State(models.build(SHARED), replace(BRIEF, steps=1))
    with torch.no_grad():
        for value in state.average.values():
            value.fill_(7)
    averaged = state.averaged()
    assert averaged.keys() == state.policy.state_dict().keys()
    for name, value in averaged.items():
        assert bool((value == 7).all()) == (name not in buffers(state.policy))


def test_tensors_of_one_memory_are_written_whole() -> None:
    whole = torch.arange(12.0).view(3, 4)
    tensors = {"whole": whole, "again": whole, "row": whole[1], "column": whole[:, 1], "empty": whole[:0]}
    read = load(packed(tensors))
    assert read.keys() == tensors.keys()
    assert all(torch.equal(read[name], each) for name, each in tensors.items())
