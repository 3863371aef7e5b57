"""A training step on any device: `python -m equigrasp.bench.device --device cuda --batches 1 4 16`.

The step is training's own, on noise that lies on the host at first, or, with `--data`, on scenes of demonstrations put
together anew that the device paints itself, as it does in training. The host's share is the time until it has asked for
a step; what is left until the device has done it is the device's. On a processor they are one.
"""

from __future__ import annotations

import json
import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from multiprocessing import connection
from pathlib import Path
from typing import Any, Literal, cast

import torch
from torch import Tensor

from equigrasp.augmentation import Augmentation
from equigrasp.augmentation.examples import Draw
from equigrasp.demonstrations import load
from equigrasp.errors import InputError
from equigrasp.export import noise
from equigrasp.models import build, find
from equigrasp.plan import Training
from equigrasp.training.batch import with_pixels
from equigrasp.training.devices import Devices, Process
from equigrasp.training.loss import loss_of
from equigrasp.training.step import State
from equigrasp.workspace import WORKSPACE

DRAWN = 32
"""Batches of scenes that are drawn before the clock starts, and taken in turn: drawing goes on beside the steps."""
WARM_UP = 5
"""Steps before the clock starts: the first allocate and plan, and then the step is captured."""


class Uncaptured(Process):
    """The one process of a training, whose host asks for each kernel by itself."""

    def captured(self, work: Callable[..., Tensor]) -> Callable[..., Tensor]:
        """The work as it is."""
        return work


@dataclass(frozen=True)
class Timed:
    """What is timed: steps of a model.

    Attributes:
        model: its name.
        batch: examples a step.
        captured: whether as a CUDA graph, on a GPU.
        precision: of the convolutions.
        steps: how many, after `WARM_UP`.
        threads: torch threads of the host.
        data: demonstrations whose recombined scenes the device paints; None for noise from the host.
    """

    model: str
    batch: int
    captured: bool
    precision: str
    steps: int
    threads: int = 1
    data: Path | None = None


@dataclass
class Device:
    """Time training steps on a device, and print a JSON line for each model, batch and number of processes.

    Example: python -m equigrasp.bench.device --device cuda --models leg-unet --batches 1 4 --side-by-side 1 8
    """

    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where: auto takes a GPU if there is one."""
    models: tuple[str, ...] = ("leg-unet", "leg-steerable", "fcgq")
    """Names of models."""
    batches: tuple[int, ...] = (1, 4, 16)
    """Examples a step."""
    side_by_side: tuple[int, ...] = (1,)
    """Processes that train on the device at once, each a model of its own."""
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """Of the convolutions; auto is bfloat16 on a GPU."""
    steps: int = 20
    """Steps that are timed, after five that are not."""
    threads: int = 1
    """Torch threads of the host."""
    data: Path | None = None
    """A folder that `equigrasp collect` made: a GPU paints their scenes; a processor is given them painted."""

    def execute(self) -> None:
        """Print the lines.

        Raises:
            InputError: if there is no such device or model, a number is below 1, or `data` are no demonstrations.
        """
        if min((self.steps, self.threads, *self.batches, *self.side_by_side)) < 1:
            raise InputError("--steps, --threads, --batches and --side-by-side must be at least 1")
        for model in self.models:
            find(model)
        device = torch.device(Devices.found(self.device).kind)
        torch.set_num_threads(self.threads)
        # on a processor there is nothing to capture
        ways = (True, False) if device.type == "cuda" else (False,)
        for model in self.models:
            for batch in self.batches:
                for captured in ways:
                    timed = Timed(model, batch, captured, self.precision, self.steps, self.threads, self.data)
                    for processes in self.side_by_side:
                        found = measure(device, timed) if processes == 1 else together(device, timed, processes)
                        print(json.dumps(found), flush=True)


def measure(device: torch.device, timed: Timed, meet: Callable[[], object] = lambda: None) -> dict[str, Any]:
    """Milliseconds of a step: `host`, until it was asked for, and `step`, until it was done; `megabytes` at the peak.

    Args:
        device: where.
        timed: what.
        meet: called before the clock starts and before it stops; several processes wait for each other in it.
    """
    on_gpu = device.type == "cuda"
    if on_gpu:
        torch.cuda.reset_peak_memory_stats(device)
    process = Process(device) if timed.captured else Uncaptured(device)
    policy = build(replace(find(timed.model).untrained(), precision=timed.precision)).to(device).train()
    state = State(policy, Training(steps=timed.steps, seed=0, batch=timed.batch))
    noises = [noise(policy.embedding_size, WORKSPACE.shape, seed) for seed in range(timed.batch)]
    observations, embeddings = (torch.cat(each) for each in zip(*noises, strict=True))
    observe, batches = with_pixels().observe, [(observations,)]
    if timed.data is not None:
        augmentation = Augmentation(load(timed.data), recombination=1.0)
        feed = process.feed(augmentation)
        draw = Draw(augmentation, 0, range(timed.batch), feed.make)
        observe, batches = feed.observe, [feed.scenes(draw(step)) for step in range(DRAWN)]
    read_out = policy.read_out(WORKSPACE.shape)
    grasps = read_out.bins * read_out.rows * read_out.columns
    generator = torch.Generator().manual_seed(0)

    def descend(language: Tensor, labels: Tensor, *scenes: Tensor) -> Tensor:
        loss = loss_of(policy.logits(observe(*scenes), language), labels)
        state.descend(loss)
        return loss.detach()

    descended = process.captured(descend)

    def step() -> None:
        # others at each step: what is learned leaves gradients that a processor is slow at
        labels = torch.randint(grasps, (timed.batch,), generator=generator)
        descended(*process.take(embeddings, labels, *batches[state.step % len(batches)]))
        state.follow()

    for _ in range(WARM_UP):
        step()
    finish(device)
    meet()
    start = time.perf_counter()
    for _ in range(timed.steps):
        step()
    asked = time.perf_counter()
    finish(device)
    meet()
    done = time.perf_counter()
    return {
        "device": torch.cuda.get_device_name(device) if on_gpu else "cpu",
        "model": timed.model,
        "batch": timed.batch,
        "captured": timed.captured,
        "precision": timed.precision,
        "side_by_side": 1,
        "scenes": "noise" if timed.data is None else "recombined",
        "host": 1e3 * (asked - start) / timed.steps,
        "step": 1e3 * (done - start) / timed.steps,
        "megabytes": torch.cuda.max_memory_allocated(device) / 1e6 if on_gpu else None,
    }


def together(device: torch.device, timed: Timed, processes: int) -> dict[str, Any]:
    """As `measure`, of so many processes at once; `step` is the time in which the device does one step of any of them.

    Raises:
        InputError: if a process dies, as it does where the device's memory is too small for all.
    """
    context = multiprocessing.get_context("spawn")
    barrier, queue = context.Barrier(processes), context.SimpleQueue()
    workers = [context.Process(target=_measure, args=(device, timed, barrier, queue)) for _ in range(processes)]
    for worker in workers:
        worker.start()
    left = {worker.sentinel: worker for worker in workers}
    while left:
        for sentinel in connection.wait(list(left)):
            ended = left.pop(cast(int, sentinel))
            # the sentinel tells of a death before there is an exit code
            ended.join()
            if ended.exitcode:
                # they would wait for it at the barrier for ever
                for other in left.values():
                    other.kill()
    if any(worker.exitcode for worker in workers):
        raise InputError(f"{processes} processes at once are too many for this device; ask for fewer")
    found = [queue.get() for _ in workers]
    return {
        **found[0],
        "side_by_side": processes,
        "host": max(each["host"] for each in found),
        "step": max(each["step"] for each in found) / processes,
    }


def _measure(device: torch.device, timed: Timed, barrier: Any, queue: Any) -> None:
    torch.set_num_threads(timed.threads)
    queue.put(measure(device, timed, barrier.wait))


def finish(device: torch.device) -> None:
    """Wait until the device has done all that it was asked for."""
    if device.type == "cuda":
        torch.cuda.synchronize(device)


if __name__ == "__main__":
    import sys

    import tyro

    try:
        tyro.cli(Device).execute()
    except InputError as error:
        sys.exit(f"equigrasp: {error}")
