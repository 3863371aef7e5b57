"""What a model is known by in a study: its settings and contents, wherever its files lie. Costs no torch."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from equigrasp.artefacts import checksum
from equigrasp.clip import OPENAI, RANDOM, find_file
from equigrasp.config import LABELS, ClipConfig, ModelConfig, OwnConfig


def config(model: ModelConfig) -> dict[str, Any]:
    """What makes the model, without what is said about it; a file of weights is named by its content, not its place.

    Of a family of one's own the module that it is in counts as well, so that an edited network is another model.

    Raises:
        InputError: if there is no such file.
    """
    values = {key: value for key, value in model.to_dict().items() if key not in LABELS}
    if isinstance(model, OwnConfig):
        values["code"] = f"sha256:{checksum(_source(type(model)))[:16]}"
    if isinstance(model, ClipConfig) and model.clip_weights not in (OPENAI, RANDOM):
        values["clip_weights"] = _by_content(model.tower, model.clip_weights)
    if ":" in str(values["text_encoder"]):
        tower, _, weights = values["text_encoder"].partition(":")
        if weights not in (OPENAI, RANDOM):
            values["text_encoder"] = f"{tower}:{_by_content(tower, weights)}"
    return values


def _source(family: type[OwnConfig]) -> bytes:
    """The module's file; nothing where it has none."""
    path = getattr(sys.modules[family.__module__], "__file__", None)
    return Path(path).read_bytes() if path else b""


def _by_content(tower: str, weights: str) -> str:
    return f"sha256:{checksum(find_file(tower, weights).read_bytes())[:16]}"


def digest(settings: Mapping[str, Any]) -> str:
    """A short name for settings, for files."""
    return checksum(json.dumps(dict(settings), sort_keys=True).encode())[:10]
