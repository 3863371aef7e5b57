"""Demonstrations as a Minari dataset, and back, bit for bit.

Each grasp is one episode of one step: what was seen, the action `(u, v, bin)`, reward 1, terminated. The seed and
options of its `reset` are in the episode's metadata, and the environment in the dataset's, so that
`dataset.recover_environment()` can lay out any scene again. What the records hold beyond that is in the step's
infos: the exact `grasp` (u and v in pixels, theta in radians), `quality`, `target`, `part` (empty for none), `demo`.

Two things differ from the environment. Color is int16, since Minari stores uint8 images as JPEG, which loses bits.
And Minari wants an observation after the last step, which a demonstration does not hold: it is all zeros.
"""

from __future__ import annotations

import importlib.util
import shutil
from collections.abc import Mapping, Sequence
from copy import deepcopy
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.workspace import WORKSPACE
from tasks import TASKS, find_task
from tasks.instructions import CHARSET, LONGEST
from tasks.task import Task

PLAN = "equigrasp_collection"
"""Where a dataset's metadata keep the plan of the collection."""


def check_installed() -> None:
    """Raise InputError unless Minari and pyarrow are installed."""
    for name in ("minari", "pyarrow"):
        if importlib.util.find_spec(name) is None:
            raise InputError(
                f"this needs {name}, which is not installed; `pip install -e '.[minari]'` in equigrasp's folder adds it"
            )


def task_of(plan: Mapping[str, Any]) -> Task:
    """The task of a collection, which a dataset of it names.

    Raises:
        InputError: if it is none of the simulator's.
    """
    if plan["task"] not in TASKS and ":" not in plan["task"]:
        raise InputError(
            f"these demonstrations are of {plan['task']!r}, which is no task of the simulator, and a Minari dataset "
            "has to name its environment; the data folder is all that `equigrasp train` needs"
        )
    return find_task(plan["task"])


def export_dataset(name: str, plan: Mapping[str, Any], demonstrations: Sequence[Demonstration]) -> Path:
    """Write a dataset into Minari's folder (`MINARI_DATASETS_PATH`, or else `~/.minari/datasets`).

    It is written under a hidden name and renamed: Minari sees the whole dataset or none.

    Args:
        name: `[NAMESPACE/]NAME-vVERSION`.
        plan: of the collection, kept in the metadata; `task` and `camera` say which environment it was.
        demonstrations: all of it, in order.

    Returns:
        The dataset's folder.

    Raises:
        InputError: if the name is no dataset's, or taken, or Minari is not installed; or the task is none of the
            simulator's, or names its environment as Gymnasium cannot.
    """
    check_installed()
    from minari import __version__ as minari_version
    from minari.dataset.minari_storage import MinariStorage
    from minari.namespace import create_namespace, list_local_namespaces

    spec = _spec(plan)
    folder = _folder(name)
    if folder.exists():
        raise InputError(f"there is a Minari dataset {name} in {folder} already; choose another --name")
    namespace, _, last = name.rpartition("/")
    if namespace and namespace not in list_local_namespaces():
        create_namespace(namespace)
    partial = folder.with_name(f".partial-{last}")
    if partial.exists():
        shutil.rmtree(partial)
    partial.mkdir(parents=True)
    storage = MinariStorage.new(
        partial / "data",
        observation_space=_observation_space(),
        action_space=spaces.MultiDiscrete([WORKSPACE.columns, WORKSPACE.rows, WORKSPACE.bins]),
        env_spec=spec,
        data_format="parquet",
    )
    storage.update_metadata(
        {
            "dataset_id": name,
            "minari_version": minari_version,
            "algorithm_name": "the scripted oracle of equigrasp",
            "description": f"Language-conditioned grasps of {plan['task']}, one an episode; made by equigrasp.",
            "requirements": [f"equigrasp=={version('equigrasp')}"],
            PLAN: dict(plan),
        }
    )
    storage.update_episodes(_episode(each) for each in demonstrations)
    partial.rename(folder)
    return folder


def import_dataset(name: str) -> tuple[dict[str, Any], list[Demonstration]]:
    """Read what `export_dataset` wrote.

    Returns:
        The plan of the collection and its demonstrations, in order.

    Raises:
        InputError: if there is no such dataset, or it is damaged or none of ours, or Minari is not installed.
    """
    check_installed()
    from minari import MinariDataset

    folder = _folder(name)
    if not (folder / "data").is_dir():
        raise InputError(f"there is no Minari dataset {name} in {folder}; `minari list local` lists those there are")
    try:
        dataset = MinariDataset(folder / "data")
        metadata = dataset.storage.metadata
        if PLAN not in metadata:
            raise InputError(f"{name} holds no demonstrations of equigrasp, as it was not exported by it")
        plan = metadata[PLAN]
        about = dataset.storage.get_episode_metadata(dataset.episode_indices)
        demonstrations = [
            _demonstration(plan["task"], episode, each) for episode, each in zip(dataset, about, strict=True)
        ]
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, IndexError, AssertionError) as error:
        reason = str(error).splitlines()[0] if str(error) else ""
        raise InputError(f"the Minari dataset {name} is damaged ({type(error).__name__}: {reason})") from None
    return plan, demonstrations


def _folder(name: str) -> Path:
    from minari.dataset.minari_dataset import parse_dataset_id
    from minari.storage.datasets_root_dir import get_dataset_path

    try:
        parse_dataset_id(name)
    except (ValueError, TypeError):
        raise InputError(f"--name is {name!r}, but a Minari dataset is named like equigrasp/pick-by-part-v0") from None
    return get_dataset_path(name)


def _spec(plan: Mapping[str, Any]) -> EnvSpec:
    """What `recover_environment` makes: the environment as it is registered, and a row's own where it is not."""
    env_id = task_of(plan).env_id
    try:
        registered = gymnasium.registry.get(env_id) or EnvSpec(env_id, "tasks.env:GraspEnv", kwargs={"task": ""})
    except gymnasium.error.Error:
        raise InputError(
            f"{plan['task']} has the env_id {env_id!r}, but Gymnasium has ids like mine/PickMine-v0; rename it"
        ) from None
    spec = deepcopy(registered)
    spec.kwargs["camera"] = plan["camera"]
    if "task" in spec.kwargs:
        # a row is no JSON, and what is recovered from it would be no task
        spec.kwargs["task"] = plan["task"]
    return spec


def _observation_space() -> spaces.Dict:
    rows, columns = WORKSPACE.shape
    return spaces.Dict(
        {
            "color": spaces.Box(0, 255, (rows, columns, 3), np.int16),
            "height": spaces.Box(0.0, 1.0, (rows, columns), np.float32),
            "instruction": spaces.Text(LONGEST, charset=CHARSET),
        }
    )


def _episode(demonstration: Demonstration) -> Any:
    from minari.data_collector import EpisodeBuffer

    seen, grasp = demonstration.observation, demonstration.grasp

    def twice(value: Any) -> list[Any]:
        """One for the reset and one for the step, as Minari has it."""
        return [value, value]

    return EpisodeBuffer(
        seed=demonstration.seed,
        options={"goal": demonstration.goal},
        observations={
            "color": np.stack([seen.color, np.zeros_like(seen.color)]).astype(np.int16),
            "height": np.stack([seen.height, np.zeros_like(seen.height)]),
            "instruction": twice(demonstration.instruction),
        },
        actions=[WORKSPACE.to_action(grasp)],
        rewards=[1.0],
        terminations=[True],
        truncations=[False],
        infos={
            "grasp": np.array(twice([grasp.u, grasp.v, grasp.theta])),
            "quality": twice(demonstration.quality),
            "target": twice(demonstration.target),
            "part": twice(demonstration.part or ""),
            "kind": twice(demonstration.kind),
            "words": twice("\n".join(demonstration.words)),
            "demo": twice(demonstration.demo),
        },
    )


def _demonstration(task: str, episode: Any, metadata: Mapping[str, Any]) -> Demonstration:
    seen, infos = episode.observations, episode.infos
    return Demonstration(
        observation=Observation(seen["color"][0].astype(np.uint8), seen["height"][0]),
        instruction=str(seen["instruction"][0]),
        grasp=Grasp(*infos["grasp"][0]),
        task=task,
        goal=int(metadata["options"]["goal"]),
        target=str(infos["target"][0]),
        part=str(infos["part"][0]) or None,
        kind=str(infos["kind"][0]),
        words=tuple(str(infos["words"][0]).splitlines()),
        demo=int(infos["demo"][0]),
        seed=int(metadata["seed"]),
        quality=float(infos["quality"][0]),
    )
