"""`equigrasp equivariance` as a user meets it, and Proposition 1 in the simulator."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from equigrasp.grasp import Grasp, Observation
from equigrasp.workspace import WORKSPACE, Motion
from equivariance_tests.simulator import proposition_1
from tasks.env import GraspEnv
from tasks.scene import Scene

SOURCE = Path(__file__).parent.parent / "docs" / "my_kernel.py"


def equivariance(folder: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "equigrasp", "equivariance", *map(str, arguments)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=500)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A user's folder with a kernel of their own."""
    source = SOURCE.read_text()
    (tmp_path / "mine.py").write_text("import torch\n\ntorch.manual_seed(0)\n" + source)
    return tmp_path


def test_a_report_has_a_picture_and_its_figures_as_json(folder: Path) -> None:
    done = equivariance(folder, "--policy", "mine:make", "--scenes", 2, "--out", "report")
    assert done.returncode == 0, done.stderr
    assert "ok   steerability: holds" in done.stdout
    assert (folder / "report" / "equivariance.png").read_bytes().startswith(b"\x89PNG")
    results = json.loads((folder / "report" / "equivariance.json").read_text())
    assert results["report"]["passed"] is True
    assert set(results["error against angle"]) == set(results["errors of eq. 2"])
    assert len(results["errors of eq. 2"]["RingKernel"]["eq. 2, any turn"]) == 2
    exact, free = (max(results["error against angle"][name]) for name in ("exact basis", "free taps (plain FCN)"))
    assert exact < 2e-4 < 0.1 < free


def test_a_broken_kernel_exits_with_1_and_is_excused_by_reasons(folder: Path) -> None:
    broken = equivariance(folder, "--policy", "mine:make_broken", "--scenes", 1)
    assert broken.returncode == 1, broken.stderr
    assert "FAIL steerability" in broken.stdout
    assert (folder / "equivariance" / "equivariance.png").exists()
    laws = ["steerability", "steerability, wide band", "equivariance", "eq. 2, whole bins", "eq. 2, any turn"]
    excuses = [word for law in laws for word in (law, "turns clockwise")]
    excused = equivariance(folder, "--policy", "mine:make_broken", "--scenes", 1, "--expect", *excuses)
    assert excused.returncode == 0, excused.stdout
    assert "expected to fail: turns clockwise" in excused.stdout


def test_a_kernel_whose_group_has_no_such_turn_is_compared_without_them(folder: Path) -> None:
    """Bins over C_1: Eq. 2 has no scene, which is a word in the report and a gap in the picture."""
    (folder / "still.py").write_text(
        "from equigrasp import fields\nfrom mine import RingKernel\n\nspace = fields.gspaces.rot2dOnR2(1)\n\n\n"
        "class Still(RingKernel):\n    read_out = fields.synthesis(6)\n"
        "    in_type, out_type = (fields.FieldType(space, n * [space.trivial_repr]) for n in (3, 7))\n"
    )
    done = equivariance(folder, "--policy", "still:Still", "--scenes", 1, "--out", "report")
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert "Still: no scene could be measured (eq. 2, any turn)" in done.stdout
    assert (folder / "report" / "equivariance.png").exists()
    results = json.loads((folder / "report" / "equivariance.json").read_text())
    assert results["errors of eq. 2"]["Still"] == {"eq. 2, whole bins": [], "eq. 2, any turn": []}


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "give either --run DIR or --policy"),
        (["--run", "x", "--policy", "mine:make"], "and not both"),
        (["--run", "nowhere"], "is not a run folder"),
        (["--policy", "nowhere:make"], "'nowhere' cannot be imported"),
        (["--policy", "mine:mak"], "did you mean 'make'"),
        (["--policy", "mine:make", "--expect", "lema 1", "why"], "did you mean 'lemma 1'"),
        (["--policy", "mine:make", "--scenes", "0"], "--scenes is 0"),
        (["--policy", "mine:make", "--simulate", "3"], "a --run to simulate"),
        (["--policy", "mine:make", "--out", "mine.py"], "is a file"),
        (["--policy", "even:Even"], "its size is odd"),
    ],
    ids=lambda value: " ".join(value)[:50] if isinstance(value, list) else "",
)
def test_a_mistake_is_one_sentence_and_writes_nothing(folder: Path, arguments: list[str], sentence: str) -> None:
    (folder / "even.py").write_text("from mine import RingKernel\n\n\nclass Even(RingKernel):\n    size = 24\n")
    done = equivariance(folder, *arguments)
    assert done.returncode == 2, done.stderr
    errors = [line for line in done.stderr.splitlines() if line.startswith("equigrasp: ")]
    assert len(errors) == 1
    assert sentence in errors[0]
    assert "Traceback" not in done.stderr
    assert not (folder / "equivariance").exists()


# Proposition 1 in the simulator


def scene_of(env: GraspEnv) -> Scene:
    assert env._scene is not None
    return env._scene


def body_of(env: GraspEnv) -> tuple[np.ndarray, np.ndarray]:
    pose = scene_of(env).pose(env.goal.object)
    return pose.position, pose.rotation


def test_the_target_alone_turns(env: GraspEnv) -> None:
    env.reset(seed=5)
    before, seen = {name: scene_of(env).pose(name) for name in scene_of(env).bodies}, env.observation
    motion = env.turn_target(math.pi)
    assert not seen.same(env.observation)
    for name, pose in before.items():
        after = scene_of(env).pose(name)
        if name == env.goal.object:
            expected = Motion(motion.angle).matrix()[:2, :2] @ pose.rotation[:2, :2]
            np.testing.assert_allclose(after.rotation[:2, :2], expected, atol=0.02)
            np.testing.assert_allclose(after.position, pose.position, atol=1e-3)
            np.testing.assert_allclose(motion(pose.position[:2]), pose.position[:2], atol=1e-9)
        else:
            np.testing.assert_allclose(after.position, pose.position, atol=1e-4)


def test_where_there_is_no_room_nothing_turns() -> None:
    crowded = GraspEnv("pick-by-part", camera="overhead", clearance=0.002)
    try:
        refusals = []
        for seed in range(12):
            crowded.reset(seed=seed)
            position, rotation = body_of(crowded)
            try:
                crowded.turn_target(math.pi / 2)
            except ValueError as refusal:
                refusals.append(str(refusal))
                np.testing.assert_array_equal(body_of(crowded)[0], position)
                np.testing.assert_array_equal(body_of(crowded)[1], rotation)
        assert refusals
        assert all("no room to turn the" in refusal for refusal in refusals)
    finally:
        crowded.close()


def test_a_grasp_that_knows_the_pose_follows_and_one_that_does_not_is_left_behind(env: GraspEnv) -> None:
    def attached(observation: Observation, instruction: str) -> Grasp:
        """Fixed in the target's own frame, which it is told."""
        position, rotation = body_of(env)
        u, v = WORKSPACE.to_pixel(position[:2] + rotation[:2, :2] @ [0.02, 0.0])
        return Grasp(float(u), float(v), 0.3 + math.atan2(rotation[1, 0], rotation[0, 0]))

    followed = proposition_1(attached, env, scenes=3, seed=1)
    assert followed.trials
    assert followed.followed.value == 1.0
    assert max(trial.pixels for trial in followed.trials) < 1.5
    assert max(trial.off for trial in followed.trials) < 2.0
    stubborn = proposition_1(lambda observation, instruction: Grasp(160, 80, 0.5), env, scenes=3, seed=1)
    assert stubborn.followed.value == 0.0
    assert "followed within" in stubborn.lines()[0]


def test_the_oracle_grasps_the_target_however_it_is_turned(env: GraspEnv) -> None:
    follow = proposition_1(lambda observation, instruction: env.oracle()[0], env, scenes=3, seed=2)
    assert sum(trial.success_after for trial in follow.trials) >= len(follow.trials) - 1
    assert follow.to_dict()["trials"][0]["instruction"]


def test_no_scene_is_refused(env: GraspEnv) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        proposition_1(lambda observation, instruction: Grasp(1, 1, 0), env, scenes=0)
