"""Figures 1 to 3 show what was computed: drawn tensors give drawn scores, the drawn motion is the scene's."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import asked
import figure1
import figure2
import figure3
import numpy as np
import pytest
import style
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from equigrasp.grasp import Demonstration
from equigrasp.models import MODELS
from equigrasp.plan import Training
from equigrasp.training import train
from tasks import TASKS
from tasks.env import GraspEnv

KILOBYTES = 500


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, data: Path, demonstrations: list[Demonstration]) -> Path:
    """A policy that was trained for a moment: real tensors, poor grasps."""
    folder = tmp_path_factory.mktemp("figures") / "run"
    model = replace(MODELS["leg-steerable"], text_encoder="hashing")
    train(model, Training(steps=3, seed=0, threads=1), demonstrations, data, folder)
    return folder


@pytest.fixture(scope="module")
def loaded(run: Path) -> Iterator[tuple[asked.LegPolicy, GraspEnv, str]]:
    policy, env, words = asked.load(run)
    yield policy, env, words
    env.close()


@pytest.fixture(scope="module")
def one(loaded: tuple[asked.LegPolicy, GraspEnv, str]) -> asked.Asked:
    policy, env, _ = loaded
    env.reset(seed=3, options={"goal": 12})
    return asked.ask(policy, env)


def texts(figure: Figure) -> str:
    found = [each.get_text() for each in figure.texts]
    for axes in figure.axes:
        found += [axes.get_title(), axes.get_xlabel(), *(each.get_text() for each in axes.texts)]
    return "\n".join(found)


def test_drawn_kernel_and_features_give_the_drawn_scores(loaded: tuple, one: asked.Asked) -> None:
    """At every angle the kernel of that angle, laid on the features, is the score, but for a constant."""
    policy, _, _ = loaded
    _, row, column = one.best
    reach = one.kernel.shape[-1] // 2
    padded = np.pad(one.features, ((0, 0), (reach, reach), (reach, reach)))
    seen = padded[:, row : row + 2 * reach + 1, column : column + 2 * reach + 1]
    scores = np.array([float((asked.kernel_at(policy, one.kernel, index) * seen).sum()) for index in range(36)])
    drawn = one.log_probabilities[:, row, column]
    # phi may run in bfloat16 where it does so for the policy's own scores too; the sum is then of other roundings
    assert np.ptp(scores - drawn) < 0.02 * np.ptp(drawn)
    assert int(scores.argmax()) == one.best[0]
    # and a kernel that is off by a bin does not
    assert np.ptp(np.roll(scores, 1) - drawn) > 0.1 * np.ptp(drawn)


@given(index=st.integers(0, 35))
@settings(max_examples=10)
def test_the_drawn_kernel_turns_with_its_angle(loaded: tuple, one: asked.Asked, index: int) -> None:
    policy, _, _ = loaded
    kernel = asked.kernel_at(policy, one.kernel, index)
    quarter = asked.kernel_at(policy, one.kernel, (index + 18) % 36)
    scale = float(np.abs(kernel).max())
    assert np.abs(np.rot90(kernel, axes=(1, 2)) - quarter).max() < 1e-4 * scale
    assert np.abs(np.rot90(kernel, axes=(1, 2)) - kernel).max() > 1e-2 * scale


def test_figure_1_turns_the_target_alone_and_says_how_far_off_the_grasp_is(loaded: tuple, tmp_path: Path) -> None:
    policy, env, words = loaded
    before, after, motion = figure1.pair(policy, env, seed=3, goal=12, degrees=60.0)
    assert math.degrees(motion.angle) == pytest.approx(60)
    assert motion([before.target]) == pytest.approx(np.array([after.target]), abs=2e-3)
    changed = np.abs(before.observation.height - after.observation.height) > 0.004
    v, u = np.nonzero(changed)
    far = np.hypot(*(asked.WORKSPACE.to_world(np.stack([u, v], axis=1)) - before.target).T)
    assert 0 < far.max() < 0.2
    figure = figure1.draw(policy, before, after, motion, words)
    said = texts(figure)
    for sentence in (before.instruction, "60°", "mm and", "1 demonstration, 3 training steps"):
        assert sentence in said
    assert all(path.stat().st_size < 1000 * KILOBYTES for path in style.save(figure, "figure-1", tmp_path))


def test_figure_1_says_when_there_is_no_room(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        figure1.main(["--run", str(run), "--seed", "1", "--goal", "12"])
    assert "no room to turn the mini-claw-hammer" in capsys.readouterr().err


def test_figure_2_names_the_shapes_of_what_it_shows(loaded: tuple, one: asked.Asked, tmp_path: Path) -> None:
    policy, _, words = loaded
    figure = figure2.draw(policy, one, words)
    said = texts(figure)
    for shape in ("4×160×320", "8×80×160", "17×8×33×33", "17×80×160", "36×80×160"):
        assert shape in said
    assert all(path.stat().st_size < 1000 * KILOBYTES for path in style.save(figure, "figure-2", tmp_path))


@pytest.mark.parametrize("figure", [figure1, figure2])
def test_without_a_run_nothing_is_drawn_and_the_command_is_said(
    figure: object, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        figure.main(["--run", str(tmp_path / "none"), "--out", str(tmp_path / "out")])  # ty: ignore
    said = " ".join(capsys.readouterr().err.split())
    assert "there is no run" in said
    assert asked.HOW in said
    assert not (tmp_path / "out").exists()


def test_a_policy_without_a_kernel_is_refused(
    tmp_path: Path, data: Path, demonstrations: list[Demonstration], capsys: pytest.CaptureFixture[str]
) -> None:
    model = replace(MODELS["fcgq"], text_encoder="hashing")
    train(model, Training(steps=1, seed=0, threads=1), demonstrations, data, tmp_path / "run")
    with pytest.raises(SystemExit):
        figure2.main(["--run", str(tmp_path / "run")])
    assert "has no kernel to draw" in " ".join(capsys.readouterr().err.split())


def test_figure_3_has_every_task_with_what_its_scene_says(tmp_path: Path) -> None:
    figure = figure3.draw(seed=0)
    titles = [axes.get_title().splitlines() for axes in figure.axes]
    assert [title[0] for title in titles[: len(TASKS)]] == list(TASKS)
    env = GraspEnv("pick-logo", camera="overhead")
    # the first scene fits
    env.reset(seed=0)
    assert titles[list(TASKS).index("pick-logo")][1] == f"\u201c{env.instruction}\u201d"
    env.close()
    pictures = [axes for axes in figure.axes if axes.images]
    assert len(pictures) == len(TASKS) + 1, "and the parts of the last"
    for axes in pictures[:-1]:
        (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
        assert (right - left, top - bottom) == pytest.approx(figure3.SIZE), "all at one scale"
        ring = axes.patches[0].get_extents().transformed(axes.transData.inverted())
        assert left < ring.x0 < ring.x1 < right, "no ring is cut off"
        assert bottom < ring.y0 < ring.y1 < top
    assert all(path.stat().st_size < 1000 * KILOBYTES for path in style.save(figure, "figure-3", tmp_path, colors=256))


def test_what_ships_is_small() -> None:
    names = [f"figure-{number}.{kind}" for number in (1, 2, 3) for kind in ("png", "pdf")]
    assert all((style.FIGURES / name).stat().st_size < 1000 * KILOBYTES for name in names)
