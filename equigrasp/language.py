"""From a sentence to its embedding: MiniLM, CLIP's text towers or hashed words, computed once and kept.

`embed` looks in memory, then in the cache on disk, and only then imports an encoder. The cache holds one small
`.npz` for each (encoder, sentence), written whole or not at all; an entry that cannot be read is made again.
Embeddings are float32 and of unit length. Sentences are encoded one at a time, so that a sentence's embedding
never depends on its neighbours in a batch.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import itertools
import re
import threading
import zlib
from collections.abc import Callable, Generator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from equigrasp import artefacts, clip
from equigrasp.errors import InputError, unknown

LONGEST_SENTENCE = 1000

ENCODERS: dict[str, int] = {"minilm": 384, "hashing": 512} | {name: tower.size for name, tower in clip.TOWERS.items()}
"""Name -> D. `clip-<tower>:<file>.safetensors` takes that tower's weights from a local file."""

_memory: dict[tuple[str, str], NDArray[np.float32]] = {}
_encoding = threading.Lock()
"""Held while a sentence is encoded: torch's count of threads is the whole process's."""


def width(encoder: str) -> int:
    """D, the length of that encoder's embeddings; costs no import.

    Raises:
        InputError: if there is no such encoder; it names the nearest.
    """
    name = encoder.partition(":")[0]
    if name not in ENCODERS or (name != encoder and not name.startswith("clip-")):
        raise unknown("text encoder", encoder, ENCODERS)
    return ENCODERS[name]


def check_encoder(encoder: str) -> None:
    """Raise an InputError unless there is such an encoder that reads, and CLIP's weights are here or can be fetched."""
    width(encoder)
    name, _, file = encoder.partition(":")
    if file == clip.RANDOM:
        raise _reads_nothing(name)
    if name in clip.TOWERS:
        clip.find_weights(name, file or clip.OPENAI)


def _reads_nothing(name: str) -> InputError:
    return InputError(
        f"a {name} of random weights reads no instruction; use the text encoder 'minilm' or 'hashing' "
        "(--text-encoder), or real weights (--clip-weights FILE)"
    )


def embed(encoder: str, sentences: Sequence[str]) -> NDArray[np.float32]:
    """Embeddings of sentences, `(N, D)` float32, each of unit length.

    Raises:
        InputError: if the encoder is unknown, or a sentence is empty, longer than 1,000 characters or of more tokens
            than the encoder reads; or if the encoder's weights are not on this machine and cannot be fetched, or make
            no unit vector.
    """
    size = width(encoder)
    for sentence in sentences:
        check(sentence)
    rows = np.empty((len(sentences), size), dtype=np.float32)
    for row, sentence in zip(rows, sentences, strict=True):
        row[:] = _embedding(encoder, sentence)
    return rows


def check(sentence: str) -> None:
    """Raise an InputError unless the sentence is text that says something in at most 1,000 characters."""
    if not isinstance(sentence, str) or not sentence.strip():
        raise InputError(f"an instruction says what to grasp, but this is {sentence!r}")
    try:
        sentence.encode()
    except UnicodeEncodeError as error:
        raise InputError(
            f"an instruction is text, but what stands at {error.start} in {sentence[:30]!r} is half of a character, a "
            "lone surrogate; leave it out"
        ) from None
    if len(sentence) > LONGEST_SENTENCE:
        raise InputError(
            f"an instruction has at most {LONGEST_SENTENCE} characters, but this has {len(sentence)} "
            f"({sentence[:30]!r}...); shorten it"
        )


def _embedding(encoder: str, sentence: str) -> NDArray[np.float32]:
    key = identify(encoder), sentence
    if key not in _memory:
        vector = _read(*key, width(encoder))
        if vector is None:
            encode = _encoder(encoder, key[0])
            with _alike_everywhere(encoder):
                vector = encode(sentence)
            if not _is_unit(vector):
                raise InputError(
                    f"{encoder} makes no unit vector of {sentence[:30]!r}; its weights are damaged, fetch them again"
                )
            _write(*key, vector)
        _memory[key] = vector
    return _memory[key]


def _is_unit(vector: NDArray[np.float32]) -> bool:
    """Whether it is of unit length, which no NaN is; the encoders' own are within 1e-6 of it."""
    return bool(abs(np.linalg.norm(vector) - 1) < 1e-4)


@contextlib.contextmanager
def _alike_everywhere(encoder: str) -> Generator[None]:
    """What is kept must not depend on how many threads, or which default device, its first asker had."""
    if encoder == "hashing":
        yield
        return
    import torch

    with _encoding, torch.device("cpu"):
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            yield
        finally:
            torch.set_num_threads(threads)


def identify(encoder: str) -> str:
    """What an embedding is filed under: the name, and for a local file also what tells it from its successor.

    Raises:
        InputError: if the local file is not there, or the weights are to be random.
    """
    name, _, file = encoder.partition(":")
    if not file:
        return name
    if file == clip.RANDOM:
        raise _reads_nothing(name)
    path = clip.find_file(name, file)
    status = path.stat()
    return f"{name}:{path.resolve()}:{status.st_size}:{status.st_mtime_ns}"


# The cache on disk


def cache_folder() -> Path:
    """Where embeddings are kept: $EQUIGRASP_CACHE, or ~/.cache/equigrasp."""
    return artefacts.cache_folder("embeddings")


def _entry(identity: str, sentence: str) -> Path:
    digest = hashlib.sha256(f"{identity}\0{sentence}".encode("utf-8", "surrogatepass")).hexdigest()
    return cache_folder() / digest[:2] / f"{digest}.npz"


def _read(identity: str, sentence: str, size: int) -> NDArray[np.float32] | None:
    """The kept embedding, or None if there is none that can be trusted."""
    # a zip carries a checksum of each member, so that a flipped bit is an error here and not a wrong embedding; which
    # error depends on the bit, that of an unknown compression and of a missing password among them
    with contextlib.suppress(Exception):
        with np.load(io.BytesIO(_entry(identity, sentence).read_bytes()), allow_pickle=False) as entry:
            vector = entry["embedding"]
        if vector.dtype == np.float32 and vector.shape == (size,) and _is_unit(vector):
            return vector
    return None


def _write(identity: str, sentence: str, vector: NDArray[np.float32]) -> None:
    """Keep an embedding; a folder that cannot be written costs the next process time and nothing else."""
    try:
        entry = _entry(identity, sentence)
    except InputError:  # no folder at all
        return
    buffer = io.BytesIO()
    np.savez(buffer, embedding=vector)
    with contextlib.suppress(OSError):
        entry.parent.mkdir(parents=True, exist_ok=True)
        artefacts.write_atomically(entry, buffer.getvalue())


# The encoders


Encoder = Callable[[str], NDArray[np.float32]]


@functools.lru_cache(maxsize=4)
def _encoder(encoder: str, identity: str) -> Encoder:
    """Load an encoder: a function from a sentence to its unit embedding `(D,)`.

    Args:
        encoder: its name.
        identity: what it is now; a file that was replaced is read again.
    """
    if encoder == "hashing":
        return hashed_words
    if encoder == "minilm":
        from equigrasp import minilm

        return minilm.load()
    return _clip(encoder)


def hashed_words(sentence: str) -> NDArray[np.float32]:
    """Words and pairs of neighbouring words, each hashed to a signed place among D, of unit length.

    No weights and no order beyond pairs: the same in every process and on every machine.
    """
    size = ENCODERS["hashing"]
    words = re.findall(r"\w+", sentence.lower()) or [sentence.strip()]
    pairs = [" ".join(pair) for pair in itertools.pairwise(words)]
    vector = np.zeros(size, dtype=np.float64)
    for term in words + pairs:
        code = zlib.crc32(term.encode("utf-8", "surrogatepass"))
        vector[code % size] += 1.0 if code & 0x80000000 else -1.0
    norm = float(np.linalg.norm(vector))
    if norm == 0:
        # terms that cancel: rare, but an instruction must not vanish
        vector[zlib.crc32(sentence.encode("utf-8", "surrogatepass")) % size] = norm = 1.0
    return (vector / norm).astype(np.float32)


def _clip(encoder: str) -> Encoder:
    """A text tower of CLIP, from a local file, the Hugging Face cache, or the network.

    Raises:
        InputError: if there are no weights to be had, or the file holds those of another model.
    """
    name, _, file = encoder.partition(":")
    # what is missing is said before torch is imported
    clip.find_weights(name, file or clip.OPENAI)

    import torch

    with torch.device("cpu"):
        model = clip.load(name, file or clip.OPENAI)
    tokenizer = clip.tokenizer(name)
    most = tokenizer.context_length
    assert most is not None, "a CLIP reads so many tokens, whatever the sentence"

    @torch.inference_mode()
    def encode(sentence: str) -> NDArray[np.float32]:
        # a start and an end stand around the sentence
        tokens = len(tokenizer.encode(sentence)) + 2
        if tokens > most:
            raise InputError(
                f"{name} reads at most {most} tokens of an instruction, but this has {tokens} "
                f"({sentence[:30]!r}...); shorten it"
            )
        with torch.autocast("cpu", enabled=False):
            vector = model.encode_text(tokenizer([sentence]))[0].float()
        return (vector / vector.norm()).numpy().copy()

    return encode
