"""What CLIP's transformers see of a heightmap lies where it is, whatever the size of their patches."""

from __future__ import annotations

import json

import open_clip
import pytest
import torch
from torch import Tensor

from equigrasp import clip
from equigrasp.encoder.clip_image import ClipImage

TEXT = {"context_length": 77, "vocab_size": 49408, "width": 16, "heads": 2, "layers": 1}
PATCHES = (14, 16, 32)
MARK = 4
"""Pixels of a side."""


@pytest.fixture(scope="module", autouse=True)
def tiny_architectures(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A small transformer of each patch beside open_clip's own."""
    folder = tmp_path_factory.mktemp("architectures")
    for patch in PATCHES:
        vision = {"image_size": 2 * patch, "layers": 4, "width": 32, "head_width": 16, "patch_size": patch}
        config = {"embed_dim": 16, "quick_gelu": True, "vision_cfg": vision, "text_cfg": TEXT}
        (folder / f"patch-{patch}.json").write_text(json.dumps(config))
    open_clip.add_model_config(folder)


@pytest.fixture
def tower(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ClipImage:
    name = f"patch-{request.param}"
    described = clip.Tower(name, "nobody/nothing", 16, (32, 3, request.param, request.param), (16, 16))
    monkeypatch.setitem(clip.TOWERS, name, described)
    return ClipImage(name, "random")


def places(side: int) -> list[int]:
    """First pixels of marks along a side, those at its ends among them."""
    return [*range(0, side - MARK, 23), side - MARK]


@torch.no_grad()
def seen(tower: ClipImage, shape: tuple[int, int], row: int, column: int) -> tuple[float, float]:
    """Where a mark is seen, (row, column) in pixels: the cell whose features it changes most, laid on the image."""
    bare = torch.full((1, 4, *shape), 128.0)
    marked = bare.clone()
    marked[:, :3, row : row + MARK, column : column + MARK] = 0
    change = (tower(marked)[-1] - tower(bare)[-1])[0].norm(dim=0)
    cell = divmod(int(change.argmax()), change.shape[1])
    found = [(at + 0.5) * side / cells - 0.5 for at, side, cells in zip(cell, shape, change.shape, strict=True)]
    return found[0], found[1]


@pytest.mark.parametrize("shape", [(160, 320), (64, 96), (96, 160)])
@pytest.mark.parametrize("tower", PATCHES, indirect=True)
def test_a_mark_is_seen_where_it_is(tower: ClipImage, shape: tuple[int, int]) -> None:
    """Within half a patch, and what of the mark may lie beyond its border; to the last row and column."""
    patch = tower.visual.conv1.kernel_size[0]
    allowed = [0.5 * side / max(round(side / patch), 1) + MARK / 2 for side in shape]
    marks = [(row, shape[1] // 2) for row in places(shape[0])] + [(shape[0] // 2, at) for at in places(shape[1])]
    for row, column in marks:
        found = seen(tower, shape, row, column)
        centre = row + (MARK - 1) / 2, column + (MARK - 1) / 2
        assert abs(found[0] - centre[0]) <= allowed[0], (row, column)
        assert abs(found[1] - centre[1]) <= allowed[1], (row, column)


@pytest.mark.parametrize("tower", [16, 32], indirect=True)
def test_what_patches_divide_is_not_resized(tower: ClipImage) -> None:
    given: list[Tensor] = []
    tower.visual.conv1.register_forward_pre_hook(lambda module, inputs: given.append(inputs[0]))
    scene = 255 * torch.rand(1, 4, 160, 320, generator=torch.Generator().manual_seed(0))
    tower(scene)
    expected = (scene[:, :3] / 255 - tower.mean.value) / tower.deviation.value
    assert torch.equal(given[0], expected)
