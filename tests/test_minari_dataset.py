"""A collection that goes to Minari and comes back is the same collection, and Minari itself can read it."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import gymnasium
import minari
import numpy as np
import pytest
from folders import contents

from equigrasp.cli import main
from equigrasp.collection import Collection
from equigrasp.demonstrations import collect, encode, store
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.workspace import WORKSPACE
from tasks.env import GraspEnv
from tasks.minari_dataset import export_dataset, import_dataset

NAME = "equigrasp/by-part-v0"


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Minari's folder."""
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))
    return tmp_path / "minari"


@pytest.fixture
def exported(root: Path, plan: Collection, demonstrations: list[Demonstration]) -> Path:
    return export_dataset(NAME, plan.plan(), demonstrations)


def test_the_commands_make_the_same_folder(root: Path, tmp_path: Path, data: Path) -> None:
    main(["export-minari", "--data", str(data), "--name", NAME])
    main(["import-minari", "--name", NAME, "--out", str(tmp_path / "back")])
    assert contents(tmp_path / "back") == contents(data)


def test_every_bit_comes_back(root: Path, plan: Collection, demonstrations: list[Demonstration]) -> None:
    """Noise is what a lossy picture format would not keep; parts may be none, names hold no other letters."""
    rng = np.random.default_rng(0)
    noise = [
        replace(
            each,
            observation=replace(
                each.observation,
                color=rng.integers(0, 256, (*WORKSPACE.shape, 3), dtype=np.uint8),
                height=rng.random(WORKSPACE.shape, dtype=np.float32),
            ),
            grasp=replace(each.grasp, u=rng.random() * 300, v=rng.random() * 150, theta=rng.random() * 3),
            quality=float(rng.random()),
            part=None,
        )
        for each in demonstrations[:3]
    ]
    export_dataset(NAME, plan.plan(), noise)
    same, back = import_dataset(NAME)
    assert same == json.loads(json.dumps(plan.plan()))
    assert [encode(each) for each in back] == [encode(each) for each in noise]


def test_minari_reads_it_as_its_own(exported: Path, demonstrations: list[Demonstration]) -> None:
    dataset = minari.load_dataset(NAME)
    assert list(minari.list_local_datasets()) == [NAME]
    assert (dataset.total_episodes, dataset.total_steps) == (23, 23)
    for episode, each in zip(dataset, demonstrations, strict=True):
        assert np.array_equal(episode.observations["color"][0], each.observation.color)
        assert np.array_equal(episode.observations["height"][0], each.observation.height)
        assert episode.observations["instruction"][0] == each.instruction
        assert np.array_equal(episode.actions, [WORKSPACE.to_action(each.grasp)])
        assert dataset.action_space.contains(episode.actions[0])
        for step in range(2):
            seen = {key: values[step] for key, values in episode.observations.items()}
            assert dataset.observation_space.contains(seen)
        assert episode.rewards.tolist() == [1.0]
        assert episode.terminations.tolist() == [True]
        assert not episode.truncations.any()


def test_an_episode_can_be_played_again(exported: Path) -> None:
    """By its reset and its action alone, in the environment that the dataset names."""
    dataset = minari.load_dataset(NAME)
    env = dataset.recover_environment()
    episode = dataset[9]
    (about,) = dataset.storage.get_episode_metadata([9])
    seen, _ = env.reset(seed=about["seed"], options=about["options"])
    assert np.array_equal(seen["color"], episode.observations["color"][0])
    assert seen["instruction"] == episode.observations["instruction"][0]
    _, reward, *_ = env.step(episode.actions[0])
    assert float(reward) > 0
    env.close()


def test_an_interrupted_export_leaves_no_dataset(
    root: Path, plan: Collection, demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch
) -> None:
    def die(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(type(WORKSPACE), "to_action", die)
        with pytest.raises(KeyboardInterrupt):
            export_dataset(NAME, plan.plan(), demonstrations)
    assert not minari.list_local_datasets()
    export_dataset(NAME, plan.plan(), demonstrations)
    assert list(minari.list_local_datasets()) == [NAME]
    assert [path.name for path in root.rglob(".partial*")] == []


def spoil_episode(dataset: Path) -> None:
    (part,) = (dataset / "data" / "4").glob("*.parquet")
    part.write_bytes(part.read_bytes()[:-100])


def spoil_metadata(**changes: object) -> Callable[[Path], None]:
    def spoil(dataset: Path) -> None:
        path = dataset / "data" / "metadata.json"
        metadata = {**json.loads(path.read_text()), **changes}
        path.write_text(json.dumps({key: value for key, value in metadata.items() if value is not None}))

    return spoil


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (shutil.rmtree, "there is no Minari dataset"),
        (spoil_episode, "is damaged"),
        (lambda dataset: shutil.rmtree(dataset / "data" / "4"), "is damaged"),
        (lambda dataset: (dataset / "data" / "metadata.json").write_text("{"), "is damaged"),
        (spoil_metadata(minari_version="9.0"), "is damaged"),
        (spoil_metadata(equigrasp_collection=None), "not exported by it"),
        (spoil_metadata(equigrasp_collection=7), "is damaged"),
        (spoil_metadata(equigrasp_collection={"task": "pick-by-part"}), "no plan"),
    ],
)
def test_what_is_no_dataset_is_refused(
    tmp_path: Path, exported: Path, spoil, sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(exported)
    with pytest.raises(SystemExit) as stopped:
        main(["import-minari", "--name", NAME, "--out", str(tmp_path / "back")])
    assert stopped.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert sentence in line
    assert not (tmp_path / "back").exists()


@pytest.mark.parametrize("name", ["by-part", "", "by part-v0", "../by-part-v0"])
def test_names_that_minari_cannot_read_are_refused(root: Path, plan: Collection, name: str) -> None:
    with pytest.raises(InputError, match="is named like"):
        export_dataset(name, plan.plan(), [])
    with pytest.raises(InputError, match="is named like"):
        import_dataset(name)


def test_a_dataset_is_never_replaced(exported: Path, plan: Collection) -> None:
    before = contents(exported)
    with pytest.raises(InputError, match="already"):
        export_dataset(NAME, plan.plan(), [])
    assert contents(exported) == before


def test_without_minari_the_way_out_is_named(monkeypatch: pytest.MonkeyPatch, data: Path) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[minari\]'"):
        import_dataset(NAME)


def test_a_collection_of_two_uneven_demonstrations_comes_back(root: Path, tmp_path: Path, env: GraspEnv) -> None:
    collect(Collection("pick-by-part", ((8, 8), (1,)), 5, "overhead"), lambda: env, tmp_path / "data")
    main(["export-minari", "--data", str(tmp_path / "data")])
    main(["import-minari", "--name", "equigrasp/pick-by-part-2demos-seed5-v0", "--out", str(tmp_path / "back")])
    assert contents(tmp_path / "back") == contents(tmp_path / "data")


ROW = """
import gymnasium

from tasks import Goal, Task

MINE = Task("pick-mine", "rows_for_minari/Mine-v0", (Goal("fork"), Goal("mug")), objects=(2, 2))
"""
REGISTERED = 'gymnasium.register(id=MINE.env_id, entry_point="tasks.env:GraspEnv", kwargs={"task": MINE})\n'


@pytest.mark.parametrize("registered", ["", REGISTERED], ids=["not registered", "registered"])
def test_a_row_of_ones_own_goes_there_and_comes_back(
    registered: str, root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a name that Minari can read, and with an environment of that row, whether Gymnasium knows it or not."""
    (tmp_path / "rows_for_minari.py").write_text(ROW + registered)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "rows_for_minari", raising=False)
    try:
        data = tmp_path / "data"
        main(["collect", "--task", "rows_for_minari:MINE", "--camera", "overhead", "--out", str(data)])
        main(["export-minari", "--data", str(data)])
        main(["import-minari", "--name", "equigrasp/pick-mine-1demos-seed0-v0", "--out", str(tmp_path / "back")])
        assert contents(tmp_path / "back") == contents(data)
        dataset = minari.load_dataset("equigrasp/pick-mine-1demos-seed0-v0")
        env = dataset.recover_environment()
        try:
            for index, episode in enumerate(dataset):
                (about,) = dataset.storage.get_episode_metadata([index])
                seen, _ = env.reset(seed=about["seed"], options=about["options"])
                assert np.array_equal(seen["color"], episode.observations["color"][0])
                assert float(env.step(episode.actions[0])[1]) > 0
        finally:
            env.close()
    finally:
        gymnasium.registry.pop("rows_for_minari/Mine-v0", None)


def test_an_environment_that_gymnasium_cannot_name_is_one_sentence(
    root: Path, tmp_path: Path, plan: Collection, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "badly_named.py").write_text(ROW.replace("rows_for_minari/Mine-v0", "Pick Mine"))
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match="has the env_id 'Pick Mine', but Gymnasium has ids like mine/PickMine-v0"):
        export_dataset(NAME, {**plan.plan(), "task": "badly_named:MINE"}, [])
    assert not minari.list_local_datasets()


def test_demonstrations_of_a_table_of_ones_own_have_no_environment_to_name(
    root: Path, tmp_path: Path, demonstrations: list[Demonstration], capsys: pytest.CaptureFixture[str]
) -> None:
    shown = [replace(each, task="my-table", goal=0) for each in demonstrations[:1]]
    store(Collection("my-table", ((0,),), 0, "my-camera"), shown, tmp_path / "data")
    with pytest.raises(SystemExit, match="2"):
        main(["export-minari", "--data", str(tmp_path / "data")])
    assert "are of 'my-table', which is no task of the simulator" in capsys.readouterr().err
    assert not root.exists()
