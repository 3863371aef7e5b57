"""Acting: what is kept of an instruction is what would be made anew, and a batch is its members."""

from __future__ import annotations

import ctypes
import multiprocessing
import resource
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor, nn

from equigrasp import Grasp, Observation, kept, models
from equigrasp import policy as acting
from equigrasp.errors import InputError
from equigrasp.policy import DensePolicy, GraspPolicy, LegPolicy, to_tensor

WORDS = ["pick the mug by its handle", "grab the fork", "take the lion by its head"]


def small(name: str, seed: int = 0) -> GraspPolicy:
    return models.build(replace(models.MODELS[name], text_encoder="hashing", precision="float32"), seed).eval()


def leg(seed: int = 0) -> LegPolicy:
    policy = small("leg-steerable", seed)
    assert isinstance(policy, LegPolicy)
    return policy


def scene(seed: int) -> Observation:
    rng = np.random.default_rng(seed)
    color = rng.integers(0, 256, (64, 96, 3), dtype=np.uint8)
    return Observation(color, rng.uniform(0, 0.1, (64, 96)).astype(np.float32))


def counted(policy: LegPolicy) -> list[int]:
    """Grows by the batch at each kernel that is made."""
    made: list[int] = []
    policy.kappa.register_forward_pre_hook(lambda module, inputs: made.append(len(inputs[0])))
    return made


@torch.no_grad()
def anew(policy: GraspPolicy, observation: Observation, words: str) -> Grasp:
    """As acting is defined, with nothing kept."""
    scores = policy.logits(to_tensor(observation)[None], policy.embed(words)[None])[0]
    return policy.read_out(observation.shape).best(scores.numpy())


# Kept kernels


@settings(max_examples=15)
@given(st.lists(st.tuples(st.integers(0, 5), st.sampled_from(WORDS)), min_size=2, max_size=6))
def test_acting_with_what_was_kept_is_acting_anew(asked: list[tuple[int, str]]) -> None:
    policy = SHARED
    for seed, words in asked:
        assert policy.act(scene(seed), words) == anew(policy, scene(seed), words)


SHARED = leg(seed=5)


def test_a_kernel_is_made_once_for_an_instruction() -> None:
    policy = leg()
    made = counted(policy)
    for seed in range(3):
        for words in WORDS:
            policy.act(scene(seed), words)
    assert made == [1, 1, 1]


def test_what_is_kept_is_bit_for_bit_what_is_made() -> None:
    policy = leg()
    policy.act(scene(0), WORDS[0])
    (entry,) = policy._kept._entries.values()
    assert entry.kernel is not None
    with torch.no_grad():
        assert torch.equal(entry.kernel, policy.kappa(policy.embed(WORDS[0])[None]))


def by_adam(policy: LegPolicy) -> None:
    """A step of training in evaluation mode, which nobody should do and somebody will."""
    adam = torch.optim.Adam(policy.parameters(), lr=1e-2, fused=True)
    policy.logits(to_tensor(scene(0))[None], policy.embed(WORDS[0])[None]).square().mean().backward()
    adam.step()


def by_loading(policy: LegPolicy) -> None:
    policy.load_state_dict(leg(seed=1).state_dict())


def by_writing(policy: LegPolicy) -> None:
    with torch.no_grad():
        next(iter(policy.kappa.parameters())).mul_(-2)


def by_averaging(policy: LegPolicy) -> None:
    others = [each.detach() for each in leg(seed=1).parameters()]
    with torch.no_grad():
        torch._foreach_lerp_(list(policy.parameters()), others, 0.5)


def by_data(policy: LegPolicy) -> None:
    for parameter in policy.kappa.parameters():
        parameter.data.mul_(-1.5)


def by_buffers(policy: LegPolicy) -> None:
    """As a batch norm's: what a kernel is made from need not be a parameter."""
    for buffer in policy.kappa.buffers():
        buffer.mul_(-2)


CHANGES = [by_adam, by_loading, by_writing, by_averaging, by_data, by_buffers]


@pytest.mark.parametrize("change", CHANGES)
def test_a_kernel_is_not_kept_beyond_its_weights(change: Callable[[LegPolicy], None]) -> None:
    policy = leg()
    policy.act(scene(0), WORDS[0])
    change(policy)
    assert policy.act(scene(0), WORDS[0]) == anew(policy, scene(0), WORDS[0])


@pytest.mark.parametrize("change", CHANGES)
def test_a_kernel_that_is_kept_for_good_would_be_noticed(
    monkeypatch: pytest.MonkeyPatch, change: Callable[[LegPolicy], None]
) -> None:
    """The law above fails for a policy that never looks at its weights again."""
    monkeypatch.setattr(kept, "same", lambda weights, others: True)
    monkeypatch.setattr(kept.Kept, "clear", lambda self: None)
    policy = leg()
    policy.act(scene(0), WORDS[0])
    change(policy)
    assert policy.act(scene(0), WORDS[0]) != anew(policy, scene(0), WORDS[0])


def test_a_training_policy_keeps_nothing() -> None:
    policy = leg()
    made = counted(policy)
    policy.train()
    for _ in range(2):
        policy.act(scene(0), WORDS[0])
    assert made == [1, 1]
    assert policy.training


def test_another_kernel_or_precision_is_noticed() -> None:
    policy = leg()
    made = counted(policy)
    policy.act(scene(0), WORDS[0])
    policy.precision = "bfloat16"
    policy.act(scene(0), WORDS[0])
    assert made == [1, 1]
    policy.kappa = leg(seed=1).kappa
    assert policy.act(scene(0), WORDS[0]) == anew(policy, scene(0), WORDS[0])


def test_the_oldest_are_forgotten_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "MOST", 2)
    policy = leg()
    made = counted(policy)
    for index in (0, 1, 0, 2, 0, 1):  # the last has been forgotten for 2
        policy.act(scene(0), WORDS[index])
    assert made == [1, 1, 1, 1]
    assert len(policy._kept._entries) == 2
    policy.act_many([scene(0)] * 3, WORDS)
    assert len(policy._kept._entries) == 1


def test_a_gradient_never_meets_what_is_kept() -> None:
    policy = leg()
    policy.act(scene(0), WORDS[0])
    policy.logits(to_tensor(scene(0))[None], policy.embed(WORDS[0])[None]).sum().backward()
    assert all(each.grad is not None for each in policy.kappa.parameters())


# Batches


@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable", "leg-equivariant", "fcgq", "vit"])
def test_a_batch_is_scored_as_its_members(name: str) -> None:
    policy, scenes = small(name), [scene(seed) for seed in range(3)]
    batch, words = (
        torch.stack([to_tensor(each) for each in scenes]),
        torch.stack([policy.embed(each) for each in WORDS]),
    )
    with torch.no_grad():
        together = policy.logits(batch, words)
        alone = torch.cat([policy.logits(batch[i : i + 1], words[i : i + 1]) for i in range(3)])
    assert difference(together, alone) < 1e-5
    assert difference(together, alone.roll(1, dims=0)) > 1e-2
    for grasp, each, said in zip(policy.act_many(scenes, WORDS), scenes, WORDS, strict=True):
        other = policy.act(each, said)
        assert abs(grasp.u - other.u) + abs(grasp.v - other.v) < 0.01
        assert abs(grasp.theta - other.theta) < 0.001


def difference(one: Tensor, other: Tensor) -> float:
    return float((one - other).abs().max() / other.abs().max())


def test_batches_that_cannot_be_are_refused() -> None:
    policy = leg()
    assert policy.act_many([], []) == []
    with pytest.raises(InputError, match="2 scenes and 1 instructions"):
        policy.act_many([scene(0), scene(1)], WORDS[:1])
    wide = Observation(np.zeros((64, 128, 3), dtype=np.uint8), np.zeros((64, 128), dtype=np.float32))
    with pytest.raises(InputError, match="scenes of one batch have one shape"):
        policy.act_many([scene(0), wide], WORDS[:2])
    with pytest.raises(InputError, match="says what to grasp"):
        policy.act_many([scene(0)], [" "])


# Modes, dtypes, and what is not finite


@pytest.mark.parametrize("name", ["leg-steerable", "fcgq"])
def test_what_is_frozen_stays_frozen(name: str) -> None:
    policy = small(name).train()
    frozen = next(policy.children())
    frozen.eval()
    before = [each.training for each in policy.modules()]
    assert len(set(before)) == 2
    policy.act(scene(0), WORDS[0])
    policy.act_many([scene(0)] * 2, WORDS[:2])
    with pytest.raises(InputError, match="says what to grasp"):
        policy.act(scene(0), " ")
    assert [each.training for each in policy.modules()] == before


@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable", "leg-equivariant", "fcgq", "vit"])
def test_a_policy_acts_in_its_own_dtype(name: str) -> None:
    single = small(name).act(scene(0), WORDS[0])
    double = small(name).double()
    for _ in range(2):  # the second time with what was kept
        grasp = double.act(scene(0), WORDS[0])
        assert abs(grasp.u - single.u) + abs(grasp.v - single.v) < 0.05
        assert abs(grasp.theta - single.theta) < 0.01
    assert isinstance(small(name).bfloat16().act(scene(0), WORDS[0]), Grasp)


def test_a_policy_that_is_cast_makes_its_kernel_anew() -> None:
    policy = leg()
    policy.act(scene(0), WORDS[0])
    policy.double().act(scene(0), WORDS[0])
    (entry,) = policy._kept._entries.values()
    assert entry.kernel is not None
    assert entry.kernel.dtype == torch.float64


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_scores_of_which_none_is_the_best_are_refused(value: float) -> None:
    policy = leg()
    with torch.no_grad():
        next(policy.phi.parameters())[0, 0, 0, 0] = value
    with pytest.raises(InputError, match="LegPolicy makes scores of which none is the best"):
        policy.act(scene(0), WORDS[0])


def test_scores_of_one_scene_alone_are_refused_too() -> None:
    class Dark(nn.Module):
        stride = 2

        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            scores = observation.new_zeros(len(observation), 36, *(side // 2 for side in observation.shape[2:]))
            scores[observation.flatten(1).amax(dim=1) == 0] = torch.nan
            return scores

    policy = DensePolicy(Dark(), "hashing")
    dark = Observation(np.zeros((64, 96, 3), np.uint8), np.zeros((64, 96), np.float32))
    assert len(policy.act_many([scene(0), scene(1)], WORDS[:2])) == 2
    for scenes in ([dark, scene(0)], [scene(0), dark]):
        with pytest.raises(InputError, match="DensePolicy makes scores of which none is the best"):
            policy.act_many(scenes, WORDS[:2])


def test_the_best_of_what_is_not_forbidden_is_taken() -> None:
    """Minus infinity beside the best score leaves it at its own cell and angle."""
    policy = small("fcgq")
    assert isinstance(policy, DensePolicy)
    free = policy.act(scene(0), WORDS[0])
    read_out = policy.read_out(scene(0).shape)
    best = read_out.label(free)
    network = policy.network

    class Forbids(nn.Module):
        def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
            scores = network(observation, embedding)
            forbidden = torch.ones(scores.shape, dtype=torch.bool)
            forbidden.view(-1)[best] = False
            return scores.masked_fill(forbidden, -torch.inf)

    policy.network = Forbids()
    grasp = policy.act(scene(0), WORDS[0])
    assert read_out.label(grasp) == best
    assert abs(grasp.u - free.u) <= policy.stride


# Memory


def faults(keep: bool) -> float:
    """Pages of 4 KiB that an act asks the system for, the median of 15: the first ones have to."""
    disable_huge_pages = 41
    ctypes.CDLL(None).prctl(disable_huge_pages, 1, 0, 0, 0)
    if not keep:
        vars(acting)["keep_freed_memory"] = lambda: None
    policy = small("leg-equivariant")
    observation = Observation(np.zeros((160, 320, 3), dtype=np.uint8), np.zeros((160, 320), dtype=np.float32))
    found = []
    for _ in range(15):
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
        policy.act(observation, WORDS[0])
        found.append(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
    return float(np.median(found))


@pytest.mark.parametrize("keep", [True, False], ids=["as it is", "broken: what is freed is given back"])
def test_an_act_asks_the_system_for_no_memory(keep: bool) -> None:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        found = pool.submit(faults, keep).result()
    assert (found < 100) == keep, found
