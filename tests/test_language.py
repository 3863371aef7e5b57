"""Sentences become unit vectors, the same however they are asked for, and are computed once."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from equigrasp import hub, language
from equigrasp.artefacts import PARTIAL, remove_partials
from equigrasp.errors import InputError

SENTENCE = "pick the mug by its handle"


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache on disk, and nothing in memory."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("EQUIGRASP_CACHE", str(folder))
    monkeypatch.setattr(language, "_memory", {})
    yield folder
    assert not list(folder.rglob(f"{PARTIAL}*"))


def python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env=os.environ | environment,
        timeout=120,
        check=False,
    )


def entries(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.npz"))


def count_encodings(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Sentences that reached the hashing encoder, in order."""
    asked: list[str] = []
    real = language.hashed_words

    def counted(sentence: str) -> np.ndarray:
        asked.append(sentence)
        return real(sentence)

    monkeypatch.setattr(language, "_encoder", lambda *_: counted)
    return asked


# What the encoders say


@pytest.mark.parametrize("encoder", ["minilm", "hashing"])
def test_embeddings_are_unit_vectors_that_tell_sentences_apart(encoder: str) -> None:
    rows = language.embed(encoder, [SENTENCE, "pick the mug by its brim", "grasp the red hat"])
    assert rows.shape == (3, language.width(encoder))
    assert rows.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(rows, axis=1), 1, atol=1e-6)
    cosine = rows @ rows.T
    assert cosine[0, 2] < cosine[0, 1] < 0.99


def test_minilm_is_the_published_model() -> None:
    # transformers' BertModel on the same weights, its tokens averaged
    published = {
        SENTENCE: [-0.0011245, 0.1025120, -0.0000501, 0.0762984],
        "grasp the brim of the hat!": [0.0137374, 0.0837734, 0.0272704, -0.0183792],
        "x " * 254: [-0.0020605, -0.0374686, -0.0314936, -0.0425641],
    }
    for sentence, start in published.items():
        np.testing.assert_allclose(language.embed("minilm", [sentence])[0, :4], start, atol=1e-6)


@pytest.mark.parametrize("encoder", ["minilm", "hashing"])
def test_a_batch_is_bitwise_its_members(encoder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sentences = [SENTENCE, "the hat", "a much longer sentence about the yellow banana on the table"]
    together = language.embed(encoder, sentences)
    monkeypatch.setenv("EQUIGRASP_CACHE", "/dev/null/nowhere")
    monkeypatch.setattr(language, "_memory", {})
    apart = [language.embed(encoder, [sentence])[0] for sentence in reversed(sentences)]
    np.testing.assert_array_equal(together, apart[::-1])


def test_the_askers_default_device_does_not_matter(monkeypatch: pytest.MonkeyPatch) -> None:
    """A count of parameters builds on the meta device, where what is computed is garbage."""
    language._encoder.cache_clear()
    with torch.device("meta"):
        found = language.embed("minilm", [SENTENCE])
    monkeypatch.setenv("EQUIGRASP_CACHE", "/dev/null/nowhere")
    monkeypatch.setattr(language, "_memory", {})
    np.testing.assert_array_equal(found, language.embed("minilm", [SENTENCE]))


@given(st.text(min_size=1, max_size=60).filter(lambda text: bool(text.strip())))
def test_any_text_hashes_to_a_unit_vector(sentence: str) -> None:
    vector = language.hashed_words(sentence)
    assert abs(np.linalg.norm(vector) - 1) < 1e-6
    np.testing.assert_array_equal(vector, language.hashed_words(sentence))


def test_hashing_is_the_same_in_another_process() -> None:
    code = f"from equigrasp import language; print(language.hashed_words({SENTENCE!r}).nonzero()[0].tolist())"
    outputs = {python(code, PYTHONHASHSEED=seed).stdout for seed in ("1", "2")}
    assert outputs == {f"{language.hashed_words(SENTENCE).nonzero()[0].tolist()}\n"}


# The cache


def test_a_sentence_is_computed_once(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = count_encodings(monkeypatch)
    first = language.embed("hashing", [SENTENCE, "the hat", SENTENCE])
    monkeypatch.setattr(language, "_memory", {})
    np.testing.assert_array_equal(language.embed("hashing", [SENTENCE, "the hat", SENTENCE]), first)
    assert asked == [SENTENCE, "the hat"]
    assert len(entries(cache)) == 2


def test_a_row_is_the_askers_own(cache: Path) -> None:
    language.embed("hashing", [SENTENCE])[:] = 0
    assert language.embed("hashing", [SENTENCE]).any()


def test_a_run_that_finds_its_embeddings_imports_no_encoder(cache: Path) -> None:
    language.embed("minilm", [SENTENCE])
    found = python(
        "import sys; from equigrasp import language;"
        f"print(language.embed('minilm', [{SENTENCE!r}])[0, :2].tolist());"
        "print([m for m in ('torch', 'transformers', 'tokenizers', 'open_clip') if m in sys.modules])"
    )
    assert found.stdout == f"{language.embed('minilm', [SENTENCE])[0, :2].tolist()}\n[]\n", found.stderr


def damage_nothing(entry: Path) -> None:
    entry.write_bytes(b"")


def damage_cut(entry: Path) -> None:
    entry.write_bytes(entry.read_bytes()[:300])


def damage_bit(entry: Path) -> None:
    content = bytearray(entry.read_bytes())
    content[400] ^= 1
    entry.write_bytes(content)


def damage_other(entry: Path) -> None:
    np.savez(entry, embedding=np.zeros(3, dtype=np.float32))


def damage_length(entry: Path) -> None:
    np.savez(entry, embedding=np.full(512, 2, dtype=np.float32))


def damage_pickle(entry: Path) -> None:
    np.savez(entry, embedding=np.array([{}], dtype=object))


@pytest.mark.parametrize(
    "damage",
    [damage_nothing, damage_cut, damage_bit, damage_other, damage_length, damage_pickle],
    ids=lambda f: f.__name__,
)
def test_a_damaged_entry_is_made_again(cache: Path, monkeypatch: pytest.MonkeyPatch, damage) -> None:
    expected = language.embed("hashing", [SENTENCE])
    [entry] = entries(cache)
    whole = entry.read_bytes()
    damage(entry)
    monkeypatch.setattr(language, "_memory", {})
    np.testing.assert_array_equal(language.embed("hashing", [SENTENCE]), expected)
    assert len(entry.read_bytes()) == len(whole)


def test_a_folder_that_cannot_be_written_still_embeds(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setenv("EQUIGRASP_CACHE", str(blocked))
    asked = count_encodings(monkeypatch)
    language.embed("hashing", [SENTENCE])
    language.embed("hashing", [SENTENCE])
    assert asked == [SENTENCE]


def write_many(folder: str) -> None:
    os.environ["EQUIGRASP_CACHE"] = folder
    vector = language.hashed_words(SENTENCE)
    while True:
        language._write("hashing", SENTENCE, vector)


def test_writers_that_are_killed_leave_whole_entries(cache: Path) -> None:
    context = get_context("fork")
    expected = language.hashed_words(SENTENCE)
    for _ in range(3):
        writers = [context.Process(target=write_many, args=(str(cache),)) for _ in range(2)]
        for writer in writers:
            writer.start()
        for _ in range(100):
            vector = language._read("hashing", SENTENCE, 512)
            assert vector is None or np.array_equal(vector, expected)
            time.sleep(0.001)
        for writer in writers:
            writer.kill()
            writer.join()
    assert np.array_equal(language._read("hashing", SENTENCE, 512), expected)  # ty: ignore[invalid-argument-type]
    remove_partials(cache)


# What cannot be


@pytest.mark.parametrize("sentence", ["", "  \n", None, 3])
def test_an_empty_instruction_is_refused(sentence: str) -> None:
    with pytest.raises(ValueError, match="says what to grasp"):
        language.embed("hashing", [sentence])


def test_a_long_instruction_is_refused(cache: Path) -> None:
    with pytest.raises(ValueError, match="at most 1000 characters, but this has 1001"):
        language.embed("hashing", ["fine", "x" * 1001])
    assert not entries(cache), "nothing is done before all sentences are looked at"
    language.embed("hashing", ["x" * 1000])


def test_an_instruction_whose_end_would_go_unheard_is_refused(cache: Path) -> None:
    language.embed("minilm", ["x " * 254])
    with pytest.raises(InputError, match=r"minilm reads at most 256 tokens of an instruction, but this has 257 \('x x"):
        language.embed("minilm", ["x " * 255])
    assert len(entries(cache)) == 1


def test_an_unknown_encoder_names_the_nearest() -> None:
    with pytest.raises(ValueError, match="no text encoder 'minlm'; did you mean 'minilm'"):
        language.embed("minlm", [SENTENCE])
    with pytest.raises(ValueError, match="no text encoder 'minilm:x'"):
        language.width("minilm:x")


def test_a_local_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not one on this machine"):
        language.embed(f"clip-rn50:{tmp_path}/none.safetensors", [SENTENCE])
    pickled = tmp_path / "weights.pt"
    pickled.write_bytes(b"")
    with pytest.raises(ValueError, match="safetensors"):
        language.embed(f"clip-rn50:{pickled}", [SENTENCE])


@pytest.mark.parametrize(
    ("url", "environment"),
    [
        ("https://huggingface.invalid", {"https_proxy": "{server}"}),
        ("https://huggingface.invalid", {"all_proxy": "http://{server}"}),
        ("https://{server}", {"https_proxy": "http://127.0.0.1:9", "no_proxy": "127.0.0.1"}),
        ("http://{server}", {"https_proxy": "http://127.0.0.1:9"}),
        ("http://huggingface.invalid", {"http_proxy": "http://{server}", "https_proxy": "http://127.0.0.1:9"}),
    ],
    ids=["no scheme", "all", "past the proxy", "another scheme's", "its scheme's"],
)
def test_a_hub_that_answers_is_reached_as_the_proxies_say(
    url: str, environment: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [each for each in os.environ if each.lower().endswith("_proxy")]:
        monkeypatch.delenv(name)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        server = f"127.0.0.1:{listening.getsockname()[1]}"
        for name, value in environment.items():
            monkeypatch.setenv(name, value.format(server=server))
        assert hub.reaches(url.format(server=server))
    assert not hub.reaches(url.format(server=server)), "nobody listens any more"


@pytest.mark.parametrize("offline", [{"HF_HUB_OFFLINE": "1"}, {"HF_ENDPOINT": "http://127.0.0.1:9"}])
def test_clip_without_a_network_says_so_at_once(offline: dict[str, str], tmp_path: Path) -> None:
    code = (
        "import time; from equigrasp import language; start = time.time()\n"
        f"try: language.embed('clip-rn50', [{SENTENCE!r}])\n"
        "except ValueError as error: print(f'{time.time() - start:.1f}', error)"
    )
    said = python(code, HF_HOME=str(tmp_path), NO_PROXY="*", **offline).stdout
    for way_out in ("local file", "'minilm' or 'hashing'", "Hugging Face cache"):
        assert way_out in said
    assert float(said.split()[0]) < 15, "a busy machine may take seconds to import, but not 47 to retry"
