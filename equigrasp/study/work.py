"""One job of a study: train, choose a checkpoint on validation scenes, measure its symmetry, test on test scenes.

Each step leaves a file in the run's folder, whole or not at all, so that a job that was killed goes on: the training
from its checkpoint, the choice and every finished test from their files. Whoever hands out the jobs writes the lines.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from equigrasp.artefacts import AGAIN, read_json, write_json
from equigrasp.clip import RANDOM
from equigrasp.config import ClipConfig
from equigrasp.demonstrations import load
from equigrasp.environment import DemonstratedEnvironment
from equigrasp.errors import BusyError, InputError, WorkerLostError
from equigrasp.evaluation import VALIDATION_SEED, episodes, single_shot
from equigrasp.plan import TESTS
from equigrasp.provenance import circumstances, device, git, versions
from equigrasp.study.matrix import Job
from equigrasp.study.settings import check_unchanged, digest

if TYPE_CHECKING:
    from equigrasp.policy import GraspPolicy

SECONDS = "seconds.json"
STARTS = "starts"
"""Beside the runs: by what each training was begun, and by what else it went on."""
CHOICE = ("checkpoint", "validation_successes")
"""What is kept of the choice of a checkpoint."""
PATIENCE = 120
"""Seconds: who trains in a run's folder is waited for so long."""
CHECKPOINT_EVERY = {"cpu": 200, "cuda": 2000}
"""Steps: on a GPU 200 take half a second, hardly longer than a checkpoint is written."""

MakeEnv = Callable[[str, Any, Any], DemonstratedEnvironment]
"""From a task's name, a camera and a set of phrasings to an environment."""
Symmetry = Callable[["GraspPolicy", Any, int, int], dict[str, Any]]
"""From a policy, an environment, a number of scenes and their seed to how equivariant the policy is, as JSON."""


@dataclass
class Stopwatch:
    """Wraps a range of steps or queries: how many were done, and in how many seconds."""

    count: int = 0
    seconds: float = 0.0

    def __call__(self, items: range) -> Iterator[int]:
        """The items, timed."""
        start = time.perf_counter()
        for item in items:
            yield item
            self.count += 1
            self.seconds = time.perf_counter() - start


@dataclass(frozen=True)
class Work:
    """A callable from a job to the lines of its tests, for any engine.

    On a cluster of several machines, `folder` must be on a disk that all of them see.

    Attributes:
        folder: the study's; the job's demonstrations lie in it already.
        make_env: makes the environments; it must pickle.
        goals: how many goals each tested or trained task has.
        symmetry: measures how equivariant a policy is; it must pickle.
    """

    folder: Path
    make_env: MakeEnv
    goals: Mapping[str, int]
    symmetry: Symmetry

    def __call__(self, job: Job) -> list[dict[str, Any]]:
        """The lines of the job's tests, in their order.

        Raises:
            InputError: if the run's folder is damaged, the disk is full, or the model was edited meanwhile.
        """
        check_unchanged(job.model, job.settings)
        data, run = self.folder / job.data, self.folder / job.run
        self._train(job, data, run)
        chosen = self._choose(job, run)
        chosen |= self._equivariance(job, run, chosen["checkpoint"])
        return [self._test(job, run, task, chosen) for task in job.tests]

    def _train(self, job: Job, data: Path, run: Path) -> None:
        from equigrasp.plan import WEIGHTS, Training
        from equigrasp.training import train
        from equigrasp.training.devices import Devices

        if (run / WEIGHTS).exists():
            return
        run.parent.mkdir(parents=True, exist_ok=True)
        training = Training(
            steps=job.steps,
            seed=job.seed,
            recombination=job.recombination,
            hard_negatives=job.hard_negatives,
            crowded=job.crowded,
            threads=job.threads,
            checkpoint_every=CHECKPOINT_EVERY[job.device],
            keep_every=job.keep_every,
        )
        watch = Stopwatch()
        demonstrations = load(data)
        self._note_start(run)
        for left in reversed(range(PATIENCE)):
            try:
                train(job.model, training, demonstrations, data, run, watch, Devices(job.device))
                break
            except BusyError:  # of a machine that was lost, whose processes take a while to die
                if not left:
                    raise
                time.sleep(1)
        # of the steps since the last start alone, and of how many: a killed process took its own time with it
        write_json(run / SECONDS, {"steps": watch.count, "seconds": watch.seconds})

    def _note_start(self, run: Path) -> None:
        started, here = self._starts(run), {"versions": versions(), "git": git(), "device": device()}
        if here not in started:
            path = self._starts_of(run)
            path.parent.mkdir(exist_ok=True)
            write_json(path, {STARTS: [*started, here]})

    def _starts(self, run: Path) -> list[dict[str, Any]]:
        path = self._starts_of(run)
        return _kept(path, "what a training was begun with", STARTS) if path.exists() else []

    def _starts_of(self, run: Path) -> Path:
        return self.folder / STARTS / f"{run.name}.json"

    def _choose(self, job: Job, run: Path) -> dict[str, Any]:
        """The best of the checkpoints: `checkpoint`, and `validation_successes` of each; of equals the latest."""
        if len(job.candidates) == 1:
            return dict(zip(CHOICE, (job.steps, {}), strict=True))
        path = run / f"choice-{job.protocol.validation}-of-{len(job.candidates)}.json"
        if path.exists():
            return {key: _kept(path, "the choice of a checkpoint", key) for key in CHOICE}
        successes = {}
        with self._env(job.task, job.camera, "seen") as env:
            for step in job.candidates:
                act = self._policy(job, run, step).act
                goals, queries = self.goals[job.task], job.protocol.validation
                tried = single_shot(act, env, goals, queries, job.seed, first=VALIDATION_SEED)
                successes[str(step)] = tried.correct.successes
        best = max(job.candidates, key=lambda step: (successes[str(step)], step))
        choice = dict(zip(CHOICE, (best, successes), strict=True))
        write_json(path, choice)
        return choice

    def _equivariance(self, job: Job, run: Path, step: int) -> dict[str, Any]:
        """`equivariance`: of the chosen weights, once for all tests; nothing where it is left out."""
        scenes = job.protocol.turned
        if not scenes:
            return {}
        path = run / f"equivariance-{step}-{scenes}.json"
        if not path.exists():
            start = time.perf_counter()
            with self._env(job.task, job.camera, "seen") as env:
                found = self.symmetry(self._policy(job, run, step), env, scenes, job.seed)
            write_json(path, {"found": found, "seconds": time.perf_counter() - start})
        return {"equivariance": _kept(path, "figures of symmetry", "found")}

    def _test(self, job: Job, run: Path, task: str, chosen: Mapping[str, Any]) -> dict[str, Any]:
        cell = job.cell(task)
        path = run / TESTS / f"{task.replace(':', '-')}-{digest(cell)}.json"
        if path.exists():
            return _kept(path, "a finished test", "line")
        policy = self._policy(job, run, chosen["checkpoint"])
        trained = read_json(run / SECONDS, "the training's time") if (run / SECONDS).exists() else {}
        seconds = {"train": trained.get("seconds"), "train_steps": trained.get("steps")}
        symmetry = run / f"equivariance-{chosen['checkpoint']}-{job.protocol.turned}.json"
        if symmetry.exists():
            seconds["equivariance"] = _kept(symmetry, "figures of symmetry", "seconds")
        results = {}
        with self._env(task, job.camera, job.protocol.phrasings) as env:
            if job.protocol.queries:
                watch = Stopwatch()
                shots = single_shot(policy.act, env, self.goals[task], job.protocol.queries, job.seed, watch)
                results["single_shot"], seconds["single_shot"] = shots, watch.seconds
            if job.protocol.scenes:
                watch = Stopwatch()
                results["paper"] = episodes(policy.act, env, job.protocol.scenes, job.seed, watch)
                seconds["paper"] = watch.seconds
        trainable = [value.numel() for value in policy.parameters() if value.requires_grad]
        line = {
            **cell,
            **chosen,
            **{name: result.recorded() for name, result in results.items()},
            **circumstances(),
            "trained_with": self._starts(run),
            "data": read_json(run / "config.json", "a run's configuration")["data"],
            "parameters": sum(trainable),
            "clip_pretrained": pretrained(job),
            "seconds": seconds,
        }
        path.parent.mkdir(exist_ok=True)
        write_json(path, {"line": line, **{name: result.to_dict() for name, result in results.items()}})
        return _kept(path, "a finished test", "line")

    def _policy(self, job: Job, run: Path, step: int) -> GraspPolicy:
        import torch

        from equigrasp.training import load_policy

        torch.set_num_threads(job.threads)
        return load_policy(run, None if step == job.steps else step)

    def _env(self, task: str, camera: str, phrasings: str) -> AbstractContextManager[DemonstratedEnvironment]:
        return closing(self.make_env(task, camera, phrasings))


@dataclass(frozen=True)
class Telling:
    """Work that tells what is wrong with a job and does not raise it, so that the other jobs are done.

    Attributes:
        work: from a job to its lines; it must pickle.
    """

    work: Callable[[Any], list[dict[str, Any]]]

    def __call__(self, job: Any) -> tuple[list[dict[str, Any]], str | None]:
        """The job's lines; without any, one sentence that names the job and says why."""
        try:
            return self.work(job), None
        except (InputError, WorkerLostError) as error:
            return [], f"{job}: {error}"


def _kept(path: Path, what: str, key: str) -> Any:
    """What a job has kept of a part that it finished; InputError if it is damaged."""
    try:
        return read_json(path, what)[key]
    except KeyError:
        raise InputError(f"{path} is damaged: it is not {what}; {AGAIN}") from None


def pretrained(job: Job) -> bool | None:
    """Whether the model's CLIP had learned anything; None where it has no CLIP."""
    return job.model.clip_weights != RANDOM if isinstance(job.model, ClipConfig) else None
