"""A picture of photographs as a PNG of few colours: a third of the bytes, and small things keep theirs."""

from __future__ import annotations

import numpy as np
from PIL import Image
from scipy.spatial import KDTree


def fewer_colors(image: Image.Image, colors: int) -> Image.Image:
    """The picture with a palette of so many colours, each counted by the root of how many pixels have it.

    By the number of pixels a wide background would have most of the palette, and a small thing the colour of another.
    """
    packed = np.asarray(image.convert("RGB"), dtype=np.int64) @ [1 << 16, 1 << 8, 1]
    found, where, pixels = np.unique(packed, return_inverse=True, return_counts=True)
    each = np.stack([found >> 16, found >> 8 & 255, found & 255], axis=1)
    weighed = np.repeat(each, np.ceil(np.sqrt(pixels)).astype(int), axis=0).astype(np.uint8)
    palette = Image.fromarray(weighed[None]).quantize(colors, dither=Image.Dither.NONE, kmeans=2).getpalette()
    chosen = np.array(palette).reshape(-1, 3)[:colors]
    # paper is white, and the table as it was
    for color in each[np.argsort(pixels)[-4:]]:
        chosen[np.abs(chosen - color).sum(axis=1).argmin()] = color
    # Pillow's own search for the nearest colour is a coarse one
    nearest = KDTree(chosen).query(each)[1].astype(np.uint8)
    fewer = Image.fromarray(nearest[where].reshape(packed.shape))
    fewer.putpalette(chosen.ravel().tolist())
    return fewer
