"""Train a policy from demonstrations, and go on bit for bit where a killed training stopped.

A run folder holds `config.json` (model, training, data: the plan), `checkpoint.safetensors` (weights, their moving
average, Adam's moments, the step), `log.jsonl`, and at the end `model.safetensors`, the averaged weights that a policy
is loaded with. A checkpoint needs no generator's state: what a step draws, examples as well as a module's dropout, is
drawn from the seed and the step, and several processes share a step without a word. Nothing is ever unpickled. The loop
never waits for the device but where it logs or saves.
"""

from __future__ import annotations

import contextlib
import functools
import json
import math
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from torch import Tensor

from equigrasp.artefacts import alone, remove_partials, write_atomically
from equigrasp.augmentation import Augmentation
from equigrasp.augmentation.examples import Draw, drawing
from equigrasp.default_dtype import in_float32
from equigrasp.demonstrations import check_loaded
from equigrasp.errors import InputError
from equigrasp.freed_memory import keep_freed_memory
from equigrasp.grasp import Demonstration
from equigrasp.models import ModelConfig, build, check_kept
from equigrasp.plan import (
    LOG_EVERY,
    PLAN,
    WEIGHTS,
    Training,
    find_weights,
    kept_weights,
    open_run,
    plan,
    read_model,
    read_plan,
    record_of,
    stamp,
)
from equigrasp.policy import GraspPolicy
from equigrasp.sharing.shareable import packed, restore
from equigrasp.training.batch import collate
from equigrasp.training.devices import Devices, Process
from equigrasp.training.loss import loss_of
from equigrasp.training.step import State

CHECKPOINT = "checkpoint.safetensors"
LOG = "log.jsonl"


def train(
    model: ModelConfig,
    training: Training,
    demonstrations: Sequence[Demonstration],
    data: str | Path,
    run: str | Path,
    progress: Callable[[range], Iterable[int]] = iter,
    devices: Devices | None = None,
) -> GraspPolicy:
    """Train a policy, or go on with the training that was begun in `run`.

    The loss is the cross-entropy of the demonstrated cell and bin over all H / stride x W / stride x 36.

    Args:
        model: what to build.
        training: how to train it.
        demonstrations: what `equigrasp.demonstrations.load(data)` gave, all of them.
        data: the folder they came from; its manifest's checksum is part of the plan.
        run: the run folder.
        progress: wraps the range of steps still to do, for a progress bar; it must pickle for several devices.
        devices: where [default: one process on the CPU].

    Returns:
        The policy with the averaged weights, in float32, ready to act, on the CPU.

    Raises:
        InputError: if no file could say how the model is built; the demonstrations are not those of `data`; `run`
            belongs to another plan, is damaged, or the disk is full; or the loss is not finite.
        BusyError: if another process trains in it.
        WorkerLostError: if one of several processes was killed; the same call goes on from the last checkpoint.
    """
    data, run = Path(data), Path(run)
    check_kept(model)
    check_loaded(demonstrations, data)
    devices = devices or Devices()
    keep_freed_memory()
    augmentation = Augmentation(demonstrations, training.recombination, training.hard_negatives, training.crowded)
    with _threads(training.threads), in_float32():
        policy = build(model, training.seed)
        embeddings = {instruction: policy.embed(instruction) for instruction in augmentation.instructions}
        megabytes = 25e-6 * sum(parameter.numel() for parameter in policy.parameters())
        open_run(run, plan(model, training, demonstrations, data, devices.plan()), megabytes)
        with alone(run, "training"):
            if not (run / WEIGHTS).exists():
                # other processes build their own, from the same seed: the same bits, and nothing to send
                make = (lambda: policy) if devices.count == 1 else functools.partial(build, model, training.seed)
                devices.run(take_steps, make, training, augmentation, embeddings, run, progress)
                remove_partials(run)
        return load_policy(run)


@contextlib.contextmanager
def _threads(count: int) -> Generator[None]:
    """Let torch have so many threads meanwhile."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def take_steps(
    process: Process,
    make: Callable[[], GraspPolicy],
    training: Training,
    augmentation: Augmentation,
    embeddings: Mapping[str, Tensor],
    run: Path,
    progress: Callable[[range], Iterable[int]],
) -> str | None:
    """All steps still to do, as one of the processes that share them; the first of them writes the run's files.

    Args:
        process: which of them, and its device.
        make: gives the policy with fresh weights, the same in every process.
        training: how to train it.
        augmentation: draws the examples.
        embeddings: of every instruction that it says, `(D,)`.
        run: the run folder.
        progress: wraps the range of steps.

    Returns:
        What is wrong with the run's checkpoint, or with its loss, or None.
    """
    torch.set_num_threads(training.threads)
    keep_freed_memory()
    policy = make().to(process.device).train()
    state = State(policy, training)
    try:
        if (run / CHECKPOINT).exists():
            resume(state, run / CHECKPOINT)
    except InputError as error:
        return str(error)
    process.wait()  # all have read it: the first may write the next
    if process.writes:
        rewind_log(run / LOG, state.step)
    scores, feed = process.shared(policy), process.feed(augmentation)

    def descend(language: Tensor, labels: Tensor, *scenes: Tensor) -> Tensor:
        loss = loss_of(scores(feed.observe(*scenes), language), labels)
        state.descend(loss)
        return loss.detach()

    step = process.captured(descend)
    losses: list[Tensor] = []
    todo = range(state.step, training.steps)
    draw = Draw(augmentation, training.seed, process.places(training.batch), feed.make)
    drawn = drawing(training.threads * process.count, process.device.type)(draw, todo)
    on_gpu = [process.device] if process.device.type == "cuda" else []
    with contextlib.closing(drawn), torch.random.fork_rng(on_gpu):
        for _, examples in zip(progress(todo) if process.writes else todo, drawn, strict=True):
            torch.manual_seed(chance(training.seed, state.step, process.rank))
            losses.append(step(*process.take(*collate(feed, policy, examples, embeddings))))
            state.follow()
            if state.step % LOG_EVERY == 0:
                values = process.mean(torch.stack(losses)).tolist()
                losses = []
                if wrong := diverged(values, state.step):
                    return wrong
                if process.writes:
                    log(run / LOG, state.step, sum(values) / len(values))
            if process.writes:
                save(state, run)
    if losses and (wrong := diverged(process.mean(torch.stack(losses)).tolist(), state.step)):
        return wrong
    if process.writes:
        write_atomically(run / CHECKPOINT, packed(state.tensors()))
        save_weights(state, run / WEIGHTS)
    process.wait()  # whoever goes on from here finds what was written
    return None


def chance(seed: int, step: int, rank: int) -> int:
    """The seed of what a module itself draws in a step, dropout for one."""
    return int(np.random.SeedSequence([seed, step, rank]).generate_state(1, np.uint64)[0])


def diverged(losses: Sequence[float], step: int) -> str | None:
    """What is wrong with the losses of the steps up to this one: the first that is not finite, or None."""
    for place, loss in enumerate(losses, start=step - len(losses) + 1):
        if not math.isfinite(loss):
            return (
                f"the loss of step {place} is {loss}, and no step after it mends the weights; train in another folder "
                "with a lower learning rate, by --learning-rate or in the model's row"
            )
    return None


def log(path: Path, step: int, loss: float) -> None:
    """Add the mean loss since the line before."""
    with path.open("a") as file:
        file.write(json.dumps({"step": step, "loss": loss}) + "\n")


def save(state: State, run: Path) -> None:
    """What is due after this step: weights for a learning curve, and the checkpoint."""
    if state.training.keep_every and state.step % state.training.keep_every == 0:
        save_weights(state, run / kept_weights(state.step))
    if state.step % state.training.checkpoint_every == 0:
        write_atomically(run / CHECKPOINT, packed(state.tensors()))


def resume(state: State, checkpoint: Path) -> None:
    """Read a checkpoint into the state; InputError if it is damaged or another model's."""
    try:
        state.restore(load_tensors(checkpoint.read_bytes()))
    except (SafetensorError, KeyError, RuntimeError) as error:
        raise InputError(
            f"{checkpoint} is damaged or another model's ({error}); delete it to train from the start"
        ) from None


def rewind_log(log: Path, step: int) -> None:
    """Drop what a killed training logged after its last checkpoint."""
    # what a crash of the machine left may be no text at all
    lines = log.read_text(errors="replace").splitlines(keepends=True) if log.exists() else []
    kept = []
    for line in lines:
        try:
            entry = json.loads(line)
        except ValueError:
            break
        if not isinstance(entry, dict) or not isinstance(entry.get("step"), int) or entry["step"] > step:
            break
        kept.append(line)
    write_atomically(log, "".join(kept).encode())


def save_weights(state: State, path: Path) -> None:
    """Write the averaged weights, in the policy's own names."""
    assert state.policy.config is not None
    write_atomically(path, packed(state.averaged(), stamp(state.policy.config)))


def load_policy(run: str | Path, step: int | None = None) -> GraspPolicy:
    """Load the policy that a run trained, ready to act.

    Args:
        run: the run folder.
        step: a step whose weights were kept, or None for the last.

    Raises:
        InputError: as `equigrasp.plan.find_weights`.
    """
    run = Path(run)
    configuration, weights = read_plan(run), find_weights(run, step)
    policy = restore(read_model(configuration, run / PLAN), weights)
    policy.record = record_of(configuration, step)
    return policy
