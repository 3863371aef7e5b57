"""What a line of results says of its cell is what was done: each setting reaches the training and the tests."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import pytest
from small import SMALL

from equigrasp.cli import main
from equigrasp.evaluation import VALIDATION_SEED, scene_seed
from equigrasp.plan import read_plan
from equigrasp.policy import GraspPolicy
from equigrasp.study.matrix import Job, Protocol
from equigrasp.study.results import known_by
from equigrasp.study.work import TESTS, Work
from tasks import TASKS
from tasks.env import GraspEnv
from tasks.instructions import GRAMMARS, render

TASK = "pick-by-part"
JOB = Job(
    model=SMALL,
    task=TASK,
    demos=1,
    seed=1,
    steps=60,
    recombination=0.7,
    camera="overhead",
    threads=1,
    checkpoints=2,
    protocol=Protocol(scenes=1, queries=4, validation=3, turned=2, phrasings="unseen"),
    tests=(TASK,),
    hard_negatives=0.3,
    crowded=0.4,
    rows=((TASK, "a"),),
)
OTHERWISE: dict[str, Any] = {
    "model": replace(SMALL, channels=8),
    "task": "pick-logo",
    "demos": 2,
    "seed": 2,
    "steps": 61,
    "recombination": 0.6,
    "camera": "fused",
    "threads": 2,
    "checkpoints": 1,
    "device": "cuda",
    "hard_negatives": 0.2,
    "crowded": 0.3,
    "rows": ((TASK, "b"),),
}
"""Another value of each setting of a training."""
TESTED_OTHERWISE: dict[str, Any] = {"scenes": 2, "queries": 5, "validation": 4, "turned": 3, "phrasings": "seen"}


@dataclass
class Asked:
    """What was asked of environments and of the measurement of symmetry, in order."""

    resets: list[tuple[str, str, int, str]] = field(default_factory=list)
    symmetry: list[tuple[int, int]] = field(default_factory=list)

    def make(self, task: str, camera: Any, phrasings: Any) -> GraspEnv:
        asked = self

        class Watched(GraspEnv):
            """The simulator, of which each scene is noted: camera, the goal's kind, seed and sentence."""

            def reset(self, **options: Any) -> Any:
                found = super().reset(**options)
                asked.resets.append((camera, str(found[1]["goal"]["index"]), options["seed"], self.instruction))
                return found

        return Watched(task, camera=camera, phrasings=phrasings)

    def measure(self, policy: GraspPolicy, env: Any, scenes: int, seed: int) -> dict[str, Any]:
        self.symmetry.append((scenes, seed))
        return {"kernel": None}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, data: Path) -> tuple[Path, Asked, dict[str, Any]]:
    """A job of a second seed, its shares and phrasings none that is usual: the study's folder, its line."""
    folder, asked = tmp_path_factory.mktemp("settings"), Asked()
    shutil.copytree(data, folder / JOB.data)
    (line,) = Work(folder, asked.make, {TASK: len(TASKS[TASK].goals)}, asked.measure)(JOB)
    return folder, asked, line


def sentences(index: str, which: Any) -> set[str]:
    """All that can be said of a goal."""
    goal = TASKS[TASK].goals[int(index)]
    return {render(goal, phrasing) for phrasing in GRAMMARS[goal.kind].phrasings(which)}


def test_a_training_is_made_as_its_line_says(done: tuple[Path, Asked, dict[str, Any]]) -> None:
    folder, _, line = done
    training = read_plan(folder / JOB.run)["training"]
    for name in ("seed", "steps", "recombination", "hard_negatives", "crowded", "threads"):
        assert training[name] == getattr(JOB, name) == line[name], name


def test_checkpoints_are_chosen_and_tests_made_on_scenes_of_their_own(
    done: tuple[Path, Asked, dict[str, Any]],
) -> None:
    _, asked, line = done
    seeds = [seed for _, _, seed, _ in asked.resets]
    validation = [scene_seed(1, place, VALIDATION_SEED) for place in range(3)]
    assert seeds == [*validation, *validation, *(scene_seed(1, place) for place in range(4)), scene_seed(1, 0)]
    assert asked.symmetry == [(2, 1)]
    assert {camera for camera, *_ in asked.resets} == {"overhead"}
    assert line["checkpoint"] in (50, 60)


def test_unseen_phrasings_are_those_of_the_tests_alone(done: tuple[Path, Asked, dict[str, Any]]) -> None:
    _, asked, _ = done
    for place, (_, goal, _, sentence) in enumerate(asked.resets):
        seen, unseen = sentences(goal, "seen"), sentences(goal, "unseen")
        assert not seen & unseen
        assert sentence in (seen if place < 6 else unseen)


def test_the_trials_that_are_kept_are_those_of_the_seed(done: tuple[Path, Asked, dict[str, Any]]) -> None:
    folder, _, line = done
    (kept,) = (folder / JOB.run / TESTS).iterdir()
    found = json.loads(kept.read_text())
    assert found["line"] == line
    assert [trial["seed"] for trial in found["single_shot"]["trials"]] == [scene_seed(1, place) for place in range(4)]
    assert {trial["seed"] for trial in found["paper"]["trials"]} == {scene_seed(1, 0)}


@pytest.mark.parametrize("which", ["seen", "unseen"])
def test_an_evaluation_says_what_it_was_asked_to(
    done: tuple[Path, Asked, dict[str, Any]], tmp_path: Path, which: str
) -> None:
    out = tmp_path / "trials.json"
    command = ["evaluate", "--run", str(done[0] / JOB.run), "--protocol", "single-shot", "--scenes", "4", "--seed", "7"]
    main([*command, "--no-oracle", "--threads", "1", "--phrasings", which, "--out", str(out)])
    trials = json.loads(out.read_text())["policy"]["trials"]
    assert [trial["seed"] for trial in trials] == [scene_seed(7, place) for place in range(4)]
    assert all(trial["instruction"] in sentences(str(trial["goal"]), which) for trial in trials)


def known(jobs: Iterable[Job]) -> set[str]:
    return {known_by(job.cell(job.task)) for job in jobs}


def test_every_setting_makes_another_cell_and_where_it_trains_otherwise_another_run() -> None:
    assert {each.name for each in fields(Job) if each.init} == {*OTHERWISE, "protocol", "tests"}
    assert {each.name for each in fields(Protocol)} == {*TESTED_OTHERWISE}
    trained = [replace(JOB, **{name: value}) for name, value in OTHERWISE.items()]
    tested = [replace(JOB, protocol=replace(JOB.protocol, **{k: value})) for k, value in TESTED_OTHERWISE.items()]
    assert len(known([JOB, *trained, *tested])) == 1 + len(OTHERWISE) + len(TESTED_OTHERWISE)
    assert len({job.run for job in (JOB, *trained)}) == 1 + len(OTHERWISE)
    assert {job.run for job in tested} == {JOB.run}


def test_a_line_that_was_measured_is_known_by_its_settings(done: tuple[Path, Asked, dict[str, Any]]) -> None:
    assert known_by(done[2]) == known_by(JOB.cell(TASK))
