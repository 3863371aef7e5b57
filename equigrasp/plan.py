"""The plan of a training, and what lies in its run folder: all that can be said of it before torch is there.

A run folder's `config.json` is the plan: model, training, data. A saved policy's is read in the same way. So a user's
mistake, another model's folder or another model's weights, costs no import of torch, which takes seconds.
"""

from __future__ import annotations

import json
import operator
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open

from equigrasp.artefacts import check_begun, check_readable, checksum, open_folder, read_json
from equigrasp.collection import check_seed
from equigrasp.config import LABELS, ModelConfig
from equigrasp.demonstrations import MANIFEST
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration

PLAN = "config.json"
WEIGHTS = "model.safetensors"
TESTS = "tests"
"""The folder of a run in which a study leaves its tests."""
LOG_EVERY = 50
MOST_THREADS = 1024
STAMP = "model"
"""Under this the metadata of weights say what model's they are."""
SILENT = ("name", "summary", "note", "paper_parameters", "precision", "text_encoder", "clip_weights")
"""Settings of a model that its weights do not depend on, or that a user may change when they load it."""


@dataclass(frozen=True)
class Training:
    """How a policy is trained.

    Attributes:
        steps: gradient steps.
        seed: of the weights and of every draw, from 0 to 999.
        batch: examples a step of one process.
        learning_rate: Adam's, constant: with the weights averaged, a falling one was no better; None for the model's
            own.
        average: decay of the weights' exponential moving average, which is what is evaluated.
        recombination: share of examples that are put together from demonstrated objects, colours and sentences.
        hard_negatives: share of those whose other objects are like the target (`equigrasp.augmentation`).
        crowded: share of those in which objects stand where the hand would come down (the same).
        threads: torch threads; the bits of a result depend on it.
        checkpoint_every: steps between checkpoints, a multiple of 50.
        keep_every: steps between weights that are kept for a learning curve; 0 keeps the last alone.

    Raises:
        InputError: if a value is out of range, or no number of its kind.
    """

    steps: int
    seed: int
    batch: int = 1
    learning_rate: float | None = None
    average: float = 0.998
    recombination: float = 0.7
    hard_negatives: float = 0.0
    crowded: float = 0.0
    threads: int = 2
    checkpoint_every: int = 200
    keep_every: int = 0

    def __post_init__(self) -> None:
        # numpy's numbers too, as a sweep has them; the plan is JSON, which has not
        for name in ("steps", "seed", "batch", "threads", "checkpoint_every", "keep_every"):
            object.__setattr__(self, name, _number(operator.index, name, getattr(self, name), "a whole number"))
        shares = ("average", "recombination", "hard_negatives", "crowded")
        for name in shares if self.learning_rate is None else (*shares, "learning_rate"):
            object.__setattr__(self, name, _number(float, name, getattr(self, name), "a number"))
        check_seed(self.seed)
        check_at_least(1, steps=self.steps, batch=self.batch)
        check_threads(self.threads)
        if self.learning_rate is not None and not 0 < self.learning_rate < 1:
            raise InputError(f"--learning-rate is {self.learning_rate}, but it must be between 0 and 1")
        if not 0 <= self.average < 1:
            raise InputError(f"--average is {self.average}, but it must be at least 0 and below 1")
        for name in ("checkpoint_every", "keep_every"):
            if getattr(self, name) % LOG_EVERY or getattr(self, name) < 0:
                option = name.replace("_", "-")
                raise InputError(f"--{option} is {getattr(self, name)}, but it must be a multiple of {LOG_EVERY}")
        if self.checkpoint_every == 0:
            raise InputError(f"--checkpoint-every is 0, but it must be at least {LOG_EVERY}")
        check_shares(self.recombination, self.hard_negatives, self.crowded)

    def of(self, model: ModelConfig) -> Training:
        """This training of a model: at the model's own learning rate, where none is named."""
        return self if self.learning_rate is not None else replace(self, learning_rate=model.learning_rate)


def _number(make: Callable[[Any], float], name: str, value: object, kind: str) -> float:
    """The value as Python's own number; InputError if it is none of the kind."""
    try:
        if isinstance(value, str):  # float reads it, but it is a mistake
            raise TypeError
        return make(value)
    except (TypeError, ValueError):
        raise InputError(f"--{name.replace('_', '-')} is {value!r:.100}, but it must be {kind}") from None


def check_at_least(fewest: int, **options: int) -> None:
    """Raise an InputError that names the first option whose number is smaller."""
    for name, value in options.items():
        if value < fewest:
            raise InputError(f"--{name.replace('_', '-')} is {value}, but it must be at least {fewest}")


def check_threads(threads: int) -> None:
    """Raise an InputError unless torch could be given so many."""
    if not 1 <= threads <= MOST_THREADS:
        raise InputError(f"--threads is {threads}, but it must be from 1 to {MOST_THREADS}")


def check_shares(recombination: float, hard_negatives: float, crowded: float) -> None:
    """Raise an InputError unless all are shares, and there are recombined scenes that could be hard or crowded."""
    ways = {"hard-negatives": hard_negatives, "crowded": crowded}
    for option, share in {"recombination": recombination, **ways}.items():
        if not 0 <= share <= 1:
            raise InputError(f"--{option} is {share}, but it must be from 0 to 1")
    for option, share in ways.items():
        if share and not recombination:
            raise InputError(
                f"--{option} is {share}, but --recombination is 0, so that no scene is put together; "
                f"raise --recombination or leave --{option} out"
            )


def plan(
    model: ModelConfig,
    training: Training,
    demonstrations: Sequence[Demonstration],
    data: Path,
    devices: Mapping[str, Any],
) -> dict[str, Any]:
    """All that determines a run, as JSON; `devices` is `Devices.plan()`."""
    manifest = read_json(data / MANIFEST, "a manifest of demonstrations")
    return {
        "data": checksum((data / MANIFEST).read_bytes()),
        "model": model.to_dict(),
        "training": asdict(training.of(model)),
        "task": demonstrations[0].task,
        "camera": manifest["camera"],
        "demos": manifest["demos"],
        "data_seed": manifest["seed"],
        **devices,
    }


def open_run(run: Path, plan: Mapping[str, Any], megabytes: float) -> None:
    """Make the run folder for a plan, or find it begun by the same one, whatever was said about its model then.

    Raises:
        InputError: as `equigrasp.artefacts.open_folder` and `read_plan`.
    """
    if (run / PLAN).is_file():
        plan = {**plan, "model": _as_begun(read_plan(run), plan["model"])}
    open_folder(run, PLAN, plan, megabytes)


def read_plan(run: Path) -> dict[str, Any]:
    """The plan of a run folder; InputError if there is none, or what is in it cannot be a training's."""
    if not (run / PLAN).exists():
        out = shlex.quote(str(run))
        raise InputError(f"{run} is not a run folder (no {PLAN}); make one with `equigrasp train --out {out}`")
    plan = read_json(run / PLAN, "a run's configuration")
    training = plan.get("training")
    right = {
        "model": isinstance(plan.get("model"), dict),
        "training": isinstance(training, dict) and isinstance(training.get("steps"), int),
        "task": isinstance(plan.get("task"), str),
        "camera": isinstance(plan.get("camera"), str),
        "step": isinstance(plan.get("step", 1), int),
    }
    for key in (key for key in right if not right[key]):
        said = f"{key} is {plan[key]!r:.100}" if key in plan else f"{key} is missing"
        # into the same folder nobody can, as long as this file is there
        raise InputError(f"{run / PLAN} is damaged, or no training's: {said}; train again into another folder")
    return plan


def step_of(plan: Mapping[str, Any], step: int | None = None) -> int:
    """After how many steps weights are: those that were kept at a step, or a folder's `model.safetensors`.

    These are the last, but in a folder that was shared of a step; its configuration says which.
    """
    return plan.get("step", plan["training"]["steps"]) if step is None else step


def record_of(plan: Mapping[str, Any], step: int | None = None) -> dict[str, Any]:
    """What a saved policy's configuration says beside its model: the plan, and of which step its weights are."""
    record = {key: value for key, value in plan.items() if key != "model"}
    return record if step_of(plan, step) == step_of(plan) else {**record, "step": step}


def check_model(run: Path, model: ModelConfig) -> None:
    """Raise an InputError if the folder was begun with another model."""
    if (run / PLAN).is_file():
        begun = read_plan(run)
        check_begun(run, begun, {"model": _as_begun(begun, model.to_dict())})


def _as_begun(plan: Mapping[str, Any], model: Mapping[str, Any]) -> dict[str, Any]:
    """A model's settings, with what the plan of a run that was begun says about it; by its name it is known."""
    said = LABELS - {"name"}
    own = {key: value for key, value in model.items() if key not in said}
    return own | {key: value for key, value in plan["model"].items() if key in said}


def read_model(configuration: Mapping[str, Any], path: Path) -> ModelConfig:
    """The model's config in a config.json; InputError if there is none, or it is of no model that there is."""
    values = configuration.get("model")
    if not isinstance(values, dict):
        raise InputError(
            f"{path} is damaged, or no policy of equigrasp's: model is missing or no settings; save it again or train "
            "again into another folder"
        )
    return ModelConfig.from_dict(values)


def kept_weights(step: int) -> str:
    """Name of the weights that were kept at a step."""
    return f"model-{step:06d}.safetensors"


def find_weights(run: Path, step: int | None = None) -> Path:
    """The weights of a run, looked at as far as `check_weights` does.

    Args:
        run: the run folder.
        step: a step whose weights were kept, or None for the last.

    Raises:
        InputError: if the folder has no configuration or no such weights, or they are damaged, or another model's.
    """
    model = read_model(read_plan(run), run / PLAN)
    weights = run / (WEIGHTS if step is None else kept_weights(step))
    if not weights.exists():
        kept = sorted(path.name for path in run.glob("model*.safetensors"))
        raise InputError(
            f"{run} has no weights {weights.name}"
            + (f"; it has {', '.join(kept)}" if kept else "; finish its training with `equigrasp train`")
        )
    check_weights(weights, model)
    return weights


def stamp(model: ModelConfig) -> dict[str, str]:
    """What is written beside weights to say what model's they are."""
    return {STAMP: json.dumps(_settings_of_weights(model), sort_keys=True)}


def check_weights(weights: Path, model: ModelConfig) -> None:
    """Look at a file of weights before it is read whole: tensors of the same shapes may mean something else.

    A setting that was not there when they were saved is not compared, nor are weights that have no stamp.

    Raises:
        InputError: if the file may not be read, is damaged, or says that it is of a model with other settings.
    """
    check_readable(weights)
    try:
        with safe_open(str(weights), framework="numpy") as file:
            said = json.loads((file.metadata() or {}).get(STAMP, "{}"))
    except (SafetensorError, ValueError, OSError) as error:
        raise damaged(weights, error) from None
    if not isinstance(said, dict):
        raise damaged(weights, f"its stamp is {said!r:.100}")
    for key, value in _settings_of_weights(model).items():
        if key in said and said[key] != value:
            raise InputError(
                f"{weights} is another model's: its {key} is {said[key]!r}, and by the {PLAN} beside it {value!r}; "
                "put the right one there, or train again"
            )


def damaged(weights: Path, why: object) -> InputError:
    """What is to be said of weights that cannot be read, with a way out that does not lead back to them."""
    if weights.name == WEIGHTS:
        way_out = (
            "save the policy again or, in a run folder, delete this file and run its `equigrasp train` again, which "
            "makes it from the checkpoint"
        )
    else:
        way_out = "take another --step, or train again into another folder"
    return InputError(f"{weights} is damaged or another model's ({why}); {way_out}")


def _settings_of_weights(model: ModelConfig) -> dict[str, Any]:
    """The settings that give weights their shapes and their meaning."""
    return {key: value for key, value in model.to_dict().items() if key not in SILENT}
