"""Augmentation moves scenes and labels by the same g; recombination moves each object by its own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import ndimage

from equigrasp.augmentation import Augmentation, Example
from equigrasp.augmentation.augmentation import Sketch, said_alike
from equigrasp.augmentation.canvas import CLEARANCE, Canvas
from equigrasp.augmentation.cutouts import LOWEST, Cutout, Scene, cut, take_apart
from equigrasp.augmentation.examples import Draw, painted
from equigrasp.augmentation.layout import Moved
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.plan import Training
from equigrasp.workspace import WORKSPACE, Motion, Workspace, warp


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


def test_a_gap_stays_free_around_what_is_put_down() -> None:
    bar = np.zeros(WORKSPACE.shape, dtype=bool)
    bar[70:90, 100:130] = True
    observation = Observation(np.full((*WORKSPACE.shape, 3), 120, np.uint8), np.where(bar, 0.05, 0).astype(np.float32))
    cutout = cut(observation, bar, "bar")
    rng = np.random.default_rng(0)
    canvas = Canvas(WORKSPACE)
    gaps = []
    for _ in range(60):
        there = canvas.height > LOWEST
        if canvas.put(cutout, rng) is not None and there.any():
            new = (canvas.height > LOWEST) & ~there
            # pixel by pixel along rows and columns, as a dilation grows
            gaps.append(int(ndimage.distance_transform_cdt(~there, metric="taxicab")[new].min()) - 1)
    assert len(gaps) > 28, "many fit, if they are tried in several places"
    assert min(gaps) == CLEARANCE


def test_every_scene_has_its_target_under_the_grasp(demonstrations: list[Demonstration]) -> None:
    for each in demonstrations:
        scene = take_apart(each)
        assert scene.target.name == each.target
        assert 3 <= len(scene.others) <= 4
        offset = np.abs(scene.target.centre - [each.grasp.u, each.grasp.v])
        assert (offset < np.array(scene.target.mask.shape[::-1]) / 2 + 2).all()


def tried(
    augmentation: Augmentation, scene: Scene, seed: int, hard: bool, monkeypatch: pytest.MonkeyPatch
) -> list[str | None]:
    """The names of what a recombined scene tried to put down, in order."""
    names: list[str | None] = []

    class Spy(Canvas):
        def put(self, cutout: Cutout, rng: np.random.Generator, near: np.ndarray | None = None) -> Motion | None:
            names.append(cutout.name)
            return super().put(cutout, rng, near)

    with monkeypatch.context() as patched:
        patched.setattr("equigrasp.augmentation.augmentation.Canvas", Spy)
        augmentation.recombined(scene, np.random.default_rng(seed), hard)
    return names


def test_what_is_cut_out_has_nothing_of_its_neighbour() -> None:
    """A block three pixels beside another, which reaches into its margin of four."""
    height = np.zeros((40, 60), np.float32)
    height[10:20, 10:20], height[10:20, 23:33] = 0.02, 0.05
    mask = np.zeros(height.shape, bool)
    mask[10:20, 10:20] = True
    block = cut(Observation(np.zeros((40, 60, 3), np.uint8), height), mask, "block")
    assert block.height.shape == (18, 18)
    assert (block.corner, set(block.height.flatten().tolist())) == ((6, 6), {0.0, np.float32(0.02)})
    assert np.array_equal(block.height > 0, block.mask > 0)


def test_specks_are_noise_and_what_is_a_little_larger_an_object(demonstrations: list[Demonstration]) -> None:
    """A pixel of a camera's noise among the objects, and a thing of four by four pixels, 12 mm."""
    demonstration, seen = demonstrations[0], demonstrations[0].observation
    scene = take_apart(demonstration)
    taken = ndimage.binary_dilation(seen.height > 0.001, iterations=12)
    v, u = np.argwhere(~taken[6:-6, 6:-6])[0] + 6
    found = {}
    for side in (1, 4):
        height = seen.height.copy()
        height[v : v + side, u : u + side] = 0.02
        found[side] = take_apart(replace(demonstration, observation=replace(seen, height=height)))
        assert np.array_equal(found[side].target.height, scene.target.height)
    assert len(found[1].others) == len(scene.others)
    assert len(found[4].others) == len(scene.others) + 1


def test_no_second_target_is_put_down(demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the objects that a demonstrator named, the target's name is never drawn twice into one scene."""
    augmentation = Augmentation(demonstrations, 1.0)
    for index, scene in enumerate(augmentation.scenes):
        for hard in (False, True):
            placed = tried(augmentation, scene, index, hard, monkeypatch)
            assert placed[0] == scene.demonstration.target
            named = [name for name in placed if name is not None]
            assert named.count(scene.demonstration.target) == 1


def test_hard_negatives_are_of_the_targets_kind_as_long_as_there_are_some(
    demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch
) -> None:
    names = sorted({each.target for each in demonstrations})
    kinds = {name: "tool" if place % 2 else "toy" for place, name in enumerate(names)}
    augmentation = Augmentation([replace(each, kind=kinds[each.target]) for each in demonstrations], 1.0, 1.0)

    def first_are_alike(hard: bool) -> bool:
        for index, scene in enumerate(augmentation.scenes):
            target, *others = tried(augmentation, scene, index, hard, monkeypatch)
            alike = [each is not None and kinds[each] == kinds[str(target)] for each in others]
            if alike != sorted(alike, reverse=True) or not any(alike):
                return False
        return True

    assert first_are_alike(hard=True)
    assert not first_are_alike(hard=False), "what is drawn from all is not sorted by chance"


def test_a_sample_is_as_hard_as_asked(demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[bool] = []
    recombined = Augmentation.recombined

    def watched(self: Augmentation, scene: Scene, rng: np.random.Generator, hard: bool = False) -> Sketch:
        asked.append(hard)
        return recombined(self, scene, rng, hard)

    monkeypatch.setattr(Augmentation, "recombined", watched)
    rng = np.random.default_rng(0)
    for share, low, high in ((0.0, 0, 0), (0.5, 8, 32), (1.0, 40, 40)):
        asked.clear()
        augmentation = Augmentation(demonstrations, 1.0, share)
        for _ in range(40):
            augmentation.sample(rng)
        assert low <= sum(asked) <= high


@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_share_of_the_examples_is_recombined(
    demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    made: list[Scene] = []
    recombined = Augmentation.recombined

    def watched(self: Augmentation, scene: Scene, rng: np.random.Generator, hard: bool = False) -> Sketch:
        made.append(scene)
        return recombined(self, scene, rng, hard)

    monkeypatch.setattr(Augmentation, "recombined", watched)
    augmentation = Augmentation(demonstrations, share)
    rng = np.random.default_rng(0)
    for _ in range(300):
        augmentation.sketch(rng)
    # four standard deviations
    assert abs(len(made) / 300 - share) < 4 * math.sqrt(share * (1 - share) / 300)
    assert len({id(scene) for scene in made}) > 15, "of the 23 scenes"


def test_a_moved_scene_turns_by_any_angle_and_goes_anywhere(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 0.0)
    rng = np.random.default_rng(0)
    layouts = [augmentation.sketch(rng).layout for _ in range(300)]
    motions = [layout.motion for layout in layouts if isinstance(layout, Moved)]
    assert len(motions) == 300
    quarters = np.bincount([int(motion.angle % (2 * math.pi) // (math.pi / 2)) for motion in motions], minlength=4)
    assert quarters.min() > 0.15 * 300
    for shifts, side in (
        ([motion.x for motion in motions], WORKSPACE.length),
        ([motion.y for motion in motions], WORKSPACE.depth),
    ):
        assert min(shifts) < -0.15 * side
        assert max(shifts) > 0.15 * side


def test_seed_step_and_place_each_draw_another_example(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 0.5)

    def drawn() -> list[Grasp]:
        draws = [Draw(augmentation, seed, range(2), painted) for seed in (0, 1)]
        return [example.grasp for draw in draws for step in (1, 2) for example in draw(step)]

    first = drawn()
    assert len({(grasp.u, grasp.v, grasp.theta) for grasp in first}) == 8
    assert drawn() == first


def test_the_generator_decides_everything(demonstrations: list[Demonstration]) -> None:
    augmentation = Augmentation(demonstrations, 0.5)
    for seed in range(4):
        first, second = (augmentation.sample(np.random.default_rng(seed)) for _ in range(2))
        assert first.observation.same(second.observation)
        assert (first.grasp, first.instruction) == (second.grasp, second.instruction)


def test_bad_shares_and_empty_tables_are_refused(demonstrations: list[Demonstration]) -> None:
    with pytest.raises(InputError, match=r"recombination is 1\.5"):
        Augmentation(demonstrations, 1.5)
    with pytest.raises(InputError, match=r"hard-negatives is -0\.5"):
        Augmentation(demonstrations, 0.5, -0.5)
    with pytest.raises(InputError, match=r"hard-negatives is 0\.5, but --recombination is 0"):
        Augmentation(demonstrations, 0.0, 0.5)
    with pytest.raises(InputError, match=r"hard-negatives is 0\.5, but --recombination is 0"):
        Training(steps=9, seed=0, recombination=0.0, hard_negatives=0.5)
    with pytest.raises(InputError, match=r"crowded is 2\.0"):
        Augmentation(demonstrations, 0.5, 0.0, 2.0)
    with pytest.raises(InputError, match=r"crowded is 0\.5, but --recombination is 0"):
        Training(steps=9, seed=0, recombination=0.0, crowded=0.5)
    with pytest.raises(InputError, match="no demonstrations"):
        Augmentation([], 0.0)
    bare = Observation(np.zeros((160, 320, 3), np.uint8), np.zeros((160, 320), np.float32))
    with pytest.raises(InputError, match="empty table"):
        take_apart(replace(demonstrations[0], observation=bare))


def boxes(workspace: Workspace, grasp: Grasp, *places: tuple[int, int]) -> Demonstration:
    """Boxes of 12 x 20 pixels on a grid, by their first row and column."""
    height = np.zeros(workspace.shape, np.float32)
    for row, column in places:
        height[row : row + 12, column : column + 20] = 0.03
    color = np.full((*workspace.shape, 3), 120, np.uint8)
    return Demonstration(
        Observation(color, height), "pick the mug", grasp, "own", 0, "mug", None, "object", ("mug",), 0, 0, 1.0
    )


@pytest.mark.parametrize(
    ("workspace", "place", "other"),
    [
        (Workspace(2.0, 1.0, 320, 640), (300, 600), (140, 300)),
        (Workspace(0.5, 1.0, 320, 160), (300, 60), (150, 60)),
        (WORKSPACE, (40, 100), (100, 200)),
    ],
    ids=["large", "tall", "own"],
)
def test_the_target_is_under_the_grasp_on_any_grid(
    workspace: Workspace, place: tuple[int, int], other: tuple[int, int]
) -> None:
    grasp = Grasp(place[1] + 10.0, place[0] + 6.0, 0.0)
    augmentation = Augmentation([boxes(workspace, grasp, place, other)], 1.0, workspace=workspace)
    [scene] = augmentation.scenes
    left, top = scene.target.corner
    rows, columns = scene.target.mask.shape
    assert left <= grasp.u < left + columns
    assert top <= grasp.v < top + rows
    for seed in range(8):
        example = augmentation.sample(np.random.default_rng(seed))
        assert workspace.contains(example.grasp)
        assert example.observation.height[round(example.grasp.v), round(example.grasp.u)] > LOWEST


@pytest.mark.parametrize("crowded", [0.0, 1.0])
@pytest.mark.parametrize("beyond", [6, 20])
def test_a_label_stays_in_the_heightmap_with_a_grasp_beside_its_object(beyond: int, crowded: float) -> None:
    """A hand-guided robot's grasp may lie a few pixels off what it took hold of."""
    demonstration = boxes(WORKSPACE, Grasp(119.0 + beyond, 46.0, 0.0), (40, 100), (100, 200))
    augmentation = Augmentation([demonstration], 1.0, crowded=crowded)
    for seed in range(1000):
        assert WORKSPACE.contains(augmentation.sample(np.random.default_rng(seed)).grasp)


@pytest.mark.parametrize("share", [0.0, 1.0], ids=["moved", "recombined"])
@pytest.mark.parametrize(("u", "v"), [(700.0, 80.0), (319.6, 80.0), (160.0, -0.6)])
def test_a_grasp_outside_of_the_heightmap_is_refused(share: float, u: float, v: float) -> None:
    demonstration = boxes(WORKSPACE, Grasp(u, v, 0.0), (40, 100))
    with pytest.raises(InputError, match="lies outside the heightmap of 160 x 320 pixels; leave its demonstration out"):
        Augmentation([demonstration], share)


@pytest.mark.parametrize("sides", [(13, 21), (12, 20), (13, 20), (12, 21)])
def test_the_motion_of_what_is_put_down_is_where_it_lies(sides: tuple[int, int]) -> None:
    """The whole scene, moved by it, has the object on the very pixels, to rounding; half a pixel beside, it has not."""
    rng = np.random.default_rng(0)
    height = np.zeros(WORKSPACE.shape, np.float32)
    box = np.s_[60 : 60 + sides[0], 90 : 90 + sides[1]]
    height[box] = rng.uniform(0.02, 0.06, sides)
    color = np.full((*WORKSPACE.shape, 3), 120, np.uint8)
    demonstration = replace(boxes(WORKSPACE, Grasp(95.0, 64.0, 0.0)), observation=Observation(color, height))
    target = take_apart(demonstration).target
    for _ in range(10):
        canvas = Canvas(WORKSPACE)
        motion = canvas.put(target, rng)
        assert motion is not None
        put = canvas.height > 0
        assert put.any()

        def beside(motion: Motion, put: np.ndarray = put, canvas: Canvas = canvas) -> float:
            moved = warp(height, WORKSPACE.pixel_map(motion), WORKSPACE.shape, 0.0)
            return float(np.abs(moved - canvas.height)[put].max())

        assert beside(motion) < 1e-4
        half = WORKSPACE.pixel / 2
        assert min(beside(Motion(0.0, half, 0.0) @ motion), beside(Motion(0.0, 0.0, half) @ motion)) > 1e-3


def alone(demonstration: Demonstration) -> Demonstration:
    """The same with nothing but its target on the table."""
    scene = take_apart(demonstration)
    height = np.zeros(demonstration.observation.shape, np.float32)
    rows, columns = scene.target.height.shape
    left, top = scene.target.corner
    height[top : top + rows, left : left + columns] = scene.target.height
    color = np.where(height[..., None] > 0, demonstration.observation.color, scene.table)
    return replace(demonstration, observation=Observation(color, height))


def test_what_was_shown_alone_is_put_among_others(demonstrations: list[Demonstration]) -> None:
    """As one teaches by hand, a thing at a time: what to pick has to be in question."""
    shown = [alone(each) for each in demonstrations]
    assert all(len(take_apart(each).others) == 0 for each in shown)
    augmentation = Augmentation(shown, 1.0)
    counts = [
        len(take_apart(replace(shown[0], observation=example.observation, grasp=example.grasp)).others)
        for example in (augmentation.sample(np.random.default_rng(seed)) for seed in range(60))
    ]
    assert set(counts) == {0, 1, 2, 3, 4}
    assert 1.5 < np.mean(counts) < 2.5


def test_of_two_things_that_are_said_alike_one_is_put_down(
    demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two mugs that the demonstrator numbers and calls "mug" alike, asked for by whatever part."""
    first = demonstrations[0]
    twins = [replace(each, target=f"{each.target}-{place}") for place, each in enumerate(demonstrations)]
    augmentation = Augmentation(twins, 1.0)
    calls = {each.target: each.words[0] for each in twins}
    for index, scene in enumerate(augmentation.scenes):
        placed = tried(augmentation, scene, index, False, monkeypatch)
        named = [calls[name] for name in placed if name is not None]
        assert named.count(calls[scene.demonstration.target]) == 1
    other = replace(first, target="another")
    assert said_alike(first, other)
    assert said_alike(first, replace(other, part="rim", words=(first.words[0], "rim")))
    assert not said_alike(first, replace(other, words=("bowl", *first.words[1:])))
    assert not said_alike(first, replace(other, kind="logo"))
    # what names nothing is known by its sentence
    assert said_alike(replace(first, words=()), replace(other, words=()))
    assert not said_alike(replace(first, words=()), replace(other, words=(), instruction="pick up the bowl"))
