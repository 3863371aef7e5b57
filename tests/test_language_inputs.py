"""What reaches the text encoders: text that is none, cache entries with a damaged bit, several askers at once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from equigrasp import language
from equigrasp.errors import InputError

SENTENCE = "pick the mug by its handle"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache on disk, and nothing in memory."""
    monkeypatch.setenv("EQUIGRASP_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(language, "_memory", {})
    return tmp_path / "cache"


@pytest.mark.parametrize("encoder", ["minilm", "hashing"])
@pytest.mark.parametrize(("sentence", "place"), [("\ud800 mug", 0), ("the mug \udcff", 8)])
def test_half_of_a_character_is_refused(encoder: str, sentence: str, place: int, cache: Path) -> None:
    with pytest.raises(InputError, match=f"what stands at {place} in '.*lone surrogate; leave it out") as error:
        language.embed(encoder, [SENTENCE, sentence])
    assert str(error.value).isascii(), "or no terminal could print it"
    assert not cache.exists(), "nothing is done before all sentences are looked at"
    language.embed(encoder, ["the \U0001f600 mug, \u676f\u5b50"])


def test_an_entry_with_any_damaged_bit_is_the_embedding_or_none() -> None:
    """A bit of a zip's headers may ask for a password, or for a compression that nobody knows."""
    [expected] = language.embed("hashing", [SENTENCE])
    entry = language._entry("hashing", SENTENCE)
    whole, unreadable = entry.read_bytes(), 0
    for place in [*range(160), *range(len(whole) - 120, len(whole))]:
        for bit in range(8):
            content = bytearray(whole)
            content[place] ^= 1 << bit
            entry.write_bytes(content)
            found = language._read("hashing", SENTENCE, 512)
            unreadable += found is None
            assert found is None or np.array_equal(found, expected)
    assert unreadable > 100


def test_several_askers_leave_torch_its_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """The count is the process's: each sets it to one and back."""
    count = [4]
    monkeypatch.setattr(torch, "get_num_threads", lambda: count[0])
    monkeypatch.setattr(torch, "set_num_threads", lambda threads: count.__setitem__(0, threads))
    asked: list[int] = []

    def encode(sentence: str) -> Any:
        asked.append(count[0])
        torch.rand(300, 300) @ torch.rand(300, 300)
        return language.hashed_words(sentence)[:384] / np.linalg.norm(language.hashed_words(sentence)[:384])

    monkeypatch.setattr(language, "_encoder", lambda *_: encode)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: language.embed("minilm", [f"{SENTENCE}, thing {number}"]), range(200)))
    assert count == [4]
    assert asked == 200 * [1]
