"""Demonstrations on disk: collect them from an environment, load them back.

A folder holds `collection.json` (the plan: task, camera, demos, seed, heightmap, goals, and the row of a task of
one's own), one `.npz` for each grasp and, once all are there, `manifest.json` with their checksums. Nothing is ever
unpickled from a file. Each grasp depends on its own seed alone, so a collection that was killed goes on where it
stopped and ends with the same bytes, whoever does the work (`equigrasp.engines`) and in what order.
"""

from __future__ import annotations

import platform
import re
import shlex
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

import equigrasp
from equigrasp.artefacts import (
    alone,
    checksum,
    open_folder,
    read_json,
    remove_partials,
    write_atomically,
    write_json,
)
from equigrasp.collection import TRIES, Collection, Place, file_name
from equigrasp.demonstration_file import check, decode, encode
from equigrasp.engines import Engine, Local
from equigrasp.environment import DemonstratedEnvironment
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.workspace import WORKSPACE

PLAN = "collection.json"
MANIFEST = "manifest.json"
GRASPS = 4
"""Grasps that the oracle rehearses in a scene."""
MEGABYTES_PER_GRASP = 0.1
IN_THIS_PROCESS = Local()


class Demonstrator:
    """Gives the file of one grasp: the work that an engine hands out, a copy to each worker.

    Args:
        collection: what is collected.
        make_env: makes an environment of that task and camera; called once in each worker. It must pickle where
            the engine has other processes.
    """

    def __init__(self, collection: Collection, make_env: Callable[[], DemonstratedEnvironment]) -> None:
        self.collection = collection
        self._make_env = make_env
        self._env: DemonstratedEnvironment | None = None

    def __call__(self, place: Place) -> bytes:
        """The content of `file_name(*place)`."""
        if self._env is None:
            self._env = self._make_env()
        return encode(demonstrate(self.collection, self._env, *place))

    def close(self) -> None:
        """Close the environment, if one was made here."""
        if self._env is not None:
            self._env.close()


def unwatched(results: Iterable[Any], total: int) -> Iterable[Any]:
    """No progress bar."""
    return results


def collect(
    collection: Collection,
    make_env: Callable[[], DemonstratedEnvironment],
    folder: str | Path,
    engine: Engine = IN_THIS_PROCESS,
    progress: Callable[[Iterator[tuple[Place, bytes]], int], Iterable[tuple[Place, bytes]]] = unwatched,
) -> None:
    """Let the oracle grasp every goal of every demonstration, each in a fresh scene, and keep what succeeded.

    Args:
        collection: what to collect.
        make_env: as for `Demonstrator`.
        folder: where the files go; one that the same collection began is gone on with.
        engine: who does the work; the files are written by this process.
        progress: wraps the results as they come, and is told how many there will be, for a progress bar.

    Raises:
        InputError: if the folder belongs to something else, the disk is full, or the oracle fails on one goal in 10
            scenes in a row; it names the goal.
        WorkerLostError: if a worker died; what was written stays.
    """
    folder = Path(folder)
    with (
        opened(collection, folder) as missing,
        closing(Demonstrator(collection, make_env)) as work,
        closing(engine(work, missing)) as results,
    ):
        for place, content in progress(results, len(missing)):
            write_atomically(folder / file_name(*place), content)


def store(collection: Collection, demonstrations: Sequence[Demonstration], folder: str | Path) -> None:
    """Write demonstrations that are at hand, as `collect` would; into a folder that has some of them, the others.

    Raises:
        InputError: if they are not the collection's, or one is not what a file gives back or a policy can be trained
            on; or the folder belongs to something else, is damaged, or has others in their place. Nothing is written
            then.
    """
    folder = Path(folder)
    expected = [(demo, collection.goals[demo][grasp]) for demo, grasp in collection.grasps()]
    if [(each.demo, each.goal) for each in demonstrations] != expected:
        raise InputError(f"these {len(demonstrations)} grasps are not those of the plan, which are {len(expected)}")
    by_place = dict(zip(collection.grasps(), demonstrations, strict=True))
    for place, each in by_place.items():
        try:
            check(each)
        except InputError as error:
            raise InputError(f"{file_name(*place)} cannot be stored: {error}") from None
        if each.task != collection.task:
            raise InputError(
                f"{file_name(*place)} cannot be stored: it is of task {each.task!r}, but its plan of "
                f"{collection.task!r}; give both the same"
            )
    with opened(collection, folder) as missing:
        for place in collection.grasps():
            if place not in missing:
                _check_same(folder / file_name(*place), by_place[place])
        for place in missing:
            write_atomically(folder / file_name(*place), encode(by_place[place]))


def _check_same(path: Path, demonstration: Demonstration) -> None:
    """Raise an InputError unless the file has this demonstration."""
    try:
        # decoded first: another zlib packs the same demonstration into other bytes
        kept = encode(decode(path.read_bytes()))
    except (OSError, InputError) as error:
        raise InputError(f"{path} is damaged or lost ({error}); choose another folder, or delete this one") from None
    if kept != encode(demonstration):
        raise InputError(
            f"{path.parent} holds another demonstration as {path.name} than the one at hand; choose another folder, or "
            "delete this one"
        )


@contextmanager
def opened(collection: Collection, folder: Path) -> Generator[list[Place]]:
    """Hold the folder, give what is still missing in it, and write the manifest once all of it is there.

    Raises:
        InputError: if the folder belongs to something else, or the disk is full.
        BusyError: if another process collects in it.
    """
    open_folder(folder, PLAN, collection.plan(), megabytes=len(collection.grasps()) * MEGABYTES_PER_GRASP)
    with alone(folder, "collection"):
        if (folder / MANIFEST).exists():
            yield []
            return
        yield [place for place in collection.grasps() if not (folder / file_name(*place)).exists()]
        _finish(collection, folder)


def _finish(collection: Collection, folder: Path) -> None:
    """Write the manifest."""
    remove_partials(folder)
    names = [file_name(*place) for place in collection.grasps()]
    versions = {
        "equigrasp": equigrasp.__version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
    }
    files = {name: checksum((folder / name).read_bytes()) for name in names}
    write_json(folder / MANIFEST, {**collection.plan(), "files": files, "versions": versions})


def demonstrate(collection: Collection, env: DemonstratedEnvironment, demo: int, grasp: int) -> Demonstration:
    """One grasp of the oracle that succeeded, in the first of its 10 scenes where it does.

    Raises:
        InputError: if it does in none of them; it names the goal.
    """
    goal = collection.goals[demo][grasp]
    asked: dict[str, Any] = {}
    for attempt in range(TRIES):
        seed = collection.scene_seed(demo, grasp, attempt)
        _, info = env.reset(seed=seed, options={"goal": goal})
        observation, instruction = env.observation, env.instruction
        asked = info["goal"]
        best, quality = env.oracle(tries=GRASPS)
        _, reward, *_ = env.step(WORKSPACE.to_action(best))
        if reward > 0:
            return Demonstration(
                observation=observation,
                instruction=instruction,
                grasp=best,
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
    by_part = f" by its {asked['part']!r}" if asked["part"] else ""
    raise InputError(
        f"the oracle picked the {asked['name']!r}{by_part} (goal {goal} of {collection.task}) in none of {TRIES} "
        "scenes, so that nobody can show how; ask for another part of it, or leave that goal out of the task"
    )


def read_collection(folder: Path) -> Collection:
    """The plan of a finished collection.

    Raises:
        InputError: if there is none, or it was made by a version that did not write down each demonstration's goals.
    """
    try:
        return Collection.of_plan(read_json(folder / MANIFEST, "a manifest of demonstrations"))
    except InputError as error:
        raise InputError(f"{folder / MANIFEST}: {error}; collect it again into an empty folder") from None


def _numbers(name: str) -> list[int]:
    return [int(number) for number in re.findall(r"\d+", name)]


def load(folder: str | Path) -> list[Demonstration]:
    """Load a whole collection, in order of demo and grasp.

    Raises:
        InputError: if the folder holds none, or an unfinished, truncated or altered one, or one whose
            heightmaps have another size than the workspace's.
    """
    folder = Path(folder)
    again = "collect it again into an empty folder"
    if not folder.is_dir():
        out = shlex.quote(str(folder))
        raise InputError(f"there is no data folder {folder}; make one with `equigrasp collect --out {out}`")
    if not (folder / MANIFEST).exists():
        if (folder / PLAN).exists():
            raise InputError(f"the collection in {folder} is unfinished; run its `equigrasp collect` again")
        raise InputError(f"{folder} holds no demonstrations (no {MANIFEST}); make some with `equigrasp collect`")
    manifest = read_json(folder / MANIFEST, "a manifest of demonstrations")
    for key, kind in {"task": str, "camera": str, "demos": int, "seed": int}.items():
        if not isinstance(manifest.get(key), kind):
            said = f"{key} is {manifest[key]!r:.100}" if key in manifest else f"{key} is missing"
            raise InputError(f"{folder / MANIFEST} is damaged: {said}; {again}")
    if manifest.get("heightmap") != list(WORKSPACE.shape):
        raise InputError(
            f"{folder} has heightmaps of {manifest.get('heightmap')} pixels, but the workspace has "
            f"{list(WORKSPACE.shape)}; {again}"
        )
    files = manifest.get("files")
    if not isinstance(files, dict) or not files:
        raise InputError(f"{folder / MANIFEST} lists no files; {again}")
    demonstrations = []
    # by number: names grow longer from demo and grasp 1000 on
    for name, expected in sorted(files.items(), key=lambda file: (_numbers(file[0]), file[0])):
        if not (folder / name).is_file():
            raise InputError(f"{folder} lacks {name}, which its manifest lists; {again}")
        content = (folder / name).read_bytes()
        if checksum(content) != expected:
            raise InputError(f"{folder / name} is truncated or altered (its checksum differs); {again}")
        try:
            demonstration = decode(content)
            check(demonstration)
        except InputError as error:
            raise InputError(f"{folder / name} is no demonstration ({error}); {again}") from None
        if demonstration.task != manifest.get("task"):
            raise InputError(
                f"{folder / name} is of task {demonstration.task!r}, but its folder of "
                f"{manifest.get('task')!r}; {again}"
            )
        demonstrations.append(demonstration)
    return demonstrations


def check_loaded(demonstrations: Sequence[Demonstration], folder: Path) -> None:
    """Raise an InputError unless these are what `load` gives of the folder, all of them and in its order."""
    kept = load(folder)
    same = len(kept) == len(demonstrations) and all(map(_same, kept, demonstrations))
    if not same:
        raise InputError(
            f"these {len(demonstrations)} demonstrations are not the {len(kept)} of {folder}, and what is trained on "
            "others would be recorded as trained on these; write yours into a folder of their own by "
            "`equigrasp.demonstrations.store`, and name that"
        )


def _same(one: Demonstration, other: Demonstration) -> bool:
    """Whether both hold the same bits."""
    names = [each.name for each in fields(Demonstration) if each.name != "observation"]
    return one.observation.same(other.observation) and all(getattr(one, name) == getattr(other, name) for name in names)
