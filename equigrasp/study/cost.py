"""What a model costs: its parameters, and the time of a training step and of a grasp (the paper's Table 5).

Weights and scene are random, as neither changes the cost; CLIP's are not needed. Each model has a process of its own,
so that its memory is its own, and the time is the median, so that a neighbour on the machine spoils few of the steps.
"""

from __future__ import annotations

import statistics
import time
from typing import Any

import numpy as np

from equigrasp.bench.fresh import DidNotFitError, in_fresh_process, peak_memory
from equigrasp.errors import WorkerLostError
from equigrasp.grasp import Observation
from equigrasp.provenance import circumstances
from equigrasp.study.matrix import CostJob
from equigrasp.study.settings import check_unchanged
from equigrasp.workspace import WORKSPACE

WARM_UP = 2
"""Steps before the clock starts: the first allocate, plan and compile."""
LIMIT = 24 * 3600.0
"""Seconds after which a model is given up."""


def measure(job: CostJob) -> list[dict[str, Any]]:
    """The line of one model, for any engine.

    `seconds` has the medians of a step (an example to the updated weights, batch 1) and of a read-out from an
    observation to its 36 maps of scores; `memory` is the process's peak in bytes.

    Raises:
        InputError: if the model was edited since the job was made.
        WorkerLostError: if its process was killed, for its memory perhaps.
    """
    try:
        return in_fresh_process(_measured, job, limit=LIMIT)
    except DidNotFitError as error:
        raise WorkerLostError(f"it was not measured: {error}") from None


def _measured(job: CostJob) -> list[dict[str, Any]]:
    import torch

    from equigrasp.freed_memory import keep_freed_memory
    from equigrasp.models import build
    from equigrasp.plan import Training
    from equigrasp.policy import to_tensor
    from equigrasp.training.loss import loss_of
    from equigrasp.training.step import State

    check_unchanged(job.model.untrained(), job.settings)
    torch.set_num_threads(job.threads)
    keep_freed_memory()
    policy = build(job.model.untrained(), seed=0)
    state = State(policy, Training(steps=1, seed=0, threads=job.threads))
    rng = np.random.default_rng(0)
    rows, columns = WORKSPACE.shape
    observation = to_tensor(
        Observation(
            rng.integers(0, 256, (rows, columns, 3), dtype=np.uint8),
            rng.uniform(0, 0.1, (rows, columns)).astype(np.float32),
        )
    )[None]
    embedding = torch.nn.functional.normalize(
        torch.from_numpy(rng.standard_normal((1, policy.embedding_size)).astype(np.float32))
    )
    steps, readings = [], []
    policy.train()
    for _ in range(WARM_UP + job.timed):
        start = time.perf_counter()
        logits = policy.logits(observation, embedding)
        # another at each step: a label that is learned leaves gradients too small for float32's usual, fast form
        label = int(rng.integers(logits.numel()))
        state.update(loss_of(logits, torch.tensor([label])))
        steps.append(time.perf_counter() - start)
    policy.eval()
    with torch.inference_mode():
        for _ in range(WARM_UP + job.timed):
            start = time.perf_counter()
            policy.logits(observation, embedding)
            readings.append(time.perf_counter() - start)
    counts = {True: 0, False: 0}
    for parameter in policy.parameters():
        counts[parameter.requires_grad] += parameter.numel()
    return [
        {
            **job.cell(),
            **circumstances(),
            "parameters": counts[True],
            "frozen_parameters": counts[False],
            "memory": int(peak_memory() * 2**20),
            "seconds": {
                "step": statistics.median(steps[WARM_UP:]),
                "read_out": statistics.median(readings[WARM_UP:]),
            },
        }
    ]
