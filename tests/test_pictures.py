"""A picture of queries says what was computed: colours are the colour bar's, a half turn is all, the grasp is seen."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.projections.polar import PolarAxes

from equigrasp import pictures
from equigrasp.cli.queries import close_up
from equigrasp.grasp import Demonstration, Grasp
from equigrasp.pictures import RANGE, Query, draw
from equigrasp.workspace import WORKSPACE
from tasks.env import GraspEnv


@pytest.fixture
def figure(demonstrations: list[Demonstration], monkeypatch: pytest.MonkeyPatch) -> Figure:
    """Of two queries, the second with its best grasp at 178 degrees."""
    drawn: list[Figure] = []
    monkeypatch.setattr(pictures, "write_figure", lambda _path, figure, **_: drawn.append(figure))
    scores = np.random.default_rng(0).normal(-20, 5, (36, 80, 160)).astype(np.float32)
    photograph = np.zeros((4, 4, 3), dtype=np.uint8)
    seen, grasp = demonstrations[0].observation, demonstrations[0].grasp
    level = Grasp(100.0, 60.0, math.radians(178))
    queries = [Query(seen, "lift it", each, grasp, scores, photograph, "lifted", True) for each in (grasp, level)]
    draw(queries, Path("nowhere.png"), "two")
    drawn[0].canvas.draw()
    return drawn[0]


def test_the_heat_has_the_colours_of_the_one_colour_bar(figure: Figure) -> None:
    heats = [image for axes in figure.axes for image in axes.images if np.asarray(image.get_array()).ndim == 2]
    assert len(heats) == 4, "of two queries, whole and closer"
    for heat in heats:
        assert heat.get_clim() == (-RANGE, 0)
        assert heat.get_cmap().name == "viridis"
        assert heat.get_alpha() is None, "nothing shines through it"
        assert np.asarray(heat.get_array()).max() == 0
    assert len([axes for axes in figure.axes if axes.get_label() == "bar"]) == 1


def test_one_legend_says_whose_grasps_are_drawn(figure: Figure) -> None:
    legends = [legend for axes in figure.axes if (legend := axes.get_legend()) is not None]
    assert [[text.get_text() for text in legend.get_texts()] for legend in legends] == [["policy", "oracle"]]


def test_angles_are_drawn_modulo_half_a_turn(figure: Figure) -> None:
    dials = [axes for axes in figure.axes if isinstance(axes, PolarAxes)]
    assert len(dials) == 2
    for dial in dials:
        # what is drawn at an end is drawn whole, and nothing stands twice
        assert (dial.get_thetamin(), dial.get_thetamax()) == pytest.approx((-5, 185))
    heights = [patch.get_height() for patch in dials[1].patches if isinstance(patch, Rectangle)]
    assert heights[0] == heights[-1], "0 and 180 degrees are one"


def test_the_close_up_shows_what_the_fingers_hold() -> None:
    env = GraspEnv("pick-fruit", camera="overhead", render_mode="rgb_array")
    try:
        env.reset(seed=0)
        grasp = env.oracle()[0]
        photographs = []
        env.attempt(
            WORKSPACE.to_grasp(WORKSPACE.to_action(grasp)),
            watch=lambda phase: photographs.append(close_up(env, grasp)) if phase == "lift" else None,
        )
    finally:
        env.close()
    last = photographs[-1]
    assert last.shape == (270, 360, 3)
    # a fruit has a colour, the hand, the table and what is beside it have none
    middle = last[60:230, 90:270].astype(int)
    assert (np.ptp(middle, axis=-1) > 60).sum() > 200
