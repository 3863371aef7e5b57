"""What a model is known by in a study: its settings and contents, wherever its files lie. Costs no torch."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from equigrasp.artefacts import checksum
from equigrasp.clip import OPENAI, RANDOM, find_file
from equigrasp.config import LABELS, ClipConfig, ModelConfig, OwnConfig
from equigrasp.errors import InputError


def config(model: ModelConfig) -> dict[str, Any]:
    """What makes the model, without what is said about it; a file of weights is named by its content, not its place.

    Of a family of one's own the module that it is in counts as well, as this process imported it, so that an edited
    network is another model. Whoever needs it for as long as a study runs keeps it: a file of weights may change.

    Raises:
        InputError: if there is no such file.
    """
    values = {key: value for key, value in model.to_dict().items() if key not in LABELS}
    if isinstance(model, OwnConfig):
        values["code"] = f"sha256:{model.module_checksum[:16]}"
    if isinstance(model, ClipConfig) and model.clip_weights not in (OPENAI, RANDOM):
        values["clip_weights"] = _by_content(model.tower, model.clip_weights)
    if ":" in str(values["text_encoder"]):
        tower, _, weights = values["text_encoder"].partition(":")
        if weights not in (OPENAI, RANDOM):
            values["text_encoder"] = f"{tower}:{_by_content(tower, weights)}"
    return values


def check_unchanged(model: ModelConfig, known: Mapping[str, Any]) -> None:
    """Raise an InputError unless the model is here and now what `config` gave of it, elsewhere and before.

    A worker imports a module of one's own later than whoever hands out the jobs, and may find it edited.
    """
    now = config(model)
    for key in (key for key in {**known, **now} if known.get(key) != now.get(key)):
        raise InputError(
            f"{model.name} was edited since this study began: its {key} is {now.get(key)!r} here, not "
            f"{known.get(key)!r}; run the study again to train what it is now"
        )


def _by_content(tower: str, weights: str) -> str:
    return f"sha256:{checksum(find_file(tower, weights).read_bytes())[:16]}"


def digest(settings: Mapping[str, Any]) -> str:
    """A short name for settings, for files."""
    return checksum(json.dumps(dict(settings), sort_keys=True).encode())[:10]
