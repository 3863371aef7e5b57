"""The figures of one model: its step with every part, its act, each beside the machine's best; or a race of two."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from equigrasp.bench import flops, machine
from equigrasp.bench.fresh import in_fresh_process
from equigrasp.bench.report import Figure, milliseconds, ratio
from equigrasp.bench.steps import Call, Size, Workload, memory_of_acts, memory_of_steps, ready
from equigrasp.bench.timing import Timing, measure, race
from equigrasp.config import LegConfig, ModelConfig, differences, read_out_at
from equigrasp.correlation import Correlation, correlate
from equigrasp.errors import InputError
from equigrasp.freed_memory import keep_freed_memory
from equigrasp.grasp import Demonstration
from equigrasp.models import build, find
from equigrasp.plan import MOST_THREADS, Training
from equigrasp.policy import LegPolicy
from equigrasp.reference_head import LiteralHead, LiteralPolicy, correlate_directly
from equigrasp.workspace import WORKSPACE

PATIENCE = 60
"""A model's three steps in its fresh process may take so many budgets of a figure, or it does not fit this machine."""
LITERAL = "literal"
THREADS = "threads="


@dataclass(frozen=True)
class Setting:
    """What all models of a run share.

    Attributes:
        demonstrations: what examples are drawn from.
        training: seed, batch, threads, recombination.
        text_encoder: who reads the instructions.
        seconds: of one figure.
    """

    demonstrations: Sequence[Demonstration]
    training: Training
    text_encoder: str
    seconds: float

    def workload(self, config: ModelConfig) -> Workload:
        """The model, with fresh weights, in training on this machine."""
        torch.set_num_threads(self.training.threads)
        keep_freed_memory()
        policy = build(ready(config, self.text_encoder), self.training.seed)
        return Workload(policy, self.demonstrations, self.training)


def step_figures(config: ModelConfig, setting: Setting) -> list[Figure]:
    """Memory, the step, its operations and share of the peak, its parts.

    Raises:
        DidNotFitError: if three steps take too long or more memory than there is.
    """
    training, seconds = setting.training, setting.seconds
    size = Size(training.batch, WORKSPACE.shape)
    memory = in_fresh_process(
        memory_of_steps, ready(config, setting.text_encoder), size, training.threads, limit=_patience(seconds)
    )
    work = setting.workload(config)
    # by itself, as in training, where a step follows a step: the convolution beside it empties its caches
    alone = measure(work.step, seconds)
    times = race({"step": work.step, "convolution": machine.convolution(work.dtype)}, seconds)
    count = flops.count(work.gradient)
    figures = [
        milliseconds("step", config.name, "step", alone),
        *_memory("step", config.name, memory),
        Figure("step", config.name, "operations", "GFLOP", (count / 1e9,), "forward and backward"),
        _share("step", config.name, count, times, work.dtype),
    ]
    for name, part in work.parts().items():
        figures.append(milliseconds("step", config.name, name, measure(part, seconds)))
    return figures


def inference_figures(config: ModelConfig, setting: Setting) -> list[Figure]:
    """Memory and time of `policy.act`, and its share of the peak.

    Raises:
        DidNotFitError: as `step_figures`.
    """
    training, seconds = setting.training, setting.seconds
    memory = in_fresh_process(
        memory_of_acts,
        ready(config, setting.text_encoder),
        setting.demonstrations[0],
        training.threads,
        limit=_patience(seconds),
    )
    work = setting.workload(config)
    alone = measure(work.act, seconds)
    times = race({"step": work.act, "convolution": machine.convolution(work.dtype)}, seconds)
    # torch's counter hangs a hook on every input that wants a gradient, and fails on a weight's view within no_grad
    work.policy.requires_grad_(False)
    count = flops.count(work.act)
    return [
        milliseconds("inference", config.name, "act", alone),
        *_memory("inference", config.name, memory),
        Figure("inference", config.name, "operations", "GFLOP", (count / 1e9,)),
        _share("inference", config.name, count, times, work.dtype),
    ]


def race_figures(
    config: ModelConfig, against: ModelConfig | str, kinds: Sequence[str], setting: Setting
) -> list[Figure]:
    """The model and another variant in turn: how many times the model's time the other takes.

    Args:
        config: whose.
        against: another model or the same one, "literal" or "threads=N"; as `opponent` gives it.
        kinds: of "step" and "inference", those that are raced.
        setting: of both.
    """
    mine = setting.workload(config)
    calls: dict[str, tuple[Call, Call]] = {}
    figures = []
    if isinstance(against, ModelConfig):
        # what is raced is what is ready, and no other difference may name it
        names = told_apart(*(ready(each, setting.text_encoder) for each in (config, against)))
        theirs = setting.workload(against)
        calls = {"step": (mine.step, theirs.step), "inference": (mine.act, theirs.act)}
    elif against.startswith(THREADS):
        names = (config.name, against)
        threads = int(against.removeprefix(THREADS))
        own = setting.training.threads
        calls = {
            "step": (_on(own, mine.step), _on(threads, mine.step)),
            "inference": (_on(own, mine.act), _on(threads, mine.act)),
        }
    else:
        names = (config.name, against)
        theirs = _literal(config, setting)
        calls = {"step": (mine.step, theirs.step), "inference": (mine.act, theirs.act)}
        figures += _race_of_heads(config, mine, setting.seconds)
    for kind in kinds:
        one, other = calls[kind]
        times = race({"one": one, "other": other}, setting.seconds)
        figures += [milliseconds(kind, name, "in turn", times[each]) for name, each in zip(names, times, strict=True)]
        figures.append(ratio(kind, f"{names[1]} / {names[0]}", "ratio", times["other"], times["one"]))
    torch.set_num_threads(setting.training.threads)
    return figures


def told_apart(one: ModelConfig, other: ModelConfig) -> tuple[str, str]:
    """The names of two models that are raced, never alike: where one name has two configs, with what differs."""
    if one.name != other.name:
        return one.name, other.name
    differing = differences(one, other)
    if not differing:
        return one.name, f"{one.name} again"
    said = [
        ", ".join(f"{setting}={values[place]}" for setting, values in differing.items() if values[place] is not None)
        for place in (0, 1)
    ]
    mine, theirs = (f"{one.name} with {each}" if each else one.name for each in said)
    return mine, theirs


def opponent(against: str, configs: Sequence[ModelConfig], read_out: str | None = None) -> ModelConfig | str:
    """What these models are raced against: the model of that name, or "literal" or "threads=N" as it is.

    Args:
        against: what was asked for.
        configs: those that are raced against it.
        read_out: resolution of a model's read-out, None for its own.

    Raises:
        InputError: if there is no such model, or they cannot be raced against it, or it cannot choose its read-out.
    """
    if against.startswith(THREADS):
        number = against.removeprefix(THREADS)
        if not number.isdecimal() or not 1 <= int(number) <= MOST_THREADS:
            raise InputError(f"--against is {against!r}, but threads=N takes a whole number from 1 to {MOST_THREADS}")
    elif against == LITERAL:
        for config in configs:
            if not isinstance(config, LegConfig) or config.kernel != "lifted":
                raise InputError(
                    f"--against literal races a lifted kernel, which {config.name} has not; add --models leg-unet"
                )
    else:
        other = find(against)
        return other if read_out is None else read_out_at(other, read_out)
    return against


def _literal(config: ModelConfig, setting: Setting) -> Workload:
    assert isinstance(config, LegConfig)
    work = setting.workload(config)
    return Workload(LiteralPolicy(work.policy, config.group_order), setting.demonstrations, setting.training)


def _race_of_heads(config: ModelConfig, work: Workload, seconds: float) -> list[Figure]:
    """kernel, correlation and read-out alone, forward and backward, on the same features.

    The literal one is raced twice: correlating as a convolution layer does, and by the same FFT as ours.
    """
    figures = []
    for route, correlation in {"by sums": correlate_directly, "by FFT": correlate}.items():
        times = race(heads(config, work, correlation), seconds)
        figures += [milliseconds("step", config.name, f"head, {name}", each, route) for name, each in times.items()]
        figures.append(ratio("step", config.name, f"head, literal {route} / ours", times["literal"], times["ours"]))
    return figures


def heads(config: ModelConfig, work: Workload, correlation: Correlation = correlate) -> dict[str, Call]:
    """Our head and the literal one, each forward and backward from the same features to 36 bins.

    Args:
        config: of the model.
        work: its policy and a batch.
        correlation: of the literal one.
    """
    policy = work.policy
    assert isinstance(policy, LegPolicy)
    assert isinstance(config, LegConfig)
    embeddings = work.batch.embeddings
    with torch.no_grad():
        features = policy.phi(work.batch.observations, embeddings).float()
    synthesis = policy.synthesis.value
    literal = LiteralHead(policy.kappa, config.group_order, correlation)  # ty: ignore[invalid-argument-type]

    def ours(features: torch.Tensor, embedding: torch.Tensor) -> torch.Tensor:
        return policy.correlate(features, policy.kappa(embedding))

    def backwards(head: Callable[[torch.Tensor, torch.Tensor], torch.Tensor]) -> Call:
        def run() -> None:
            policy.zero_grad(set_to_none=True)
            field = head(features.detach().requires_grad_(), embeddings)
            torch.einsum("io,bohw->bihw", synthesis, field).square().sum().backward()

        return run

    return {name: backwards(head) for name, head in (("ours", ours), ("literal", literal))}


def _on(threads: int, call: Call) -> Call:
    def run() -> None:
        torch.set_num_threads(threads)
        call()

    return run


def _patience(seconds: float) -> float:
    return max(PATIENCE * seconds, PATIENCE)


def _memory(group: str, subject: str, memory: dict[str, float]) -> list[Figure]:
    before = memory["before"]
    return [
        Figure(group, subject, "peak memory", "MiB", (memory["peak"],), f"of the whole process, {before:.0f} before")
    ]


def _share(group: str, subject: str, count: int, times: dict[str, Timing], dtype: torch.dtype) -> Figure:
    """Operations a second over those of the convolution that ran beside it."""
    slower = times["step"].over(times["convolution"])
    share = tuple(100 * count / machine.CONVOLUTION_FLOPS / each for each in slower)
    return Figure(group, subject, "of the peak", "%", share, f"a 3x3 convolution in {str(dtype).partition('.')[2]}")
