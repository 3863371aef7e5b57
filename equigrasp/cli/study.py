"""The command that fills a table: collect, train, choose, test, cell by cell."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from equigrasp.cli.common import Camera, Phrasings, bar, make_env, options, say
from equigrasp.cli.policy import on_clip
from equigrasp.errors import InputError

if TYPE_CHECKING:
    from equigrasp.config import ModelConfig
    from equigrasp.engines import Engine
    from equigrasp.study.matrix import CostJob, Job, Matrix

    Lines = list[dict[str, Any]]


STUDY, PLAN = "study.json", {"study": 1}
"""The file that makes a folder a study's, and what it says."""


HEARD_BY_COSTS = "table models text_encoder read_out threads timed_steps engine workers address dry_run out"
"""Options that table 5 hears, which measures models and trains none."""


def check_study(folder: Path) -> None:
    """Raise an InputError where a study could not begin or go on; writes nothing."""
    from equigrasp.artefacts import LOCK, PARTIAL, check_folder, open_folder

    check_folder(folder, "--out")
    names = {entry.name for entry in folder.iterdir()} if folder.exists() else set()
    if any(name != LOCK and not name.startswith(PARTIAL) for name in names):
        open_folder(folder, STUDY, PLAN, megabytes=1)  # it was begun, or is refused


@dataclass
class Study:
    """Fill a table of the paper, or one of your own: every finished cell is one line of OUT/results.jsonl.

    The same command goes on with a stopped study, does no finished cell again, and takes over what other studies in
    the same folder trained. `docs/study.md` says which scenes are for what.

    Example: equigrasp study --models leg-steerable --tasks pick-by-part --demos 1 --seeds 0 --steps 4000 --dry-run
    """

    table: Literal[1, 2, 4, 5, 6] | None = None
    """The paper's table, which sets models and tasks unless they are named here: 1 the V-1 tasks, 2 the V-2 tasks, 4
    ablations, 5 parameters and time of a step, 6 pick-by-part."""
    models: tuple[str, ...] = ()
    """Names of models."""
    tasks: tuple[str, ...] = ()
    """Tasks to train on."""
    tested_on: tuple[str, ...] = ()
    """Tasks to test on [default: pick-random-v1 and -v2 on their parts and themselves (v2 on pick-novel-v2 too), any
    other on itself]."""
    demos: tuple[int, ...] = (1, 10)
    """Numbers of demonstrations."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Each sets demonstrations, weights, and scenes; from 0 to 999."""
    steps: tuple[int, ...] = (40_000,)
    """Gradient steps."""
    recombination: tuple[float, ...] = (0.0,)
    """Shares of recombined examples; 0 is the paper's own way."""
    hard_negatives: float = 0.0
    """Share of recombined examples whose other objects are like the target."""
    crowded: float = 0.0
    """Share of recombined examples in which objects stand where the hand would come down."""
    scenes: int = 100
    """Scenes of the paper's protocol in each test; 0 leaves it out."""
    queries: int = 500
    """Single shots in each test; 0 leaves them out."""
    checkpoints: int = 4
    """Validation chooses the best of so many, evenly spaced; 1 takes the last."""
    validation: int = 100
    """Single shots for each checkpoint, in scenes that no test has."""
    turned: int = 40
    """Scenes in which the target alone is turned: does the grasp follow? 0 leaves out all figures of symmetry."""
    phrasings: Phrasings = "seen"
    """Phrasings of the tests."""
    camera: Camera = "fused"
    """Three fused RGB-D cameras, as in the paper, or one overhead (several times faster)."""
    text_encoder: str | None = None
    """Who reads the instruction: minilm, hashing, ... [default: each model's own]."""
    read_out: Literal["half", "full"] | None = None
    """Resolution of every read-out, of the heightmap's; kernels keep their cells [default: each model's own, half]."""
    clip_weights: tuple[str, ...] = ()
    """For models on CLIP: openai, .safetensors files, or random; without, they are listed and not run."""
    threads: int = 1
    """Torch threads of each worker; the bits of a result depend on it."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Where to train; --workers N trains N models side by side on one GPU. Tests run on the processor."""
    timed_steps: int = 20
    """Of table 5: steps that are timed."""
    engine: Literal["local", "ray"] = "local"
    """Processes of this machine, or a Ray cluster (needs `equigrasp[ray]`, and OUT on a disk that all nodes see)."""
    workers: int | None = None
    """Trainings at the same time [default: 1; on Ray, one for each CPU]."""
    address: str | None = None
    """HOST:PORT of a Ray cluster that this machine is a node of [default: start one here]."""
    dry_run: bool = False
    """List what is done, what is missing and how long it takes; do nothing, not even bake meshes of your own."""
    out: Path | None = None
    """The study's folder [default: studies/table-N or studies/own]."""

    def execute(self) -> Path:
        """Do what is missing, and give the file of results."""
        from equigrasp.engines import ENGINES
        from equigrasp.study.results import RESULTS

        out = (self.out or Path("studies") / (f"table-{self.table}" if self.table else "own")).absolute()
        costs = self.table == 5
        if costs:
            self._check_costs()
        if self.device != "cpu":
            from equigrasp.training.devices import Devices

            Devices(self.device)  # that there is none is said before any work
        models, left_out = self._models()
        if left_out:
            say(*left_out)
        if not models:
            raise InputError("none of these models can be run, so that there is nothing to study")
        if self.dry_run:
            check_study(out)
        if costs:
            self._costs(models, out, ENGINES[self.engine](self.workers, self.address))
        else:
            self._cells(self._matrix(models).jobs(), out, ENGINES[self.engine](self.workers, self.address))
        return out / RESULTS

    def _check_costs(self) -> None:
        """Raise an InputError for an option that table 5 would not hear."""
        if (self.workers or 1) > 1:
            raise InputError(
                f"--workers is {self.workers}, but steps that run side by side slow each other; leave it out"
            )
        ignored = [
            f"--{each.name.replace('_', '-')}"
            for each in fields(self)
            if each.name not in HEARD_BY_COSTS.split() and getattr(self, each.name) != each.default
        ]
        if ignored:
            raise InputError(
                f"table 5 measures models on the processor and trains nothing; leave out {', '.join(ignored)}"
            )

    def _models(self) -> tuple[list[ModelConfig], list[str]]:
        """The rows that can be run, and a line for each that cannot."""
        from equigrasp import language
        from equigrasp.config import ClipConfig, read_out_at
        from equigrasp.models import find
        from equigrasp.study.tables import TABLES

        names = self.models or (TABLES[self.table].models if self.table else ())
        if not names:
            raise InputError("a study needs --table, or --models and --tasks; `equigrasp models` lists the models")
        found, left_out = [], []
        for name in dict.fromkeys(names):
            model = find(name)
            if self.text_encoder is not None:
                model = replace(model, text_encoder=self.text_encoder)
            if self.read_out is not None:
                model = read_out_at(model, self.read_out)
            if self.table == 5:
                language.width(model.encoder)  # fresh weights, and nothing is read
            elif isinstance(model, ClipConfig):
                model, why = self._on_clip(model)
                if model is None:
                    left_out.append(f"not run: {name}, {why}")
                    continue
            else:
                model.check()
                language.check_encoder(model.encoder)
            found.append(model)
        return found, left_out

    def _on_clip(self, model: ModelConfig) -> tuple[ModelConfig | None, str]:
        """The model on the first of --clip-weights that are its tower's; or None, and why."""
        from equigrasp.language import check_encoder

        why = "which needs CLIP's weights; --clip-weights names them"
        for weights in self.clip_weights:
            try:
                loaded = on_clip(model, weights)
                loaded.check()
                check_encoder(loaded.encoder)
            except InputError as error:
                why = str(error)
            else:
                return loaded, ""
        return None, why

    def _matrix(self, models: list[ModelConfig]) -> Matrix:
        from equigrasp.study.matrix import Matrix, Protocol
        from equigrasp.study.tables import TABLES
        from tasks import find_row, find_task

        tasks = self.tasks or (TABLES[self.table].tasks if self.table else ())
        if not tasks:
            raise InputError("a study needs --table or --tasks; `equigrasp tasks` lists the tasks")
        for option in ("demos", "seeds", "steps", "recombination"):
            if not getattr(self, option):
                raise InputError(f"--{option} has no number, so that nothing would be studied; name one, or leave it")
        names = dict.fromkeys((*tasks, *self.tested_on))
        # a look at what is missing must not bake somebody's meshes
        rows = {task: (find_row if self.dry_run else find_task)(task) for task in names}
        for task in tasks:
            if not rows[task].trains:
                raise InputError(f"{task} is for testing alone; train on pick-random-v2, which is tested on it too")
        return Matrix(
            models=tuple(models),
            tasks=tasks,
            demos=self.demos,
            seeds=self.seeds,
            steps=self.steps,
            recombination=self.recombination,
            hard_negatives=self.hard_negatives,
            crowded=self.crowded,
            camera=self.camera,
            threads=self.threads,
            checkpoints=self.checkpoints,
            protocol=Protocol(self.scenes, self.queries, self.validation, self.turned, self.phrasings),
            tested_on=self.tested_on,
            device=self.device,
            rows=tuple((name, row.fingerprint()) for name, row in rows.items() if ":" in name),
        )

    def _cells(self, jobs: list[Job], out: Path, engine: Engine) -> None:
        from equigrasp.study.listing import listing
        from equigrasp.study.results import RESULTS, known_by, read
        from equigrasp.study.work import Work
        from equivariance_tests.record import symmetry
        from tasks import find_task

        def missing(lines: Lines) -> list[Job]:
            done = {known_by(line) for line in lines}
            left = [
                replace(job, tests=tuple(task for task in job.tests if known_by(job.cell(task)) not in done))
                for job in jobs
            ]
            return [job for job in left if job.tests]

        if self.dry_run:
            lines, half = read(out / RESULTS)
            if half:
                say(f"the last line of {out / RESULTS} is not whole; its cell counts as missing")
            say(*listing(jobs, missing(lines), lines, out, self.workers or 1))
            return
        names = {task for job in jobs for task in (job.task, *job.tests)}
        work = Work(out, make_env, {name: len(find_task(name).goals) for name in names}, symmetry)
        self._run(work, missing, out, engine, collect_first=True)

    def _costs(self, models: list[ModelConfig], out: Path, engine: Engine) -> None:
        from equigrasp.study.cost import measure
        from equigrasp.study.matrix import CostJob
        from equigrasp.study.results import RESULTS, known_by, read

        jobs = [CostJob(model, self.threads, self.timed_steps) for model in models]

        def missing(lines: Lines) -> list[CostJob]:
            done = {known_by(line) for line in lines}
            return [job for job in jobs if known_by(job.cell()) not in done]

        if self.dry_run:
            left = missing(read(out / RESULTS)[0])
            say(*(f"{'missing' if job in left else 'done':8} {job.model.name}" for job in jobs))
            return
        self._run(measure, missing, out, engine)

    def _run(self, work: Any, missing: Any, out: Path, engine: Engine, collect_first: bool = False) -> None:
        """Do the missing jobs, and add their lines as they come."""
        from equigrasp.artefacts import alone, append_line, open_folder
        from equigrasp.study.results import RESULTS, recover
        from equigrasp.study.work import Telling

        open_folder(out, STUDY, PLAN, megabytes=1)
        with alone(out, "study"):
            lines, half = recover(out / RESULTS)
            if half:
                say(f"the last line of {out / RESULTS} was not whole; it is dropped, and its cell is made again")
            left = missing(lines)
            if collect_first:
                self._collect(left, out, engine)
            undone = 0
            with closing(engine(Telling(work), left)) as results:
                for _, (measured, wrong) in bar("study", "jobs")(results, len(left)):
                    if wrong is not None:
                        undone += 1
                        say(f"not done: {wrong}")
                    for line in measured:
                        append_line(out / RESULTS, line)
        if undone:
            raise InputError(
                f"{undone} of {len(left)} jobs could not be done, for the reasons above; what the others gave is in "
                f"{out / RESULTS}, and the same command tries these again"
            )
        say(
            f"every cell of this study that can be run is a line of {out / RESULTS}",
            f"next: uv run python paper_figs/tables.py{options(results=out / RESULTS, out=out)}",
        )

    def _collect(self, jobs: list[Job], out: Path, engine: Engine) -> None:
        """Each task's demonstrations once, whoever trains on them."""
        from equigrasp.collection import Collection, draw_goals
        from equigrasp.demonstrations import MANIFEST, collect
        from tasks import find_task

        for job in {job.data: job for job in jobs}.values():
            folder = out / job.data
            if (folder / MANIFEST).exists():
                continue
            folder.parent.mkdir(exist_ok=True)
            goals = draw_goals(find_task(job.task).demonstration_goals, job.demos, job.seed)
            collection = Collection(job.task, goals, job.seed, job.camera)
            collect(collection, partial(make_env, job.task, self.camera), folder, engine, bar(folder.name, "grasps"))
