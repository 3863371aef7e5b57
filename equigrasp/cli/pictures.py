"""Commands that end in a picture: one query looked at closely, and the whole job from nothing."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from equigrasp.cli.common import Camera, a_sentence, camera_of, make_env, options, say, task_of
from equigrasp.cli.policy import Evaluate, Train
from equigrasp.cli.queries import ask, draw_trials
from equigrasp.cli.suite import Collect
from equigrasp.errors import InputError

if TYPE_CHECKING:
    from equigrasp.success import Evaluation


@dataclass
class Show:
    """Look at one query: scene, heatmap, angles, grasp and outcome as one picture.

    Example: equigrasp show --run runs/my-run --seed 3 --instruction "pick up the mug by its handle"
    """

    run: Path
    """A run folder that `equigrasp train` made."""
    task: str | None = None
    """Name of the task [default: the one it was trained on]."""
    seed: int = 3
    """Which scene of those that `equigrasp evaluate` tests, none a demonstration's: s * 1000000 + k is the k-th from 0
    of its --seed s."""
    goal: int | None = None
    """Index of the goal, in the order of `equigrasp tasks`; of n goals, the k-th single shot asks for k modulo n
    [default: the scene's own, as the paper's protocol asks]."""
    instruction: str | None = None
    """What to say [default: the scene's own sentence]."""
    camera: Camera | None = None
    """Cameras [default: those it was trained with]."""
    step: int | None = None
    """A step whose weights were kept [default: the last]."""
    out: Path | None = None
    """The picture, a .png or .pdf [default: in the run folder]."""

    def execute(self) -> None:
        """Grasp once and draw it."""
        from equigrasp.artefacts import check_folder, check_writable
        from equigrasp.evaluation import scene_at
        from equigrasp.language import check
        from equigrasp.plan import find_weights, read_plan

        plan = read_plan(self.run)
        find_weights(self.run, self.step)
        task = task_of(plan, self.task)
        camera = camera_of(plan, self.camera)
        if self.instruction is not None:
            check(self.instruction)
        if self.goal is not None and not 0 <= self.goal < len(task.goals):
            raise InputError(f"--goal is {self.goal}, but {task.name} has goals 0 to {len(task.goals) - 1}")
        scene = scene_at(self.seed)
        step = "" if self.step is None else f"-step-{self.step}"
        out = self.out or self.run / "pictures" / f"{task.name}-seed{self.seed}{step}.png"
        if out.suffix.lower() not in (".png", ".pdf"):
            raise InputError(f"--out is {out}, but its name must end in .png or .pdf, which says the format")
        check_folder(out.parent, "--out")
        if out.parent.exists():
            check_writable(out, "--out")
        from equigrasp.training import load_policy

        policy = load_policy(self.run, self.step)
        # an encoder that is not to be had is said before a simulator starts
        policy.embed(self.instruction or a_sentence(task))
        env = make_env(task, camera, render_mode="rgb_array")
        try:
            query = ask(policy, env, scene, self.goal, self.instruction)
        finally:
            env.close()
        from equigrasp.pictures import draw

        out.parent.mkdir(parents=True, exist_ok=True)
        of_step = "" if self.step is None else f", step {self.step}"
        draw([query], out, f"{self.run.name} on {task.name}, scene {self.seed}{of_step}")
        say(f"\u201c{query.instruction}\u201d: {query.outcome}", f"the picture is {out}")
        same = {"task": self.task, "goal": self.goal, "instruction": self.instruction, "camera": self.camera}
        say(f"next: equigrasp show{options(run=self.run, step=self.step, **same, seed=self.seed + 1)}")


@dataclass
class Quickstart:
    """The whole job from nothing: collect, train, evaluate, draw. Two to four minutes on two cores.

    Example: equigrasp quickstart
    """

    task: str = "pick-by-part"
    """Name of the task."""
    model: str = "leg-steerable"
    """Name of the model."""
    demos: int = 1
    """Demonstrations; one holds a grasp for every goal of the task."""
    steps: int = 1500
    """Gradient steps."""
    queries: int = 100
    """Unseen single-shot queries to measure on."""
    camera: Camera = "overhead"
    """The overhead camera is several times faster than the paper's three."""
    seed: int = 0
    """Of everything, from 0 to 999."""
    out: Path = Path("quickstart")
    """Where data, run and pictures go."""

    def execute(self) -> None:
        """Run the commands one after the other, then draw."""
        from equigrasp.artefacts import check_folder
        from equigrasp.evaluation import SCENES_PER_SEED
        from equigrasp.language import check_encoder
        from equigrasp.models import find
        from equigrasp.plan import Training, check_model
        from tasks import find_task

        task, model = find_task(self.task), find(self.model)
        # all that its commands would refuse, before the first of them works
        model.check()
        check_encoder(model.encoder)
        Training(steps=self.steps, seed=self.seed)
        if not 1 <= self.queries <= SCENES_PER_SEED:
            raise InputError(f"--queries is {self.queries}, but it must be from 1 to {SCENES_PER_SEED}")
        for name in ("data", "run", "right", "wrong"):
            check_folder(self.out / name, "--out")
        check_model(self.out / "run", model)
        say(f"1/4  the oracle demonstrates {task.name}")
        data = Collect(self.task, self.demos, self.camera, self.seed, self.out / "data").execute()
        say(f"\n2/4  {self.model} learns from that")
        run = Train(data, self.model, self.steps, self.seed, out=self.out / "run").execute()
        say(f"\n3/4  {self.queries} queries in scenes that it has not seen, one grasp each")
        result = Evaluate(run, scenes=self.queries, protocol="single-shot", seed=self.seed).execute()
        say("\n4/4  pictures")
        for path in self.draw(run, result):
            say(f"    {path}")
        say(
            f"next: equigrasp show --run {shlex.quote(str(run))} --seed 3, or `equigrasp train --help` for a longer "
            "training"
        )

    def draw(self, run: Path, result: Evaluation) -> list[Path]:
        """Draw four queries with different objects, and up to four failures; give the pictures' paths."""
        from equigrasp.training import load_policy

        policy = load_policy(run)
        different = {trial.object: trial for trial in result.trials if trial.correct}
        failures = [trial for trial in result.trials if not trial.correct]
        after = f"{self.model} after {self.steps} steps"
        rates = f"{result.correct.successes} of {result.correct.trials} unseen queries right"
        env = make_env(self.task, self.camera, render_mode="rgb_array")
        try:
            right = draw_trials(policy, env, [*different.values()][:4], self.out / "right", f"{after}: {rates}")
            wrong = draw_trials(policy, env, failures[:4], self.out / "wrong", f"{after}: what went wrong")
        finally:
            env.close()
        return right + wrong
