"""A training step of one policy, and its parts, exactly as `equigrasp.training.train` does them; and an act."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from equigrasp.augmentation import Augmentation, Example
from equigrasp.augmentation.examples import Draw, drawing, painted, recipe
from equigrasp.bench import fresh
from equigrasp.config import ModelConfig
from equigrasp.freed_memory import keep_freed_memory
from equigrasp.grasp import Demonstration, Grasp
from equigrasp.models import build
from equigrasp.plan import Training
from equigrasp.policy import DensePolicy, GraspPolicy, LegPolicy
from equigrasp.precision import multiplies_bfloat16
from equigrasp.training.batch import collate, with_pixels
from equigrasp.training.loss import loss_of
from equigrasp.training.step import State
from equigrasp.workspace import WORKSPACE

Call = Callable[[], object]


def ready(config: ModelConfig, text_encoder: str) -> ModelConfig:
    """The model for a stopwatch: times depend neither on CLIP's weights nor on who reads the instruction.

    So nothing need be there or be fetched. An embedding is computed once for a sentence and kept, in training too.
    """
    return replace(config.untrained(), text_encoder=text_encoder)


class Batch(NamedTuple):
    """Examples of a step as tensors of the host.

    Attributes:
        embeddings: of their instructions, `(B, D)`.
        labels: of their grasps in the policy's read-out, `(B,)`.
        observations: `(B, 4, H, W)`, colour and height.
    """

    embeddings: Tensor
    labels: Tensor
    observations: Tensor


class Workload:
    """One policy in training on real demonstrations.

    Args:
        policy: with fresh weights, or any.
        demonstrations: what examples are drawn from.
        training: its seed, batch, threads and recombination.
    """

    def __init__(self, policy: GraspPolicy, demonstrations: Sequence[Demonstration], training: Training) -> None:
        self.policy = policy.train()
        self.training = training
        self.augmentation = Augmentation(
            demonstrations, training.recombination, training.hard_negatives, training.crowded
        )
        self.embeddings = {sentence: policy.embed(sentence) for sentence in self.augmentation.instructions}
        self.state = State(policy, training)
        self.feed = with_pixels()
        self.examples = self._draw(0)
        self.batch = self._collate()
        self.drawn = drawing(training.threads, "cpu")(self._draw, itertools.count())

    def step(self) -> None:
        """The next step of the training, all in, its examples drawn while the one before was computed."""
        self._in_mode(True)
        self.examples = next(self.drawn)
        self.state.update(self._loss(self._collate()))

    def act(self) -> Grasp:
        """One grasp for one observation, in evaluation mode, of an instruction that was heard before."""
        self._in_mode(False)
        demonstration = self.augmentation.demonstrations[0]
        return self.policy.act(demonstration.observation, demonstration.instruction)

    def gradient(self) -> None:
        """Forward and backward of one fixed batch."""
        self._in_mode(True)
        self._forget()
        self._loss(self.batch).backward()

    def optimiser(self) -> Call:
        """What a step does with the gradients once they are there: those that are there now, at every call."""
        gradients = [parameter.grad for parameter in self.state.parameters.values()]

        def optimise() -> None:
            # other parts forget them, and Adam passes over what has none
            for parameter, gradient in zip(self.state.parameters.values(), gradients, strict=True):
                parameter.grad = gradient
            self.state.adam.step()
            self.state.follow()

        return optimise

    @property
    def dtype(self) -> torch.dtype:
        """Of the policy's convolutions."""
        return torch.bfloat16 if multiplies_bfloat16(self.policy.precision, "cpu") else torch.float32

    def parts(self) -> dict[str, Call]:
        """What a step is made of, each on a fixed batch, forward and backward where it has a backward."""
        embeddings, labels, observations = self.batch
        logits = self._logits(self.batch).detach().requires_grad_()
        # a scene that is put together anew takes twice as long as one that moves: each call draws another step's
        steps = itertools.count()
        parts: dict[str, Call] = {"augmentation": lambda: self._draw(next(steps)), "data": self._collate}
        # what is left of it to the host where a GPU paints: no part of a step here
        told = Draw(self.augmentation, self.training.seed, range(self.training.batch), recipe)
        parts["augmentation in numbers"] = lambda: told(next(steps))
        if isinstance(self.policy, LegPolicy):
            parts |= self._leg(self.policy)
        elif isinstance(self.policy, DensePolicy):
            network = self.policy.network
            parts["network"] = self._differentiated(lambda: network(observations, embeddings), autocast=True)
        parts["loss"] = lambda: loss_of(_fresh(logits), labels).backward()
        self.gradient()
        parts["optimiser"] = self.optimiser()
        return parts

    def _in_mode(self, training: bool) -> None:
        if self.policy.training != training:
            self.policy.train(training)

    def _leg(self, policy: LegPolicy) -> dict[str, Call]:
        embeddings, observations = self.batch.embeddings, self.batch.observations
        with torch.no_grad(), self._autocast():
            features = policy.phi(observations, embeddings).float().requires_grad_()
            kernel = policy.kappa(embeddings).float().requires_grad_()
        with torch.no_grad():
            field = policy.correlate(features, kernel).requires_grad_()
        synthesis = policy.synthesis.value
        return {
            "phi": self._differentiated(lambda: policy.phi(observations, embeddings), autocast=True),
            "kernel": self._differentiated(lambda: policy.kappa(embeddings), autocast=True),
            "correlation": self._differentiated(lambda: policy.correlate(_fresh(features), _fresh(kernel))),
            "read-out": self._differentiated(lambda: torch.einsum("io,bohw->bihw", synthesis, _fresh(field))),
        }

    def _differentiated(self, function: Callable[[], Tensor], autocast: bool = False) -> Call:
        """Forward, and backward from a fixed gradient."""
        with torch.no_grad(), self._autocast(autocast):
            output = function()
        gradient = torch.randn(output.shape, generator=torch.Generator().manual_seed(0)).to(output)

        def run() -> None:
            self._forget()
            with self._autocast(autocast):
                output = function()
            output.backward(gradient)

        return run

    def _autocast(self, enabled: bool = True) -> torch.autocast:
        return torch.autocast("cpu", torch.bfloat16, enabled=enabled and self.dtype == torch.bfloat16)

    def _draw(self, step: int) -> list[Example]:
        return Draw(self.augmentation, self.training.seed, range(self.training.batch), painted)(step)

    def _collate(self) -> Batch:
        return Batch(*collate(self.feed, self.policy, self.examples, self.embeddings))

    def _logits(self, batch: Batch) -> Tensor:
        return self.policy.logits(batch.observations, batch.embeddings)

    def _loss(self, batch: Batch) -> Tensor:
        return loss_of(self._logits(batch), batch.labels)

    def _forget(self) -> None:
        self.state.forget()


def _fresh(tensor: Tensor) -> Tensor:
    """The same numbers as a new leaf: nothing is added to an older gradient, which would be work of its own."""
    return tensor.detach().requires_grad_()


@dataclass(frozen=True)
class Size:
    """Of what a step on noise works on.

    Attributes:
        batch: observations.
        shape: rows and columns of each, multiples of 32.
        bins: angles read out; other than the workspace's for a `LegPolicy` alone.
    """

    batch: int
    shape: tuple[int, int]
    bins: int = WORKSPACE.bins


def step_on_noise(config: ModelConfig, size: Size, training: Training) -> Callable[[], Tensor]:
    """A training step without its data, on noise of any size, with fresh weights: what growth is about.

    A call gives the step's loss, a scalar.
    """
    policy = build(config, 0)
    if size.bins != policy.bins:
        assert isinstance(policy, LegPolicy)
        policy = policy.at(size.bins)
    batch, shape = size.batch, size.shape
    generator = torch.Generator().manual_seed(0)
    scale = torch.tensor([255.0, 255.0, 255.0, 0.1]).view(4, 1, 1)
    observations = torch.rand(batch, 4, *shape, generator=generator) * scale
    embeddings = torch.randn(batch, policy.embedding_size, generator=generator)
    embeddings = torch.nn.functional.normalize(embeddings)
    read_out = policy.read_out(shape)
    grasps = read_out.bins * read_out.rows * read_out.columns
    state = State(policy.train(), training)

    def step() -> Tensor:
        # one label for all steps would be learned, and of a loss that is all but zero the gradients are numbers too
        # small for float32's usual form, on which processors are many times slower
        labels = torch.randint(grasps, (batch,), generator=generator)
        loss = loss_of(policy.logits(observations, embeddings), labels)
        state.update(loss)
        return loss.detach()

    return step


def memory_of_steps(config: ModelConfig, size: Size, threads: int, steps: int = 3) -> dict[str, float]:
    """Run in a fresh process: MiB resident before the model was built, and at most while it was trained.

    Returns:
        "before" and "peak".
    """
    training = Training(steps=steps, seed=0, batch=size.batch, threads=threads)
    return _memory(lambda: step_on_noise(config, size, training), threads, steps)


def memory_of_acts(config: ModelConfig, demonstration: Demonstration, threads: int, acts: int = 3) -> dict[str, float]:
    """Run in a fresh process: MiB resident before the model was built, and at most while it acted."""

    def prepare() -> Call:
        policy = build(config, 0).eval()
        return lambda: policy.act(demonstration.observation, demonstration.instruction)

    return _memory(prepare, threads, acts)


def _memory(prepare: Callable[[], Call], threads: int, calls: int) -> dict[str, float]:
    torch.set_num_threads(threads)
    keep_freed_memory()
    before = fresh.peak_memory()
    call = prepare()
    for _ in range(calls):
        call()
    return {"before": before, "peak": fresh.peak_memory()}
