"""Which settings set results apart that would be taken for one another: said where there are several, else not."""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence
from typing import Any

from equigrasp.models import MODELS
from equigrasp.study.matrix import CostJob, Matrix, Protocol

RECORDED_BY = "recorded by"
CHECKPOINT = "checkpoint"
USUAL = {
    RECORDED_BY: "equigrasp study",
    "threads": Matrix.threads,
    "checkpoints": Matrix.checkpoints,
    "validation": Protocol.validation,
    "training_device": Matrix.device,
    "timed_steps": CostJob.timed,
}
"""What is not said of a setting, beside what the model's row has."""


def told_apart(results: Sequence[tuple[str, Hashable, Mapping[str, Any]]]) -> list[tuple[str, ...]]:
    """What must be said of each result, that no two be known by the same.

    A setting is said of a model's results where two that are known by the same differ in it, and then of those whose
    value is not the usual one. The order of the results decides nothing.

    Args:
        results: of each its model's name, what it is known by, and its settings; no two have both in common.

    Returns:
        of each its settings, in words.
    """
    alike: dict[tuple[str, Hashable], list[Mapping[str, Any]]] = defaultdict(list)
    for model, known_by, settings in results:
        alike[model, known_by].append(settings)
    names: dict[str, set[str]] = defaultdict(set)
    for (model, _), several in alike.items():
        for one, other in itertools.combinations(several, 2):
            differ = {name for name in {**one, **other} if one.get(name) != other.get(name)}
            # a chosen checkpoint follows from the other settings, and plans of the two commands hardly compare
            names[model] |= differ & {RECORDED_BY} or differ - {CHECKPOINT} or differ
    return [_words(settings, sorted(names[model]), _usual(model)) for model, _, settings in results]


def _usual(model: str) -> dict[str, Any]:
    row = MODELS.get(model)
    return USUAL if row is None else {**row.to_dict(), "learning_rate": row.learning_rate, **USUAL}


def _words(settings: Mapping[str, Any], names: Sequence[str], usual: Mapping[str, Any]) -> tuple[str, ...]:
    values = {name: settings.get(name) for name in names}
    return tuple(f"{name.replace('_', ' ')} {value}" for name, value in values.items() if value != usual.get(name))
