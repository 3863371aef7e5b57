"""A table that a camera of one's own sees a little off z = 0, tilted or rough is told from what stands on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from equigrasp.augmentation import Augmentation
from equigrasp.augmentation.cutouts import take_apart
from equigrasp.augmentation.table import LOWEST, find_table
from equigrasp.cli import main
from equigrasp.collection import Collection
from equigrasp.demonstrations import store
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.heightmap import Camera, fuse
from equigrasp.workspace import WORKSPACE

THINGS = {"mug": (0.05, (-0.25, 0.1)), "spoon": (0.03, (0.0, 0.0)), "bowl": (0.045, (0.25, -0.1))}
"""How high things are and where their middle is, metres; each is a box, 60 mm x 40 mm."""
HALF = np.array([0.03, 0.02])
CAMERA = 0.8
"""Metres above the table; it sees all but its ends."""


def shown(noise: float = 0.0, level: float = 0.0, tilt: float = 0.0, wide: float = 0.0) -> list[Demonstration]:
    """A demonstration of each thing, as a real camera might see it.

    Args:
        noise: standard deviation of the depth, metres.
        level: where the table seems to lie, metres.
        tilt: by how much it seems to rise, metres for each metre.
        wide: over how many pixels of the camera the noise is alike.
    """
    rng = np.random.default_rng(0)
    focal, middle = 500.0, np.array([319.5, 239.5])
    x, y = (np.stack(np.meshgrid(np.arange(640), np.arange(480)), -1) - middle).transpose(2, 0, 1) / focal * CAMERA
    intrinsics = np.array([[focal, 0, middle[0]], [0, focal, middle[1]], [0, 0, 1]])
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = CAMERA
    demonstrations = []
    for number, target in enumerate(THINGS):
        color = np.full((480, 640, 3), (150, 140, 130), np.uint8)
        height = level + tilt * (x + 0.5 * y)
        for place, (high, (left, up)) in enumerate(THINGS.values()):
            # where its top is seen, which is nearer to the camera
            size = CAMERA / (CAMERA - high)
            covered = (np.abs(x - left * size) < HALF[0] * size) & (np.abs(-y - up * size) < HALF[1] * size)
            height[covered] += high
            color[covered] = 250 * np.eye(3)[place]
        stray = ndimage.gaussian_filter(rng.normal(size=height.shape), wide)
        depth = (CAMERA - height + noise * stray / stray.std()).astype(np.float32)
        u, v = WORKSPACE.to_pixel(THINGS[target][1])
        demonstrations.append(
            Demonstration(
                observation=fuse([Camera(color, depth, intrinsics, pose)]),
                instruction=f"pick up the {target} by its middle",
                grasp=Grasp(u, v, 1.2),
                task="my-table",
                goal=number,
                target=target,
                part="middle",
                kind="part",
                words=(target, "middle"),
                demo=0,
                seed=number,
                quality=1.0,
            )
        )
    return demonstrations


TABLES = {
    "clean": {},
    "1 mm of noise": {"noise": 0.001},
    "3 mm of noise": {"noise": 0.003},
    "noise in waves": {"noise": 0.002, "wide": 4.0},
    "2 mm too high": {"level": 0.002},
    "6 mm too high": {"level": 0.006},
    "6 mm too low": {"level": -0.006},
    "tilted by half a degree": {"tilt": 0.01},
    "all of it": {"noise": 0.002, "level": 0.004, "tilt": 0.01},
}


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_things_are_told_from_a_table_that_is_a_little_off(table: dict[str, float]) -> None:
    pixels = 4 * HALF.prod() / WORKSPACE.pixel**2
    for each in shown(**table):
        scene = take_apart(each)
        standing = ndimage.binary_erosion(scene.target.mask > 0.5)
        assert 0.7 * pixels < standing.sum() < 1.5 * pixels
        assert np.abs(scene.target.centre - [each.grasp.u, each.grasp.v]).max() < 3
        assert np.abs(scene.table.astype(int) - [150, 140, 130]).max() == 0
        assert len(scene.others) >= 2
        others = sorted((other for other in scene.others), key=lambda other: -other.mask.sum())
        assert 0.7 * pixels < others[1].mask.sum() < 2.0 * pixels


def test_what_comes_in_from_outside_a_moved_scene_is_as_high_as_the_table() -> None:
    """A step of 6 mm at the border of what was seen would be in every training picture and in none of acting's."""
    demonstrations = shown(level=0.006)
    # so near that it sees no border of its own
    seen = [replace(each, observation=filled(each.observation, 0.006)) for each in demonstrations]
    augmentation, rng = Augmentation(seen, 0.0), np.random.default_rng(0)
    for _ in range(20):
        assert np.abs(augmentation.sample(rng).observation.height.min() - 0.006) < 1e-4


def filled(observation: Observation, level: float) -> Observation:
    """The observation with bare table where nothing was seen."""
    bare = (observation.height == 0) & ~observation.color.any(axis=-1)
    color, height = observation.color.copy(), observation.height.copy()
    color[bare], height[bare] = (150, 140, 130), level
    return Observation(color, height)


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
@pytest.mark.parametrize("crowded", [0.0, 0.5])
def test_such_demonstrations_are_recombined(
    table: dict[str, float], crowded: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nearly each one, and a grasp sees the same height as before, on a table as high as before."""
    demonstrations = shown(**table)
    augmentation = Augmentation(demonstrations, 1.0, crowded=crowded)
    whole: list[Demonstration] = []
    moved = Augmentation.moved

    def watched(self: Augmentation, demonstration: Demonstration, *rest: np.ndarray | np.random.Generator) -> object:
        whole.append(demonstration)
        return moved(self, demonstration, *rest)  # ty: ignore[invalid-argument-type]

    monkeypatch.setattr(Augmentation, "moved", watched)
    off = 4 * table.get("noise", 0.0) + abs(table.get("tilt", 0.0)) + 0.001
    for seed in range(30):
        known = len(whole)
        example = augmentation.sample(np.random.default_rng(seed))
        if len(whole) > known:
            continue
        [source] = [each for each in demonstrations if each.words[0] in example.instruction]
        assert np.median(example.observation.height) == pytest.approx(np.median(source.observation.height), abs=0.002)
        assert example.observation.height.min() >= 0
        # put off along its object to make room for the hand, a grasp may come to where it ends
        if not crowded:
            at, was = ((round(each.grasp.v), round(each.grasp.u)) for each in (example, source))
            assert example.observation.height[at] == pytest.approx(source.observation.height[was], abs=off)
    assert len(whole) <= (10 if crowded else 0)


@given(st.floats(0, 0.02), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.integers(0, 99))
def test_the_plane_that_is_found_is_the_tables(level: float, along: float, across: float, seed: int) -> None:
    """Wherever it lies above z = 0, which heightmaps do not go below."""
    rng = np.random.default_rng(seed)
    rows, columns = np.indices(WORKSPACE.shape) / 320
    plane = 0.03 + level + along * columns + across * rows
    height = plane.copy()
    for _ in range(5):
        row, column = rng.integers(0, [120, 260])
        height[row : row + 40, column : column + 40] += rng.uniform(0.02, 0.1)
    color = np.full((*WORKSPACE.shape, 3), 120, np.uint8)
    color[:, :60], height[:, :60] = 0, 0.0
    table = find_table(Observation(color, height.astype(np.float32)))
    assert np.abs(table.level - plane).max() < 0.0005
    assert table.lowest == LOWEST


def test_the_simulators_table_lies_at_nought(demonstrations: list[Demonstration]) -> None:
    """To the bit, for what was drawn from its demonstrations is drawn again."""
    for each in demonstrations:
        assert not take_apart(each).level.any()
        assert find_table(each.observation).lowest == LOWEST


def flat(*boxes: tuple[int, int, int, int], high: float = 0.05) -> Demonstration:
    """Boxes (row, column, rows, columns) on a table at z = 0; the first is the target."""
    height = np.zeros(WORKSPACE.shape, np.float32)
    for row, column, rows, columns in boxes:
        height[row : row + rows, column : column + columns] = high
    row, column, rows, columns = boxes[0]
    color = np.full((*WORKSPACE.shape, 3), 120, np.uint8)
    grasp = Grasp(column + columns / 2, row + rows / 2, 0.0)
    return replace(shown()[0], observation=Observation(color, height), grasp=grasp)


LARGE = {
    "a bar": flat((60, 20, 12, 144), (20, 200, 20, 20)),
    "a plate": flat((8, 8, 144, 144), (20, 200, 20, 20)),
    "two plates": flat((8, 8, 144, 144), (8, 165, 144, 144)),
    "beside a plate nearly as low as the table": flat((60, 200, 20, 20), (8, 8, 64, 144), high=0.003),
}
LARGE["beside a plate nearly as low as the table"].observation.height[60:80, 200:220] = 0.05


@pytest.mark.parametrize("demonstration", LARGE.values(), ids=LARGE)
def test_large_things_are_taken_apart_as_ever(demonstration: Demonstration) -> None:
    """Of 0.45 m, the longest that a mesh of one's own may be: 144 pixels."""
    scene = take_apart(demonstration)
    assert not scene.level.any()
    expected, _ = ndimage.label(ndimage.binary_dilation(demonstration.observation.height > LOWEST))
    chosen = expected == expected[round(demonstration.grasp.v), round(demonstration.grasp.u)]
    assert scene.target.mask.sum() == chosen.sum()
    Augmentation([demonstration], 1.0).sample(np.random.default_rng(0))


def spoiled(name: str) -> Demonstration:
    """Pictures of which nothing can be told: a floor beside the table, a tray around it, a thin target."""
    if name == "beside the floor":
        # a good part of what was seen is floor at nought, so that the table is a thing
        return flat((0, 0, 160, 200), (40, 60, 20, 20), high=0.03)
    if name == "against a tray's rim":
        return flat((70, 0, 20, 30), (0, 0, 160, 12), (0, 308, 160, 12), (0, 0, 12, 320), (148, 0, 12, 320))
    [demonstration, *_] = shown(noise=0.003, level=0.004)
    gone = demonstration.observation.height.copy()
    u, v = round(demonstration.grasp.u), round(demonstration.grasp.v)
    gone[v - 12 : v + 12, u - 16 : u + 16] = gone[v - 12 : v + 12, u + 20 : u + 52]
    return replace(demonstration, observation=Observation(demonstration.observation.color, gone))


SPOILED = {
    "beside the floor": "to lie 0.0 mm above z = 0: .* more than 4.0 mm .* covers 6.% of what was seen",
    "against a tray's rim": "is too large to be put down in another turn",
    "thinner than the noise": r"to lie [789]\.. mm above z = 0: .* is .* mm from the grasp",
}


@pytest.mark.parametrize(("name", "sentence"), SPOILED.items(), ids=SPOILED)
def test_a_target_that_cannot_be_told_from_the_table_is_refused_in_one_sentence(name: str, sentence: str) -> None:
    demonstration = replace(spoiled(name), seed=71)
    for crowded in (0.0, 0.4):
        with pytest.raises(
            InputError, match=rf"the target of Demonstration\(my-table.* seed 71\).*{sentence}"
        ) as error:
            Augmentation([demonstration], 0.7, crowded=crowded)
        assert "\n" not in str(error.value)
        assert "train with --recombination 0" in str(error.value)
    Augmentation([demonstration], 0.0).sample(np.random.default_rng(0))


def test_a_training_that_could_not_recombine_does_not_begin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data, run = tmp_path / "data", tmp_path / "run"
    store(Collection("my-table", goals=((0,),), seed=0, camera="mine"), [spoiled("against a tray's rim")], data)
    command = ["train", "--data", str(data), "--steps", "2", "--text-encoder", "hashing", "--out", str(run)]
    with pytest.raises(SystemExit, match="2"):
        main(command)
    assert "correct the camera's pose" in capsys.readouterr().err
    assert not run.exists()
    main([*command, "--recombination", "0"])
    assert run.exists()
