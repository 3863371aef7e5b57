"""A user's own camera and robot, docs/my_robot.py as it stands; the simulator stands in for both."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from equigrasp.cli import main
from equigrasp.demonstrations import load
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.training import load_policy
from equigrasp.workspace import WORKSPACE
from tasks.camera import fused_viewpoints, overhead_viewpoint, shoot
from tasks.env import GraspEnv

DOCS = Path(__file__).parent.parent / "docs"


@pytest.fixture(scope="module")
def my_robot() -> ModuleType:
    spec = importlib.util.spec_from_file_location("my_robot", DOCS / "my_robot.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def shown(my_robot: ModuleType, env: GraspEnv) -> list[Demonstration]:
    """What the oracle does, told in metres and radians as a robot would."""
    demonstrations = []
    for number in range(3):
        _, info = env.reset(seed=number)
        grasp = env.oracle()[0]
        viewpoint = overhead_viewpoint()
        color, depth, _ = shoot(env.started()[1].visible(), viewpoint)
        seen = my_robot.observe(color, depth, viewpoint.intrinsics, viewpoint.pose)
        assert np.abs(seen.height - env.observation.height).max() < 1e-4
        assert np.array_equal(seen.color, env.observation.color)
        x, y = WORKSPACE.to_world([grasp.u, grasp.v])
        target, part = info["goal"]["name"], info["goal"]["part"]
        made = my_robot.demonstration(number, seen, x, y, grasp.theta, target, part)
        assert (made.grasp.u, made.grasp.v, made.grasp.theta) == pytest.approx((grasp.u, grasp.v, grasp.theta))
        demonstrations.append(made)
    return demonstrations


def test_a_camera_that_looks_aslant_sees_what_stands_there(my_robot: ModuleType, env: GraspEnv) -> None:
    env.reset(seed=4)
    viewpoint = fused_viewpoints()[0]
    color, depth, _ = shoot(env.started()[1].visible(), viewpoint)

    def overlap(pose: np.ndarray) -> float:
        """Of what stands on the table in either view, how much does in both."""
        seen = my_robot.observe(color, depth, viewpoint.intrinsics, pose).height > 0.01
        stands = env.observation.height > 0.01
        return (seen & stands).sum() / (seen | stands).sum()

    assert overlap(viewpoint.pose) > 0.6
    # as OpenGL has it, with y up: it looks away
    with pytest.raises(InputError, match="not OpenGL's"):
        overlap(viewpoint.pose @ np.diag([1.0, -1.0, -1.0, 1.0]))


def test_what_a_robot_was_shown_trains_a_policy(
    my_robot: ModuleType, shown: list[Demonstration], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, run = tmp_path / "my-table", tmp_path / "run"
    my_robot.keep(shown, data)
    for kept, made in zip(load(data), shown, strict=True):
        assert kept.observation.same(made.observation)
        assert (kept.grasp, kept.instruction) == (made.grasp, made.instruction)
    main(["train", "--data", str(data), "--steps", "2", "--text-encoder", "hashing", "--out", str(run)])
    assert "evaluate" not in capsys.readouterr().out
    grasp = load_policy(run).act(shown[0].observation, shown[0].instruction)
    assert WORKSPACE.contains(grasp)
    trained = "this run was trained on 'my-table', which is no task of the simulator; "
    for command, said in (
        (["evaluate"], trained + "name one with --task"),
        (["evaluate", "--task", "pick-fruit"], "add --camera fused or overhead"),
        (["evaluate", "--task", "pick-friut"], "did you mean 'pick-fruit'"),
        (["show"], trained + "name one with --task"),
        (["show", "--task", "pick-fruit"], "add --camera fused or overhead"),
        (["equivariance", "--simulate", "1"], trained + "leave --simulate out"),
    ):
        with pytest.raises(SystemExit, match="2"):
            main([*command, "--run", str(run)])
        assert said in capsys.readouterr().err


def test_the_page_calls_what_the_file_has(my_robot: ModuleType) -> None:
    page = (DOCS / "my_robot.md").read_text()
    names = {
        name.strip()
        for line in page.splitlines()
        if line.startswith("from my_robot import")
        for name in line.removeprefix("from my_robot import").split(",")
    }
    assert names == {"observe", "demonstration", "keep"}
    assert all(hasattr(my_robot, name) for name in names)
