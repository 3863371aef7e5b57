"""The card of a saved policy: what was recorded of it, and nothing else. What was not measured is said to be so.

    config.json, evaluations/*.json, equivariance.json -> README.md as the Hugging Face hub reads it

The header's `model-index` has the success rates again, for the hub's own tables.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

from huggingface_hub import EvalResult, ModelCardData

from equigrasp import clip
from equigrasp.config import ClipConfig, ModelConfig, OwnConfig
from equigrasp.sharing.measured import PROTOCOLS, Law, Measured

CARD = "README.md"
LICENSE = "mit"
OPENING = "A policy of equigrasp: "


def model_card(
    config: ModelConfig,
    record: Mapping[str, Any],
    data: ModelCardData,
    evaluations: Sequence[Measured] = (),
    laws: Sequence[Law] = (),
    license: str | None = None,
    where: str = "FOLDER",
) -> str:
    """The card's Markdown, with the header that the hub reads.

    Args:
        config: what the policy is built from.
        record: what its config.json says besides; empty for a policy that no command trained.
        data: tags and library for the header.
        evaluations: what was measured of success.
        laws: what was measured of symmetry.
        license: of the weights, as the hub abbreviates it; by default the one in `data`.
        where: from where it is loaded, a folder or an id.
    """
    header = data.to_dict() | ({"license": license} if license else {})
    results = [each for measured in evaluations for each in _results(measured)]
    named = {"model_name": config.name, "eval_results": results} if results else {}
    lines = [
        "---",
        ModelCardData(**header, **named).to_yaml(),
        "---",
        "",
        f"# {config.name}",
        "",
        f"{OPENING}{config.summary}. From a heightmap and an",
        "instruction it gives a planar grasp: a pixel and the angle of the closing axis.",
        "",
        "## How it was made",
        "",
        *_origin(config, record),
        "",
        "## Success",
        "",
        *_success(evaluations),
        "",
        "## Equivariance",
        "",
        *_equivariance(laws),
        "",
        "## How to load it",
        "",
        *_loading(config, record, where),
        "",
        "## Licence",
        "",
        f"The weights: {header.get('license', 'not said')}. equigrasp itself: MIT.",
    ]
    return "\n".join(lines) + "\n"


def is_card(text: str) -> bool:
    """Whether a README.md is one that `model_card` wrote, edited since or not."""
    header, _, body = text.removeprefix("---\n").partition("\n---\n")
    return "library_name: equigrasp" in header.splitlines() and f"\n{OPENING}" in body


def _origin(config: ModelConfig, record: Mapping[str, Any]) -> list[str]:
    training = record.get("training", {})
    demonstrations = f"{record['demos']}, collected with seed {record['data_seed']}" if "demos" in record else None
    facts: dict[str, object] = {
        "Task": record.get("task"),
        "Demonstrations": demonstrations,
        "Camera": record.get("camera"),
        "Training steps": training.get("steps"),
        **({"Weights": f"of step {record['step']} of these"} if "step" in record else {}),
        "Batch": training.get("batch"),
        "Seed": training.get("seed"),
        "Recombined examples": training.get("recombination"),
        "Of these with hard negatives": training.get("hard_negatives"),
        "Of these crowded": training.get("crowded"),
        "Model": f"{config.name}, of the family {config.family}",
        "Text encoder": _file_named(config.encoder),
        "CLIP": _clip(config),
    }
    return ["| | |", "|---|---|", *(f"| {key} | {_cell(value)} |" for key, value in facts.items())]


def _clip(config: ModelConfig) -> str:
    if not isinstance(config, ClipConfig):
        return "none in the model"
    weights = {
        clip.OPENAI: "pretrained by OpenAI, frozen",
        clip.RANDOM: "not pretrained: random weights, frozen",
    }.get(config.clip_weights, f"the weights of a local file, {Path(config.clip_weights).name}, frozen")
    return f"{config.tower}, {weights}; they are in model.safetensors"


def _file_named(encoder: str) -> str:
    name, _, file = encoder.partition(":")
    return f"{name}, by weights of its user's: {Path(file).name}" if file else name


def _success(evaluations: Sequence[Measured]) -> list[str]:
    if not evaluations:
        return ["Not measured."]
    lines = [
        "Shares and mean rewards with their 95% Wilson intervals. *Right*: the instructed object alone is lifted, by "
        "the instructed part if one is named.",
        "",
        "| task | phrasings | protocol | camera | scenes' seed | right | right object | mean reward | oracle, right |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for each in evaluations:
        cells = (
            each.task,
            each.phrasings,
            PROTOCOLS[each.protocol].format(scenes=each.scenes),
            each.camera,
            each.seed,
            each.rates["correct"],
            each.rates["correct_object"],
            "" if each.reward is None else each.reward,
            "not measured" if each.oracle is None else each.oracle,
        )
        lines.append("| " + " | ".join(map(_cell, cells)) + " |")
    return lines


def _equivariance(laws: Sequence[Law]) -> list[str]:
    if not laws:
        return ["Not measured."]
    lines = [
        "The laws of `equigrasp equivariance` on these weights, each by its worst case.",
        "",
        "| law | of | worst | allowed | it |",
        "|---|---|---|---|---|",
    ]
    for law in laws:
        worst = None if law.value is None else f"{law.value:.2g} {law.unit}".strip()
        said = law.status + (f": {law.reason}" if law.reason else "")
        lines.append(f"| {law.name} | {law.subject} | {_cell(worst)} | {law.tolerance:g} {law.unit} | {said} |")
    return lines


def _loading(config: ModelConfig, record: Mapping[str, Any], where: str) -> list[str]:
    lines = [
        "```python",
        "from equigrasp.policy import GraspPolicy",
        *(
            [f"import {config.family.partition(':')[0]}  # its author's own code"]
            if isinstance(config, OwnConfig)
            else []
        ),
        "",
        f'policy = GraspPolicy.from_pretrained("{where}")',
        'grasp = policy.act(observation, "pick up the mug by its handle")',
        "```",
    ]
    if ":" in config.encoder:
        tower = config.encoder.partition(":")[0]
        lines += [
            "",
            f'The text encoder\'s weights are not here: pass `text_encoder="{tower}:/path/to/weights.safetensors"`.',
        ]
    if "training" in record:
        lines += ["", "The folder is a run's as well: `equigrasp evaluate --run FOLDER` measures it."]
    return lines


def _results(measured: Measured) -> list[EvalResult]:
    names: dict[Literal["correct", "correct_object"], str] = {
        "correct": "right grasps",
        "correct_object": "right object",
    }
    return [
        EvalResult(
            task_type="robotics",
            dataset_type=f"equigrasp/{measured.task}",
            dataset_name=f"{measured.task}, {measured.phrasings} phrasings, {measured.protocol}",
            # the hub puts together what is of one task, type and config, and keeps the first one's name
            dataset_config=f"{measured.protocol}, {measured.phrasings}, {measured.camera}, seed {measured.seed}",
            dataset_args={"camera": measured.camera, "seed": measured.seed, "scenes": measured.scenes},
            metric_type="success_rate",
            metric_name=name,
            metric_value=measured.rates[key].value,
        )
        for key, name in names.items()
    ]


def _cell(value: object) -> str:
    return "not recorded" if value is None else str(value).replace("|", "\\|")
