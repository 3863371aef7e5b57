"""A training step on any device: `python -m equigrasp.bench.device --device cuda --batches 1 4 16`.

The step is training's own, on noise that lies on the host at first, as real examples do. The host's share is the time
until it has asked for a step; what is left until the device has done it is the device's. On a processor they are one.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import torch

from equigrasp.devices import Devices, Process
from equigrasp.errors import InputError
from equigrasp.export import noise
from equigrasp.models import build, find
from equigrasp.plan import Training
from equigrasp.training import State, loss_of
from equigrasp.workspace import WORKSPACE

WARM_UP = 3
"""Steps before the clock starts: the first allocate, plan and compile."""


@dataclass
class Device:
    """Time training steps on a device, and print a JSON line for each model and batch.

    Example: python -m equigrasp.bench.device --device cuda --models leg-unet leg-steerable --batches 1 4 16
    """

    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where: auto takes a GPU if there is one."""
    models: tuple[str, ...] = ("leg-unet", "leg-steerable", "fcgq")
    """Names of models."""
    batches: tuple[int, ...] = (1, 4, 16)
    """Examples a step."""
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """Of the convolutions; auto is bfloat16 on a GPU."""
    steps: int = 20
    """Steps that are timed, after three that are not."""
    threads: int = 1
    """Torch threads of the host."""

    def execute(self) -> None:
        """Print the lines.

        Raises:
            InputError: if there is no such device or model, or a number is below 1.
        """
        if min((self.steps, self.threads, *self.batches)) < 1:
            raise InputError("--steps, --threads and --batches must be at least 1")
        devices = Devices.found(self.device)
        torch.set_num_threads(self.threads)
        for model in self.models:
            for batch in self.batches:
                found = measure(Process(torch.device(devices.kind)), model, batch, self.steps, self.precision)
                print(json.dumps(found), flush=True)


def measure(process: Process, model: str, batch: int, steps: int, precision: str = "auto") -> dict[str, Any]:
    """Milliseconds of a step: `host`, until it was asked for, and `step`, until it was done; `megabytes` at the peak.

    Args:
        process: its device is where.
        model: a model's name.
        batch: examples a step.
        steps: how many are timed.
        precision: of the convolutions.
    """
    policy = build(replace(find(model).untrained(), precision=precision)).to(process.device).train()
    state = State(policy, Training(steps=steps, seed=0, batch=batch))
    scenes = [noise(policy.embedding_size, WORKSPACE.shape, seed) for seed in range(batch)]
    observations, embeddings = (torch.cat(each) for each in zip(*scenes, strict=True))
    labels = torch.arange(batch)

    def step() -> None:
        scene, language, label = process.take(observations, embeddings, labels)
        state.update(loss_of(policy.logits(scene, language), label))

    for _ in range(WARM_UP):
        step()
    finish(process.device)
    start = time.perf_counter()
    for _ in range(steps):
        step()
    asked = time.perf_counter()
    finish(process.device)
    done = time.perf_counter()
    on_gpu = process.device.type == "cuda"
    return {
        "device": torch.cuda.get_device_name(process.device) if on_gpu else "cpu",
        "model": model,
        "batch": batch,
        "precision": precision,
        "host": 1e3 * (asked - start) / steps,
        "step": 1e3 * (done - start) / steps,
        "megabytes": torch.cuda.max_memory_allocated(process.device) / 1e6 if on_gpu else None,
    }


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
