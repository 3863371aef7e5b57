"""The gallery's pictures: what they say is what the suite has, and they show it in its place."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure

from equigrasp.workspace import WORKSPACE, Motion
from tasks import TASKS, camera, gallery
from tasks.above import HORIZON, PART_COLORS, ZOOM, in_parts, photographed, sky
from tasks.objects import LOGOS, OBJECTS, PAINTS, load
from tasks.scene import Client, Scene

SIZE = (0.2, 0.2)


@pytest.fixture(scope="module")
def bullet() -> Iterator[Client]:
    client = Client()
    yield client
    client.disconnect()


def alone(bullet: Client, name: str) -> Scene:
    return Scene(bullet, [load(name)], [Motion(0.7)])


def drawn(picture: str, monkeypatch: pytest.MonkeyPatch) -> Figure:
    """What a function of the gallery would have written."""
    figures: list[Figure] = []
    monkeypatch.setattr(gallery, "write_figure", lambda _path, figure, **_: figures.append(figure))
    getattr(gallery, picture)(Path("nowhere.png"))
    return figures[0]


def test_a_plain_sees_the_whole_sky_and_a_hill_looks_down_on_it() -> None:
    hill = np.zeros((40, 40))
    assert np.allclose(sky(hill, 0.001), 1.0)
    hill[15:25, 15:25] = 0.03
    seen = sky(hill, 0.001)
    assert np.allclose(seen[15:25, 15:25], 1.0)
    assert seen[20, 12] < 0.9, "it stands before the sky of what is beside it"


@given(st.floats(0.005, 0.1), st.integers(6, 30))
@settings(max_examples=20, deadline=None)
def test_the_middle_of_a_round_pit_sees_as_much_sky_as_its_walls_leave(depth: float, radius: int) -> None:
    rows, columns = np.mgrid[-45:46, -45:46]
    pit = np.where(np.hypot(rows, columns) < radius, 0.0, depth)
    # what is far counts less, by one minus its share of the horizon's distance
    slope = depth / (0.001 * radius) * (1 - 0.001 * radius / HORIZON)
    assert sky(pit, 0.001)[45, 45] == pytest.approx(1 / (1 + slope**2), abs=0.12)
    seen = sky(pit, 0.001)
    assert np.allclose(seen, seen[::-1]), "no side is brighter"
    assert np.allclose(seen, seen.T)


def test_a_mug_is_hollow_to_people_and_to_policies_it_is_as_it_was(bullet: Client) -> None:
    scene = alone(bullet, "mug")
    before, _ = camera.overhead(scene.visible())
    x, y, _ = scene.pose("mug").position
    picture = photographed(scene, np.array([x, y]), SIZE)
    middle = tuple(round(side / WORKSPACE.pixel * ZOOM / 2) for side in SIZE)
    assert picture.shaded()[middle].sum() < 0.75 * picture.color[middle].sum()
    after, _ = camera.overhead(scene.visible())
    assert np.array_equal(after.color, before.color)
    assert np.array_equal(after.height, before.height)


def test_a_part_is_drawn_where_the_judge_has_it(bullet: Client) -> None:
    for name in ("scissors", "mug"):
        scene = alone(bullet, name)
        observation, bodies = camera.overhead(scene.visible())
        # a picture as large as the table has ZOOM x ZOOM pixels for each of a heightmap's
        picture, indices = in_parts(scene, np.zeros(2), (WORKSPACE.length, WORKSPACE.depth), gallery.BRIGHT)
        v, u = np.nonzero(bodies == scene.bodies[name])
        points = np.column_stack([WORKSPACE.to_world(np.stack([u, v], axis=1)), observation.height[v, u].astype(float)])
        parts = [*load(name).parts, None]
        judged = [parts[part] for part in scene.parts_at(name, points)]
        names = [*PART_COLORS, None]
        shown = [names[index] for index in indices[ZOOM * v + ZOOM // 2, ZOOM * u + ZOOM // 2]]
        assert np.mean([a == b for a, b in zip(judged, shown, strict=True)]) > 0.95
        assert (None in judged) == (name == "scissors"), "their points are no part"
        lit, handle = np.median(picture.color[indices == names.index("handle")], axis=0), PART_COLORS["handle"]
        assert np.allclose(lit / lit.max(), np.divide(handle, max(handle)), atol=0.02), "whatever the object"


def test_each_part_has_a_colour_of_its_own() -> None:
    asked = {goal.part for goal in TASKS["pick-by-part"].goals}
    assert asked == set(PART_COLORS)
    assert len(set(PART_COLORS.values())) == len(PART_COLORS)


def test_every_object_and_colour_is_in_the_picture_once(monkeypatch: pytest.MonkeyPatch) -> None:
    words = Counter(text.get_text() for text in drawn("draw_objects", monkeypatch).axes[0].texts)
    plain = [name.replace("-", " ") for name in OBJECTS if not name.startswith(("block", "bottle", "L-"))]
    assert {word: words[word] for word in (*plain, *LOGOS)} == dict.fromkeys((*plain, *LOGOS), 1)
    # an orange is no fruit of the suite, so that a colour is nothing else
    assert {word: words[word] for word in PAINTS} == dict.fromkeys(PAINTS, 1)


def test_every_part_that_is_asked_for_is_named_under_its_object(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = drawn("draw_parts", monkeypatch).axes[0]
    goals = TASKS["pick-by-part"].goals
    words = Counter(text.get_text() for text in axes.texts)
    assert {part: words[part] for part in PART_COLORS} == Counter(goal.part for goal in goals)
    titles = {text.get_text(): text.get_position() for text in axes.texts if text.get_fontweight() == "bold"}
    assert set(titles) == {goal.object.replace("-", " ") for goal in goals}
    for text in axes.texts:
        if (part := text.get_text()) in PART_COLORS:
            x, y = text.get_position()
            above = {name: place for name, place in titles.items() if place[1] < y < place[1] + 0.4}
            nearest = min(above, key=lambda name: abs(above[name][0] - x))
            assert any(goal.part == part and goal.object.replace("-", " ") == nearest for goal in goals)


def test_things_on_a_sheet_do_not_touch() -> None:
    lefts = gallery.Sheet(1.0).spread([0.2, 0.1, 0.4])
    assert lefts == pytest.approx([0.075, 0.35, 0.525])
