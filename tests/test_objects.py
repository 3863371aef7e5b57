"""Laws of the objects: drawing, mesh, hulls, parts and numbers all say the same thing, and PyBullet agrees.

Each law that compares two descriptions is also aimed at a broken one (mirrored, shifted, parts swapped), which
it must reject.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import ConvexHull, KDTree

from tasks.objects import OBJECTS, ObjectAsset, Part, Shape, load
from tasks.objects.asset import BAKED, PALETTE_SLOTS
from tasks.objects.shape import COLOURS
from tasks.objects.solid import Distance, box, capsule, disc, ellipsoid, plate, ring, sphere, union

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
}

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
}

SOLIDS: dict[str, Distance] = {
    "sphere": sphere((1, 2, 3), 9),
    "ellipsoid": ellipsoid((0, 0, 3), (9, 12, 10)),
    "capsule": capsule((-8, 0, 0), (8, 3, 2), 5),
    "box": box((-9, -5, -3), (9, 5, 8), 2),
    "disc": disc((1, 0), 9, -4, 7, 1),
    "ring": ring((0, 0, 1), 11, 4),
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


def test_ten_objects_have_the_23_parts_of_pick_by_part() -> None:
    assert {name: load(name).parts for name in OBJECTS} == PARTS
    assert sum(len(parts) for parts in PARTS.values()) == 23


@pytest.mark.parametrize("name", SOLIDS)
@given(
    here=st.tuples(*[st.floats(-25, 25)] * 3),
    step=st.tuples(*[st.floats(-3, 3)] * 3),
)
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
    for broken in (vertices * [-1, 1, 1], vertices + np.array([0.003, 0, 0]), vertices * 1.05):
        assert np.abs(asset.distance(broken)).max() > 0.0015


def test_inside_is_the_same_for_the_distance_and_the_mesh(asset: ObjectAsset) -> None:
    vertices, faces, _ = read_visual(asset.visual)
    points = cloud(asset, 300)
    distance = asset.distance(points)
    clear = np.abs(distance) > 0.0008
    assert (distance[clear] < 0).sum() > 15
    np.testing.assert_array_equal(in_mesh(points[clear], vertices, faces), distance[clear] < 0)
    assert (in_mesh(points[clear], vertices * [-1, 1, 1], faces[:, ::-1]) != (distance[clear] < 0)).any()


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


def test_swapped_parts_are_noticed(asset: ObjectAsset) -> None:
    names = asset.parts
    swap = dict(zip(names, [*names[1:], names[0]], strict=True))
    pieces = tuple(
        Part(None if piece.name is None else swap[piece.name], piece.solid, piece.colour)
        for piece in OBJECTS[asset.name].pieces
    )
    assert landmark_errors(asset, Shape(pieces, OBJECTS[asset.name].blend), np.zeros(3)) > 0


def test_part_at_is_in_the_object_frame(asset: ObjectAsset) -> None:
    points = cloud(asset, 2000)
    np.testing.assert_array_equal(asset.part_at(points), asset.shape.part_at(points + asset.centre))
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


def test_a_face_has_the_colour_of_its_piece(asset: ObjectAsset) -> None:
    vertices, faces, slots = read_visual(asset.visual)
    areas = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    weight = np.sqrt((areas**2).sum(axis=1))
    slot = np.array([list(COLOURS).index(piece.colour) for piece in OBJECTS[asset.name].pieces])
    right = slots == slot[OBJECTS[asset.name].piece_at(vertices[faces].mean(axis=1) + asset.centre)]
    # Slivers along a border may fall either way once coordinates are rounded.
    assert weight[right].sum() / weight.sum() > 0.999


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
    for broken in ([hull * [-1, 1, 1] for hull in hulls], [hull * 0.95 for hull in hulls]):
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
    assert 0.08 < np.ptp(vertices[:, 0]) < 0.19
    assert np.ptp(vertices[:, 2]) >= 0.011


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
    expected = {f"{name}{suffix}" for name in OBJECTS for suffix in suffixes} | {"palette.mtl", "palette.png"}
    assert {path.name for path in BAKED.iterdir()} == expected
    assert sum(path.stat().st_size for path in BAKED.iterdir()) < 1_500_000
