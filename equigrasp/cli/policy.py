"""Commands about policies: what models there are, training, evaluation."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from equigrasp.cli.common import Camera, Phrasings, a_sentence, bar, camera_of, make_env, options, say, task_of
from equigrasp.cli.queries import draw_trials
from equigrasp.errors import InputError

if TYPE_CHECKING:
    from equigrasp.config import ModelConfig
    from equigrasp.evaluation import Act
    from equigrasp.success import Evaluation


@dataclass
class Models:
    """List the models: what each is; or count their parameters, or compare two of them.

    Example: equigrasp models --diff leg-unet leg-unet-no-steerability
    """

    count: bool = False
    """Make each model and count its trainable parameters, beside the paper's figure."""
    diff: tuple[str, str] | None = None
    """Two models: print the settings in which they differ, and nothing else."""

    def execute(self) -> None:
        """Print them."""
        from equigrasp.config import ClipConfig, differences
        from equigrasp.models import MODELS, count_parameters, find

        if self.diff is not None:
            one, other = (find(name) for name in self.diff)
            for setting, (before, after) in differences(one, other).items():
                say(f"{setting}: {_said(before)} -> {_said(after)}")
            return
        for name, config in MODELS.items():
            say(f"{name:28} {config.summary}")
            if isinstance(config, ClipConfig):
                say(f"{'':28} on {config.tower}, weights {config.clip_weights}: its image tower is frozen")
            if config.note:
                say(f"{'':28} {config.note}")
            if self.count:
                trainable, frozen = count_parameters(config)
                paper = f"{config.paper_parameters:.1f} M" if config.paper_parameters else "not in it"
                apart = f", and {frozen / 1e6:.1f} M frozen" if frozen else ""
                say(f"{'':28} {trainable / 1e6:.2f} M trainable parameters{apart} (the paper: {paper})")
        say("next: equigrasp train --model leg-steerable --data DIR")


def _said(value: object) -> str:
    return "not there" if value is None else str(value)


@dataclass
class Train:
    """Train a policy; the same command goes on where a stopped one was.

    Example: equigrasp train --model leg-steerable --data data/pick-by-part-1demos-seed0 --steps 4000
    """

    data: Path
    """A folder that `equigrasp collect` made, or `equigrasp.demonstrations.store` (docs/my_robot.md)."""
    model: str = "leg-steerable"
    """Name of the model (`equigrasp models` lists them), or of a config of yours: my_module:MY_MODEL."""
    steps: int = 4000
    """Gradient steps."""
    seed: int = 0
    """Of the weights and of every draw, from 0 to 999."""
    recombination: float = 0.7
    """Share of examples put together from objects, colours and sentences of demonstrations; 0 is the paper's own."""
    hard_negatives: float = 0.0
    """Share of these whose other objects are like the target: goals of its kind, its thing in other colours."""
    crowded: float = 0.0
    """Share of these in which objects stand where the hand would come down, so that it grasps beside them."""
    batch: int = 1
    """Examples a step, on each device."""
    learning_rate: float | None = None
    """Adam's [default: the model's own]."""
    precision: Literal["auto", "float32", "bfloat16"] = "auto"
    """bfloat16 where the processor multiplies it natively, or the one named."""
    read_out: Literal["half", "full"] | None = None
    """Resolution of the read-out, of the heightmap's; kernels keep their cells [default: the model's own, half]."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where to train: auto takes a GPU if there is one."""
    devices: int = 1
    """Devices that share each step, a process on each: of batch B, N of them do what one does with N x B."""
    threads: int | None = None
    """Torch threads of each process [default: one for each core that it may use, shared out among them; of a run that
    was begun, its own]."""
    text_encoder: str | None = None
    """Who reads the instruction: minilm, hashing, a clip-* tower or clip-*:FILE [default: the model's own]."""
    clip_weights: str | None = None
    """For a model on CLIP, whose weights: openai, a .safetensors file, or random [default: openai]."""
    checkpoint_every: int = 200
    """Steps between checkpoints; a multiple of 50."""
    keep_every: int = 0
    """Keep the weights of every so many steps too, for a learning curve; a multiple of 50."""
    out: Path | None = None
    """The run folder [default: runs/MODEL-TASK-DEMOSdemos-STEPSsteps-seedSEED]."""

    def execute(self) -> Path:
        """Train, and give the run folder."""
        from equigrasp.config import read_out_at
        from equigrasp.demonstrations import load
        from equigrasp.language import check_encoder
        from equigrasp.models import find
        from equigrasp.plan import Training, check_model
        from tasks import TASKS

        model = find(self.model)
        encoder = model.text_encoder if self.text_encoder is None else self.text_encoder
        model = replace(model, precision=self.precision, text_encoder=encoder)
        if self.clip_weights is not None:
            model = on_clip(model, self.clip_weights)
        if self.read_out is not None:
            model = read_out_at(model, self.read_out)
        model.check()
        check_encoder(model.encoder)
        training = Training(
            steps=self.steps,
            seed=self.seed,
            batch=self.batch,
            learning_rate=self.learning_rate,
            recombination=self.recombination,
            hard_negatives=self.hard_negatives,
            crowded=self.crowded,
            threads=1 if self.threads is None else self.threads,
            checkpoint_every=self.checkpoint_every,
            keep_every=self.keep_every,
        )
        demonstrations = load(self.data)
        task = demonstrations[0].task
        if self.out is not None:
            check_model(self.out, model)
        from equigrasp.precision import multiplies_bfloat16
        from equigrasp.training import train
        from equigrasp.training.devices import Devices

        devices = Devices.found(self.device, self.devices)
        if self.precision == "bfloat16" and not multiplies_bfloat16("auto", devices.kind):
            say(
                "this processor has no instruction for bfloat16, which may take several times as long as float32; "
                "--precision auto knows"
            )
        demos = 1 + max(each.demo for each in demonstrations)
        name = f"{model.name}-{task}-{demos}demos-{self.steps}steps-seed{self.seed}"
        if self.read_out is not None:
            name += f"-{self.read_out}"
        if devices.plan():
            name += f"-{devices.count}{devices.kind}"
        out = self.out or Path("runs") / name
        check_model(out, model)
        if self.threads is None:
            training = replace(training, threads=_threads(out, devices.count))
        train(model, training, demonstrations, self.data, out, bar("train", "steps"), devices)
        say(f"the trained policy lies in {out}")
        # of a table of one's own there is nothing to simulate
        if task in TASKS or ":" in task:
            say(f"next: equigrasp evaluate --run {shlex.quote(str(out))}")
        return out


def _threads(run: Path, processes: int) -> int:
    """Those that a run was begun with, on a machine of other cores perhaps; of a new one all cores, shared out."""
    import joblib

    from equigrasp.plan import PLAN, read_plan

    begun = read_plan(run)["training"].get("threads") if (run / PLAN).is_file() else None
    return begun if isinstance(begun, int) else max(joblib.cpu_count() // processes, 1)


def on_clip(model: ModelConfig, weights: str) -> ModelConfig:
    """The model on a CLIP of these weights; a file is named from the root, so that the run is not tied to a folder.

    Raises:
        InputError: if the model has no CLIP.
    """
    from equigrasp.clip import OPENAI, RANDOM
    from equigrasp.config import ClipConfig

    if not isinstance(model, ClipConfig):
        raise InputError(f"{model.name} has no CLIP, so --clip-weights {weights} says nothing; leave it out")
    if weights not in (OPENAI, RANDOM):
        weights = str(Path(weights).expanduser().absolute())
    return replace(model, clip_weights=weights)


@dataclass
class Evaluate:
    """Measure a policy's success rates on scenes that no demonstration showed, the oracle beside it.

    Example: equigrasp evaluate --run runs/my-run --protocol single-shot --scenes 500
    """

    run: Path
    """A run folder that `equigrasp train` made."""
    task: str | None = None
    """Name of the task [default: the one it was trained on]."""
    scenes: int = 100
    """How many scenes."""
    protocol: Literal["paper", "single-shot"] = "paper"
    """The paper's (n goals a scene, n + 1 trials) or one grasp a scene, balanced over the goals."""
    phrasings: Phrasings = "seen"
    """Phrasings that demonstrations use, or those held out."""
    camera: Camera | None = None
    """Cameras [default: those it was trained with]."""
    seed: int = 0
    """Which scenes, from 0 to 999; none is a demonstration's."""
    step: int | None = None
    """A step whose weights were kept [default: the last]."""
    oracle: bool = True
    """Also measure the scripted oracle on the same scenes."""
    threads: int | None = None
    """Torch threads [default: one for each core]."""
    failures: int = 0
    """Draw up to so many failed single shots, one row each, into the folder OUT-failures beside the JSON file."""
    record: Path | None = None
    """A file of results that gets one more line, the rates without the trials; figures are drawn from it."""
    out: Path | None = None
    """The JSON file with every trial [default: in the run folder]."""

    def execute(self) -> Evaluation:
        """Evaluate, print the rates, write every trial; give the policy's evaluation."""
        from equigrasp.artefacts import append_line, check_folder, check_writable, write_json
        from equigrasp.evaluation import check_scenes, episodes, single_shot
        from equigrasp.plan import check_at_least, check_threads, find_weights, read_plan, step_of

        check_scenes(self.scenes, self.seed)
        check_at_least(0, failures=self.failures)
        check_threads(1 if self.threads is None else self.threads)
        plan = read_plan(self.run)
        find_weights(self.run, self.step)
        task = task_of(plan, self.task)
        camera = camera_of(plan, self.camera)
        step = "last" if self.step is None else str(self.step)
        name = f"{task.name}-{self.protocol}-{self.scenes}-{self.phrasings}-seed{self.seed}-step-{step}"
        # the run's own camera goes without saying
        name += "" if camera == plan["camera"] else f"-{camera}"
        out = self.out or self.run / "evaluations" / f"{name}.json"
        if self.out is None:
            check_folder(out.parent, "--out")
        else:
            check_writable(self.out, "--out")
        drawn = out.with_name(f"{out.stem}-failures")
        if self.failures:
            check_folder(drawn, "--out")
        if self.record is not None:
            check_writable(self.record, "--record", lines=True)
        if self.failures and self.protocol != "single-shot":
            raise InputError(
                f"--failures {self.failures} draws single shots, but --protocol is {self.protocol}; "
                "add --protocol single-shot, or leave --failures out"
            )
        from equigrasp.training import load_policy

        policy = load_policy(self.run, self.step)
        # an encoder that is not to be had is said before a simulator starts
        policy.embed(a_sentence(task, self.phrasings))
        import joblib
        import torch

        torch.set_num_threads(self.threads or joblib.cpu_count())
        env = make_env(task, camera, self.phrasings)
        actors: dict[str, Act] = {"policy": policy.act}
        if self.oracle:
            actors["oracle"] = lambda observation, instruction: env.oracle()[0]
        results = {}
        try:
            for actor, act in actors.items():
                if self.protocol == "paper":
                    results[actor] = episodes(act, env, self.scenes, self.seed, bar(actor, "scenes"))
                else:
                    results[actor] = single_shot(
                        act, env, len(task.goals), self.scenes, self.seed, bar(actor, "queries")
                    )
        finally:
            env.close()
        # before anything is said: whoever listens may leave, and the work is to stay
        out.parent.mkdir(exist_ok=True)
        what = {
            "task": task.name,
            "protocol": self.protocol,
            "phrasings": self.phrasings,
            "camera": camera,
            "seed": self.seed,
            "step": step_of(plan, self.step),
            "run": plan,
        }
        write_json(out, {**what, **{actor: result.to_dict() for actor, result in results.items()}})
        if self.record is not None:
            rates = {actor: result.recorded() for actor, result in results.items()}
            append_line(self.record, {**what, **rates})
        say(f"{task.name}, {self.protocol} protocol, {self.scenes} scenes, {self.phrasings} phrasings (95% Wilson)")
        for actor, result in results.items():
            say(f"{actor}:")
            say(*(f"    {line}" for line in result.lines()))
        if self.failures:
            failed = [trial for trial in results["policy"].trials if not trial.correct][: self.failures]
            watched = make_env(task, camera, self.phrasings, render_mode="rgb_array")
            try:
                pictures = draw_trials(policy, watched, failed, drawn, f"failures of {self.run.name}")
            finally:
                watched.close()
            say(*(f"failures are drawn in {path}" for path in pictures))
        same = {"step": self.step, "task": self.task, "camera": self.camera}
        say(f"every trial lies in {out}", f"next: equigrasp show{options(run=self.run, **same, seed=3)}")
        return results["policy"]
