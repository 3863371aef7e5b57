"""Examples painted where they are learned from: what was cut out lies on the device, and where it goes comes over.

A scene of five objects is 51 numbers for the host to send, and 204,800 painted. The pixels are those that
`Layout.paint` paints on the host, to rounding.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from equigrasp.augmentation.augmentation import Augmentation
from equigrasp.augmentation.examples import Recipe
from equigrasp.augmentation.repainting import LUMINANCE, paint


class Painter:
    """Paints examples of one augmentation on a device.

    Args:
        augmentation: whose demonstrations and cut-out objects are brought over, once.
        device: where to.
    """

    def __init__(self, augmentation: Augmentation, device: torch.device) -> None:
        def there(values: NDArray) -> Tensor:
            return torch.from_numpy(np.ascontiguousarray(values)).to(device)

        scenes, demonstrations = augmentation.scenes, augmentation.demonstrations
        cutouts = list(itertools.chain(*([each.target, *each.others] for each in scenes)))
        stood_on = [each.table for each in scenes for _ in (each.target, *each.others)]
        whole = [np.ones(each.observation.shape, np.float32) for each in demonstrations]
        masks = [*(each.mask for each in cutouts), *whole]
        colors = [*(each.color for each in cutouts), *(each.observation.color for each in demonstrations)]
        moved = zip(demonstrations, augmentation.levels, strict=True)
        heights = [*(each.height for each in cutouts), *(each.observation.height - level for each, level in moved)]
        areas = [each.size for each in masks]
        # all pixels in one row, those of an object from its start on; a cut's mask is 0 or 1
        self._starts = there(np.cumsum([0, *areas[:-1]]))
        self._sizes = there(np.array([each.shape for each in masks], dtype=np.int64))
        self._colors = there(np.concatenate([each.reshape(-1, 3) for each in colors]))
        self._heights = there(np.concatenate([each.ravel() for each in heights]).astype(np.float32))
        self._masks = there(np.concatenate([each.ravel() for each in masks]).astype(np.uint8))
        own = [*(paint(each) for each in cutouts), *(np.zeros(3) for _ in whole)]
        self._own = there(np.array(own, dtype=np.float32))
        self._stood_on = there(np.array([*stood_on, *augmentation.tables], dtype=np.float32))
        self._tables = there(np.array([*(each.table for each in scenes), *augmentation.tables], dtype=np.float32))
        flat = [np.full(augmentation.workspace.shape, level, np.float32) for level in augmentation.levels]
        self._levels = there(np.stack([*(each.level for each in scenes), *flat]))
        self._luminance = there(LUMINANCE.astype(np.float32))
        rows, columns = augmentation.workspace.shape
        self._v = there(np.arange(rows, dtype=np.float32) + 0.5).view(1, 1, rows, 1)
        self._u = there(np.arange(columns, dtype=np.float32) + 0.5).view(1, 1, 1, columns)

    def __call__(self, numbers: Tensor, ways: Tensor, paints: Tensor, grounds: Tensor) -> Tensor:
        """Examples as observations `(B, 4, H, W)`: colour 0 .. 255, height in metres.

        Args:
            numbers: `(B, N)`, which objects, as `Recipe` numbers them.
            ways: `(B, N, 2, 3)`, from (u, v, 1) of the heightmap to (u, v) of the object, from the first pixel's
                corner.
            paints: `(B, N, 3)`, another paint for each of them; not a number for its own.
            grounds: `(B,)`, which table.
        """
        with torch.no_grad():
            u, v = (self._u * way[..., 0] + self._v * way[..., 1] + way[..., 2] for way in _by_row(ways))
            owner, seen = self._owners(numbers, u, v)
            # one object a pixel from here on: no two of them meet
            number, u, v = numbers.gather(1, owner.flatten(1)).view_as(owner), _of(u, owner), _of(v, owner)
            coat = paints.gather(1, owner.view(len(owner), -1, 1).expand(-1, -1, 3)).view(*owner.shape, 3)
            corners, right, down = self._corners(number, u, v)
            color = _between([self._color(each, number, coat) for each in corners], right[..., None], down[..., None])
            height = _between([self._heights[each] for each in corners], right, down)
            color = torch.where(seen[..., None], color.floor(), self._tables[grounds].view(-1, 1, 1, 3))
            height = height * seen + self._levels[grounds]
            return torch.cat([color.permute(0, 3, 1, 2), height[:, None]], dim=1)

    def _owners(self, numbers: Tensor, u: Tensor, v: Tensor) -> tuple[Tensor, Tensor]:
        """Which of the objects covers a pixel, and whether one does, `(B, H, W)`."""
        number = numbers[..., None, None]
        rows, columns = self._sizes[number].unbind(-1)
        inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        corners, right, down = self._corners(number, u, v)
        mask = _between([self._masks[each].float() for each in corners], right, down)
        covers = inside & (mask > 0.5)
        return covers.to(torch.uint8).argmax(1), covers.any(1)

    def _corners(self, number: Tensor, u: Tensor, v: Tensor) -> tuple[list[Tensor], Tensor, Tensor]:
        """Indices of the four pixels of its object that a place lies between, and how far on it is, right and down."""
        rows, columns = self._sizes[number].unbind(-1)
        left, top = (u - 0.5).floor(), (v - 0.5).floor()
        across = [(left + step).long().clamp_min(0).minimum(columns - 1) for step in (0, 1)]
        along = [(top + step).long().clamp_min(0).minimum(rows - 1) for step in (0, 1)]
        start = self._starts[number]
        return [start + y * columns + x for y in along for x in across], u - 0.5 - left, v - 0.5 - top

    def _color(self, index: Tensor, number: Tensor, coat: Tensor) -> Tensor:
        """Colours `(B, H, W, 3)` of these pixels, in their object's new paint if it has one: `repainting.repaint`."""
        color, own, table = self._colors[index].float(), self._own[number], self._stood_on[number]
        shade = color @ self._luminance / (own @ self._luminance).clamp_min(1.0)
        painted = (shade[..., None] * coat).clamp(0, 255).floor()
        nearest = ((color * own).sum(-1) / (own * own).sum(-1).clamp_min(1.0))[..., None] * own
        off_paint, off_table = ((color - each).abs().amax(-1) for each in (nearest, table))
        is_painted = (self._heights[index] > 0) & (off_paint <= off_table) & ~coat[..., 0].isnan()
        return torch.where(is_painted[..., None], painted, color)


def _by_row(ways: Tensor) -> Sequence[Tensor]:
    """The two rows of `(B, N, 2, 3)`, `(B, N, 1, 1, 3)` each."""
    return ways[:, :, :, None, None].unbind(2)


def _of(values: Tensor, owner: Tensor) -> Tensor:
    """Each pixel's value for its own object: `(B, N, H, W)`, `(B, H, W)` -> `(B, H, W)`."""
    return values.gather(1, owner[:, None])[:, 0]


def _between(corners: Sequence[Tensor], right: Tensor, down: Tensor) -> Tensor:
    """Bilinear."""
    a, b, c, d = corners
    upper, lower = a + (b - a) * right, c + (d - c) * right
    return upper + (lower - upper) * down


def recipes(drawn: Sequence[Recipe]) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """What a `Painter` takes for these examples: numbers, ways, paints, grounds."""
    numbers, ways, paints = (
        torch.from_numpy(np.stack(values))
        for values in zip(*((each.numbers, each.ways, each.paints) for each in drawn), strict=True)
    )
    return numbers, ways, paints, torch.tensor([each.ground for each in drawn])
