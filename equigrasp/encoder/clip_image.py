"""CLIP's image tower as a frozen source of feature maps, at any size of heightmap."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import clip
from equigrasp.constant import Constant

MEAN, DEVIATION = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)
"""Of the colours 0 .. 1 that CLIP was trained on."""


class ClipImage(nn.Module):
    """A frozen image tower: colours of `(B, 4, H, W)` -> four maps, from the deepest to the shallowest.

    Residual towers give layers 4 to 1, `H / 32` to `H / 4`; transformers give the patches' states after their last
    block and after three quarters, half and a quarter of them, all at one resolution. Where a patch does not divide the
    sides, as 14 pixels do not, the image is first resized to the nearest sides that it divides. No parameter has
    gradients and batch statistics are those of the weights, whatever `train` says. What only the pooled embedding needs
    is left out.

    Args:
        name: a tower of `clip.TOWERS`.
        weights: "openai", a file, or "random".

    Raises:
        InputError: if the weights are not to be had (`clip.find_weights`).
    """

    def __init__(self, name: str, weights: str) -> None:
        super().__init__()
        # open_clip's class, whose parts are called here by their names
        self.visual: Any = clip.load(name, weights).visual
        self.is_residual = hasattr(self.visual, "layer4")
        if self.is_residual:
            self.visual.attnpool = None
            width = self.visual.conv3.out_channels
            self.channels = (32 * width, 16 * width, 8 * width, 4 * width)
        else:
            self.visual.ln_post, self.visual.proj = None, None
            self.channels = (self.visual.conv1.out_channels,) * 4
        self.mean, self.deviation = (
            Constant(torch.tensor(each, dtype=torch.float64).view(1, 3, 1, 1)) for each in (MEAN, DEVIATION)
        )
        self.requires_grad_(False)
        self.to(memory_format=torch.channels_last)
        self.eval()

    def train(self, mode: bool = True) -> ClipImage:
        """Frozen: stays in eval mode."""
        return super().train(False)

    def forward(self, observation: Tensor) -> list[Tensor]:
        """Colour 0 .. 255 and height, `(B, 4, H, W)`, sides multiples of 32 -> four maps `(B, channels[i], h, w)`."""
        image = (observation[:, :3] / 255 - self.mean.value) / self.deviation.value
        image = image.contiguous(memory_format=torch.channels_last)
        return self._layers(image) if self.is_residual else self._blocks(image)

    def _layers(self, image: Tensor) -> list[Tensor]:
        x, maps = self.visual.stem(image), []
        for layer in (self.visual.layer1, self.visual.layer2, self.visual.layer3, self.visual.layer4):
            x = layer(x)
            maps.append(x)
        return maps[::-1]

    def _blocks(self, image: Tensor) -> list[Tensor]:
        patches = self.visual.conv1(self._whole(image))
        rows, columns = patches.shape[2:]
        first = self.visual.class_embedding.to(patches.dtype).expand(len(image), 1, -1)
        x = torch.cat([first, patches.flatten(2).transpose(1, 2)], dim=1)
        x = self.visual.ln_pre(x + self._places(rows, columns).to(x.dtype))
        blocks, maps = self.visual.transformer.resblocks, []
        for count, block in enumerate(blocks, start=1):
            x = block(x)
            if count % (len(blocks) // 4) == 0:
                maps.append(x[:, 1:].transpose(1, 2).unflatten(2, (rows, columns)))
        return maps[::-1]

    def _whole(self, image: Tensor) -> Tensor:
        """The image at the nearest size that patches cover without a rest: conv1 would leave out its last pixels."""
        patch = self.visual.conv1.stride[0]
        size = [max(round(side / patch), 1) * patch for side in image.shape[2:]]
        if size == list(image.shape[2:]):
            return image
        return functional.interpolate(image, size=size, mode="bilinear", align_corners=False)

    def _places(self, rows: int, columns: int) -> Tensor:
        """The trained square of position embeddings, stretched to this grid, the class token's before it."""
        places = self.visual.positional_embedding
        side = round((len(places) - 1) ** 0.5)
        square = places[1:].T.unflatten(1, (side, side))[None]
        if (rows, columns) != (side, side):
            square = functional.interpolate(square, size=(rows, columns), mode="bicubic", align_corners=False)
        return torch.cat([places[:1], square[0].flatten(1).T])
