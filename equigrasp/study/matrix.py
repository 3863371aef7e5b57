"""Which cells a study has: models by tasks by demonstrations by seeds.

A job is one training and the tasks that it is tested on; a cell is one of these tests. A cell is known by its
settings: two cells with the same settings are the same one, wherever its line was written. Costs no torch.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from equigrasp.collection import check_demos, check_seed
from equigrasp.config import ModelConfig
from equigrasp.errors import InputError
from equigrasp.evaluation import SCENES_PER_SEED
from equigrasp.plan import check_at_least, check_shares, check_threads
from equigrasp.study.settings import config, digest
from equigrasp.study.tables import TESTED_ON


@dataclass(frozen=True)
class Protocol:
    """How a trained policy is measured.

    Attributes:
        scenes: of the paper's protocol in each test; 0 leaves it out.
        queries: single shots in each test; 0 leaves them out.
        validation: single shots for each checkpoint, in scenes that no test has, on the task that was trained on.
        turned: scenes of the trained task in which the target alone is turned, to see whether the grasp follows; 0
            leaves out all figures of symmetry.
        phrasings: "seen" or "unseen", of the tests.

    Raises:
        InputError: if a number is out of range.
    """

    scenes: int = 100
    queries: int = 500
    validation: int = 100
    turned: int = 40
    phrasings: str = "seen"

    def __post_init__(self) -> None:
        for name, fewest in (("scenes", 0), ("queries", 0), ("validation", 1), ("turned", 0)):
            if not fewest <= getattr(self, name) <= SCENES_PER_SEED:
                raise InputError(
                    f"--{name} is {getattr(self, name)}, but it must be from {fewest} to {SCENES_PER_SEED}"
                )
        if not self.scenes and not self.queries:
            raise InputError("--scenes and --queries are both 0, so that nothing would be tested; raise one of them")


@dataclass(frozen=True)
class Job:
    """One training, and the tests of what it trained.

    Attributes:
        model: the model's row.
        task: what is demonstrated.
        demos: how many demonstrations.
        seed: of the demonstrations, the weights and draws, the validation scenes and the test scenes.
        steps: gradient steps.
        recombination: share of recombined examples; 0 is the paper's own way.
        camera: the environment's.
        threads: torch threads; the bits of a result depend on it.
        checkpoints: between how many checkpoints, evenly spaced, validation chooses; 1 takes the last.
        protocol: how it is tested.
        tests: names of the tasks that it is tested on.
        device: "cpu" or "cuda", where it is trained; it is tested on the processor.
        hard_negatives: share of recombined examples whose other objects are like the target.
        crowded: share of recombined examples in which objects stand where the hand would come down.
        rows: names of tasks of one's own, and what their rows are now: an edited row is another task.
        settings: what the model is known by, as it was when the job was made, in whichever process.

    Raises:
        InputError: if a value is out of range, or the model's file of weights is not there.
    """

    model: ModelConfig
    task: str
    demos: int
    seed: int
    steps: int
    recombination: float
    camera: str
    threads: int
    checkpoints: int
    protocol: Protocol
    tests: tuple[str, ...]
    device: str = "cpu"
    hard_negatives: float = 0.0
    crowded: float = 0.0
    rows: tuple[tuple[str, str], ...] = ()
    settings: Mapping[str, Any] = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_seed(self.seed)
        check_demos(self.demos)
        check_at_least(1, steps=self.steps, checkpoints=self.checkpoints)
        check_threads(self.threads)
        check_shares(self.recombination, self.hard_negatives, self.crowded)
        object.__setattr__(self, "settings", config(self.model))

    @property
    def keep_every(self) -> int:
        """Steps between the checkpoints to choose from, a multiple of 50; 0 if the last is the only one."""
        every = 50 * -(-self.steps // (50 * self.checkpoints))
        return every if every < self.steps else 0

    @property
    def candidates(self) -> list[int]:
        """The steps whose weights validation chooses from; the last is always among them."""
        return [*(range(self.keep_every, self.steps, self.keep_every) if self.keep_every else ()), self.steps]

    @property
    def data(self) -> Path:
        """Where its demonstrations lie, from the study's folder: jobs that share them share this."""
        own = "".join(f"-{row}" for row in self._rows(self.task).values())
        return Path("data") / f"{_file(self.task)}-{self.demos}demos-seed{self.seed}-{self.camera}{own}"

    @property
    def run(self) -> Path:
        """Where it trains, from the study's folder."""
        ways = {
            "model": {"name": self.model.name, **self.settings},
            "recombination": self.recombination,
            "camera": self.camera,
            "threads": self.threads,
            "keep_every": self.keep_every,
            **self._rows(self.task),
            **self._trained_otherwise,
        }
        name = f"{self.model.name}-{_file(self.task)}-{self.demos}demos-{self.steps}steps-seed{self.seed}"
        return Path("runs") / f"{name}-{digest(ways)}"

    def cell(self, tested_on: str) -> dict[str, Any]:
        """The settings of one of its tests, as JSON: all that determines the result."""
        return {
            "kind": "grasp",
            "model": self.model.name,
            "config": dict(self.settings),
            "trained_on": self.task,
            "tested_on": tested_on,
            "demos": self.demos,
            "seed": self.seed,
            "steps": self.steps,
            "recombination": self.recombination,
            "camera": self.camera,
            "threads": self.threads,
            "checkpoints": self.checkpoints,
            "scenes": self.protocol.scenes,
            "queries": self.protocol.queries,
            "validation": self.protocol.validation,
            "turned": self.protocol.turned,
            "phrasings": self.protocol.phrasings,
            **self._rows(self.task, tested_on),
            **self._trained_otherwise,
        }

    def _rows(self, *tasks: str) -> dict[str, str]:
        """What the rows of those of these tasks are that are one's own, as settings."""
        return {f"row of {name}": row for name, row in self.rows if name in tasks}

    @property
    def _trained_otherwise(self) -> dict[str, Any]:
        """What is not as it was for all cells before there was a choice."""
        ways = {
            "training_device": (self.device, "cpu"),
            "learning_rate": (self.model.learning_rate, ModelConfig.learning_rate),
            "hard_negatives": (self.hard_negatives, 0.0),
            "crowded": (self.crowded, 0.0),
        }
        return {key: value for key, (value, usual) in ways.items() if value != usual}

    def __str__(self) -> str:
        way = f", recombination {self.recombination:g}" if self.recombination else ""
        way += f", hard negatives {self.hard_negatives:g}" if self.hard_negatives else ""
        way += f", crowded {self.crowded:g}" if self.crowded else ""
        return f"{self.model.name}, {self.task}, {self.demos} demos, seed {self.seed}, {self.steps} steps{way}"


@dataclass(frozen=True)
class CostJob:
    """A model whose size and time are measured (Table 5): no data, fresh weights.

    Attributes:
        model: the model's row.
        threads: torch threads.
        timed: steps that are timed.
        settings: as of a `Job`, of the model without weights.

    Raises:
        InputError: if nothing would be timed.
    """

    model: ModelConfig
    threads: int
    timed: int = 20
    settings: Mapping[str, Any] = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_at_least(1, timed_steps=self.timed)
        check_threads(self.threads)
        object.__setattr__(self, "settings", config(self.model.untrained()))

    def cell(self) -> dict[str, Any]:
        """Its settings, as JSON."""
        return {
            "kind": "cost",
            "model": self.model.name,
            "config": dict(self.settings),
            "threads": self.threads,
            "timed_steps": self.timed,
        }

    def __str__(self) -> str:
        return self.model.name


@dataclass(frozen=True)
class Matrix:
    """All jobs of a study, in the order in which they are done: every model once before any second seed.

    Attributes:
        models: the rows.
        tasks: what is trained on.
        demos: numbers of demonstrations.
        seeds: from 0 to 999 each.
        steps: numbers of gradient steps.
        recombination: shares of recombined examples.
        protocol: how each is tested.
        tested_on: tasks to test on instead of those of `TESTED_ON`.
        device: "cpu" or "cuda", where all are trained.
        hard_negatives: share of recombined examples whose other objects are like the target.
        crowded: share of recombined examples in which objects stand where the hand would come down.
        rows: names of tasks of one's own, and what their rows are now.
    """

    models: tuple[ModelConfig, ...]
    tasks: tuple[str, ...]
    demos: tuple[int, ...]
    seeds: tuple[int, ...]
    steps: tuple[int, ...]
    recombination: tuple[float, ...] = (0.0,)
    camera: str = "fused"
    threads: int = 1
    checkpoints: int = 4
    protocol: Protocol = field(default_factory=Protocol)
    tested_on: tuple[str, ...] = ()
    device: str = "cpu"
    hard_negatives: float = 0.0
    crowded: float = 0.0
    rows: tuple[tuple[str, str], ...] = ()

    def jobs(self) -> list[Job]:
        """Every training once."""
        axes = (self.seeds, self.tasks, self.demos, self.steps, self.recombination, self.models)
        jobs = (
            Job(
                model=model,
                task=task,
                demos=demos,
                seed=seed,
                steps=steps,
                recombination=recombination + 0.0,  # which makes of -0.0, another number in JSON, the same cell
                camera=self.camera,
                threads=self.threads,
                checkpoints=self.checkpoints,
                protocol=self.protocol,
                tests=tuple(dict.fromkeys(self.tested_on or TESTED_ON.get(task, (task,)))),
                device=self.device,
                hard_negatives=self.hard_negatives,
                crowded=self.crowded,
                rows=self.rows,
            )
            for seed, task, demos, steps, recombination, model in itertools.product(*axes)
        )
        return list(dict.fromkeys(jobs))


def _file(task: str) -> str:
    return task.replace(":", "-")
