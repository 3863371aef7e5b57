"""How hard the tasks are is measured in simulators that are given back, and what cannot be measured is one sentence."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path

import numpy as np
import pybullet
import pytest

from equigrasp.cli.difficulty import Difficulty
from equigrasp.errors import InputError
from tasks import TASKS, Goal, Task
from tasks.difficulty import CHANCE, ORACLE, Scenes
from tasks.env import GraspEnv

BOTTLES = Task("bottles", "mine/Bottles-v0", (Goal("bottle-A", "body"), Goal("bottle-B", "body")), objects=(2, 2))
"""From above a bottle is its cap: not a pixel shows its body."""


def clients() -> int:
    """PyBullet's clients of this process."""
    return sum(bool(pybullet.getConnectionInfo(index)["isConnected"]) for index in range(1000))


def test_every_simulator_is_given_back(tmp_path: Path) -> None:
    before = clients()
    Difficulty(tasks=("pick-logo", "pick-fruit"), scenes=1, out=tmp_path / "difficulty.jsonl").execute()
    assert clients() == before
    scenes = Scenes(TASKS["pick-logo"], ORACLE)
    scenes.close()
    first = scenes(0)
    assert clients() == before + 1
    scenes.close()
    scenes.close()
    assert clients() == before
    assert scenes(0) == first
    scenes.close()


def test_a_task_that_is_named_twice_counts_once(capsys: pytest.CaptureFixture[str]) -> None:
    Difficulty(tasks=("pick-logo", "pick-logo"), scenes=1, chance=False).execute()
    said = capsys.readouterr().out.splitlines()
    assert sum(line.startswith("pick-logo") for line in said) == 1
    assert [line[20:] for line in said if line.startswith(("pick-logo", "all of them"))] == [said[0][20:]] * 2


def first_tries(actor: str) -> list[bool]:
    """Of the two bottles, asked for by what cannot be seen: whether each first try was right."""
    with closing(Scenes(BOTTLES, actor)) as scenes:
        return [each.right for each in scenes(0)]


def test_a_part_that_no_pixel_shows_is_one_sentence_for_who_aims_at_its_pixels() -> None:
    pixel, centre = CHANCE
    sentence = "'bottles' asks for the bottle-[AB] by body, of which the overhead camera shows not a pixel"
    with pytest.raises(InputError, match=sentence) as error:
        first_tries(pixel)
    assert "\n" not in str(error.value)
    assert first_tries(ORACLE) == first_tries(centre) == [False]


@pytest.mark.parametrize("actor", CHANCE)
def test_who_guesses_the_angle_guesses_any(actor: str, env: GraspEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    env.reset(seed=5)
    truth, rng = env.truth(), np.random.default_rng(0)
    monkeypatch.setattr(env, "truth", lambda: truth)
    angles = np.array([CHANCE[actor](env, rng).theta for _ in range(300)])
    assert ((angles >= 0) & (angles < math.pi)).all()
    quarters = np.histogram(angles, 4, (0, math.pi))[0] / len(angles)
    assert ((quarters > 0.15) & (quarters < 0.35)).all()


def test_who_aims_at_any_pixel_of_the_target_aims_at_all_of_it(env: GraspEnv, monkeypatch: pytest.MonkeyPatch) -> None:
    env.reset(seed=5)
    truth, rng = env.truth(), np.random.default_rng(0)
    monkeypatch.setattr(env, "truth", lambda: truth)
    pixel, _ = CHANCE.values()
    drawn = [pixel(env, rng) for _ in range(300)]
    assert all(truth.on_part[int(grasp.v), int(grasp.u)] for grasp in drawn)
    there, aimed = np.argwhere(truth.on_part), np.array([(grasp.v, grasp.u) for grasp in drawn])
    assert np.ptp(there, axis=0).max() > 15, "a target of a few pixels would show nothing"
    assert np.abs(aimed.mean(axis=0) - there.mean(axis=0)).max() < 2
    assert aimed.std(axis=0) == pytest.approx(there.std(axis=0), rel=0.2)


@pytest.mark.parametrize("gap", [-1.0, 0.0, 0.99, 50.5, math.nan, math.inf])
def test_a_gap_that_would_lay_objects_into_each_other_is_refused(gap: float) -> None:
    with pytest.raises(InputError, match=f"--gap is {gap:g}, but it must be from 1 to 50 millimetres"):
        Difficulty(tasks=("pick-logo",), gap=gap, scenes=1).execute()
