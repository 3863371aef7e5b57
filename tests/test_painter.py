"""What a device paints from a recipe is what the host paints, and a training that is fed so learns the same."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from test_cuda_graph import GPU, Host
from test_devices import FEW, Exact, exact_policy
from torch import Tensor

from equigrasp.augmentation import Augmentation
from equigrasp.augmentation.examples import Draw, painted, recipe
from equigrasp.engines.in_order import in_order
from equigrasp.grasp import Demonstration, Observation
from equigrasp.plan import WEIGHTS
from equigrasp.policy import to_tensor
from equigrasp.training import painter as painter_module
from equigrasp.training.batch import Feed, with_pixels, with_recipes
from equigrasp.training.devices import Process
from equigrasp.training.loop import take_steps
from equigrasp.training.painter import Painter, recipes
from equigrasp.workspace import WORKSPACE

CPU = torch.device("cpu")
DRAWS = 12
ONE = range(1)


def on_a_slope(demonstration: Demonstration) -> Demonstration:
    """As a camera of one's own sees it whose pose is a little off: a table 8 to 14 mm above z = 0."""
    seen = demonstration.observation
    rows, columns = np.indices(seen.height.shape)
    slope = (0.008 + 0.004 * rows / rows.max() + 0.002 * columns / columns.max()).astype(np.float32)
    return replace(demonstration, observation=Observation(seen.color, seen.height + slope))


def off(augmentation: Augmentation, paint: Callable[..., Tensor]) -> tuple[float, float]:
    """How far colours and heights are off those of the host, in all but one pixel of a thousand of each example."""
    worst = [0.0, 0.0]
    for step in range(DRAWS):
        [told], [example] = Draw(augmentation, 0, ONE, recipe)(step), Draw(augmentation, 0, ONE, painted)(step)
        assert (told.instruction, told.grasp) == (example.instruction, example.grasp)
        apart = (paint(*recipes([told]))[0] - to_tensor(example.observation)).abs()
        for place, each in enumerate((apart[:3].amax(0), apart[3])):
            worst[place] = max(worst[place], float(each.flatten().sort().values[-each.numel() // 1000]))
    return worst[0], worst[1]


KINDS = {
    "moved": lambda plain, colored: Augmentation(plain, 0.0),
    "recombined": lambda plain, colored: Augmentation(plain, 1.0),
    "crowded": lambda plain, colored: Augmentation(plain, 1.0, 0.0, 1.0),
    "repainted": lambda plain, colored: Augmentation(colored, 1.0, 0.5),
    "recombined on a slope": lambda plain, colored: Augmentation([on_a_slope(each) for each in plain], 1.0),
    "moved on a slope": lambda plain, colored: Augmentation([on_a_slope(each) for each in plain], 0.0),
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_device_paints_what_the_host_paints(
    demonstrations: list[Demonstration], colored: list[Demonstration], kind: str
) -> None:
    """To a level of 255, where a sum that is all but whole is cut off, and to a hundredth of a millimetre."""
    augmentation = KINDS[kind](demonstrations, colored)
    color, height = off(augmentation, Painter(augmentation, CPU))
    assert color <= 1
    assert height < 1e-5


@GPU
def test_a_gpu_paints_it_too_as_a_graph(colored: list[Demonstration]) -> None:
    augmentation, process = Augmentation(colored, 0.7), Process(torch.device("cuda"))
    paint = process.captured(Painter(augmentation, process.device))
    color, height = off(augmentation, lambda *told: paint(*process.take(*told)).cpu())
    assert color <= 1
    assert height < 1e-5


def half_a_pixel_off(paint: Painter) -> Callable[..., Tensor]:
    return lambda numbers, ways, *rest: paint(numbers, ways + torch.tensor([0.0, 0.0, 0.5]), *rest)


def in_its_own_paint(paint: Painter) -> Callable[..., Tensor]:
    return lambda numbers, ways, paints, grounds: paint(numbers, ways, torch.full_like(paints, torch.nan), grounds)


def on_a_level_table(paint: Painter) -> Callable[..., Tensor]:
    paint._levels.zero_()
    return paint


@pytest.mark.parametrize(
    ("kind", "broken"),
    [("recombined", half_a_pixel_off), ("repainted", in_its_own_paint), ("moved on a slope", on_a_level_table)],
)
def test_what_is_painted_wrong_would_be_noticed(
    demonstrations: list[Demonstration],
    colored: list[Demonstration],
    kind: str,
    broken: Callable[[Painter], Callable[..., Tensor]],
) -> None:
    augmentation = KINDS[kind](demonstrations, colored)
    color, height = off(augmentation, broken(Painter(augmentation, CPU)))
    assert color > 1 or height > 1e-3


def test_a_batch_is_painted_as_each_of_its_examples(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 0.5)
    paint = Painter(augmentation, CPU)
    batch = Draw(augmentation, 0, range(4), recipe)(0)
    assert torch.equal(paint(*recipes(batch)), torch.cat([paint(*recipes([each])) for each in batch]))


def test_what_comes_over_is_a_few_numbers_and_the_device_asks_for_no_more(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 1.0)
    paint, told = Painter(augmentation, CPU), recipes(Draw(augmentation, 0, ONE, recipe)(0))
    [pixels] = with_pixels().scenes(Draw(augmentation, 0, ONE, painted)(0))
    assert sum(each.nbytes for each in told) < 0.001 * pixels.nbytes
    host = Host()
    with host:
        paint(*told)
    assert host.asked == []


def test_recipes_are_drawn_in_other_processes(demonstrations: list[Demonstration]) -> None:
    draw = Draw(Augmentation(demonstrations, 0.5), 0, range(2), recipe)
    for step, told in enumerate(in_order(draw, range(4), workers=2)):
        for one, other in zip(recipes(told), recipes(draw(step)), strict=True):
            assert torch.equal(one.nan_to_num(-1.0), other.nan_to_num(-1.0))


class Painting(Exact):
    """A process that paints where it learns, as a GPU does."""

    def feed(self, augmentation: Augmentation) -> Feed:
        feed = with_recipes(augmentation, self.device)
        return replace(feed, observe=lambda *told: feed.observe(*told).double())

    def take(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        # it paints in float32, as on a GPU
        language, *rest = tensors
        return language.double(), *rest


@pytest.mark.parametrize("works", [True, False])
def test_a_training_learns_the_same_from_what_it_paints_itself(
    tmp_path: Path, demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch, works: bool
) -> None:
    if not works:
        monkeypatch.setattr(painter_module, "_between", lambda corners, right, down: corners[0])
    augmentation = Augmentation(demonstrations, FEW.recombination)
    embeddings = {sentence: exact_policy().embed(sentence) for sentence in augmentation.instructions}
    for name, kind in (("host", Exact), ("device", Painting)):
        (tmp_path / name).mkdir()
        take_steps(kind(CPU), exact_policy, FEW, augmentation, embeddings, tmp_path / name, iter)
    host, device = (load_file(tmp_path / name / WEIGHTS) for name in ("host", "device"))
    start = exact_policy().state_dict()

    def between(one: Mapping[str, Tensor], other: Mapping[str, Tensor]) -> float:
        return math.hypot(*(float((one[name].double() - other[name].double()).norm()) for name in host))

    # Adam takes a step as long where a gradient is all but zero, and so the worst of all weights says little
    assert (between(host, device) < 0.05 * between(host, start)) == works


def test_as_many_objects_are_told_as_any_example_has(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 1.0)
    drawn = [Draw(augmentation, 0, ONE, recipe)(step)[0] for step in range(60)]
    assert {len(each.numbers) for each in drawn} == {augmentation.most}
    beside = [int((each.ways[:, 0, 2] == -1).sum()) for each in drawn]
    assert min(beside) == 0, "some are full"
    assert Augmentation(demonstrations, 0.0).most == 1
    assert WORKSPACE.shape == demonstrations[0].observation.shape
