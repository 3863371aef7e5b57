"""The rotator: which angle is which bin, the gripper's mirror, gradients and memory of its chunks."""

from __future__ import annotations

import math
from functools import partial

import pytest
import torch
from torch import Tensor, nn

from equigrasp.baselines.rotator import Rotator, turn
from equigrasp.errors import InputError


class BarAlongX(nn.Module):
    """Scores a cell by how far its neighbours to the left and right look like it: best along a horizontal bar."""

    stride = 2

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        cells = torch.nn.functional.avg_pool2d(observation[:, 3:], 2)
        kernel = torch.zeros(1, 1, 21, 21, dtype=cells.dtype)
        kernel[..., 9:12, :] = 1.0
        return torch.nn.functional.conv2d(cells, kernel, padding=10)


class Small(nn.Module):
    """A convolutional network without symmetry, told the instruction."""

    stride = 2

    def __init__(self) -> None:
        super().__init__()
        self.language = nn.Linear(512, 8)
        self.first, self.last = nn.Conv2d(4, 8, 5, stride=2, padding=2), nn.Conv2d(8, 1, 3, padding=1)

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        x = torch.tanh(self.first(observation / 100) + self.language(embedding)[:, :, None, None])
        return self.last(x)


def small(rotations: int, chunk: int = 4) -> Rotator:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        return Rotator(Small(), rotations, chunk, 36).double()


def scene(rows: int = 32, columns: int = 32) -> tuple[Tensor, Tensor]:
    rng = torch.Generator().manual_seed(3)
    observation = 100 * torch.rand(2, 4, rows, columns, generator=rng, dtype=torch.float64)
    return observation, torch.nn.functional.normalize(torch.randn(2, 512, generator=rng, dtype=torch.float64))


def bar(degrees: float) -> Tensor:
    """A bar of height 1 through the middle at that angle from +x, y up: `(1, 4, 96, 160)`."""
    v, u = (torch.arange(n) - (n - 1) / 2 for n in (96, 160))
    x, y = u[None], -v[:, None]
    alpha = math.radians(degrees)
    along, across = x * math.cos(alpha) + y * math.sin(alpha), y * math.cos(alpha) - x * math.sin(alpha)
    height = ((along.abs() < 22) & (across.abs() < 3)).float()
    return torch.cat([torch.zeros(3, 96, 160), height[None]])[None]


@pytest.mark.parametrize("rotations", [36, 72])
@pytest.mark.parametrize("degrees", [0, 25, 90, 130])
def test_the_best_bin_is_the_angle_and_the_best_cell_the_place(rotations: int, degrees: int) -> None:
    scores = Rotator(BarAlongX(), rotations, 9, 36)(bar(degrees), torch.zeros(1, 512))[0]
    best = int(scores.argmax())
    row, column = best // 80 % 48, best % 80
    assert best // (48 * 80) == degrees // 5
    assert abs(2 * column + 0.5 - 79.5) <= 3
    assert abs(2 * row + 0.5 - 47.5) <= 3


def test_a_turn_is_clockwise_and_a_quarter_is_exact() -> None:
    image = torch.rand(1, 2, 32, 32, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(turn(image, math.pi / 2, (32, 32)), image.rot90(-1, (2, 3)), rtol=0, atol=1e-12)
    torch.testing.assert_close(turn(image, 0.0, (32, 32)), image, rtol=0, atol=1e-12)
    smooth = torch.nn.functional.interpolate(image[..., :6, :6], size=(32, 32), mode="bicubic")
    back = turn(turn(smooth, 0.4, (64, 64)), -0.4, (32, 32))
    assert (back - smooth)[..., 4:-4, 4:-4].abs().max() < 0.05


@pytest.mark.parametrize(("rotations", "holds"), [(72, True), (36, False)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_with_both_postures_alone_a_quarter_turn_goes_through_exactly(
    dtype: torch.dtype, rotations: int, holds: bool
) -> None:
    rotator = small(rotations).to(dtype)
    observation, embedding = (each.to(dtype) for each in scene())
    with torch.no_grad():
        scores = rotator(observation, embedding)
        turned = rotator(observation.rot90(1, (2, 3)), embedding)
    expected = scores.rot90(1, (2, 3)).roll(18, dims=1)
    assert bool((turned - expected).abs().max() < 20 * torch.finfo(dtype).eps) is holds


def gradients(rotator: Rotator, scores: Tensor) -> list[Tensor]:
    loss = torch.nn.functional.cross_entropy(scores.flatten(1), torch.tensor([5, 4000]))
    return list(torch.autograd.grad(loss, list(rotator.parameters())))


@pytest.mark.parametrize(("rotations", "chunk"), [(72, 1), (72, 5), (36, 36)])
def test_scores_and_gradients_are_those_of_the_plain_version(rotations: int, chunk: int) -> None:
    rotator, (observation, embedding) = small(rotations, chunk), scene()
    plain = rotator.scores_of(observation, embedding, rotator.angles)
    plain = plain.view(2, -1, 36, 16, 16).exp().sum(dim=1).log()
    scores = rotator(observation, embedding)
    torch.testing.assert_close(scores, plain, rtol=0, atol=1e-9)
    expected, found = gradients(rotator, plain), gradients(rotator, scores)
    largest = max(float(each.abs().max()) for each in expected)
    for a, b in zip(found, expected, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-5, atol=1e-5 * largest)


def kept_for_backward(score, *inputs: Tensor) -> int:
    """Bytes that autograd keeps between forward and backward."""
    kept = {}

    def pack(tensor: Tensor) -> Tensor:
        kept[tensor.untyped_storage().data_ptr()] = tensor.untyped_storage().nbytes()
        return tensor

    with torch.autograd.graph.saved_tensors_hooks(pack, lambda tensor: tensor):
        result = score(*inputs)
    assert result.requires_grad
    return sum(kept.values())


def test_memory_does_not_grow_with_the_rotations() -> None:
    """But for the scores: what is kept beyond them is the same for 36 and 72, and without chunks it is not."""
    observation, embedding = scene(64, 64)
    scores = {n: 8 * 2 * n * 32 * 32 for n in (36, 72)}
    chunked = {n: kept_for_backward(small(n, 2), observation, embedding) for n in scores}
    assert chunked[72] - chunked[36] < 3 * scores[36]
    plain = {}
    for n in scores:
        rotator = small(n)
        plain[n] = kept_for_backward(partial(rotator.scores_of, angles=rotator.angles), observation, embedding)
    assert plain[72] - plain[36] > 20 * scores[36]


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputError, match="36 angles over half a turn or 72"):
        Rotator(Small(), 35, 1, 36)
    with pytest.raises(InputError, match="at least 1 copy"):
        Rotator(Small(), 36, 0, 36)
