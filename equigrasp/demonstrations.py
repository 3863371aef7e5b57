"""Demonstrations on disk: collect them from an environment, load them back.

A folder holds `collection.json` (the plan: task, camera, demos, seed, heightmap), one `.npz` for each grasp
and, once all are there, `manifest.json` with their checksums. Nothing is ever unpickled. Each grasp depends
on its own seed alone, so a collection that was killed goes on where it stopped and ends with the same bytes.
"""

from __future__ import annotations

import io
import platform
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import equigrasp
from equigrasp.artefacts import (
    checksum,
    open_folder,
    read_json,
    remove_partials,
    write_atomically,
    write_json,
)
from equigrasp.environment import DemonstratedEnvironment
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.workspace import WORKSPACE

PLAN = "collection.json"
MANIFEST = "manifest.json"
TRIES = 10
"""Scenes that are tried for one grasp."""
GRASPS = 4
"""Grasps that the oracle rehearses in a scene."""
SEEDS_PER_RUN = 10**6
"""How many scenes belong to one `--seed`: scene seeds of different runs never meet."""
MEGABYTES_PER_GRASP = 0.1


@dataclass(frozen=True)
class Collection:
    """What is to be collected.

    Attributes:
        task: the task's name.
        goals: how many goals it has; a demonstration holds one grasp for each.
        demos: how many demonstrations.
        seed: which scenes, from 0 to 999; other seeds give other scenes, and none is an evaluation's scene.
        camera: the environment's camera.

    Raises:
        InputError: if demos or seed are out of range.
    """

    task: str
    goals: int
    demos: int
    seed: int
    camera: str

    def __post_init__(self) -> None:
        most = SEEDS_PER_RUN // (self.goals * TRIES)
        if not 1 <= self.demos <= most:
            raise InputError(f"--demos is {self.demos}, but it must be from 1 to {most}")
        check_seed(self.seed)

    def plan(self) -> dict[str, Any]:
        """All that determines the files, as JSON."""
        return {
            "task": self.task,
            "goals": self.goals,
            "demos": self.demos,
            "seed": self.seed,
            "camera": self.camera,
            "heightmap": list(WORKSPACE.shape),
        }

    def scene_seed(self, demo: int, goal: int, attempt: int) -> int:
        """The seed that the environment is reset with."""
        return self.seed * SEEDS_PER_RUN + (demo * self.goals + goal) * TRIES + attempt

    def grasps(self) -> Iterator[tuple[int, int]]:
        """All (demo, goal) pairs, in order."""
        return ((demo, goal) for demo in range(self.demos) for goal in range(self.goals))


def check_seed(seed: int) -> None:
    """Raise InputError unless the seed is from 0 to 999."""
    if not 0 <= seed < 1000:
        raise InputError(f"--seed is {seed}, but it must be from 0 to 999")


def file_name(demo: int, goal: int) -> str:
    """Name of the file that holds one grasp."""
    return f"demo-{demo:03d}-goal-{goal:03d}.npz"


def collect(
    collection: Collection,
    env: DemonstratedEnvironment,
    folder: Path,
    progress: Callable[[Sequence[tuple[int, int]]], Iterator[tuple[int, int]]] = iter,
) -> None:
    """Let the oracle grasp every goal `demos` times, each in a fresh scene, and keep what succeeded.

    Args:
        collection: what to collect.
        env: an environment of that task.
        folder: where the files go; one that the same collection began is gone on with.
        progress: wraps the list of grasps that are still to do, for a progress bar.

    Raises:
        InputError: if the folder belongs to something else, or the disk is full.
        RuntimeError: if the oracle fails on one goal in 10 scenes in a row.
    """
    count = collection.demos * collection.goals
    open_folder(folder, PLAN, collection.plan(), megabytes=count * MEGABYTES_PER_GRASP)
    if (folder / MANIFEST).exists():
        return
    missing = [pair for pair in collection.grasps() if not (folder / file_name(*pair)).exists()]
    for demo, goal in progress(missing):
        demonstration = demonstrate(collection, env, demo, goal)
        write_atomically(folder / file_name(demo, goal), encode(demonstration))
    remove_partials(folder)
    checksums = {file_name(*pair): checksum((folder / file_name(*pair)).read_bytes()) for pair in collection.grasps()}
    versions = {
        "equigrasp": equigrasp.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    write_json(folder / MANIFEST, {**collection.plan(), "files": checksums, "versions": versions})


def demonstrate(collection: Collection, env: DemonstratedEnvironment, demo: int, goal: int) -> Demonstration:
    """One grasp of the oracle that succeeded, in the first of its 10 scenes where it does."""
    for attempt in range(TRIES):
        seed = collection.scene_seed(demo, goal, attempt)
        _, info = env.reset(seed=seed, options={"goal": goal})
        observation, instruction = env.observation, env.instruction
        asked = info["goal"]
        grasp, quality = env.oracle(tries=GRASPS)
        _, reward, *_ = env.step(WORKSPACE.to_action(grasp))
        if reward > 0:
            return Demonstration(
                observation=observation,
                instruction=instruction,
                grasp=grasp,
                task=collection.task,
                goal=goal,
                target=asked["name"],
                part=asked["part"],
                kind=asked["kind"],
                words=tuple(asked["words"]),
                demo=demo,
                seed=seed,
                quality=quality,
            )
    raise RuntimeError(f"the oracle failed on goal {goal} of {collection.task} in {TRIES} scenes in a row")


def encode(demonstration: Demonstration) -> bytes:
    """A demonstration as the bytes of an `.npz`; the same demonstration gives the same bytes."""
    grasp = demonstration.grasp
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        color=demonstration.observation.color,
        height=demonstration.observation.height,
        instruction=np.array(demonstration.instruction),
        grasp=np.array([grasp.u, grasp.v, grasp.theta]),
        task=np.array(demonstration.task),
        target=np.array(demonstration.target),
        part=np.array(demonstration.part or ""),
        kind=np.array(demonstration.kind),
        words=np.array(demonstration.words, dtype=np.str_),
        indices=np.array([demonstration.goal, demonstration.demo, demonstration.seed], dtype=np.int64),
        quality=np.array(demonstration.quality),
    )
    return buffer.getvalue()


def decode(content: bytes) -> Demonstration:
    """The inverse of `encode`.

    Raises:
        ValueError, KeyError, OSError or zipfile.BadZipFile: if the bytes are not a demonstration's.
    """
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        goal, demo, seed = (int(value) for value in arrays["indices"])
        return Demonstration(
            observation=Observation(arrays["color"], arrays["height"]),
            instruction=str(arrays["instruction"]),
            grasp=Grasp(*arrays["grasp"]),
            task=str(arrays["task"]),
            goal=goal,
            target=str(arrays["target"]),
            part=str(arrays["part"]) or None,
            kind=str(arrays["kind"]),
            words=tuple(str(word) for word in arrays["words"]),
            demo=demo,
            seed=seed,
            quality=float(arrays["quality"]),
        )


def load(folder: Path) -> list[Demonstration]:
    """Load a whole collection, in order of demo and goal.

    Raises:
        InputError: if the folder holds none, or an unfinished, truncated or altered one, or one whose
            heightmaps have another size than the workspace's.
    """
    again = "collect it again into an empty folder"
    if not folder.is_dir():
        raise InputError(f"there is no data folder {folder}; make one with `equigrasp collect --out {folder}`")
    if not (folder / MANIFEST).exists():
        if (folder / PLAN).exists():
            raise InputError(f"the collection in {folder} is unfinished; run its `equigrasp collect` again")
        raise InputError(f"{folder} holds no demonstrations (no {MANIFEST}); make some with `equigrasp collect`")
    manifest = read_json(folder / MANIFEST, "a manifest of demonstrations")
    if tuple(manifest.get("heightmap", ())) != WORKSPACE.shape:
        raise InputError(
            f"{folder} has heightmaps of {manifest.get('heightmap')} pixels, but the workspace has "
            f"{list(WORKSPACE.shape)}; {again}"
        )
    files = manifest.get("files")
    if not isinstance(files, dict) or not files:
        raise InputError(f"{folder / MANIFEST} lists no files; {again}")
    demonstrations = []
    for name, expected in sorted(files.items()):
        if not (folder / name).exists():
            raise InputError(f"{folder} lacks {name}, which its manifest lists; {again}")
        content = (folder / name).read_bytes()
        if checksum(content) != expected:
            raise InputError(f"{folder / name} is truncated or altered (its checksum differs); {again}")
        try:
            demonstration = decode(content)
        except (ValueError, KeyError, OSError, zipfile.BadZipFile) as error:
            raise InputError(f"{folder / name} is no demonstration ({error}); {again}") from None
        if demonstration.observation.shape != WORKSPACE.shape:
            raise InputError(
                f"{folder / name} has a heightmap of {demonstration.observation.shape} pixels, "
                f"but the workspace has {WORKSPACE.shape}; {again}"
            )
        if demonstration.task != manifest.get("task"):
            raise InputError(
                f"{folder / name} is of task {demonstration.task!r}, but its folder of "
                f"{manifest.get('task')!r}; {again}"
            )
        demonstrations.append(demonstration)
    return demonstrations
