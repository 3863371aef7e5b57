"""CLIPort's rotator: the scene is turned by every angle, scored for one orientation of the hand, and turned back.

The network scores grasps whose closing axis lies along +x. Turning the observation by -theta brings a grasp with
closing axis theta there, so n turned copies score n angles with one channel.

The gripper is its own mirror: angles are modulo pi and the 36 bins cover half a turn. n = 36 copies, by 0, 5, .. 175
degrees, are one for each bin, but the network sees a bin's grasp in one of its two postures alone, and a scene turned
by 180 degrees is another scene to it. n = 72 copies, by 0, 5, .. 355 degrees, show both postures, theta and
theta + pi; a grasp can be had by either, so their probabilities are added (logsumexp of the scores). Then the scores
of a scene turned by a quarter are the turned scores, which for n = 36 they are not.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.utils.checkpoint import checkpoint

from equigrasp.errors import InputError

CANVAS_MULTIPLE = 64
"""Sides of the square on which every turn of the scene fits are multiples of this."""


class Rotator(nn.Module):
    """`(B, 4, H, W)`, `(B, D)` -> scores `(B, bins, H / stride, W / stride)`, in bounded memory.

    Turned copies go through the network a chunk at a time; what a chunk computed is thrown away and computed again
    for the gradient, so that memory does not grow with n.

    Args:
        network: `(B, 4, S, S)`, `(B, D)` -> `(B, 1, S / stride, S / stride)`; has `stride`.
        rotations: n; `bins`, or twice as many.
        chunk: copies that are in memory at a time.
        bins: angles over pi.

    Raises:
        InputError: if n is neither, or the chunk is empty.
    """

    def __init__(self, network: nn.Module, rotations: int, chunk: int, bins: int) -> None:
        super().__init__()
        if rotations not in (bins, 2 * bins):
            raise InputError(
                f"a rotator turns the scene by {bins} angles over half a turn or {2 * bins} over a whole one, "
                f"but this is {rotations}"
            )
        if chunk < 1:
            raise InputError(f"a rotator turns at least 1 copy at a time, but this is {chunk}")
        self.network = network
        self.stride = int(network.stride)  # ty: ignore[invalid-argument-type]
        self.bins = bins
        self.chunk = chunk
        self.angles = [math.pi * i / bins for i in range(rotations)]

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """Colour 0 .. 255 and height in metres, and the unit embedding -> scores."""
        chunks = [self.angles[i : i + self.chunk] for i in range(0, len(self.angles), self.chunk)]
        scores = torch.cat(
            [checkpoint(self.scores_of, observation, embedding, chunk, use_reentrant=False) for chunk in chunks], dim=1
        )
        # theta and theta + pi are one grasp
        return scores.unflatten(1, (-1, self.bins)).logsumexp(dim=1)

    def scores_of(self, observation: Tensor, embedding: Tensor, angles: list[float]) -> Tensor:
        """The scores of some angles, all their copies in memory at once: `(B, len(angles), H / stride, W / stride)`."""
        batch, _, rows, columns = observation.shape
        side = math.ceil(math.hypot(rows, columns) / CANVAS_MULTIPLE) * CANVAS_MULTIPLE
        turned = torch.stack([turn(observation, angle, (side, side)) for angle in angles], dim=1)
        repeated = embedding.repeat_interleave(len(angles), dim=0)
        scores = self.network(turned.flatten(0, 1), repeated).to(observation.dtype).unflatten(0, (batch, -1))
        cells = rows // self.stride, columns // self.stride
        return torch.cat([turn(scores[:, i], -angle, cells) for i, angle in enumerate(angles)], dim=1)


def turn(image: Tensor, angle: float, size: tuple[int, int]) -> Tensor:
    """The image turned clockwise by `angle` about its middle, cut or padded with zeros to `size`, bilinear.

    Args:
        image: `(B, C, H, W)`, row 0 at the top.
        angle: radians; with y up, the result at p is the image at R(angle) p.
        size: rows and columns of the result, about the same middle.
    """
    # whole quarters as permutations of pixels, which interpolation in float32 is only to 1e-5
    quarters = math.floor(2 * angle / math.pi + 0.5 + 1e-9)
    image = image.rot90(-quarters, (2, 3))
    rest = angle - quarters * math.pi / 2
    c, s = (round(value * 2**40) / 2**40 for value in (math.cos(rest), math.sin(rest)))
    rows, columns = image.shape[2:]
    v, u = (torch.arange(n, device=image.device).to(image.dtype) - (n - 1) / 2 for n in size)
    v = v[:, None]
    # rows grow downwards, so that the rotation's sine changes sides; grid_sample counts from -1 to 1 over the edges
    grid = torch.stack([(c * u + s * v) * (2 / columns), (c * v - s * u) * (2 / rows)], dim=2)
    return functional.grid_sample(
        image, grid.expand(len(image), -1, -1, -1), mode="bilinear", padding_mode="zeros", align_corners=False
    )
