"""What is stored is what was demonstrated; what is not a collection is refused in one sentence."""

from __future__ import annotations

import importlib
import json
import shutil
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from folders import contents
from hypothesis import given
from hypothesis import strategies as st

from equigrasp.artefacts import LOCK, alone, checksum
from equigrasp.cli.suite import Collect
from equigrasp.collection import TRIES, Collection, draw_goals
from equigrasp.demonstrations import (
    MANIFEST,
    PLAN,
    collect,
    decode,
    demonstrate,
    encode,
    load,
    read_collection,
    store,
)
from equigrasp.errors import InputError
from equigrasp.evaluation import scene_seed
from equigrasp.grasp import Demonstration, Observation
from equigrasp.workspace import WORKSPACE
from tasks import TASKS
from tasks.env import GraspEnv
from tasks.goal import Goal
from tasks.task import Task


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


def test_a_part_that_nobody_can_take_is_named() -> None:
    goals = (Goal("avocado", "pit"), Goal("fork"))
    with GraspEnv(Task("pick-pit", "mine/Pit-v0", goals, objects=(1, 1)), camera="overhead") as env:
        collection = Collection("pick-pit", ((0,), (1,)), seed=0, camera="overhead")
        sentence = r"the oracle picked the 'avocado' by its 'pit' \(goal 0 of pick-pit\) in none of 10 scenes, so that"
        with pytest.raises(InputError, match=sentence) as error:
            demonstrate(collection, env, 0, 0)
        assert "\n" not in str(error.value)
        assert demonstrate(collection, env, 1, 0).target == "fork"


def test_an_interrupted_collection_goes_on_to_the_same_bytes(
    tmp_path: Path, data: Path, env: GraspEnv, plan: Collection
) -> None:
    begun = tmp_path / "begun"
    begun.mkdir()
    for name in (PLAN, "demo-000-grasp-003.npz", "demo-000-grasp-011.npz"):
        shutil.copy(data / name, begun / name)
    (begun / ".partial-demo-000-grasp-004.npz").write_bytes(b"half")
    collect(plan, lambda: env, begun)
    assert contents(begun) == contents(data)


def test_training_scenes_and_test_scenes_never_meet(plan: Collection) -> None:
    longest = replace(plan, seed=999, goals=1000 * ((0,) * 100,))
    assert longest.scene_seed(999, 99, 9) < scene_seed(0, 0)
    with pytest.raises(InputError, match="scenes for 100000"):
        replace(longest, goals=(*longest.goals, (0,)))


def every_seed(collection: Collection) -> list[int]:
    return [collection.scene_seed(*place, attempt) for place in collection.grasps() for attempt in range(TRIES)]


uneven = st.lists(st.lists(st.integers(0, 30), min_size=1, max_size=12), min_size=1, max_size=6)


@given(uneven, st.integers(0, 998))
def test_no_two_tries_share_a_scene(goals: list[list[int]], seed: int) -> None:
    collection = Collection("any", tuple(map(tuple, goals)), seed, "overhead")
    own, next_ones = every_seed(collection), every_seed(replace(collection, seed=seed + 1))
    assert len({*own, *next_ones}) == 2 * len(own)


@given(uneven, st.integers(1, 6))
def test_a_demonstration_does_not_depend_on_later_ones(goals: list[list[int]], demos: int) -> None:
    more = Collection("any", tuple(map(tuple, goals)), 3, "overhead")
    fewer = replace(more, goals=more.goals[:demos])
    assert every_seed(fewer) == every_seed(more)[: len(every_seed(fewer))]


def test_the_goals_of_a_demonstration_do_not_depend_on_later_ones() -> None:
    def any_five(rng: np.random.Generator) -> tuple[int, ...]:
        return tuple(rng.integers(0, 30, 5).tolist())

    three, five = draw_goals(any_five, 3, seed=7), draw_goals(any_five, 5, seed=7)
    assert five[:3] == three
    assert len(set(five)) == 5
    assert draw_goals(any_five, 3, seed=8) != three


def test_a_goal_may_come_twice(tmp_path: Path, env: GraspEnv, plan: Collection) -> None:
    twice = replace(plan, goals=((4, 4), (7,)))
    collect(twice, lambda: env, tmp_path / "data")
    first, second, third = load(tmp_path / "data")
    assert [(each.demo, each.goal) for each in (first, second, third)] == [(0, 4), (0, 4), (1, 7)]
    assert not first.observation.same(second.observation)


def test_the_scenes_of_pick_by_part_are_what_they_were() -> None:
    """Published results are of these scenes."""
    task = TASKS["pick-by-part"]
    collection = Collection(task.name, draw_goals(task.demonstration_goals, 10, seed=2), 2, "fused")
    assert collection.goals == 10 * (tuple(range(23)),)
    assert collection.scene_seed(4, 6, 1) == 2 * 10**6 + (4 * 23 + 6) * 10 + 1


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"goals": ()}, "--demos is 0"),
        ({"goals": ((0,), (), (1,))}, "demonstration 1 of pick-by-part has no goal"),
        ({"seed": -1}, "--seed is -1"),
        ({"seed": 1000}, "--seed is 1000"),
    ],
)
def test_plans_out_of_range_are_refused(plan: Collection, change: dict, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        replace(plan, **change)


def test_too_many_demonstrations_are_refused_before_their_goals_are_drawn() -> None:
    with pytest.raises(InputError, match="--demos is 1000000"):
        draw_goals(lambda rng: pytest.fail("drawn"), 10**6, seed=0)


@given(uneven, st.integers(0, 999), st.none() | st.text("0123456789abcdef", min_size=1))
def test_a_plan_survives_json(goals: list[list[int]], seed: int, row: str | None) -> None:
    collection = Collection("any", tuple(map(tuple, goals)), seed, "overhead", row)
    assert Collection.of_plan(json.loads(json.dumps(collection.plan()))) == collection


@pytest.mark.parametrize(
    "change",
    [
        {"goals": 23},
        {"goals": [[0.5]]},
        {"goals": [["x"]]},
        {"demos": 2},
        {"heightmap": [80, 160]},
        {"seed": -1},
        {"row of pick-by-part": 7},
    ],
    ids=str,
)
def test_what_is_no_plan_is_refused(plan: Collection, change: dict) -> None:
    with pytest.raises(InputError):
        Collection.of_plan({**plan.plan(), **change})
    with pytest.raises(InputError):
        Collection.of_plan([])


def test_demonstrations_at_hand_are_stored_as_collected(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration], plan: Collection
) -> None:
    store(plan, demonstrations, tmp_path / "data")
    assert contents(tmp_path / "data") == contents(data)
    for others in (demonstrations[1:], demonstrations[::-1]):
        with pytest.raises(InputError, match="not those of the plan"):
            store(plan, others, tmp_path / "others")
    assert not (tmp_path / "others").exists()


def test_other_demonstrations_are_not_taken_for_those_that_a_folder_has(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration], plan: Collection
) -> None:
    """Of a plan that both are of: who corrects a grasp and stores it again is not left with the old one."""
    corrected = [*demonstrations]
    corrected[3] = replace(corrected[3], grasp=replace(corrected[3].grasp, u=corrected[3].grasp.u + 1))
    begun, whole = tmp_path / "begun", tmp_path / "whole"
    shutil.copytree(data, whole)
    begun.mkdir()
    for name in (PLAN, "demo-000-grasp-003.npz"):
        shutil.copy(data / name, begun / name)
    for folder in (begun, whole):
        before = {LOCK: b"", **contents(folder)}
        with pytest.raises(InputError, match=r"holds another demonstration as demo-000-grasp-003.npz"):
            store(plan, corrected, folder)
        assert contents(folder) == before
        store(plan, demonstrations, folder)
        assert load(folder)[3].grasp == demonstrations[3].grasp


def alter_manifest(folder: Path, **changes: object) -> None:
    manifest = json.loads((folder / MANIFEST).read_text())
    (folder / MANIFEST).write_text(json.dumps({**manifest, **changes}))


def truncate(folder: Path) -> None:
    path = folder / "demo-000-grasp-007.npz"
    path.write_bytes(path.read_bytes()[:1000])


def shrink(folder: Path) -> None:
    """A well-formed file with a heightmap of another size, and its checksum in the manifest."""
    path = folder / "demo-000-grasp-000.npz"
    small = replace(
        decode(path.read_bytes()),
        observation=Observation(np.zeros((80, 160, 3), np.uint8), np.zeros((80, 160), np.float32)),
    )
    path.write_bytes(encode(small))
    files = json.loads((folder / MANIFEST).read_text())["files"]
    alter_manifest(folder, files={**files, path.name: checksum(path.read_bytes())})


def no_array(folder: Path) -> None:
    path = folder / "demo-000-grasp-000.npz"
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
        (lambda folder: (folder / "demo-000-grasp-007.npz").unlink(), "lacks demo-000-grasp-007"),
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


def test_two_collections_in_a_folder_are_refused(tmp_path: Path, data: Path, env: GraspEnv, plan: Collection) -> None:
    folder = tmp_path / "data"
    shutil.copytree(data, folder)
    (folder / MANIFEST).unlink()
    before = contents(folder)
    with alone(folder, "collection"), pytest.raises(InputError, match="another collection is at work in"):
        collect(plan, lambda: env, folder)
    assert contents(folder) == before


def test_another_collection_is_not_mixed_in(tmp_path: Path, data: Path, env: GraspEnv, plan: Collection) -> None:
    folder = tmp_path / "data"
    shutil.copytree(data, folder)
    with pytest.raises(InputError, match="demos 1, not 2"):
        collect(replace(plan, goals=2 * plan.goals), lambda: env, folder)
    assert contents(folder) == contents(data)


def test_a_row_of_ones_own_that_was_edited_is_not_mixed_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stopped collection goes on with the row that it was begun with, and with no other."""
    (tmp_path / "rows_to_collect.py").write_text(
        "from tasks import Goal, Task\n"
        "MINE = Task('pick-mine', 'mine/Mine-v0', (Goal('fork'), Goal('mug'), Goal('knife')), objects=(2, 2))\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    folder = tmp_path / "data"
    collecting = Collect(task="rows_to_collect:MINE", camera="overhead", out=folder)
    collecting.execute()
    finished = contents(folder)
    for stopped in (MANIFEST, "demo-000-grasp-001.npz"):
        (folder / stopped).unlink()
    module = importlib.import_module("rows_to_collect")
    edited = replace(module.MINE, goals=tuple(Goal(name) for name in ("apple", "banana", "lemon")), objects=(3, 3))
    with monkeypatch.context() as patched:
        patched.setattr(module, "MINE", edited)
        before = contents(folder)
        with pytest.raises(InputError, match="was begun with row of rows_to_collect:MINE"):
            collecting.execute()
        assert contents(folder) == before
    collecting.execute()
    assert contents(folder) == finished
    assert read_collection(folder).row == module.MINE.fingerprint()


def test_the_plan_of_a_task_of_the_suite_has_no_row(plan: Collection, data: Path) -> None:
    """Its files keep their bytes, whoever edits a row of their own."""
    assert plan.plan().keys() == {"task", "demos", "seed", "camera", "heightmap", "goals"}
    assert json.loads((data / PLAN).read_bytes()) == json.loads(json.dumps(plan.plan()))
