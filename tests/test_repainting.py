"""A thing in another colour is that thing, in the colour that is said; nothing else on the table is asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from equigrasp.augmentation import Augmentation, Example, repainting
from equigrasp.augmentation import augmentation as augmentation_module
from equigrasp.augmentation.canvas import Canvas
from equigrasp.augmentation.cutouts import Cutout, take_apart
from equigrasp.augmentation.repainting import Palette, paint, repaint
from equigrasp.grasp import Demonstration
from equigrasp.workspace import WORKSPACE, Motion

DRAWS = 60


def examples(demonstrations: list[Demonstration]) -> list[Example]:
    augmentation = Augmentation(demonstrations, 1.0)
    return [augmentation.sample(np.random.default_rng(seed)) for seed in range(DRAWS)]


def wrong_colors(demonstrations: list[Demonstration], drawn: list[Example]) -> int:
    """In how many examples the thing under the grasp looks like another colour than the one that is said."""
    palette = Palette([take_apart(each) for each in demonstrations])
    looks = {color: np.mean(paints, axis=0) for color, paints in palette.colors.items()}
    wrong = 0
    for example in drawn:
        u, v, _ = WORKSPACE.to_action(example.grasp)
        window = np.s_[max(v - 4, 0) : v + 5, max(u - 4, 0) : u + 5]
        seen = np.median(example.observation.color[window][example.observation.height[window] > 0.004], axis=0)
        nearest = min(looks, key=lambda color: float(np.linalg.norm(looks[color] - seen)))
        wrong += f" {nearest} " not in f" {example.instruction} "
    return wrong


def test_what_is_kept_is_bounded_and_changes_nothing(
    colored: list[Demonstration], monkeypatch: pytest.MonkeyPatch
) -> None:
    before = examples(colored)
    monkeypatch.setattr(repainting, "KEPT", 2)
    palette = Palette([take_apart(each) for each in colored])
    for scene in palette.scenes[:4]:
        palette.painted(scene, palette.color(np.random.default_rng(0)), np.random.default_rng(0))
    assert len(palette._painted) == 2
    for one, other in zip(before, examples(colored), strict=True):
        assert np.array_equal(one.observation.color, other.observation.color)


def test_what_is_grasped_has_the_color_that_is_said(colored: list[Demonstration]) -> None:
    drawn = examples(colored)
    # a shaded edge may look like a neighbour's colour
    assert wrong_colors(colored, drawn) <= DRAWS // 10
    shown = {each.instruction for each in colored}
    assert len({each.instruction for each in drawn} - shown) > DRAWS // 2


@pytest.mark.parametrize(
    "broken",
    [lambda cutout, new, table: cutout.color, lambda cutout, new, table: repaint(cutout, new[::-1], table)],
    ids=["left as it was", "another color"],
)
def test_paint_that_is_not_what_is_said_would_be_noticed(
    colored: list[Demonstration],
    monkeypatch: pytest.MonkeyPatch,
    broken: Callable[[Cutout, NDArray[np.float64], NDArray[np.uint8]], NDArray[np.uint8]],
) -> None:
    monkeypatch.setattr(repainting, "repaint", broken)
    assert wrong_colors(colored, examples(colored)) > DRAWS // 4


def test_a_thing_keeps_its_shades_and_what_is_beside_it(colored: list[Demonstration]) -> None:
    for demonstration in colored:
        scene = take_apart(demonstration)
        target = scene.target
        other = paint(target)[::-1] * 0.8 + 20
        painted = repaint(target, other, scene.table)
        beside = target.height == 0
        assert np.array_equal(painted[beside], target.color[beside])
        assert np.abs(paint(replace(target, color=painted)) - other).max() < 8
        back = repaint(replace(target, color=painted), paint(target), scene.table)
        assert np.abs(back.astype(int) - target.color).mean() < 6


def test_what_is_darker_stays_darker_by_as_much() -> None:
    """A thing with a bright half, a dark one and a stripe of its own paint."""
    color = np.empty((9, 10, 3), np.uint8)
    color[:, :4], color[:, 4:6], color[:, 6:] = (120, 60, 30), (100, 50, 25), (50, 25, 12)
    target = Cutout(color, np.full((9, 10), 0.03, np.float32), np.ones((9, 10), np.float32), (0, 0), None)
    assert paint(target).tolist() == [100, 50, 25]
    painted = repaint(target, np.array([20.0, 80.0, 160.0]), np.array([96, 97, 103], np.uint8))
    assert np.abs(painted[:, 4:6].astype(int) - [20, 80, 160]).max() <= 1
    assert np.abs(painted[:, :4].astype(int) - [24, 96, 192]).max() <= 1
    assert np.abs(painted[:, 6:].astype(int) - [10, 40, 80]).max() <= 2


@pytest.mark.parametrize(("hard", "fewest", "most"), [(0.0, 0.0, 0.3), (1.0, 0.4, 0.8)])
def test_nothing_else_is_what_is_asked_for(
    colored: list[Demonstration], monkeypatch: pytest.MonkeyPatch, hard: float, fewest: float, most: float
) -> None:
    """And of hard negatives about half are the same thing in another colour."""
    put: list[str | None] = []
    same = []

    class Watched(Canvas):
        def put(self, cutout: Cutout, rng: np.random.Generator, near: np.ndarray | None = None) -> Motion | None:
            put.append(cutout.name)
            return super().put(cutout, rng, near)

    monkeypatch.setattr(augmentation_module, "Canvas", Watched)
    augmentation = Augmentation(colored, 1.0, hard)
    for seed in range(DRAWS):
        example = augmentation.sample(np.random.default_rng(seed))
        target, *others = put
        assert target is not None
        assert all(word in example.instruction for word in target.replace("-", " ").split())
        assert target not in others
        assert None not in others
        same += [str(other).split(" ", 1)[1] == target.split(" ", 1)[1] for other in others]
        put.clear()
    assert fewest <= np.mean(same) <= most


def test_every_sentence_is_announced(colored: list[Demonstration]) -> None:
    announced = set(Augmentation(colored, 0.7).instructions)
    assert {each.instruction for each in examples(colored)} <= announced


def test_the_same_seed_paints_the_same(colored: list[Demonstration]) -> None:
    for one, again in zip(examples(colored), examples(colored), strict=True):
        assert one.instruction == again.instruction
        assert np.array_equal(one.observation.color, again.observation.color)


def test_without_recombination_nothing_is_painted(colored: list[Demonstration]) -> None:
    augmentation = Augmentation(colored, 0.0)
    assert set(augmentation.instructions) == {each.instruction for each in colored}
    assert augmentation.palette.scenes == ()


def test_things_without_a_color_and_things_in_every_color_stay_as_they_are(
    demonstrations: list[Demonstration], colored: list[Demonstration]
) -> None:
    assert Palette([take_apart(each) for each in demonstrations]).scenes == ()
    thing = colored[0].words[1]
    alone = [replace(each, words=(each.words[0], thing)) for each in colored]
    assert Palette([take_apart(each) for each in alone]).scenes == ()
    assert len(Palette([take_apart(each) for each in colored]).scenes) == len(colored)


def test_what_an_example_paints_does_not_grow_with_the_demonstrations(
    colored: list[Demonstration], monkeypatch: pytest.MonkeyPatch
) -> None:
    painted = Palette.painted
    count = 0

    def counted(self: Palette, *arguments: Any) -> Cutout:
        nonlocal count
        count += 1
        return painted(self, *arguments)

    monkeypatch.setattr(Palette, "painted", counted)
    counts = []
    for demonstrations in (colored, 5 * colored):
        count = 0
        examples(demonstrations)
        counts.append(count)
    assert counts[0] > DRAWS
    assert counts[1] < 1.5 * counts[0]


@pytest.mark.parametrize("own", [(200, 40, 40), (30, 90, 40), (160, 160, 160), (40, 30, 20)], ids=str)
def test_table_that_heights_reach_over_stays_table(own: tuple[int, int, int]) -> None:
    """As of several cameras: what stands there is a pixel wider than what is seen of it."""
    table = np.array([96, 97, 103], np.uint8)
    color = np.broadcast_to(table, (12, 12, 3)).copy()
    color[2:-2, 2:-2] = own
    color[4:6, 4:6] = np.array(own) * 0.7
    height = np.zeros((12, 12), np.float32)
    height[1:-1, 1:-1] = 0.03
    target = Cutout(color, height, (height > 0).astype(np.float32), (0, 0), None)
    painted = repaint(target, np.array([20.0, 80.0, 220.0]), table)
    changed = np.abs(painted.astype(int) - color).max(axis=-1) > 0
    assert changed[2:-2, 2:-2].all()
    fringe = (height > 0) & ~np.pad(np.ones((8, 8), bool), 2)
    assert not changed[fringe].any()
    whole = repaint(target, np.array([20.0, 80.0, 220.0]), np.array([255, 0, 255], np.uint8))
    assert (np.abs(whole.astype(int) - color).max(axis=-1) > 0)[fringe].all(), "what does not know the table paints it"
