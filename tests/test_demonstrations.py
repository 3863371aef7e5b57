"""What is stored is what was demonstrated; what is not a collection is refused in one sentence."""

from __future__ import annotations

import json
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from equigrasp.artefacts import checksum
from equigrasp.demonstrations import MANIFEST, PLAN, Collection, collect, decode, demonstrate, encode, load
from equigrasp.errors import InputError
from equigrasp.evaluation import scene_seed
from equigrasp.grasp import Demonstration, Observation
from equigrasp.workspace import WORKSPACE
from tasks.env import GraspEnv


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_demonstration_survives_the_disk(demonstrations: list[Demonstration]) -> None:
    for before in demonstrations[:3]:
        after = decode(encode(before))
        assert after.observation.same(before.observation)
        for field in fields(Demonstration):
            if field.name != "observation":
                assert getattr(after, field.name) == getattr(before, field.name)
        assert encode(after) == encode(before)


def test_every_goal_is_demonstrated_once(demonstrations: list[Demonstration]) -> None:
    assert [each.goal for each in demonstrations] == list(range(23))


def test_a_demonstration_can_be_repeated(demonstrations: list[Demonstration], env: GraspEnv) -> None:
    """The scene's seed and the grasp are enough: the same grasp in the same scene earns its reward again."""
    for each in demonstrations[5:8]:
        env.reset(seed=each.seed, options={"goal": each.goal})
        assert env.observation.same(each.observation)
        assert env.instruction == each.instruction
        _, reward, *_ = env.step(WORKSPACE.to_action(each.grasp))
        assert reward > 0


def test_order_does_not_matter(demonstrations: list[Demonstration], env: GraspEnv, plan: Collection) -> None:
    for goal in (17, 4):
        assert encode(demonstrate(plan, env, 0, goal)) == encode(demonstrations[goal])


def test_an_interrupted_collection_goes_on_to_the_same_bytes(
    tmp_path: Path, data: Path, env: GraspEnv, plan: Collection
) -> None:
    begun = tmp_path / "begun"
    begun.mkdir()
    for name in (PLAN, "demo-000-goal-003.npz", "demo-000-goal-011.npz"):
        shutil.copy(data / name, begun / name)
    (begun / ".partial-demo-000-goal-004.npz").write_bytes(b"half")
    collect(plan, env, begun)
    assert contents(begun) == contents(data)


def test_training_scenes_and_test_scenes_never_meet(plan: Collection) -> None:
    last = replace(plan, seed=999, demos=1000).scene_seed(999, 22, 9)
    assert last < scene_seed(0, 0)


def test_seeds_of_two_grasps_differ(plan: Collection) -> None:
    several = replace(plan, demos=10)
    seeds = [several.scene_seed(*pair, attempt) for pair in several.grasps() for attempt in range(10)]
    assert len(set(seeds)) == len(seeds)


@pytest.mark.parametrize(("field", "value"), [("demos", 0), ("demos", 10**6), ("seed", -1), ("seed", 1000)])
def test_counts_out_of_range_are_refused(plan: Collection, field: str, value: int) -> None:
    with pytest.raises(InputError, match=f"--{field} is {value}"):
        replace(plan, **{field: value})


def alter_manifest(folder: Path, **changes: object) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps({**manifest, **changes}))


def truncate(folder: Path) -> None:
    path = folder / "demo-000-goal-007.npz"
    path.write_bytes(path.read_bytes()[:1000])


def shrink(folder: Path) -> None:
    """A well-formed file with a heightmap of another size, and its checksum in the manifest."""
    path = folder / "demo-000-goal-000.npz"
    small = replace(
        decode(path.read_bytes()),
        observation=Observation(np.zeros((80, 160, 3), np.uint8), np.zeros((80, 160), np.float32)),
    )
    path.write_bytes(encode(small))
    files = json.loads((folder / MANIFEST).read_text())["files"]
    alter_manifest(folder, files={**files, path.name: checksum(path.read_bytes())})


def no_array(folder: Path) -> None:
    path = folder / "demo-000-goal-000.npz"
    path.write_bytes(b"no zip")
    files = json.loads((folder / MANIFEST).read_text())["files"]
    alter_manifest(folder, files={**files, path.name: checksum(path.read_bytes())})


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (lambda folder: shutil.rmtree(folder), "there is no data folder"),
        (lambda folder: [path.unlink() for path in folder.iterdir()], "holds no demonstrations"),
        (lambda folder: (folder / MANIFEST).unlink(), "unfinished"),
        (lambda folder: (folder / MANIFEST).write_text("{"), "damaged"),
        (lambda folder: alter_manifest(folder, files={}), "lists no files"),
        (lambda folder: alter_manifest(folder, heightmap=[80, 160]), "pixels"),
        (lambda folder: alter_manifest(folder, task="pick-fruit"), "pick-fruit"),
        (lambda folder: (folder / "demo-000-goal-007.npz").unlink(), "lacks demo-000-goal-007"),
        (truncate, "truncated or altered"),
        (shrink, "pixels"),
        (no_array, "is no demonstration"),
    ],
)
def test_what_is_not_a_collection_is_refused(tmp_path: Path, data: Path, spoil, sentence: str) -> None:
    folder = tmp_path / "data"
    shutil.copytree(data, folder)
    spoil(folder)
    with pytest.raises(InputError, match=sentence) as error:
        load(folder)
    assert "\n" not in str(error.value)


def test_another_collection_is_not_mixed_in(tmp_path: Path, data: Path, env: GraspEnv, plan: Collection) -> None:
    folder = tmp_path / "data"
    shutil.copytree(data, folder)
    with pytest.raises(InputError, match="demos 1, not 2"):
        collect(replace(plan, demos=2), env, folder)
    assert contents(folder) == contents(data)
