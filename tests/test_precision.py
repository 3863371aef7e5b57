"""What `auto` is: bfloat16 exactly where the hardware has an instruction for it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from equigrasp import precision, provenance


def processor_with(*instructions: str) -> Callable[[pytest.MonkeyPatch], None]:
    """Says yes to these of torch's questions, and no to the others."""

    def pretend(monkeypatch: pytest.MonkeyPatch) -> None:
        for question in precision.NATIVE:
            monkeypatch.setattr(torch.cpu, question, lambda yes=question in instructions: yes, raising=False)

    return pretend


def test_questions_are_those_that_torch_answers() -> None:
    assert all(isinstance(getattr(torch.cpu, question)(), bool) for question in precision.NATIVE)


@pytest.mark.parametrize("instruction", ["_is_amx_tile_supported", "_is_avx512_bf16_supported"])
def test_auto_is_bfloat16_where_the_processor_multiplies_it(instruction: str, monkeypatch: pytest.MonkeyPatch) -> None:
    processor_with(instruction)(monkeypatch)
    assert precision.multiplies_bfloat16("auto", "cpu")
    assert provenance.device()["auto"] == "bfloat16"


def test_auto_is_float32_on_other_processors_and_bfloat16_on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    processor_with()(monkeypatch)
    assert not precision.multiplies_bfloat16("auto", "cpu")
    assert provenance.device()["auto"] == "float32"
    assert precision.multiplies_bfloat16("auto", "cuda")


def test_auto_is_float32_where_torch_has_no_such_question(monkeypatch: pytest.MonkeyPatch) -> None:
    for question in precision.NATIVE:
        monkeypatch.delattr(torch.cpu, question, raising=False)
    assert not precision.multiplies_bfloat16("auto", "cpu")


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_a_precision_that_is_named_holds_everywhere(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    processor_with(*precision.NATIVE)(monkeypatch)
    assert not precision.multiplies_bfloat16("float32", device)
    processor_with()(monkeypatch)
    assert precision.multiplies_bfloat16("bfloat16", device)
