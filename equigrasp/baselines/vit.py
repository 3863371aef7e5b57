"""A baseline: image patches and language tokens through one transformer, its image tokens upsampled to 36 channels.

After the LEG paper's ViT baseline. Nothing in it turns or moves with the scene by construction: attention is told
each patch's place, and learns from augmentation alone what a translation or a turn does.
"""

from __future__ import annotations

import itertools
import math

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp.encoder.image import normalise
from equigrasp.encoder.unet import convolution
from equigrasp.errors import InputError

STRIDE = 2
"""Heightmap pixels a cell of the scores."""


class VisionTransformer(nn.Module):
    """`(B, 4, H, W)`, `(B, D)` -> scores `(B, bins, H / 2, W / 2)`; H and W are multiples of `patch`.

    Args:
        embedding_size: D.
        patch: side of a patch, pixels; a power of two, at least 4.
        width: of a token; a multiple of 4 and of `heads`.
        depth: layers.
        heads: of each layer's attention.
        language_tokens: tokens that the instruction's embedding becomes.
        widths: channels of the upsampling network at 1, 2, 4, ... times the patches' resolution, multiples of 8; as
            many as there are doublings from there to half of the heightmap's.
        bins: output channels.

    Raises:
        InputError: if a setting cannot be.
    """

    stride = STRIDE

    def __init__(
        self,
        embedding_size: int,
        patch: int,
        width: int,
        depth: int,
        heads: int,
        language_tokens: int,
        widths: tuple[int, ...],
        bins: int,
    ) -> None:
        super().__init__()
        doublings = (patch // STRIDE).bit_length() - 1
        if patch < 4 or patch & (patch - 1):
            raise InputError(f"a patch's side is a power of two from 4 on, but this is {patch}")
        if width % 4 or width % heads or width < 4:
            raise InputError(f"a token's width is a multiple of 4 and of the {heads} heads, but this is {width}")
        if len(widths) != doublings or any(each % 8 or each < 8 for each in widths):
            raise InputError(
                f"from patches of {patch} pixels to cells of {STRIDE} there are {doublings} doublings, so there are as "
                f"many widths, multiples of 8, but these are {widths}"
            )
        if depth < 1 or language_tokens < 1:
            raise InputError(f"a transformer has layers and language tokens, but these are {depth}, {language_tokens}")
        self.patch = patch
        self.width = width
        # a product, and not the convolution that it is: in bfloat16 on AMX oneDNN gets that one wrong (docs/models.md)
        self.embed_patches = nn.Linear(4 * patch**2, width)
        self.embed_language = nn.Linear(embedding_size, language_tokens * width)
        self.layers = nn.ModuleList(
            nn.TransformerEncoderLayer(
                width, heads, 4 * width, dropout=0.0, activation="gelu", batch_first=True, norm_first=True
            )
            for _ in range(depth)
        )
        self.norm = nn.LayerNorm(width)
        self.up = nn.ModuleList(convolution(a, b) for a, b in itertools.pairwise((width, *widths)))
        self.out = nn.Conv2d(widths[-1], bins, 3, padding=1)
        self.up.to(memory_format=torch.channels_last)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Colour 0 .. 255 and height in metres, `(B, 4, H, W)`, and the unit embedding `(B, D)` -> scores."""
        rows, columns = self._grid(observation)
        patches = functional.pixel_unshuffle(normalise(observation), self.patch).flatten(2).transpose(1, 2)
        patches = self.embed_patches(patches)
        patches = patches + places(rows, columns, self.width, like=observation)
        language = self.embed_language(embedding * math.sqrt(embedding.shape[1])).unflatten(1, (-1, self.width))
        tokens = torch.cat([language.to(patches.dtype), patches], dim=1)
        for layer in self.layers:
            tokens = layer(tokens)
        tokens = self.norm(tokens[:, language.shape[1] :])
        x = tokens.transpose(1, 2).unflatten(2, (rows, columns)).contiguous(memory_format=torch.channels_last)
        for layer in self.up:
            x = functional.interpolate(layer(x), scale_factor=2, mode="bilinear", align_corners=False)
        return self.out(x)

    def _grid(self, observation: Tensor) -> tuple[int, int]:
        """Rows and columns of patches."""
        rows, columns = (side // self.patch for side in observation.shape[2:])
        shape = (4, rows * self.patch, columns * self.patch)
        if tuple(observation.shape[1:]) != shape or not rows or not columns:
            raise InputError(
                f"an observation is (B, 4, H, W), colour and height, sides multiples of {self.patch}, but this is "
                f"{tuple(observation.shape)}; crop it or pad it with bare table"
            )
        return rows, columns


def places(rows: int, columns: int, width: int, like: Tensor) -> Tensor:
    """Sines and cosines of each patch's row and column, `(rows * columns, width)`: any size of heightmap has them."""
    quarter = width // 4
    # wavelengths from about 6 patches, so that neighbours differ, to 600, so that no two places are alike
    frequencies = 100.0 ** -(torch.arange(quarter, dtype=like.dtype, device=like.device) / quarter)
    row, column = (
        torch.outer(torch.arange(n, device=like.device).to(like.dtype), frequencies) for n in (rows, columns)
    )
    waves = torch.cat(
        [
            torch.cat([row.sin(), row.cos()], dim=1)[:, None].expand(-1, columns, -1),
            torch.cat([column.sin(), column.cos()], dim=1)[None].expand(rows, -1, -1),
        ],
        dim=2,
    )
    return waves.flatten(0, 1)
