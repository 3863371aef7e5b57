"""Hypothesis without deadlines (these machines are shared), and one small real collection for all tests."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

# two workers on two cores: a second thread of each would wait for the other's; read when torch loads
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from equigrasp.collection import Collection, draw_goals
from equigrasp.demonstrations import collect, load
from equigrasp.grasp import Demonstration
from tasks import TASKS
from tasks.env import GraspEnv

settings.register_profile("dev", deadline=None, max_examples=30)
settings.register_profile("ci", deadline=None, max_examples=50, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "dev")


@pytest.fixture(scope="session")
def env() -> Iterator[GraspEnv]:
    """The real simulator with the fast camera."""
    env = GraspEnv("pick-by-part", camera="overhead")
    yield env
    env.close()


@pytest.fixture(scope="session")
def plan() -> Collection:
    task = TASKS["pick-by-part"]
    return Collection(task.name, draw_goals(task.demonstration_goals, demos=1, seed=0), seed=0, camera="overhead")


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory, env: GraspEnv, plan: Collection) -> Path:
    """One real demonstration of pick-by-part, 23 grasps; no test may change it."""
    folder = tmp_path_factory.mktemp("collection") / "data"
    collect(plan, lambda: env, folder)
    return folder


@pytest.fixture(scope="session")
def demonstrations(data: Path) -> list[Demonstration]:
    return load(data)


@pytest.fixture(scope="session")
def colored(tmp_path_factory: pytest.TempPathFactory) -> list[Demonstration]:
    """One real demonstration of pick-random-v2: 22 things, each in one of ten colours."""
    task = TASKS["pick-random-v2"]
    env = GraspEnv(task.name, camera="overhead")
    folder = tmp_path_factory.mktemp("colored") / "data"
    goals = draw_goals(task.demonstration_goals, demos=1, seed=0)
    collect(Collection(task.name, goals, seed=0, camera="overhead"), lambda: env, folder)
    env.close()
    return load(folder)
