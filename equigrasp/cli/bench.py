"""The command that says what this machine does."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from equigrasp.cli.common import make_env, say
from equigrasp.errors import InputError

if TYPE_CHECKING:
    from equigrasp.bench.model_figures import Setting
    from equigrasp.bench.report import Figure, Report
    from equigrasp.bench.world_growth import Grown
    from equigrasp.config import ModelConfig
    from equigrasp.grasp import Demonstration

Kind = Literal["step", "inference", "observation", "simulator", "start-up", "growth"]
KINDS: tuple[Kind, ...] = ("start-up", "observation", "simulator", "inference", "step", "growth")
"""In the order in which they are measured: what is soon done first."""
ON_MODELS = {"step", "inference", "growth"}
GRASPS = 6
"""Demonstrated grasps that examples are drawn from."""


@dataclass
class Bench:
    """What this machine does: training steps and their parts, acts, observations, grasps, starts; memory, growth.

    Figures are medians of repeated blocks, with quartiles; ratios come from blocks that were timed in turn, so that
    they hold on a busy machine too.

    Example: equigrasp bench --only step --models leg-unet --against literal
    """

    only: tuple[Kind, ...] = ()
    """Kinds of figures [default: all but growth, or with --against step and inference]."""
    models: tuple[str, ...] = ()
    """Names of models [default: all that fit this machine; of growth and --against, leg-unet]."""
    against: str | None = None
    """Race each model with another one, with threads=N, or with the literal reading of the paper: `literal`."""
    axes: tuple[str, ...] = ()
    """Of growth: pixels, batch, "kernel size", coefficients, bins, "group order", objects, workers [default: all]."""
    seconds: float = 2.0
    """Budget of each figure; blocks are repeated for so long."""
    task: str = "pick-by-part"
    """What is grasped and seen."""
    batch: int = 1
    """Examples a step."""
    read_out: Literal["half", "full"] | None = None
    """Every model's read-out, --against's too, at this resolution of the heightmap's [default: each model's, half]."""
    threads: int | None = None
    """Torch threads [default: one for each core]."""
    workers: int | None = None
    """Processes whose grasps are compared with one's [default: one for each core]."""
    text_encoder: str = "hashing"
    """Who reads the instructions; they are read once, so that no figure depends on it."""
    seed: int = 0
    """Of weights, examples and scenes, from 0 to 999."""
    out: Path | None = None
    """A JSON file that gets every figure."""

    def execute(self) -> Report:
        """Measure, print a table, write the figures; give them."""
        from equigrasp.artefacts import check_writable
        from equigrasp.bench.timing import check_seconds
        from equigrasp.config import read_out_at
        from equigrasp.language import check_encoder
        from equigrasp.models import MODELS, find
        from tasks import find_task

        check_seconds(self.seconds)
        kinds = self._kinds()
        named = [find(name) for name in dict.fromkeys(self.models)]
        if self.against is not None and not named:
            named = [find("leg-unet")]
        if self.read_out is not None:
            if not named:
                raise InputError("--read-out needs --models: not every model can choose its own")
            named = [read_out_at(each, self.read_out) for each in named]
        if self.workers is not None and self.workers < 1:
            raise InputError(f"--workers is {self.workers}, but it must be at least 1")
        if self.out is not None:
            check_writable(self.out, "--out")
        find_task(self.task)
        check_encoder(self.text_encoder)

        import joblib

        from equigrasp.bench import growth, model_figures
        from equigrasp.bench.machine import describe, load
        from equigrasp.bench.report import Report, table
        from equigrasp.plan import Training

        growth.check_axes(self.axes)
        self._check_models(kinds)
        against = None if self.against is None else model_figures.opponent(self.against, named, self.read_out)
        threads = joblib.cpu_count() if self.threads is None else self.threads
        training = Training(steps=1, seed=self.seed, batch=self.batch, threads=threads)
        settings = {**asdict(self), "out": None}
        report = Report(describe(training.threads), settings)
        setting = None
        if ON_MODELS & set(kinds):
            setting = model_figures.Setting(self._demonstrations(), training, self.text_encoder, self.seconds)
        for kind in kinds:
            if kind == "growth":
                assert setting is not None
                self._grow(named or [find("leg-unet")], setting, report)
            elif kind in ON_MODELS:
                assert setting is not None
                _measure(kind, named or list(MODELS.values()), against, setting, report)
            else:
                found = {"start-up": self._starts, "observation": self._cameras, "simulator": self._simulator}[kind]()
                _show(report, found)
        report.machine["load after"] = load()
        say("", *table(report.figures))
        if report.fits:
            say("", *growth.lines(report.fits))
        say(*(f"not measured: {name}: {reason}" for name, reason in report.skipped.items()))
        busy = max(report.machine["load"] or 0, (report.machine["load after"] or 0) - training.threads)
        if busy > (os.cpu_count() or 1) / 4:
            say(f"others were at work on this machine (load {busy:.1f}): trust the ratios, not the times")
        if self.out is not None:
            from equigrasp.artefacts import write_json

            write_json(self.out, report.to_dict())
            say(f"every figure lies in {self.out}")
        return report

    def _kinds(self) -> list[Kind]:
        if self.against is None:
            if self.axes and "growth" not in self.only:
                only = " ".join((*self.only, "growth"))
                raise InputError(f"--axes are of growth, which is not among what is measured; say --only {only}")
            return [kind for kind in KINDS if kind in (self.only or set(KINDS) - {"growth"})]
        wrong = set(self.only) - {"step", "inference"}
        if wrong:
            raise InputError(f"--against races step and inference, and not {min(wrong)}; leave that out of --only")
        if self.axes:
            raise InputError("--axes are of growth, which --against does not race; leave one of them out")
        return [kind for kind in KINDS if kind in (self.only or ("step", "inference"))]

    def _check_models(self, kinds: Sequence[Kind]) -> None:
        """Raise an InputError if models are named and nothing of models is measured."""
        from equigrasp.bench.growth import WORLD_AXES

        of_models = ON_MODELS & set(kinds)
        if self.axes and set(self.axes) <= set(WORLD_AXES):
            of_models -= {"growth"}
        if self.models and not of_models:
            measured = [f"growth over {' and '.join(self.axes)}" if kind == "growth" else kind for kind in kinds]
            raise InputError(
                f"--models are named, but what is measured is of no model ({', '.join(measured)}); leave --models "
                "out, or add step or inference to --only"
            )

    def _demonstrations(self) -> list[Demonstration]:
        from equigrasp.collection import Collection, draw_goals
        from equigrasp.demonstrations import demonstrate
        from tasks import find_task

        goals = draw_goals(find_task(self.task).demonstration_goals, 1, self.seed)
        collection = Collection(self.task, (goals[0][:GRASPS],), self.seed, "overhead")
        with closing(make_env(self.task, "overhead")) as env:
            return [demonstrate(collection, env, *place) for place in collection.grasps()]

    def _grow(self, models: Sequence[ModelConfig], setting: Setting, report: Report) -> None:
        from equigrasp.bench import growth
        from equigrasp.bench.fresh import DidNotFitError
        from equigrasp.config import LegConfig

        for model in models:
            points = growth.axes(model, self.batch)
            for axis in [each for each in self.axes or growth.AXES if each in growth.AXES]:
                try:
                    if axis in points:
                        found, fits = growth.grow(axis, points[axis], setting)
                    elif axis == growth.GROUP_AXIS and isinstance(model, LegConfig) and model.kernel == "lifted":
                        found, fits = growth.grow_group(model, setting)
                    else:
                        report.skipped[f"growth of {model.name} with {axis}"] = f"it has no {axis}"
                        continue
                except DidNotFitError as error:
                    report.skipped[f"growth of {model.name} with {axis}"] = str(error)
                    continue
                _show(report, found)
                report.fits += fits
        for axis in self.axes or growth.WORLD_AXES:
            if axis in growth.WORLD_AXES:
                found, fits = {"objects": self._objects, "workers": self._workers}[axis]()
                _show(report, found)
                report.fits += fits

    def _objects(self) -> Grown:
        from equigrasp.bench.world_growth import OBJECTS, grow_objects
        from tasks import find_task
        from tasks.stages import stages

        task = find_task(self.task)
        with ExitStack() as stack:
            envs = {
                count: stack.enter_context(closing(make_env(replace(task, objects=(count, count)), "overhead")))
                for count in OBJECTS
                if count <= len(task.pool)
            }
            return grow_objects({count: partial(stages, env) for count, env in envs.items()}, self.seconds, self.seed)

    def _workers(self) -> Grown:
        import joblib

        from equigrasp.bench.world_growth import grow_workers
        from tasks.stages import Episodes

        with closing(Episodes(partial(make_env, self.task, "overhead"))) as episodes:
            return grow_workers(episodes, self.workers or joblib.cpu_count(), self.seconds, self.seed)

    def _starts(self) -> list[Figure]:
        from equigrasp.bench.report import milliseconds
        from equigrasp.bench.startup import STARTS, start
        from equigrasp.bench.timing import race

        times = race({name: start(arguments) for name, arguments in STARTS.items()}, self.seconds)
        return [milliseconds("start-up", name, "start to end", each) for name, each in times.items()]

    def _cameras(self) -> list[Figure]:
        from equigrasp.bench.world import observation_figures
        from tasks import camera

        with closing(make_env(self.task, "fused")) as env:
            env.reset(seed=self.seed)
            _, scene = env.started()
            cameras = {
                "overhead": lambda: camera.overhead(scene.visible()),
                "fused": lambda: camera.fused(scene.visible()),
            }
            return observation_figures(cameras, self.seconds)

    def _simulator(self) -> list[Figure]:
        import joblib

        from equigrasp.bench.world import stage_figures, worker_figures
        from tasks.stages import Episodes, stages

        with closing(make_env(self.task, "overhead")) as env:
            figures = stage_figures(partial(stages, env), self.seconds, self.seed)
        with closing(Episodes(partial(make_env, self.task, "overhead"))) as episodes:
            return figures + worker_figures(episodes, self.workers or joblib.cpu_count(), self.seconds, self.seed)


def _measure(
    kind: Kind, models: Sequence[ModelConfig], against: ModelConfig | str | None, setting: Setting, report: Report
) -> None:
    from equigrasp.bench.fresh import DidNotFitError
    from equigrasp.bench.model_figures import inference_figures, race_figures, step_figures

    for model in models:
        try:
            if against is not None:
                found = race_figures(model, against, [kind], setting)
            else:
                found = {"step": step_figures, "inference": inference_figures}[kind](model, setting)
        except DidNotFitError as error:
            report.skipped[f"{kind} of {model.name}"] = str(error)
            say(f"{kind:12} {model.name:28} does not fit: {error}")
            continue
        _show(report, found)


def _show(report: Report, found: Sequence[Figure]) -> None:
    for each in found:
        say(f"{each.group:12} {each.subject:28} {each.what:40} {each.median:10.4g} {each.unit}")
    report.figures += found
