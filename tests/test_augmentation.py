"""Augmentation moves scenes and labels by the same g; recombination moves each object by its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from equigrasp.augmentation import CLEARANCE, Augmentation, Canvas, Example
from equigrasp.cutouts import LOWEST, take_apart
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Observation
from equigrasp.workspace import WORKSPACE, Motion, warp


def patch(example: Example, grasp_side: float = 0.0) -> np.ndarray:
    """The height around a grasp, in the grasp's own frame `(33, 33)`: the same for one grasp under any motion."""
    grasp = example.grasp
    x, y = WORKSPACE.to_world([grasp.u, grasp.v])
    # undo the grasp's pose: its point to the middle of a 33 x 33 picture, its closing axis along the columns
    upright = Motion(-(grasp.theta + grasp_side)).about(x, y)
    shift = np.eye(3)
    shift[:2, 2] = 16 - np.array([grasp.u, grasp.v])
    return warp(example.observation.height, shift @ WORKSPACE.pixel_map(upright), (33, 33), 0.0)


def alike(first: np.ndarray, second: np.ndarray) -> float:
    """Mean difference where either has an object, as a share of the mean height."""
    inside = np.maximum(first, second) > LOWEST
    return float(np.abs(first - second)[inside].mean() / np.maximum(first, second)[inside].mean())


def core(example: Example, original: np.ndarray) -> float:
    """How different the grasp's own surroundings are; a closing axis has two directions, the better one counts."""
    window = np.s_[10:23, 10:23]
    return min(alike(patch(example, side)[window], original[window]) for side in (0.0, math.pi))


def original(demonstration: Demonstration) -> np.ndarray:
    return patch(Example(demonstration.observation, demonstration.instruction, demonstration.grasp))


def source(example: Example, demonstrations: list[Demonstration]) -> Demonstration:
    """The demonstration that an example asks to repeat, by the words of its sentence."""
    [found] = [each for each in demonstrations if all(f" {word}" in example.instruction for word in each.words)]
    return found


@pytest.mark.parametrize("share", [0.0, 1.0], ids=["moved", "recombined"])
def test_a_grasp_sees_its_object_as_before(demonstrations: list[Demonstration], share: float) -> None:
    augmentation = Augmentation(demonstrations, share)
    rng = np.random.default_rng(0)
    differences = []
    for _ in range(40):
        example = augmentation.sample(rng)
        demonstration = source(example, demonstrations)
        assert WORKSPACE.contains(example.grasp)
        differences.append(core(example, original(demonstration)))
    assert np.median(differences) < 0.12


def test_a_label_that_turns_the_wrong_way_is_noticed(demonstrations: list[Demonstration]) -> None:
    """The law above fails for a broken augmentation: an angle of the wrong sign."""
    augmentation = Augmentation(demonstrations, 1.0)
    rng = np.random.default_rng(0)
    differences = []
    for _ in range(40):
        example = augmentation.sample(rng)
        demonstration = source(example, demonstrations)
        turned = example.grasp.theta - demonstration.grasp.theta
        broken = replace(example, grasp=replace(example.grasp, theta=demonstration.grasp.theta - turned))
        differences.append(core(broken, original(demonstration)))
    assert np.median(differences) > 0.25


def test_recombined_objects_do_not_touch(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 1.0)
    rng = np.random.default_rng(1)
    for _ in range(10):
        example = augmentation.sample(rng)
        mask = example.observation.height > LOWEST
        _, apart = ndimage.label(mask, structure=np.ones((3, 3)))
        _, near = ndimage.label(ndimage.binary_dilation(mask, iterations=CLEARANCE // 2))
        assert near >= 3
        assert apart >= near


def test_every_scene_has_its_target_under_the_grasp(demonstrations: list[Demonstration]) -> None:
    for each in demonstrations:
        scene = take_apart(each)
        assert scene.target.name == each.target
        assert 3 <= len(scene.others) <= 4
        offset = np.abs(scene.target.centre - [each.grasp.u, each.grasp.v])
        assert (offset < np.array(scene.target.mask.shape[::-1]) / 2 + 2).all()


def test_no_second_target_is_put_down(demonstrations: list[Demonstration]) -> None:
    """Of the objects that a demonstrator named, the target's name is never drawn twice into one scene."""
    augmentation = Augmentation(demonstrations, 1.0)
    placed: list[str | None] = []

    class Spy(Canvas):
        def put(self, cutout, rng):
            placed.append(cutout.name)
            return super().put(cutout, rng)

    import equigrasp.augmentation as module

    original, module.Canvas = module.Canvas, Spy  # ty: ignore[invalid-assignment]
    try:
        for index, scene in enumerate(augmentation.scenes):
            placed.clear()
            augmentation.recombined(scene, np.random.default_rng(index))
            assert placed[0] == scene.demonstration.target
            named = [name for name in placed if name is not None]
            assert named.count(scene.demonstration.target) == 1
    finally:
        module.Canvas = original


def test_the_generator_decides_everything(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 0.5)
    for seed in range(4):
        first, second = (augmentation.sample(np.random.default_rng(seed)) for _ in range(2))
        assert first.observation.same(second.observation)
        assert (first.grasp, first.instruction) == (second.grasp, second.instruction)


def test_bad_shares_and_empty_tables_are_refused(demonstrations: list[Demonstration]) -> None:
    with pytest.raises(InputError, match=r"recombination is 1\.5"):
        Augmentation(demonstrations, 1.5)
    with pytest.raises(InputError, match="no demonstrations"):
        Augmentation([], 0.0)
    bare = Observation(np.zeros((160, 320, 3), np.uint8), np.zeros((160, 320), np.float32))
    with pytest.raises(InputError, match="empty table"):
        take_apart(replace(demonstrations[0], observation=bare))
