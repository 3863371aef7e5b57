"""Several processes that share a step do what one does with the whole of it; the loop never waits for its device."""

from __future__ import annotations

import contextlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pytest
import small
import torch
from children import children, is_alive
from folders import contents
from safetensors.torch import load_file
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from equigrasp.augmentation import Augmentation
from equigrasp.augmentation.examples import Draw, painted
from equigrasp.bench.device import Device, Timed, together
from equigrasp.cli import main
from equigrasp.errors import InputError, WorkerLostError
from equigrasp.grasp import Demonstration
from equigrasp.models import MODELS, build
from equigrasp.plan import LOG_EVERY, WEIGHTS, Training, read_plan
from equigrasp.policy import GraspPolicy
from equigrasp.training import CHECKPOINT, LOG, train
from equigrasp.training import loop as training_module
from equigrasp.training.devices import Devices, Process, Ranked
from equigrasp.training.loop import take_steps

SMALL = replace(small.SMALL, widths=(8, 8, 8, 8, 8), precision="float32")
BRIEF = Training(steps=56, seed=3, recombination=0.5, threads=1, checkpoint_every=50)
FEW = replace(BRIEF, steps=8)
TWO = pytest.mark.skipif(joblib.cpu_count() < 2, reason="two processes want two cores")


def apart(one: Path, other: Path) -> float:
    """The largest difference between two runs' averaged weights."""
    a, b = load_file(one / WEIGHTS), load_file(other / WEIGHTS)
    assert a.keys() == b.keys()
    return max(float((a[name] - b[name]).abs().max()) for name in a)


class Exact(Process):
    """The one process of a training in float64, where sums in another order differ by 1e-16 and not by 1e-7.

    Adam divides a gradient by its own size, and so makes of a rounding error in a gradient that is all but zero a
    step as long as any other.
    """

    def take(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        return tuple(each.double() if each.is_floating_point() else each for each in tensors)


class ExactRanked(Exact, Ranked):
    """One of several."""


class Deaf(ExactRanked):
    """One of several that draws what the first one draws."""

    def places(self, batch: int) -> range:
        return range(batch)


def exact_policy() -> GraspPolicy:
    return build(SMALL, BRIEF.seed).double()


def policy() -> GraspPolicy:
    return build(SMALL, BRIEF.seed)


def everything(process: Process, folder: Path, *rest: Any) -> str | None:
    """All that is to be found out of two processes: it takes long to start them."""
    assert isinstance(process, Ranked)
    for name, kind in (("shared", ExactRanked), ("deaf", Deaf)):
        take_steps(kind(process._fabric), exact_policy, FEW, *rest, folder / name, iter)
    take_steps(process, policy, BRIEF, *rest, folder / "at once", iter)
    for steps in (50, BRIEF.steps):
        take_steps(process, policy, replace(BRIEF, steps=steps), *rest, folder / "resumed", iter)
    return take_steps(process, policy, BRIEF, *rest, folder / "damaged", iter)


class DiesAt:
    """A progress bar in whose process a step kills the process."""

    def __init__(self, step: int) -> None:
        self.step = step

    def __call__(self, items: range) -> Iterator[int]:
        for item in items:
            if item == self.step:
                os._exit(9)
            yield item


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory, demonstrations: list[Demonstration]) -> Path:
    """Runs of one process, and of two, by what they are."""
    folder = tmp_path_factory.mktemp("devices")
    for name in ("whole", "shared", "deaf", "at once", "resumed", "damaged"):
        (folder / name).mkdir()
    (folder / "damaged" / CHECKPOINT).write_bytes(b"garbage")
    augmentation = Augmentation(demonstrations, BRIEF.recombination)
    embeddings = {instruction: policy().embed(instruction) for instruction in augmentation.instructions}
    together = replace(FEW, batch=2 * FEW.batch)
    take_steps(Exact(torch.device("cpu")), exact_policy, together, augmentation, embeddings, folder / "whole", iter)
    with pytest.raises(InputError, match="damaged or another model's") as error:
        Devices(count=2).run(everything, folder, augmentation, embeddings)
    assert "\n" not in str(error.value)
    return folder


@TWO
def test_two_processes_do_what_one_does_with_twice_the_batch(runs: Path) -> None:
    assert apart(runs / "whole", runs / "shared") < 1e-9
    assert sorted(contents(runs / "whole")) == sorted(contents(runs / "shared")) == [CHECKPOINT, LOG, WEIGHTS]


@TWO
def test_processes_that_draw_the_same_examples_would_be_noticed(runs: Path) -> None:
    """The law above fails for processes that do not know which they are."""
    assert apart(runs / "whole", runs / "deaf") > 1e-4


@TWO
def test_a_shared_training_that_is_gone_on_with_ends_with_the_same_bytes(runs: Path) -> None:
    assert contents(runs / "resumed") == contents(runs / "at once")


@TWO
@pytest.mark.slow
def test_a_shared_training_that_was_killed_ends_with_the_same_bytes(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    run, two = tmp_path / "run", Devices(count=2)
    with pytest.raises(WorkerLostError, match="one of 2 training processes died"):
        train(SMALL, BRIEF, demonstrations, data, run, DiesAt(53), two)
    assert (run / CHECKPOINT).exists()
    train(SMALL, BRIEF, demonstrations, data, run, devices=two)
    train(SMALL, BRIEF, demonstrations, data, tmp_path / "whole", devices=two)
    assert contents(run) == contents(tmp_path / "whole")


STARTED = """
import os, sys, time
from pathlib import Path
sys.path[:0] = sys.argv[2:]
from equigrasp.training.devices import Devices

def work(process, folder):
    (folder / str(os.getpid())).touch()
    while True:  # as a training does that nobody stops
        time.sleep(0.1)

if __name__ == "__main__":
    Devices(count=2).run(work, Path(sys.argv[1]))
"""


@TWO
@pytest.mark.parametrize(("way", "at_work"), [(signal.SIGTERM, False), (signal.SIGINT, True)], ids=str)
def test_processes_of_a_training_end_with_the_one_that_started_them(
    tmp_path: Path, way: signal.Signals, at_work: bool
) -> None:
    """Whether they have met yet or not, and though the signal reaches that one alone, as a scheduler's does."""
    script, folder = tmp_path / "started.py", tmp_path / "working"
    script.write_text(STARTED)
    folder.mkdir()
    process = subprocess.Popen(
        [sys.executable, str(script), str(folder), *sys.path],
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
        # a shell's background job inherits that Ctrl-C is ignored
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )
    ranks: list[int] = []
    try:
        while process.poll() is None and (len(ranks) < 2 or (at_work and len(list(folder.iterdir())) < 2)):
            ranks = children(process.pid, "spawn_main")
            time.sleep(0.05)
        assert len(ranks) == 2
        process.send_signal(way)
        process.wait(timeout=60)
        for _ in range(3600):  # three minutes: they look when they have imported torch
            if not any(map(is_alive, ranks)):
                break
            time.sleep(0.05)
        assert not any(map(is_alive, ranks))
    finally:
        for pid in [process.pid, *ranks]:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        process.wait()


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system knows no affinity")
def test_threads_are_of_the_cores_that_a_process_may_use_and_a_run_that_was_begun_keeps_its_own(
    tmp_path: Path, data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    row = "from dataclasses import replace\nfrom equigrasp.models import MODELS\n"
    row += "TINY = replace(MODELS['fcgq'], name='tiny', widths=(8, 8, 8, 8, 8), text_encoder='hashing')\n"
    (tmp_path / "tiny.py").write_text(row)
    monkeypatch.syspath_prepend(tmp_path)
    asked = ["train", "--data", str(data), "--model", "tiny:TINY", "--steps", "1", "--out"]
    before = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(before)})
        main([*asked, str(tmp_path / "one")])
    finally:
        os.sched_setaffinity(0, before)
    assert read_plan(tmp_path / "one")["training"]["threads"] == 1
    main([*asked, str(tmp_path / "three"), "--threads", "3"])
    finished = contents(tmp_path / "three")
    main([*asked, str(tmp_path / "three")])
    assert contents(tmp_path / "three") == finished


def test_a_run_belongs_to_its_devices(tmp_path: Path, data: Path, demonstrations: list[Demonstration]) -> None:
    """One processor is what runs had before there was a choice, and their plans say nothing of it."""
    train(SMALL, replace(BRIEF, steps=1), demonstrations, data, tmp_path / "run")
    assert "devices" not in read_plan(tmp_path / "run")
    with pytest.raises(InputError, match=r"was begun with devices None, not .*'count': 2"):
        train(SMALL, replace(BRIEF, steps=1), demonstrations, data, tmp_path / "run", devices=Devices(count=2))


def test_a_step_is_shared_out_among_its_processes(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations[:3], 0.5)
    step = Draw(augmentation, BRIEF.seed, range(6), painted)(5)
    for rank in range(3):
        process = Process(torch.device("cpu"))
        process.rank = rank
        places = process.places(2)
        for example, place in zip(Draw(augmentation, BRIEF.seed, places, painted)(5), places, strict=True):
            assert example.grasp == step[place].grasp
            assert np.array_equal(example.observation.height, step[place].observation.height)
    assert len({example.grasp for example in step}) == 6


def test_the_first_example_is_the_one_of_steps_of_one(demonstrations: list[Demonstration]) -> None:
    """Runs of batch 1 were drawn from (seed, step); they go on as they began."""
    augmentation = Augmentation(demonstrations[:3], 0.5)
    for step in range(8):
        before = augmentation.sample(np.random.default_rng([BRIEF.seed, step]))
        assert Draw(augmentation, BRIEF.seed, range(1), painted)(step)[0].grasp == before.grasp


class Waits(TorchDispatchMode):
    """Counts what makes the host wait for its device: a tensor that becomes a number."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        self.count += func is torch.ops.aten._local_scalar_dense.default
        return func(*args, **(kwargs or {}))


def waits_of_each_step(run: Path, data: Path, demonstrations: list[Demonstration]) -> list[int]:
    counts: list[int] = []

    def count(items: range) -> Iterable[int]:
        for item in items:
            before = waits.count
            yield item
            counts.append(waits.count - before)

    # what is made once for a size or a device is no part of a step
    train(SMALL, replace(BRIEF, steps=1), demonstrations, data, run / "first")
    with Waits() as waits:
        train(SMALL, BRIEF, demonstrations, data, run / "counted", count)
    logged = set(range(LOG_EVERY - 1, BRIEF.steps, LOG_EVERY))
    return [waited for step, waited in enumerate(counts) if step not in logged]


def test_no_step_waits_for_the_device(tmp_path: Path, data: Path, demonstrations: list[Demonstration]) -> None:
    assert waits_of_each_step(tmp_path, data, demonstrations) == [0] * 55


def test_a_loss_that_is_read_at_each_step_would_be_noticed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    loss_of = training_module.loss_of

    def read(logits: Tensor, labels: Tensor) -> Tensor:
        loss = loss_of(logits, labels)
        assert loss.item() > 0
        return loss

    monkeypatch.setattr(training_module, "loss_of", read)
    assert waits_of_each_step(tmp_path, data, demonstrations) == [1] * 55


@pytest.mark.parametrize("name", [name for name, row in MODELS.items() if row.encoder == "minilm"])
def test_every_weight_has_its_share_of_the_gradient(name: str) -> None:
    """DistributedDataParallel waits for the gradient of every trainable weight."""
    model = build(replace(MODELS[name], precision="float32"), seed=0)
    scene = torch.rand(1, 4, 32, 64, generator=torch.Generator().manual_seed(0))
    model.logits(scene, torch.ones(1, model.embedding_size)).logsumexp((1, 2, 3)).sum().backward()
    assert not [name for name, value in model.named_parameters() if value.requires_grad and value.grad is None]


def test_devices_that_are_not_there_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 0)
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    assert Devices.found("auto") == Devices("cpu", 1)
    for kind, count, sentence in (
        ("cuda", 1, "no GPU that torch sees"),
        ("cpu", 0, "--devices is 0, but it must be at least 1"),
        ("cpu", 3, "--devices is 3, but there are 2 processor cores"),
        ("tpu", 1, "there is no device 'tpu'"),
    ):
        with pytest.raises(InputError, match=sentence):
            Devices(kind, count)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    assert Devices.found("auto", 4) == Devices("cuda", 4)
    with pytest.raises(InputError, match="there are 4 GPUs"):
        Devices.found("auto", 5)


def test_several_devices_without_fabric_say_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(joblib, "cpu_count", lambda: 2)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[ddp\]'"):
        Devices(count=2)


def test_a_step_is_timed_on_any_device(capsys: pytest.CaptureFixture[str], data: Path) -> None:
    Device(device="cpu", models=("leg-steerable",), batches=(1, 2), steps=1).execute()
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [(line["model"], line["batch"], line["device"]) for line in lines] == [
        ("leg-steerable", 1, "cpu"),
        ("leg-steerable", 2, "cpu"),
    ]
    assert all(0 < line["host"] <= line["step"] for line in lines)
    Device(device="cpu", models=("leg-steerable",), batches=(1,), steps=1, data=data).execute()
    [line] = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert line["scenes"] == "recombined"
    with pytest.raises(InputError, match="must be at least 1"):
        Device(batches=(0,)).execute()


@TWO
def test_a_process_that_is_killed_does_not_leave_the_others_waiting() -> None:
    def kill_one() -> None:
        while not (started := multiprocessing.active_children()):
            time.sleep(0.1)
        started[0].kill()

    threading.Thread(target=kill_one).start()
    with pytest.raises(InputError, match="2 processes at once are too many for this device"):
        together(torch.device("cpu"), Timed("leg-steerable", 1, False, "float32", 1), 2)
