"""What is only said about a model makes no other run of it: a training goes on, whoever words it how."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from folders import contents

from equigrasp.artefacts import write_json
from equigrasp.config import ModelConfig
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.models import MODELS
from equigrasp.plan import PLAN, WEIGHTS, Training, check_model
from equigrasp.training import train

SMALL = replace(MODELS["fcgq"], widths=(8, 8, 16, 16, 16), text_encoder="hashing")  # type: ignore[call-arg]
REWORDED: ModelConfig = replace(SMALL, summary="in other words", note="and more of them", paper_parameters=1.0)
BRIEF = Training(steps=3, seed=3, threads=1)


class KilledError(Exception):
    """Stands for the death of a process."""


def killed(steps: range) -> Iterator[int]:
    yield steps[0]
    raise KilledError


def test_a_training_goes_on_in_other_words_to_the_same_bits(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    with pytest.raises(KilledError):
        train(SMALL, BRIEF, demonstrations, data, tmp_path / "run", killed)
    begun = (tmp_path / "run" / PLAN).read_bytes()
    train(REWORDED, BRIEF, demonstrations, data, tmp_path / "run")
    train(SMALL, BRIEF, demonstrations, data, tmp_path / "undisturbed")
    for name in (PLAN, WEIGHTS):
        assert (tmp_path / "run" / name).read_bytes() == (tmp_path / "undisturbed" / name).read_bytes()
    assert (tmp_path / "run" / PLAN).read_bytes() == begun, "a run says what it was begun with"
    done = contents(tmp_path / "run")
    train(replace(REWORDED, summary="once more"), BRIEF, demonstrations, data, tmp_path / "run")
    assert contents(tmp_path / "run") == done


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"name": "another"}, "was begun with model name 'fcgq', not 'another'"),
        ({"widths": (8, 8, 16, 16, 8)}, r"was begun with model widths \[8, 8, 16, 16, 16\]"),
        ({"text_encoder": "minilm"}, "was begun with model text_encoder 'hashing'"),
    ],
    ids=str,
)
def test_another_model_is_still_refused(
    change: dict[str, Any], sentence: str, tmp_path: Path, data: Path, demonstrations: list[Demonstration]
) -> None:
    train(SMALL, BRIEF, demonstrations, data, tmp_path / "run")
    done = contents(tmp_path / "run")
    for model in (replace(SMALL, **change), replace(REWORDED, **change)):
        with pytest.raises(InputError, match=sentence):
            check_model(tmp_path / "run", model)
        with pytest.raises(InputError, match=sentence):
            train(model, BRIEF, demonstrations, data, tmp_path / "run")
    assert contents(tmp_path / "run") == done


def test_a_row_that_is_derived_anew_goes_on_in_the_tables_own_run(tmp_path: Path) -> None:
    """As `paper_figs/table4.py` derives its rows, with the words of the full model."""
    row = MODELS["leg-unet-no-steerability"]
    anew = replace(MODELS["leg-unet"], name=row.name, kernel="plain")  # type: ignore[call-arg]
    assert anew.summary != row.summary
    write_json(
        tmp_path / PLAN, {"model": anew.to_dict(), "training": {"steps": 6}, "task": "pick-toy", "camera": "fused"}
    )
    check_model(tmp_path, row)
    with pytest.raises(InputError, match="model kernel"):
        check_model(tmp_path, replace(row, kernel="lifted"))  # type: ignore[call-arg]
