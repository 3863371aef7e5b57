"""Training resumes bit for bit, learns, and refuses what is damaged."""

from __future__ import annotations

import functools
import itertools
import json
import multiprocessing
import threading
from collections.abc import Callable, Generator, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from deaths import DiedError, die_after
from folders import contents
from safetensors.torch import load_file
from small import SMALL
from torch import nn

from equigrasp.artefacts import alone
from equigrasp.augmentation import Augmentation
from equigrasp.augmentation.examples import Draw, ahead, in_turn, painted
from equigrasp.demonstrations import load
from equigrasp.engines.in_order import in_order
from equigrasp.errors import BusyError, InputError
from equigrasp.grasp import Demonstration
from equigrasp.models import MODELS, ModelConfig, build
from equigrasp.plan import PLAN, WEIGHTS, Training, kept_weights, read_plan
from equigrasp.policy import DensePolicy
from equigrasp.training import CHECKPOINT, LOG, load_policy, train
from equigrasp.training.devices import Process
from equigrasp.training.loop import take_steps
from equigrasp.training.step import State

BRIEF = Training(steps=120, seed=3, recombination=0.5, threads=1, checkpoint_every=50, keep_every=100)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, data: Path, demonstrations: list[Demonstration]) -> Path:
    run = tmp_path_factory.mktemp("training") / "run"
    train(SMALL, BRIEF, demonstrations, data, run)
    return run


def test_an_interrupted_training_ends_with_the_same_bytes(
    tmp_path: Path, finished: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    run = tmp_path / "run"
    for steps in (30, 80, 10):  # before the first checkpoint, after the kept weights, within a log line
        with pytest.raises(DiedError):
            train(SMALL, BRIEF, demonstrations, data, run, die_after(steps))
    train(SMALL, BRIEF, demonstrations, data, run)
    assert contents(run) == contents(finished)


def test_a_resume_without_adams_moments_would_be_noticed(
    tmp_path: Path, finished: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    """The law above fails for a broken checkpoint, one that forgets the moments."""
    from safetensors.torch import save_file

    run = tmp_path / "run"
    with pytest.raises(DiedError):
        train(SMALL, BRIEF, demonstrations, data, run, die_after(60))
    tensors = load_file(run / CHECKPOINT)
    forgotten = {name: torch.zeros_like(value) if ".exp_avg" in name else value for name, value in tensors.items()}
    save_file(forgotten, run / CHECKPOINT)
    train(SMALL, BRIEF, demonstrations, data, run)
    assert contents(run)[WEIGHTS] != contents(finished)[WEIGHTS]


class Chancy(nn.Module):
    """A network of a user's own: batch statistics, dropout, and a weight that nothing uses."""

    stride = 2

    def __init__(self) -> None:
        super().__init__()
        self.see, self.norm = nn.Conv2d(4, 36, 3, stride=2, padding=1), nn.BatchNorm2d(36)
        self.spare = nn.Parameter(torch.ones(3))

    def forward(self, observation: torch.Tensor, embedding: torch.Tensor) -> torch.Tensor:
        scores = self.norm(self.see(observation / 100)) * (1 + embedding.mean(dim=1)).view(-1, 1, 1, 1)
        return nn.functional.dropout(scores, 0.3, self.training)


def chancy() -> DensePolicy:
    with torch.random.fork_rng([]):
        torch.manual_seed(0)
        policy = DensePolicy(Chancy(), "hashing")
    policy.config = SMALL
    return policy


def test_a_module_with_chance_and_statistics_of_its_own_goes_on_to_the_same_bytes(
    tmp_path: Path, demonstrations: list[Demonstration]
) -> None:
    brief = replace(BRIEF, steps=70, keep_every=0)
    augmentation = Augmentation(demonstrations, 0.0)
    embeddings = {sentence: chancy().embed(sentence) for sentence in augmentation.instructions}

    def go_on(run: Path, progress: Callable[[range], Iterable[int]] = iter) -> None:
        run.mkdir(exist_ok=True)
        wrong = take_steps(Process(torch.device("cpu")), chancy, brief, augmentation, embeddings, run, progress)
        assert wrong is None, wrong

    torch.manual_seed(5)
    expected = torch.rand(1)
    torch.manual_seed(5)
    go_on(tmp_path / "whole")
    assert torch.equal(torch.rand(1), expected), "the caller's own generator is left as it was"
    with pytest.raises(DiedError):
        go_on(tmp_path / "killed", die_after(60))
    torch.manual_seed(1)  # whatever another process begins with
    go_on(tmp_path / "killed")
    assert contents(tmp_path / "killed") == contents(tmp_path / "whole")
    saved = load_file(tmp_path / "whole" / CHECKPOINT)
    assert saved["buffers.network.norm.num_batches_tracked"] == 70


def fail_at_two(step: int) -> int:
    if step == 2:
        raise DiedError
    return step


def drawers() -> set[object]:
    """Threads and processes that draw examples now."""
    threads = [each for each in threading.enumerate() if each.name.startswith("ahead")]
    return {*threads, *multiprocessing.active_children()}


@pytest.mark.parametrize("drawing", [ahead, in_turn, functools.partial(in_order, workers=2)])
def test_examples_are_drawn_in_order_and_what_goes_wrong_arrives(
    demonstrations: list[Demonstration], drawing: Callable[..., Generator]
) -> None:
    before = drawers()  # others' that nobody has collected yet
    augmentation = Augmentation(demonstrations[:3], BRIEF.recombination)
    draw = Draw(augmentation, BRIEF.seed, range(2), painted)
    for step, examples in enumerate(drawing(draw, range(5))):
        for example, again in zip(examples, draw(step), strict=True):
            assert example.instruction == again.instruction
            assert example.grasp == again.grasp
            assert np.array_equal(example.observation.color, again.observation.color)

    results = drawing(fail_at_two, itertools.count())
    assert [next(results), next(results)] == [0, 1]
    with pytest.raises(DiedError):
        next(results)
    unfinished = drawing(fail_at_two, range(2))
    assert next(unfinished) == 0
    unfinished.close()
    assert not drawers() - before


def test_training_again_changes_nothing(finished: Path, data: Path, demonstrations: list[Demonstration]) -> None:
    before = contents(finished)
    train(SMALL, BRIEF, demonstrations, data, finished)
    assert contents(finished) == before


def test_two_trainings_in_a_folder_are_refused(finished: Path, data: Path, demonstrations: list[Demonstration]) -> None:
    before = contents(finished)
    with alone(finished, "training"), pytest.raises(BusyError, match="another training is at work in"):
        train(SMALL, BRIEF, demonstrations, data, finished)
    assert contents(finished) == before


def test_the_loss_falls(finished: Path) -> None:
    losses = [json.loads(line)["loss"] for line in (finished / LOG).read_text().splitlines()]
    assert losses[1] < losses[0]


def test_a_loaded_policy_acts_as_the_trained_one(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    policy = train(SMALL, replace(BRIEF, steps=1), demonstrations, data, tmp_path / "run")
    loaded = load_policy(tmp_path / "run")
    each = demonstrations[0]
    assert loaded.act(each.observation, each.instruction) == policy.act(each.observation, each.instruction)


def test_weights_on_the_way_are_kept(finished: Path) -> None:
    assert load_policy(finished, step=100).state_dict().keys() == load_policy(finished).state_dict().keys()
    with pytest.raises(InputError, match=r"no weights model-000070.*model-000100"):
        load_policy(finished, step=70)


class Diverges(nn.Module):
    """A network of a user's own whose scores are finite for so many passes, and then no more."""

    stride = 2

    def __init__(self, passes: int) -> None:
        super().__init__()
        self.see, self.passes, self.passed = nn.Conv2d(4, 36, 3, stride=2, padding=1), passes, 0

    def forward(self, observation: torch.Tensor, embedding: torch.Tensor) -> torch.Tensor:
        self.passed += 1
        return self.see(observation) if self.passed <= self.passes else self.see(observation) * torch.inf


@pytest.mark.parametrize(("finite", "steps"), [(2, 60), (52, 60)], ids=["where it logs", "after the last line"])
def test_a_loss_that_is_not_finite_ends_the_training_in_one_sentence(
    finite: int, steps: int, tmp_path: Path, demonstrations: list[Demonstration]
) -> None:
    policy, training = DensePolicy(Diverges(finite), "hashing"), replace(BRIEF, steps=steps, keep_every=0)
    policy.config = SMALL
    augmentation = Augmentation(demonstrations, 0.0)
    embeddings = {sentence: policy.embed(sentence) for sentence in augmentation.instructions}
    wrong = take_steps(Process(torch.device("cpu")), lambda: policy, training, augmentation, embeddings, tmp_path, iter)
    assert wrong is not None
    assert wrong.startswith(f"the loss of step {finite + 1} is nan")
    assert "--learning-rate" in wrong
    assert not (tmp_path / WEIGHTS).exists()
    assert "NaN" not in (tmp_path / LOG).read_text()


def test_a_model_is_trained_at_its_own_learning_rate(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    slow = replace(MODELS["vit"], text_encoder="hashing")
    assert slow.learning_rate != SMALL.learning_rate
    for model in (SMALL, slow):
        train(model, Training(steps=1, seed=0, threads=1), demonstrations, data, tmp_path / model.name)
        assert read_plan(tmp_path / model.name)["training"]["learning_rate"] == model.learning_rate
        state = State(build(model, 0), Training(steps=1, seed=0))
        assert state.adam.learning_rate == model.learning_rate
    # named or not, it is the same training
    train(
        slow,
        Training(steps=1, seed=0, learning_rate=slow.learning_rate, threads=1),
        demonstrations,
        data,
        tmp_path / slow.name,
    )


@pytest.mark.parametrize(
    "given",
    [lambda all: all[:3], lambda all: [*all[1:], all[0]], lambda all: [*all[:-1], reworded(all[-1])]],
    ids=["a few", "in another order", "with other words"],
)
def test_demonstrations_of_another_folder_are_refused(
    given: Callable[[list[Demonstration]], list[Demonstration]],
    tmp_path: Path,
    data: Path,
    demonstrations: list[Demonstration],
) -> None:
    with pytest.raises(InputError, match=r"are not the 23 of .*demonstrations\.store"):
        train(SMALL, BRIEF, given(demonstrations), data, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def reworded(demonstration: Demonstration) -> Demonstration:
    return replace(demonstration, instruction="pick up something else")


def test_weights_are_the_same_bits_whatever_torchs_default_dtype_is(tmp_path: Path, data: Path) -> None:
    made = []
    for dtype in (torch.float32, torch.float64):
        run = tmp_path / str(dtype)
        torch.set_default_dtype(dtype)
        try:
            train(SMALL, Training(steps=2, seed=0, threads=1), load(data), data, run)
            assert torch.get_default_dtype() == dtype
        finally:
            torch.set_default_dtype(torch.float32)
        made.append((run / WEIGHTS).read_bytes())
    assert made[0] == made[1]


def test_folders_may_be_strings_and_threads_are_given_back(tmp_path: Path, data: Path) -> None:
    before = torch.get_num_threads()
    other = 2 if before == 1 else 1
    train(SMALL, Training(steps=1, seed=0, threads=other), load(str(data)), str(data), str(tmp_path / "run"))
    assert torch.get_num_threads() == before


def test_numbers_of_numpy_are_numbers(tmp_path: Path, data: Path, demonstrations: list[Demonstration]) -> None:
    numbers: dict[str, Any] = {
        "steps": np.int64(1),
        "seed": np.uint8(3),
        "learning_rate": np.float32(0.001),
        "recombination": np.float64(0.5),
    }
    swept = Training(**numbers, threads=1)
    train(SMALL, swept, demonstrations, data, tmp_path / "run")
    training = read_plan(tmp_path / "run")["training"]
    assert Training(**training) == swept
    assert training["steps"] == 1


def test_another_plan_is_refused(finished: Path, data: Path, demonstrations: list[Demonstration]) -> None:
    before = contents(finished)
    with pytest.raises(InputError, match="was begun with training"):
        train(SMALL, replace(BRIEF, seed=4), demonstrations, data, finished)
    assert contents(finished) == before


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"steps": 0}, "--steps is 0"),
        ({"batch": 0}, "--batch is 0"),
        ({"seed": -1}, "--seed is -1"),
        ({"learning_rate": -1.0}, "--learning-rate"),
        ({"checkpoint_every": 30}, "--checkpoint-every is 30"),
        ({"checkpoint_every": 0}, "--checkpoint-every is 0"),
        ({"steps": 4.0}, r"--steps is 4\.0, but it must be a whole number"),
        ({"steps": "4"}, "--steps is '4', but it must be a whole number"),
        ({"crowded": "0.4"}, r"--crowded is '0\.4', but it must be a number"),
        ({"learning_rate": [1e-3]}, r"--learning-rate is \[0\.001\], but it must be a number"),
    ],
)
def test_settings_out_of_range_are_refused(changes: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        replace(BRIEF, **changes)


def spoil(run: Path, name: str, content: bytes | None) -> None:
    if content is None:
        (run / name).unlink()
    else:
        (run / name).write_bytes(content)


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        (WEIGHTS, None, "no weights"),
        (WEIGHTS, b"garbage", "damaged or another"),
        (PLAN, None, "not a run folder"),
        (PLAN, b"{}", "damaged"),
        (PLAN, b"{", "damaged"),
    ],
)
def test_a_damaged_run_is_one_sentence(
    tmp_path: Path, finished: Path, name: str, content: bytes | None, sentence: str
) -> None:
    import shutil

    run = tmp_path / "run"
    shutil.copytree(finished, run)
    spoil(run, name, content)
    with pytest.raises(InputError, match=sentence) as error:
        load_policy(run)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("content", [b"garbage", b"", None], ids=["garbage", "empty", "another model's"])
def test_a_corrupt_checkpoint_is_one_sentence(
    tmp_path: Path, finished: Path, data: Path, demonstrations: list[Demonstration], content: bytes | None
) -> None:
    import shutil

    run = tmp_path / "run"
    shutil.copytree(finished, run)
    (run / WEIGHTS).unlink()
    (run / CHECKPOINT).write_bytes((run / kept_weights(100)).read_bytes() if content is None else content)
    with pytest.raises(InputError, match="damaged or another model's"):
        train(SMALL, BRIEF, demonstrations, data, run)


def test_batches_train_too(tmp_path: Path, data: Path, demonstrations: list[Demonstration]) -> None:
    train(SMALL, replace(BRIEF, steps=2, batch=3), demonstrations, data, tmp_path / "run")
    assert (tmp_path / "run" / WEIGHTS).exists()


@pytest.mark.parametrize("name", MODELS)
def test_every_model_is_its_config(name: str) -> None:
    assert ModelConfig.from_dict(json.loads(json.dumps(MODELS[name].to_dict()))) == MODELS[name]
