"""Laws of the objects: drawing, mesh, hulls, parts and numbers all say the same thing, and PyBullet agrees.

Each law that compares two descriptions is also aimed at a broken one (mirrored, shifted, parts swapped), which
it must reject.
"""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pybullet
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import ConvexHull, KDTree

from equigrasp.workspace import WORKSPACE
from tasks import TASKS
from tasks.env import GraspEnv
from tasks.goal import Goal
from tasks.objects import OBJECTS, Mark, ObjectAsset, Part, Shape, load
from tasks.objects.asset import BAKED, PALETTE_SLOTS, baked_file
from tasks.objects.block import TOP as BLOCK_TOP
from tasks.objects.bottle import LETTERS
from tasks.objects.bottle import TOP as BOTTLE_TOP
from tasks.objects.shape import COLOURS
from tasks.objects.solid import Distance, box, capsule, disc, ellipsoid, plate, ring, sphere, stroke, union
from tasks.task import Task

PICTURES = ("block-star", "block-heart", "block-moon", "block-lightning", "block-flower", "block-anchor")
BOTTLES = tuple(f"bottle-{letter}" for letter in "ABCDEHKS")

PARTS = {
    "fork": ("head", "middle", "end"),
    "knife": ("head", "middle", "end"),
    "spoon": ("head", "middle", "end"),
    "medium-clamp": ("head", "handle"),
    "mini-claw-hammer": ("head", "handle"),
    "mug": ("brim", "handle"),
    "scissors": ("handle", "middle"),
    "lion": ("head", "body"),
    "hippo": ("head", "body"),
    "rhino": ("head", "body"),
    "bowl": ("rim", "body"),
    "banana": ("stem", "body"),
    "apple": ("body",),
    "strawberry": ("body", "leaves"),
    "lemon": ("body",),
    "starfruit": ("body",),
    "avocado": ("body", "pit"),
    "L-block": ("body",),
    **dict.fromkeys(PICTURES, ("body",)),
    **dict.fromkeys(BOTTLES, ("cap", "body")),
    "deer": ("head", "body"),
    "elephant": ("head", "body"),
    "giraffe": ("head", "body"),
    "monkey": ("head", "body"),
    "zebra": ("head", "body"),
}

# Their mirror images are other objects. (Of a bowl, say, it is the same again.)
LOPSIDED = {
    "fork", "knife", "spoon", "medium-clamp", "mini-claw-hammer", "mug", "scissors", "lion", "hippo", "rhino",
    "banana", "strawberry", "avocado", "L-block",
}  # fmt: skip

# Where a person would point, in millimetres of the drawing.
LANDMARKS: dict[str, dict[str | None, list[tuple[float, float, float]]]] = {
    "fork": {"head": [(80, 14.5, 6), (80, -5, 6), (54, 0, 6)], "middle": [(5, 0, 6)], "end": [(-60, 0, 6)]},
    "knife": {"head": [(50, 0, 6), (80, 2, 6)], "middle": [(0, 0, 6)], "end": [(-56, 0, 12), (-75, 0, 6)]},
    "spoon": {"head": [(64, 18, 10), (64, 0, 2)], "middle": [(10, 0, 6)], "end": [(-60, 0, 6)]},
    "medium-clamp": {"head": [(68, 0, 8), (34, 15, 8), (4, 0, 15)], "handle": [(-60, 22, 8), (-60, -22, 8)]},
    "mini-claw-hammer": {"head": [(48, 30, 12), (37, -42, 12)], "handle": [(0, 0, 11), (-80, 0, 12)]},
    "mug": {"brim": [(-28.5, 0, 50), (0, 28.5, 55), (0, 0, 3)], "handle": [(50, 0, 30)]},
    "scissors": {"handle": [(-69, 24, 6), (-52, -7, 6)], "middle": [(2, 0, 6), (25, 0, 6)], None: [(70, 8, 6)]},
    "lion": {"head": [(74, 20, 16), (30, 30, 16)], "body": [(-20, 4, 16), (24, -35, 23), (-72, 20, 10)]},
    "hippo": {"head": [(62, 6, 16), (34, 14, 16)], "body": [(-30, 0, 16), (8, -30, 23)]},
    "rhino": {"head": [(85, 20, 16), (56, 2, 16)], "body": [(-30, 0, 16), (14, -35, 23)]},
    "bowl": {"rim": [(54.5, 0, 55), (0, -54.5, 45)], "body": [(0, 0, 4), (48, 0, 15)]},
    "banana": {"stem": [(82, -33, 11), (74, -23, 12)], "body": [(0, 17, 16), (-76, -28, 12), (50, 2, 14)]},
    "apple": {"body": [(0, 0, 20), (28, 0, 30), (-7, -3, 66), (24, 6, 58)]},
    "strawberry": {"body": [(-20, 0, 16), (0, 0, 40)], "leaves": [(46, 2, 19), (26, 0, 40), (26, 17, 25)]},
    "lemon": {"body": [(0, 0, 20), (42, 0, 18), (-38, 0, 18)]},
    "starfruit": {"body": [(0, 0, 14), (0, 28, 14), (17, -23, 14)]},
    "avocado": {"body": [(34, 0, 20), (-12, 24, 18), (-12, 0, 4)], "pit": [(-12, 0, 33)]},
    "L-block": {"body": [(-30, 40, 15), (36, -34, 15)]},
    **{name: {"body": [(0, 0, 30), (22, 22, 10)]} for name in PICTURES},
    **{name: {"cap": [(0, 0, 68), (23, 0, 50)], "body": [(0, 0, 10), (0, 22, 20)]} for name in BOTTLES},
    "deer": {"head": [(28, 90, 16), (66, 33, 16)], "body": [(-20, 2, 30), (22, -48, 23), (-62, 19, 16)]},
    "elephant": {"head": [(70, -38, 16), (20, 26, 38), (40, 20, 30)], "body": [(-30, 0, 16), (-42, -40, 23)]},
    "giraffe": {"head": [(66, 73, 16), (37, 98, 20)], "body": [(28, 40, 16), (-20, 0, 30), (17, -54, 23)]},
    "monkey": {"head": [(45, 30, 30), (18, 47, 20), (57, 54, 20)], "body": [(-76, 30, 11), (0, 6, 25), (32, -46, 16)]},
    "zebra": {"head": [(72, 20, 16), (34, 60, 23)], "body": [(10, 36, 16), (-20, 0, 30), (20, -46, 23)]},
}

SOLIDS: dict[str, Distance] = {
    "sphere": sphere((1, 2, 3), 9),
    "ellipsoid": ellipsoid((0, 0, 3), (9, 12, 10)),
    "capsule": capsule((-8, 0, 0), (8, 3, 2), 5),
    "box": box((-9, -5, -3), (9, 5, 8), 2),
    "disc": disc((1, 0), 9, -4, 7, 1),
    "ring": ring((0, 0, 1), 11, 4),
    "stroke": stroke([(-8, -8), (3, -6), (5, 9)], 6, -5, 4),
    "plate": plate([(-8, -8), (9, -6), (2, 1), (-6, 10)], -3, 5, 1),
}


def read_visual(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Vertices `(V, 3)`, faces `(F, 3)`, and each face's slot of the palette `(F,)`."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([[float(x) for x in row[1:]] for row in rows if row[0] == "v"])
    corners = np.array([[c.split("/") for c in row[1:]] for row in rows if row[0] == "f"]).astype(int) - 1
    across = np.array([float(row[1]) for row in rows if row[0] == "vt"])
    return vertices, corners[:, :, 0], (across[corners[:, 0, 1]] * PALETTE_SLOTS).astype(int)


def read_hulls(path: Path) -> list[NDArray[np.float64]]:
    """The corners `(V, 3)` of each hull."""
    groups: list[list[list[float]]] = []
    for row in (line.split() for line in path.read_text().splitlines()):
        if row[0] == "o":
            groups.append([])
        elif row[0] == "v":
            groups[-1].append([float(x) for x in row[1:]])
    return [np.array(group) for group in groups]


def in_mesh(points: NDArray[np.float64], vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray:
    """Which points `(N, 3)` the closed mesh winds around: an inside that knows nothing of distances."""
    a, b, c = (vertices[faces[:, i]][None] - points[:, None] for i in range(3))
    la, lb, lc = (np.sqrt((v * v).sum(-1)) for v in (a, b, c))
    triple = (a * np.cross(b, c)).sum(-1)
    below = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return np.arctan2(triple, below).sum(axis=1) / (2 * np.pi) > 0.5


def in_hulls(points: NDArray[np.float64], hulls: list[NDArray[np.float64]]) -> NDArray[np.bool_]:
    planes = [ConvexHull(corners).equations for corners in hulls]
    return np.any([(points @ p[:, :3].T + p[:, 3] <= 0).all(axis=1) for p in planes], axis=0)


def cloud(asset: ObjectAsset, count: int) -> NDArray[np.float64]:
    """Points around and in the object, `(count, 3)` metres."""
    vertices = np.concatenate(read_hulls(asset.collision))
    low, high = vertices.min(axis=0) - 0.003, vertices.max(axis=0) + 0.003
    return np.random.default_rng(0).uniform(low, high, (count, 3))


def landmark_errors(asset: ObjectAsset, shape: Shape, jitter: NDArray[np.float64]) -> int:
    """How many landmarks, moved by `jitter` (3,) metres, a shape gives to another part."""
    wrong = 0
    for part, points in LANDMARKS[asset.name].items():
        found = shape.part_at(np.array(points) / 1000 + jitter)
        wrong += sum((shape.parts[i] if i >= 0 else None) != part for i in found)
    return wrong


def settle(asset: ObjectAsset, lift: float, tilt: float = 0.0) -> tuple[NDArray[np.float64], float]:
    """Drop an object onto a plane for a second: its position (3,) in metres and its tilt in degrees."""
    client = pybullet.connect(pybullet.DIRECT)
    try:
        pybullet.setGravity(0, 0, -9.81, client)
        plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE, physicsClientId=client)
        pybullet.createMultiBody(0, plane, physicsClientId=client)
        hulls = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(asset.collision), physicsClientId=client)
        body = pybullet.createMultiBody(
            0.08,
            hulls,
            -1,
            [0, 0, asset.rest_height + lift],
            pybullet.getQuaternionFromEuler([tilt, 0, 0]),
            physicsClientId=client,
        )
        for _ in range(240):
            pybullet.stepSimulation(client)
        position, turn = pybullet.getBasePositionAndOrientation(body, client)
        upright = np.clip(pybullet.getMatrixFromQuaternion(turn)[8], -1, 1)
        return np.array(position), float(np.degrees(np.arccos(upright)))
    finally:
        pybullet.disconnect(client)


@pytest.fixture(params=list(OBJECTS))
def asset(request: pytest.FixtureRequest) -> ObjectAsset:
    return load(request.param)


def several_parts() -> list[str]:
    return [name for name, parts in PARTS.items() if len(parts) > 1]


def test_objects_have_their_parts() -> None:
    assert {name: load(name).parts for name in OBJECTS} == PARTS


def test_ten_objects_have_the_23_parts_of_pick_by_part() -> None:
    goals = TASKS["pick-by-part"].goals
    assert {goal.object: tuple(g.part for g in goals if g.object == goal.object) for goal in goals} == {
        name: PARTS[name] for name in list(PARTS)[:10]
    }
    assert len(goals) == 23


@pytest.mark.parametrize("name", SOLIDS)
@given(
    here=st.tuples(*[st.floats(-25, 25)] * 3),
    step=st.tuples(*[st.floats(-3, 3)] * 3),
)
@example(here=(0.0, 0.0, 0.0), step=(0.0, 0.0, 3.0))
@settings(max_examples=60, deadline=None)
def test_a_distance_changes_no_faster_than_one_moves(name: str, here: tuple, step: tuple) -> None:
    ends = np.array([here, np.add(here, step)])
    before, after = SOLIDS[name](ends.T)
    # An ellipsoid is exact to first order only; its bound grows with the ratio of its radii.
    steepest = 1.8 if name == "ellipsoid" else 1.0
    assert abs(after - before) <= steepest * np.linalg.norm(ends[1] - ends[0]) + 1e-9


@given(blend=st.floats(0.1, 8), x=st.floats(-20, 20), y=st.floats(-20, 20))
@settings(max_examples=60, deadline=None)
def test_a_blend_adds_at_most_a_quarter_of_itself(blend: float, x: float, y: float) -> None:
    point = np.array([[x], [y], [0.0]])
    solids = SOLIDS["sphere"], SOLIDS["box"]
    sharp, smooth = union(*solids)(point)[0], union(*solids, blend=blend)(point)[0]
    assert sharp - blend / 4 - 1e-9 <= smooth <= sharp + 1e-12


def test_the_visual_mesh_lies_on_the_surface_and_a_mirrored_one_does_not(asset: ObjectAsset) -> None:
    vertices, faces, _ = read_visual(asset.visual)
    middles = vertices[faces].mean(axis=1)
    assert np.abs(asset.distance(vertices)).max() < 0.0015
    assert np.abs(asset.distance(middles)).max() < 0.0015
    mirrored = [vertices * [-1, 1, 1]] if asset.name in LOPSIDED else []
    for broken in (*mirrored, vertices + np.array([0.003, 0, 0]), vertices * 1.1):
        assert np.abs(asset.distance(broken)).max() > 0.0015


def test_inside_is_the_same_for_the_distance_and_the_mesh(asset: ObjectAsset) -> None:
    vertices, faces, _ = read_visual(asset.visual)
    points = cloud(asset, 300)
    distance = asset.distance(points)
    clear = np.abs(distance) > 0.0008
    assert (distance[clear] < 0).sum() > 15
    np.testing.assert_array_equal(in_mesh(points[clear], vertices, faces), distance[clear] < 0)
    mirrored = [(vertices * [-1, 1, 1], faces[:, ::-1])] if asset.name in LOPSIDED else []
    for broken in (*mirrored, (vertices + np.array([0.005, 0, 0]), faces)):
        assert (in_mesh(points[clear], *broken) != (distance[clear] < 0)).any()


def test_the_visual_mesh_is_closed(asset: ObjectAsset) -> None:
    _, faces, _ = read_visual(asset.visual)
    edges = {(int(face[i]), int(face[i - 2])) for face in faces for i in range(3)}
    assert {(b, a) for a, b in edges} == edges


def test_the_origin_is_the_centre_of_mass(asset: ObjectAsset) -> None:
    points = cloud(asset, 150_000)
    inside = points[asset.distance(points) < 0]
    # The standard error of a mean over the sample is 0.3 mm at most.
    assert np.abs(inside.mean(axis=0)).max() < 0.0015


@pytest.mark.parametrize("name", OBJECTS)
@given(jitter=st.tuples(*[st.floats(-0.0015, 0.0015)] * 3))
@settings(max_examples=20, deadline=None)
def test_landmarks_belong_to_the_part_that_one_would_name(name: str, jitter: tuple) -> None:
    assert landmark_errors(load(name), OBJECTS[name], np.array(jitter)) == 0


@pytest.mark.parametrize("name", several_parts())
def test_swapped_parts_are_noticed(name: str) -> None:
    asset = load(name)
    names = asset.parts
    swap = dict(zip(names, [*names[1:], names[0]], strict=True))
    pieces = tuple(
        Part(None if piece.name is None else swap[piece.name], piece.solid, piece.colour)
        for piece in OBJECTS[asset.name].pieces
    )
    assert landmark_errors(asset, Shape(pieces, OBJECTS[asset.name].blend), np.zeros(3)) > 0


def test_part_at_is_in_the_object_frame(asset: ObjectAsset) -> None:
    points = cloud(asset, 2000)
    np.testing.assert_array_equal(asset.part_at(points), OBJECTS[asset.name].part_at(points + asset.centre))
    assert asset.part_at(points).dtype == np.int64
    assert (asset.part_at(points[:10] + np.array([0, 0, 1.0])) == -1).all()
    assert asset.part_at(np.empty((0, 3))).shape == (0,)


def test_parts_cover_the_surface_and_each_is_large_enough_to_hold(asset: ObjectAsset) -> None:
    vertices, faces, _ = read_visual(asset.visual)
    part = asset.part_at(vertices[faces].mean(axis=1))
    if None not in {piece.name for piece in OBJECTS[asset.name].pieces}:
        assert (part >= 0).all()
    for index in range(len(asset.parts)):
        extent = np.ptp(vertices[faces[part == index]].reshape(-1, 3), axis=0)
        assert extent[:2].max() > 0.025, asset.parts[index]  # a fingertip is 20 mm wide
        assert extent[2] > 0.008, asset.parts[index]


def test_a_face_has_the_colour_of_its_piece_or_mark(asset: ObjectAsset) -> None:
    vertices, faces, slots = read_visual(asset.visual)
    areas = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    weight = np.sqrt((areas**2).sum(axis=1))
    right = slots == OBJECTS[asset.name].colour_at(vertices[faces].mean(axis=1) + asset.centre)
    # Slivers along a border may fall either way once coordinates are rounded.
    assert weight[right].sum() / weight.sum() > 0.999


@pytest.mark.parametrize("name", [name for name, shape in OBJECTS.items() if any(p.marks for p in shape.pieces)])
def test_marks_are_where_they_are_drawn_all_over_the_faces(name: str) -> None:
    asset = load(name)
    vertices, faces, slots = read_visual(asset.visual)
    corners = vertices[faces]
    areas = np.sqrt((np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) ** 2).sum(axis=1))
    rng = np.random.default_rng(0)
    chosen = rng.choice(len(faces), 20_000, p=areas / areas.sum())
    points = (rng.dirichlet([1, 1, 1], 20_000)[:, :, None] * corners[chosen]).sum(axis=1) + asset.centre

    def wrong(shift: float) -> float:
        return float((OBJECTS[asset.name].colour_at(points + np.array([shift, 0, 0])) != slots[chosen]).mean())

    # What is cut is off by the marks' blur at most, and by less on average.
    blur = max(mark.blur for piece in OBJECTS[asset.name].pieces for mark in piece.marks)
    assert wrong(0.0) < 0.02 * blur
    if name != "L-block":  # the mark on it has the block's own colour
        assert wrong(0.003) > max(2 * wrong(0.0), 0.002)


def seen_from_above(name: str, angle: float, top: float) -> NDArray[np.int64]:
    """The colours (16, 16) of an upright object's top, turned by `angle`, at the heightmap's pixels."""
    steps = (np.arange(16) - 7.5) * WORKSPACE.pixel
    x, y = np.meshgrid(steps, steps)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    points = np.column_stack([np.stack([x.ravel(), y.ravel()], axis=1) @ turn, np.full(256, top / 1000 - 1e-5)])
    return OBJECTS[name].colour_at(points).reshape(16, 16)


@pytest.mark.parametrize(("names", "top"), [(BOTTLES, BOTTLE_TOP), (PICTURES, BLOCK_TOP)])
def test_captions_and_pictures_differ_at_the_heightmaps_pixels_however_they_are_turned(
    names: tuple, top: float
) -> None:
    angles = np.radians(np.arange(0, 360, 10))
    white = list(COLOURS).index("white")
    turned = {name: np.stack([seen_from_above(name, angle, top) != white for angle in angles]) for name in names}

    def overlap(one: NDArray[np.bool_], others: NDArray[np.bool_]) -> float:
        return float(((one & others).sum(axis=(1, 2)) / (one | others).sum(axis=(1, 2))).max())

    for name in names:
        assert turned[name][0].mean() > 0.1
        for other in names:
            if other != name:
                assert overlap(turned[name][0], turned[other]) < 0.8, (name, other)
        # and another look at the same one is alike
        again = np.stack([seen_from_above(name, angle + np.radians(5), top) != white for angle in angles])
        assert overlap(turned[name][0], again) > 0.7, name


def test_the_palette_holds_the_colours() -> None:
    pixels = np.asarray(Image.open(BAKED / "palette.png"))
    for slot, colour in enumerate(COLOURS.values()):
        u = int((slot + 0.5) / PALETTE_SLOTS * pixels.shape[1])
        assert tuple(pixels[pixels.shape[0] // 2, u]) == colour


def test_hulls_fill_the_object_and_little_else(asset: ObjectAsset) -> None:
    hulls = read_hulls(asset.collision)
    points = cloud(asset, 8_000)
    distance = asset.distance(points)
    solid, filled = distance < 0, in_hulls(points, hulls)
    assert (solid & filled).sum() / (solid | filled).sum() > 0.85
    assert (solid & filled).sum() / solid.sum() > 0.93
    assert distance[filled].max() < 0.003
    mirrored = [[hull * [-1, 1, 1] for hull in hulls]] if asset.name in LOPSIDED else []
    for broken in (*mirrored, [hull * 0.95 for hull in hulls]):
        filled = in_hulls(points, broken)
        assert (solid & filled).sum() / solid.sum() < 0.93


def test_the_footprint_is_the_silhouette(asset: ObjectAsset) -> None:
    vertices, faces, _ = read_visual(asset.visual)
    seen = np.concatenate([vertices, vertices[faces].mean(axis=1)])[:, :2]
    tree = KDTree(asset.footprint)
    assert tree.query(seen)[0].max() < 0.004  # dense: no point of the object is far from it
    column = np.linspace(-asset.rest_height, 0.06, 60)
    stacked = np.concatenate([np.column_stack([asset.footprint, np.full(len(asset.footprint), z)]) for z in column])
    lowest = asset.distance(stacked).reshape(60, -1).min(axis=0)
    assert lowest.max() < 0.0015  # tight: no point of it is far from the object
    furthest = np.sqrt((asset.footprint**2).sum(axis=1)).max()
    assert furthest <= asset.radius <= furthest + 0.003
    assert not asset.footprint.flags.writeable


def test_the_gripper_can_close_on_it_and_five_fit_on_the_table(asset: ObjectAsset) -> None:
    vertices, _, _ = read_visual(asset.visual)
    assert asset.radius < 0.11
    assert 0.045 < np.ptp(vertices[:, 0]) < 0.19
    assert np.ptp(vertices[:, 2]) >= 0.011


@pytest.fixture(scope="module")
def alone() -> Iterator[GraspEnv]:
    """One object on the table, to be taken by any part."""
    env = GraspEnv(Task("alone", "", tuple(map(Goal, OBJECTS)), objects=(1, 1)), camera="overhead")
    yield env
    env.close()


@pytest.mark.parametrize("name", OBJECTS)
def test_the_oracle_grasps_it_and_a_grasp_beside_it_lifts_nothing(alone: GraspEnv, name: str) -> None:
    alone.reset(seed=1, options={"goal": list(OBJECTS).index(name)})
    grasp, score = alone.oracle()
    assert score > 0.3
    beside = dataclasses.replace(grasp, u=grasp.u + 60 if grasp.u < WORKSPACE.columns / 2 else grasp.u - 60)
    assert alone.attempt(beside).reason == "nothing lifted"
    assert alone.attempt(alone.oracle()[0]).success


def test_it_rests_where_it_says(asset: ObjectAsset) -> None:
    position, tilt = settle(asset, lift=0.001)
    assert tilt < 3
    assert np.hypot(position[0], position[1]) < 0.002
    assert abs(position[2] - asset.rest_height) < 0.0005


def test_resting_is_not_given_to_any_pose() -> None:
    position, tilt = settle(load("mug"), lift=0.02, tilt=1.2)
    assert tilt > 3
    assert abs(position[2] - load("mug").rest_height) > 0.0005


def test_its_inertial_frame_is_the_object_frame_and_its_colours_are_drawn() -> None:
    client = pybullet.connect(pybullet.DIRECT)
    try:
        lion = load("lion")
        visual = pybullet.createVisualShape(pybullet.GEOM_MESH, fileName=str(lion.visual), physicsClientId=client)
        hulls = pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=str(lion.collision), physicsClientId=client)
        body = pybullet.createMultiBody(0.08, hulls, visual, physicsClientId=client)
        offset = pybullet.getDynamicsInfo(body, -1, client)[3]
        view = pybullet.computeViewMatrix([0, 0, 5], [0, 0, 0], [0, 1, 0])
        frame = pybullet.computeProjectionMatrix(-0.1, 0.1, -0.1, 0.1, 4.8, 5.2)

        def hues() -> NDArray[np.float64]:
            image = pybullet.getCameraImage(
                64, 64, view, frame, renderer=pybullet.ER_TINY_RENDERER, physicsClientId=client
            )
            pixels = np.reshape(image[2], (64, 64, 4))[..., :3].astype(float)
            seen = pixels[np.reshape(image[4], (64, 64)) == body]
            return seen / np.maximum(seen.max(axis=1, keepdims=True), 1)

        natural = hues()
        pybullet.changeVisualShape(body, -1, textureUniqueId=-1, rgbaColor=[0, 0, 1, 1], physicsClientId=client)
        blue = hues()
    finally:
        pybullet.disconnect(client)
    assert np.abs(offset).max() < 1e-9
    for colour in ("sand", "mane"):
        wanted = np.array(COLOURS[colour]) / max(COLOURS[colour])
        assert (np.abs(natural - wanted).max(axis=1) < 0.06).sum() > 30, colour
    assert (blue[:, :2] < 0.05).all()


def test_load_is_cached_and_an_unknown_name_gets_the_nearest() -> None:
    assert load("mug") is load("mug")
    with pytest.raises(ValueError, match="no object 'hipo'; did you mean 'hippo'"):
        load("hipo")


def test_a_shape_needs_a_named_part_and_known_colours() -> None:
    with pytest.raises(ValueError, match="at least one named part"):
        Shape((Part(None, SOLIDS["sphere"], "red"),))
    with pytest.raises(ValueError, match="Unknown colour 'puce'"):
        Shape((Part("body", SOLIDS["sphere"], "puce"),))
    with pytest.raises(ValueError, match="Unknown colour 'teal'"):
        Shape((Part("body", SOLIDS["sphere"], "red", (Mark(SOLIDS["box"], "teal"),)),))


def test_a_later_mark_covers_an_earlier_one_and_only_its_piece() -> None:
    marks = (Mark(box((-9, -9, 4), (9, 9, 20)), "white"), Mark(disc((0, 0), 3, 4, 20), "ink"))
    shape = Shape((
        Part("body", box((-8, -8, 0), (8, 8, 10)), "red", marks),
        Part("knob", box((10, -8, 0), (20, 8, 10)), "blue"),
    ))  # fmt: skip
    points = np.array([(0, 0, 10), (6, 0, 10), (6, 0, 2), (15, 0, 10), (8, 0, 9)]) / 1000
    seen = [list(COLOURS)[slot] for slot in shape.colour_at(points)]
    assert seen == ["ink", "white", "red", "blue", "white"]
    assert set(shape.part_at(points)) == {0, 1}
    bare = Shape(tuple(dataclasses.replace(piece, marks=()) for piece in shape.pieces))
    np.testing.assert_array_equal(shape.distance(points), bare.distance(points))


def test_names_are_told_apart_without_capitals() -> None:
    assert len({baked_file(name, ".obj") for name in OBJECTS}) == len(OBJECTS)
    assert {f"bottle-{letter}" for letter in LETTERS} == set(BOTTLES)


def test_baking_writes_the_shipped_bytes(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "tasks.objects.bake", "--out", str(tmp_path), "knife"]
    subprocess.run(command, check=True, cwd=Path(__file__).parents[1], capture_output=True)
    written = sorted(path.name for path in tmp_path.iterdir())
    assert written == ["knife.hulls.obj", "knife.json", "knife.obj", "palette.mtl", "palette.png"]
    for name in written:
        assert (tmp_path / name).read_bytes() == (BAKED / name).read_bytes(), name


def test_baking_names_the_nearest_object() -> None:
    command = [sys.executable, "-m", "tasks.objects.bake", "knive"]
    result = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=False)
    assert result.returncode == 2
    assert "did you mean 'knife'?" in result.stderr


def test_what_ships_is_small_and_complete() -> None:
    suffixes = (".obj", ".hulls.obj", ".json")
    expected = {baked_file(name, suffix).name for name in OBJECTS for suffix in suffixes}
    expected |= {"palette.mtl", "palette.png"}
    assert {path.name for path in BAKED.iterdir()} == expected
    assert sum(path.stat().st_size for path in BAKED.iterdir()) < 4_000_000
