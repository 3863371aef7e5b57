"""Laws of a user's meshes: the file, the solid, the look, the parts and the physics all say the same thing.

Whoever passes a file that no object can be made of hears one sentence, and the process lives on.
"""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cloudpickle
import meshes
import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from PIL import Image

from equigrasp.errors import InputError
from tasks import camera
from tasks.arrangement import arrange
from tasks.gripper import reach
from tasks.meshes import MeshObject, bake, mesh, mesh_folder
from tasks.meshes.parts import check_names, from_json, label
from tasks.objects import ObjectAsset
from tasks.oracle import best_grasps, see
from tasks.scene import Client, Scene
from tasks.surface import Visible, surface
from tasks.task import Goal, Task

HAMMER_PARTS = {"handle": "Wood.001", "head": "Steel"}
FUZZ = int(os.environ.get("EQUIGRASP_FUZZ", "48"))


@pytest.fixture(autouse=True, scope="session")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Nobody's own cache is touched, nor trusted."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("EQUIGRASP_CACHE", str(folder))
        yield folder / "objects"


@pytest.fixture(scope="session")
def hammer(tmp_path_factory: pytest.TempPathFactory) -> MeshObject:
    file = meshes.write_hammer(tmp_path_factory.mktemp("hammer"))
    return MeshObject("toy-hammer", file, scale=0.001, parts=HAMMER_PARTS)


@pytest.fixture(scope="session")
def bar(tmp_path_factory: pytest.TempPathFactory) -> MeshObject:
    return MeshObject("bar", meshes.write_textured_bar(tmp_path_factory.mktemp("bar")), mass=0.1)


@pytest.fixture(scope="session", params=["hammer", "bar"])
def own(request: pytest.FixtureRequest) -> MeshObject:
    return request.getfixturevalue(request.param)


def prepared(file: Path, **settings: Any) -> bake.Prepared:
    return bake.prepare(MeshObject("thing", file, **settings)._settings())


def volume(thing: bake.Prepared) -> float:
    """Cubic metres."""
    return float((thing.samples.distances < 0).sum() * thing.samples.step**3)


def extents(thing: bake.Prepared) -> NDArray[np.float64]:
    """Metres."""
    inside = np.argwhere(thing.samples.distances < 0)
    return (np.ptp(inside, axis=0) + 1) * thing.samples.step


def write(folder: Path, shape: trimesh.Trimesh, name: str) -> Path:
    file = folder / name
    shape.export(file)
    return file


def seen_colours(asset: ObjectAsset) -> NDArray[np.float64]:
    """What a camera sees of it from above: the hues of its pixels `(N, 3)`, brightest channel 1."""
    thing = Visible(0, surface(asset), np.array([0.0, 0.0, asset.rest_height]), np.eye(3))
    color, _, owner = camera.shoot([thing], camera.overhead_viewpoint())
    pixels = color[owner == 0].astype(np.float64)
    return pixels / pixels.max(axis=1, keepdims=True)


# What comes out


def test_the_visual_mesh_lies_on_the_files_surface_and_a_shifted_one_does_not(hammer: MeshObject) -> None:
    asset = hammer.load()
    vertices = np.array([line.split()[1:] for line in asset.visual.read_text().splitlines() if line[:2] == "v "], float)

    def furthest(points: NDArray[np.float64]) -> float:
        """From the two boxes that the file holds, whose union's surface is theirs but where they meet."""
        place = (points + asset.centre) * 1000
        # as drawn: the middle of the bounding box at x = 0 and y = 0, and 0.8 mm sunk into the table
        place += [2.0, 0.0, 0.8]
        signed = []
        for low, high in (meshes.HANDLE, meshes.HEAD):
            outside = np.maximum(np.array(low) - place, place - np.array(high))
            signed.append(np.linalg.norm(outside.clip(0), axis=1) + outside.max(axis=1).clip(max=0))
        below = np.abs(place[:, 2] - 0.8)
        return float(np.minimum(np.abs(np.min(signed, axis=0)), below).max())

    assert furthest(vertices) < 1.2
    assert furthest(vertices + np.array([0.003, 0, 0])) > 1.2
    assert furthest(vertices * [-1, 1, 1]) > 1.2
    assert np.abs(asset.distance(vertices)).max() < 0.0008


def test_centre_of_mass_mass_and_footprint_are_those_of_the_boxes(hammer: MeshObject) -> None:
    asset = hammer.load()
    boxes = [meshes.box(*ends) for ends in (meshes.HANDLE, meshes.HEAD)]
    weights = np.array([each.volume for each in boxes])
    centre = weights @ np.array([each.centroid for each in boxes]) / weights.sum() / 1000
    assert asset.centre == pytest.approx(centre - [0.002, 0.0, 0.0008], abs=0.0008)
    assert np.ptp(asset.footprint, axis=0) == pytest.approx([0.124, 0.060], abs=0.002)
    assert asset.mass == 0.08
    assert not asset.footprint.flags.writeable


def test_it_rests_where_it_says(own: MeshObject) -> None:
    asset = own.load()
    bullet = Client()
    scene = Scene(bullet, [asset], arrange([asset], np.random.default_rng(0), 0.01))
    pose = scene.pose(asset.name)
    bullet.disconnect()
    assert abs(pose.position[2] - asset.rest_height) < 0.0005
    assert pose.rotation[2, 2] > np.cos(np.radians(1.5))


def test_parts_are_where_the_file_has_them_and_swapped_ones_are_not(hammer: MeshObject) -> None:
    asset = hammer.load()
    landmarks = {
        "handle": [(-62, 0, 10), (-20, 9, 5), (20, -9, 15)],
        "head": [(50, 30, 10), (50, -30, 20), (62, 0, 15)],
    }
    for part, points in landmarks.items():
        found = asset.part_at(np.array(points) / 1000 - asset.centre)
        assert [asset.parts[index] for index in found] == [part] * 3
    assert asset.part_at(np.array([[0.0, 0.0, 0.2]])).tolist() == [-1]
    assert asset.part_at(np.empty((0, 3))).shape == (0,)


def test_colours_and_textures_are_those_of_the_file(hammer: MeshObject, bar: MeshObject) -> None:
    brown, grey = np.array([2, 1, 1 / 3]) / 2, np.ones(3)
    hues = seen_colours(hammer.load())
    assert (np.abs(hues - brown).max(axis=1) < 0.05).sum() > 100
    assert (np.abs(hues - grey).max(axis=1) < 0.05).sum() > 80
    hues = seen_colours(bar.load())
    red, blue = (hues[:, 0] == 1) & (hues[:, 2] < 0.2), (hues[:, 2] == 1) & (hues[:, 0] < 0.2)
    assert red.mean() == pytest.approx(0.5, abs=0.05)
    assert blue.mean() == pytest.approx(0.5, abs=0.05)


def test_the_oracle_picks_it_and_its_parts(hammer: MeshObject, bar: MeshObject) -> None:
    assets = [hammer.load(), bar.load()]
    bullet, goals = Client(), [Goal("toy-hammer", "handle"), Goal("toy-hammer", "head"), Goal("bar")]
    right = 0
    for seed in range(4):
        scene = Scene(bullet, assets, arrange(assets, np.random.default_rng(seed), 0.012))
        for goal in goals:
            view, owner = camera.overhead(scene.visible())
            [(grasp, _)] = best_grasps(see(scene, goal, view, owner))
            lifted, touched = scene.grasp(reach(grasp, view))
            scene.put_down()
            parts = touched.get(goal.object, [])
            right += lifted == [goal.object] and (goal.part is None or 2 * parts.count(goal.part) >= len(parts))
    bullet.disconnect()
    assert right >= 11


# Formats and damage


@pytest.mark.parametrize("name", ["m.obj", "m.stl", "m.ply", "m.glb", "m.gltf"])
def test_all_formats_say_the_same(name: str, tmp_path: Path) -> None:
    shape = meshes.hammer()
    if name.endswith("gltf"):
        for part, content in trimesh.Scene(shape).export(file_type="gltf").items():
            (tmp_path / part.replace("model.gltf", name)).write_bytes(content)
        file = tmp_path / name
    else:
        file = write(tmp_path, shape, name)
    thing = prepared(file, scale=0.001, up="z")
    assert volume(thing) == pytest.approx(36000e-9 + 37440e-9, rel=0.05)
    assert extents(thing) == pytest.approx([0.124, 0.060, 0.0252], abs=0.0025)


def test_a_urdf_puts_its_shapes_together(tmp_path: Path) -> None:
    write(tmp_path, meshes.box(*meshes.HANDLE), "handle.stl")
    body = (
        meshes.link("wood", '<mesh filename="package://r/handle.stl" scale="0.001 0.001 0.001"/>')
        + meshes.link("steel", '<box size="0.024 0.06 0.026"/>', '<origin xyz="0 0 0.013"/>')
        + '<joint name="j" type="fixed"><parent link="wood"/><child link="steel"/>'
        '<origin xyz="0.052 0 0"/></joint>'
    )
    file = meshes.write_urdf(tmp_path, body)
    thing = prepared(file, parts=["wood", "steel"])
    assert volume(thing) == pytest.approx(73440e-9, rel=0.05)
    assert {"wood", "steel"} <= set(thing.source.all_names)
    turned = body.replace('xyz="0.052 0 0"', 'xyz="0.052 0 0" rpy="0 0 1.5708"')
    assert extents(prepared(meshes.write_urdf(tmp_path, turned)))[1] < 0.04


DAMAGE: dict[str, Callable[[trimesh.Trimesh], trimesh.Trimesh]] = {
    "inside out": lambda m: trimesh.Trimesh(m.vertices, m.faces[:, ::-1], process=False),
    "one face turned": lambda m: trimesh.Trimesh(
        m.vertices, np.concatenate([m.faces[:1, ::-1], m.faces[1:]]), process=False
    ),
    "every face twice, back to back": lambda m: trimesh.Trimesh(
        m.vertices, np.concatenate([m.faces, m.faces[:, ::-1]]), process=False
    ),
    "corners apart": lambda m: trimesh.Trimesh(
        m.vertices[m.faces].reshape(-1, 3), np.arange(3 * len(m.faces)).reshape(-1, 3), process=False
    ),
    "a small hole": lambda m: trimesh.Trimesh(m.vertices, m.faces[1:], process=False),
    "degenerate faces": lambda m: trimesh.Trimesh(
        m.vertices, np.concatenate([m.faces, np.zeros((5, 3), int)]), process=False
    ),
    "another inside it": lambda m: meshes.joined(m, trimesh.Trimesh(m.vertices * 0.6, m.faces[:, ::-1], process=False)),
    "in two that overlap": lambda m: meshes.joined(trimesh.creation.capsule(60, 18), trimesh.creation.capsule(59, 18)),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_not_watertight_is_mended(damage: str, tmp_path: Path) -> None:
    sound = trimesh.creation.capsule(60, 18)
    thing = prepared(write(tmp_path, DAMAGE[damage](sound), "m.stl"), scale=0.001)
    assert volume(thing) == pytest.approx(sound.volume * 1e-9, rel=0.05)


def test_a_cup_stays_hollow_and_a_lid_makes_it_solid(tmp_path: Path) -> None:
    """A cavity that one can reach is kept, one that nothing can reach is filled."""
    outer, inner = trimesh.creation.cylinder(35, 80), trimesh.creation.cylinder(30, 70)
    closed = meshes.joined(outer, trimesh.Trimesh(inner.vertices, inner.faces[:, ::-1], process=False))
    assert volume(prepared(write(tmp_path, closed, "closed.stl"), scale=0.0009)) == pytest.approx(
        outer.volume * 0.0009**3, rel=0.05
    )
    profile = [[0, 0], [35, 0], [35, 80], [31, 80], [31, 5], [0, 5]]
    cup = trimesh.creation.revolve(np.array(profile, float), sections=48)
    assert volume(prepared(write(tmp_path, cup, "cup.stl"), scale=0.001)) == pytest.approx(cup.volume * 1e-9, rel=0.05)
    assert cup.volume < 0.4 * outer.volume


# How it lies


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
def test_the_named_axis_points_up(up: str, tmp_path: Path) -> None:
    # a peg on a plate: the peg is where up is
    plate, peg = meshes.box((-30, -20, 0), (30, 20, 10)), meshes.box((-6, -6, 10), (6, 6, 40))
    shape = meshes.joined(plate, peg)
    to = {"x": [0, 90], "-x": [0, -90], "y": [-90, 0], "-y": [90, 0], "z": [0, 0], "-z": [180, 0]}[up]
    turn = trimesh.transformations.euler_matrix(*np.radians([*to, 0]))
    thing = prepared(write(tmp_path, shape.apply_transform(turn), "m.stl"), scale=0.001, up=up)
    layers = (thing.samples.distances < 0).sum(axis=(0, 1))
    layers = layers[layers > 0]
    assert layers[1] > 8 * layers[-2]
    assert extents(thing)[2] == pytest.approx(0.0392, abs=0.0025)


def test_at_rest_a_plank_lies_down_and_always_the_same_way(tmp_path: Path) -> None:
    file = write(tmp_path, meshes.box((0, 0, 0), (20, 50, 90)), "m.stl")
    assert extents(prepared(file, scale=0.001))[2] == pytest.approx(0.0892, abs=0.0025)
    lying = [prepared(file, scale=0.001, pose="rest") for _ in range(2)]
    assert extents(lying[0])[2] == pytest.approx(0.0192, abs=0.0025)
    np.testing.assert_array_equal(lying[0].samples.distances, lying[1].samples.distances)


def test_what_falls_over_is_refused(tmp_path: Path) -> None:
    leaning = meshes.joined(meshes.box((0, -8, 0), (12, 8, 20)), meshes.box((0, -8, 20), (30, 8, 60)))
    file = write(tmp_path, leaning, "m.stl")
    with pytest.raises(InputError, match="does not stand with z up; pass pose='rest'"):
        bake.bake_mesh(MeshObject("m", file, scale=0.001)._settings(), tmp_path)


# Parts


def labelled(tmp_path: Path, parts: Any) -> list[str | None]:
    """The parts at the end of the handle, its middle and the head, by the labels' own function."""
    file = meshes.write_hammer(tmp_path)
    if not isinstance(parts, (list, dict)):
        (tmp_path / "hammer.parts.json").write_text(parts)
        parts = None
    settings = MeshObject("h", file, scale=0.001, parts=parts)._settings()
    given = from_json(settings["parts"], file.name)
    source = bake.prepare(settings).source
    points = np.array([[-60.0, 0, 10], [0, 0, 20], [64, 0, 13]])
    face = np.array([0, 4, 12 + 8])
    check_names(given, source, file.name)
    labels = label(given, source, face, points, file.name)
    return [given[index].name if index >= 0 else None for index in labels]


def test_parts_by_names_boxes_faces_and_the_rest(tmp_path: Path) -> None:
    assert labelled(tmp_path, HAMMER_PARTS) == ["handle", "handle", "head"]
    assert labelled(tmp_path, {"grip": "brown", "metal": ["grey"]}) == ["grip", "grip", "metal"]
    box = '[{"name": "end", "box": [[-50, 20, 30], [-70, -20, -10]]}'
    assert labelled(tmp_path, box + "]") == ["end", None, None]
    assert labelled(tmp_path, box + ', {"name": "body"}]') == ["end", "body", "body"]
    faces = '{"parts": [{"name": "tip", "faces": [0, 1]}, {"name": "head", "group": "Steel"}]}'
    assert labelled(tmp_path, faces) == ["tip", None, "head"]


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({"handle": "Wood.01"}, "no object, group or material for the part 'handle'.*did you mean 'Wood.001'"),
        (["Steel"], "'Steel' cannot be said in an instruction"),
        ('[{"name": "a", "box": [[0,0,0],[1,1,1]]}, {"name": "a"}]', "two parts are called 'a'"),
        ('[{"name": "a", "box": [[900,0,0],[901,1,1]]}]', "part 'a' has none of the surface"),
        ('[{"name": "a", "box": [[0,0],[1,1,1]]}]', "a box of 'a' is two corners"),
        ('[{"name": "a", "sphere": 3}]', "a part has the key 'sphere'"),
        ('[{"name": "a", "faces": [24]}]', "the faces 0 to 23, but the part 'a' has 24"),
        ('[{"name": "a"}, {"name": "b"}]', "only one part may have all"),
        ("no json", "is no JSON"),
        ("3", "is a list of parts"),
    ],
)
def test_wrong_parts_are_named(parts: Any, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        labelled(tmp_path, parts)


# Mistakes


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"name": "My Mug"}, "lower-case words joined by hyphens"),
        ({"scale": 0}, "scale of 'm' is a number above 0, not 0"),
        ({"scale": -1.0}, "scale of 'm' is a number above 0"),
        ({"scale": float("nan")}, "scale of 'm' is a number above 0"),
        ({"mass": 80}, "80 kg, and above 0.3 kg some shapes slip from the fingers as they lift; pass a mass"),
        ({"up": "w"}, "up of 'm' is one of x, y, z"),
        ({"pose": "sitting"}, "pose of 'm' is 'up' or 'rest'"),
        ({"color": "reddish"}, "color of 'm' is a name"),
        ({"color": (1.0, 0.0, 0.0)}, "three whole numbers"),
        ({"color": "red", "texture": "hammer.obj"}, "a color and a texture"),
        ({"file": "missing.obj"}, "is not there"),
        ({"file": "look.mtl"}, "no format that is read here"),
        ({"parts": 3}, "parts of 'm' is a list"),
        ({"texture": "missing.png"}, "the texture of 'm' is not there"),
    ],
)
def test_a_wrong_setting_is_refused_at_once(
    settings: dict[str, Any], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    meshes.write_hammer(tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=words):
        MeshObject(**{"name": "m", "file": "hammer.obj", **settings})  # ty: ignore[invalid-argument-type]


def test_numbers_may_be_numpys(tmp_path: Path) -> None:
    """They become plain ones, so that the checksum of the settings is that of plain ones too."""
    file = meshes.write_hammer(tmp_path)
    scale: Any = np.float32(0.5) ** 10
    mass: Any = np.float64(0.1)
    channels = np.array([1, 20, 255], dtype=np.uint8)
    colors: list[Any] = [tuple(channels), channels, [1, 20, 255]]
    plain = MeshObject("m", file, scale=0.5**10, mass=0.1, color=(1, 20, 255))
    for color in colors:
        own = MeshObject("m", file, scale=scale, mass=mass, color=color)
        assert own == plain
        assert repr(own) == repr(plain)
        assert own.fingerprint() == plain.fingerprint()
    none: list[Any] = [np.float32("nan"), np.bool_(True), "1", None]
    for wrong in none:
        with pytest.raises(InputError, match="scale of 'm' is a number above 0"):
            MeshObject("m", file, scale=wrong)


CUBE = meshes.obj_text({"cube": meshes.box((0, 0, 0), (40, 40, 40))})
WRONG: dict[str, tuple[str, str | bytes, str]] = {
    "empty": ("m.obj", "", "holds no faces"),
    "points only": ("m.obj", "v 0 0 0\nv 1 1 1\n", "holds no faces"),
    "no vertex": ("m.obj", CUBE + "f 1 2 99\n", "line 22.*there is no vertex 99"),
    "NaN": ("m.obj", CUBE.replace("v 0.0", "v nan", 1), "no numbers or infinite"),
    "infinite": ("m.obj", CUBE.replace("v 0.0", "v inf", 1), "no numbers or infinite"),
    "flat": ("m.obj", "v 0 0 0\nv 40 0 0\nv 0 40 0\nf 1 2 3\n", "is flat"),
    "a line": ("m.obj", "v 0 0 0\nv 40 0 0\nv 80 9 9\nf 1 2 2\n", "flat|area"),
    "an open sheet": (
        "m.obj",
        "v 0 0 0\nv 60 0 0\nv 60 60 30\nv 0 60 30\nf 1 2 3\nf 1 3 4\n",
        "is open|encloses no volume",
    ),
    "outside": ("m.obj", "mtllib ../secret.mtl\n" + CUBE, "outside its own folder"),
    "absolute": ("m.obj", "mtllib /etc/passwd\n" + CUBE, "outside its own folder"),
    "no material": ("m.obj", "mtllib gone.mtl\n" + CUBE, "names the material file 'gone.mtl', which is not there"),
    "cut STL": ("m.stl", meshes.stl(*(lambda b: (b.vertices, b.faces))(meshes.hammer()))[:500], "copy it again"),
    "cut GLB": ("m.glb", trimesh.Scene(meshes.hammer()).export(file_type="glb")[:900], "is cut short"),
    "no GLB": ("m.glb", b"PK\3\4 something else altogether", "is no GLB"),
    "no glTF": ("m.gltf", "[]", "no glTF"),
    "glTF outside": ("m.gltf", '{"buffers": [{"uri": "../../secret.bin"}]}', "outside its own folder"),
    "glTF from the net": ("m.gltf", '{"buffers": [{"uri": "https://example.org/a.bin"}]}', "outside its own folder"),
    "no PLY": ("m.ply", b"plywood", "is no PLY"),
    "boastful PLY": ("m.ply", "ply\nformat ascii 1.0\nelement vertex 99999999999\nend_header\n", "header says"),
    "no XML": ("m.urdf", "<robot", "no sound URDF"),
    "no robot": ("m.urdf", "<html/>", "no URDF"),
    "entities": ("m.urdf", '<!DOCTYPE r [<!ENTITY a "a">]><robot/>', "document type"),
    "missing mesh": (
        "m.urdf",
        "<robot>" + meshes.link("a", "<mesh filename='gone.stl'/>") + "</robot>",
        "names the mesh 'gone.stl', which is not there",
    ),
    "a circle": (
        "m.urdf",
        "<robot><link name='a'/><link name='b'/>"
        + "".join(f"<joint name='{p}'><parent link='{p}'/><child link='{c}'/></joint>" for p, c in ("ab", "ba"))
        + "</robot>",
        "run in a circle",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_file_of_no_use_gets_one_clear_sentence(case: str, tmp_path: Path) -> None:
    name, content, words = WRONG[case]
    file = tmp_path / name
    file.write_bytes(content.encode() if isinstance(content, str) else content)
    thing = MeshObject("m", file, scale=0.001)
    with pytest.raises(InputError, match=words) as caught:
        bake.prepare(thing._settings())
    assert "\n" not in str(caught.value)


def test_the_sentence_comes_through_from_the_process_that_bakes(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which imports nothing of the user's own folder, whatever the files there are called."""
    file = tmp_path / "m.stl"
    file.write_bytes(b"nothing of the kind")
    (tmp_path / "tasks").mkdir()
    for name in ("tasks/__init__", "copy", "runpy", "trimesh"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('somebody else')\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match=r"m\.stl is no sound STL: it is shorter than its header"):
        MeshObject("m", file).load()
    assert not list(cache.glob(".partial-*"))


@pytest.mark.parametrize(
    ("scale", "words"),
    [
        (1.0, "too large|the most that fits.*pass scale=0.001 if it is in millimetres"),
        (0.05, "the most that fits.*pass scale=0.0"),
        (1e-5, "too small to be grasped; pass scale=0.0"),
    ],
)
def test_a_wrong_scale_is_told_the_right_one(scale: float, words: str, tmp_path: Path) -> None:
    file = write(tmp_path, meshes.hammer(), "m.stl")
    with pytest.raises(InputError, match=words) as caught:
        prepared(file, scale=scale)
    told = float(str(caught.value).split("scale=")[1].split()[0])
    assert volume(prepared(file, scale=told)) > 0


def test_what_the_hand_cannot_hold_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, meshes.box((0, 0, 0), (100, 100, 100)), "m.stl")
    with pytest.raises(InputError, match="can be grasped nowhere"):
        prepared(file, scale=0.001)
    assert prepared(file, scale=0.0006)


def test_a_texture_needs_texture_coordinates(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (0, 200, 0)).save(tmp_path / "green.png")
    file = write(tmp_path, meshes.hammer(), "m.stl")
    with pytest.raises(InputError, match="no texture coordinates"):
        prepared(file, scale=0.001, texture=tmp_path / "green.png")


# Kept, and carried about


def test_a_mesh_is_baked_once(hammer: MeshObject, monkeypatch: pytest.MonkeyPatch) -> None:
    first = hammer.load()
    assert hammer.load() is first
    monkeypatch.setattr(mesh, "_loaded", {})
    monkeypatch.setattr(mesh, "_bake_apart", lambda *_: pytest.fail("it was baked twice"))
    again = replace(hammer, name="another").load()
    assert (again.name, again.visual) == ("another", first.visual)
    np.testing.assert_array_equal(again.footprint, first.footprint)


def test_other_contents_and_settings_are_other_objects(tmp_path: Path) -> None:
    file = meshes.write_hammer(tmp_path)
    thing = MeshObject("h", file, scale=0.001)

    def key(each: MeshObject) -> str:
        return each._checksum(each._settings())

    keys = [key(thing), key(replace(thing, scale=0.0011)), key(replace(thing, color="red"))]
    (tmp_path / "look.mtl").write_text("newmtl brown\nKd 0 0 1\nnewmtl grey\nKd 0.5 0.5 0.5\n")
    keys.append(key(thing))
    file.write_text(file.read_text().replace("v 64.0", "v 66.0"))
    keys.append(key(thing))
    assert len(set(keys)) == 5
    assert key(thing) == keys[-1]


def fake_bake(settings: dict[str, Any], out: Path) -> None:
    for name in mesh._FILES:
        (out / name).write_text(f"{name} of {settings['file']}")


def test_a_row_is_known_by_its_meshes_content_and_not_by_their_place(tmp_path: Path) -> None:
    def known_by(file: Path, name: str = "toy-hammer", scale: float = 0.001, **settings: Any) -> str:
        own = MeshObject(name, file, scale=scale, **settings)
        return Task("mine", "mine/Mine-v0", (Goal(name), Goal("fork")), objects=(2, 2), own=(own,)).fingerprint()

    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
    here, there = (meshes.write_hammer(tmp_path / folder) for folder in ("here", "there"))
    first = known_by(here)
    assert known_by(there) == first
    others = [known_by(here, scale=0.0011), known_by(here, mass=0.1), known_by(here, parts=HAMMER_PARTS)]
    others.append(known_by(here, name="mallet"))
    here.with_name("look.mtl").write_text("newmtl brown\nKd 0 1 0\nnewmtl grey\nKd 0.5 0.5 0.5\n")
    others.append(known_by(here))
    there.with_name("hammer.parts.json").write_text('[{"name": "all"}]')
    others.append(known_by(there))
    there.with_name("hammer.parts.json").unlink()
    assert known_by(there) == first
    there.write_text(there.read_text().replace("40.0", "44.0"))
    others.append(known_by(there))
    assert len({first, *others}) == 1 + len(others)


def test_what_a_killed_bake_left_is_swept_and_one_at_work_is_not(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh, "_bake_apart", fake_bake)
    left, at_work = (cache / f".partial-{name}" for name in ("left", "at-work"))
    for folder in (left, at_work):
        folder.mkdir(parents=True)
        (folder / "object.obj").write_text("half")
    for folder, age in ((left, 3700.0), (at_work, mesh._LONGEST)):
        os.utime(folder, (time.time() - age, time.time() - age))
    mesh._baked({"file": "a"}, "swept")
    assert not left.exists()
    assert (at_work / "object.obj").exists()
    shutil.rmtree(at_work)


def test_two_at_once_both_end_right(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    together = threading.Barrier(2, timeout=60)

    def slow_bake(settings: dict[str, Any], out: Path) -> None:
        fake_bake(settings, out)
        together.wait()

    monkeypatch.setattr(mesh, "_bake_apart", slow_bake)
    folders: list[Path] = []
    threads = [threading.Thread(target=lambda: folders.append(mesh._baked({"file": "a"}, "two"))) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert folders == [cache / "two"] * 2
    assert mesh._whole(cache / "two")
    assert not list(cache.glob(".partial-*"))


def test_a_damaged_entry_is_made_again(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh, "_bake_apart", fake_bake)
    folder = mesh._baked({"file": "b"}, "damaged")
    (folder / "object.npz").write_text("")
    assert not mesh._whole(folder)
    assert mesh._whole(mesh._baked({"file": "b"}, "damaged"))


@pytest.mark.parametrize("end", ["kill -ABRT $$", "exit 1"])
def test_a_crash_of_native_code_is_a_sentence(
    end: str, tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "crash"
    program.write_text(f"#!/bin/sh\necho 'deep trouble' >&2\n{end}\n")
    program.chmod(0o755)
    monkeypatch.setattr(mesh.sys, "executable", str(program))
    with pytest.raises(InputError, match=r"m.obj could not be baked \((signal 6|exit code 1): deep trouble\)"):
        mesh._baked({"file": "m.obj"}, "crash")
    assert not list(cache.glob("*crash*"))
    assert not list(cache.glob(".partial-*"))


def test_a_missing_extra_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mesh.importlib.util, "find_spec", lambda name: None if name == "igl" else object())
    with pytest.raises(InputError, match=r"needs libigl; install the extra: pip install -e '\.\[bake\]'"):
        MeshObject("m", write(tmp_path, meshes.box((0, 0, 0), (31, 32, 33)), "m.stl"), scale=0.001).load()


def test_it_travels_to_other_processes(hammer: MeshObject) -> None:
    copy = cloudpickle.loads(cloudpickle.dumps(hammer))
    assert copy == hammer
    assert hash(copy) == hash(hammer)
    asset = hammer.load()
    asset.distance(np.zeros((1, 3)))
    travelled = cloudpickle.loads(cloudpickle.dumps(asset))
    assert len(cloudpickle.dumps(asset.shape)) < 2000
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (50, 3))
    np.testing.assert_array_equal(travelled.distance(points), asset.distance(points))
    np.testing.assert_array_equal(travelled.part_at(points), asset.part_at(points))


# Folders


def tree(folder: Path, *files: str) -> None:
    for name in files:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(CUBE)


def test_ycb_and_graspnet_have_their_layouts(tmp_path: Path) -> None:
    tree(
        tmp_path / "ycb",
        "003_cracker_box/google_16k/textured.obj",
        "003_cracker_box/tsdf/textured.obj",
        "065-a_cups/tsdf/textured.obj",
        "011_banana/textured_simple.obj",
        "011_banana/textured.obj",
    )
    objects = mesh_folder(tmp_path / "ycb", mass=0.2)
    assert list(objects) == ["banana", "cracker-box", "cups-a"]
    assert Path(objects["cracker-box"].file).parent.name == "google_16k"
    assert Path(objects["banana"].file).name == "textured_simple.obj"
    assert objects["banana"].mass == 0.2
    tree(tmp_path / "net/models", "000/textured.obj", "000/nontextured.ply", "001/nontextured.ply")
    assert list(mesh_folder(tmp_path / "net")) == ["graspnet-000", "graspnet-001"]
    (tmp_path / "net/names.json").write_text('{"000": "cracker-box"}')
    assert list(mesh_folder(tmp_path / "net")) == ["cracker-box", "graspnet-001"]


def test_a_plain_folder(tmp_path: Path) -> None:
    tree(tmp_path, "My Mug.obj", "My Mug.stl", "spoon.ply", "cup/model.obj", "cup/model.mtl", "notes/readme.txt")
    objects = mesh_folder(tmp_path, scale=0.001)
    assert list(objects) == ["cup", "my-mug", "spoon"]
    assert Path(objects["my-mug"].file).suffix == ".obj"
    (tmp_path / "mug.urdf").write_text("<robot>" + meshes.link("a", "<mesh filename='My Mug.obj'/>") + "</robot>")
    assert [Path(each.file).name for each in mesh_folder(tmp_path).values()] == [
        "model.obj",
        "mug.urdf",
        "My Mug.stl",
        "spoon.ply",
    ]


@pytest.mark.parametrize(
    ("files", "names", "words"),
    [
        ([], None, "holds no meshes"),
        (["a b.obj", "a-b.obj"], None, "would both be called 'a-b'"),
        (["a.obj"], '{"b": "mug"}', "names 'b', but there is no such object"),
        (["a.obj"], "[]", "is an object of names"),
    ],
)
def test_a_folder_that_cannot_be_read_is_explained(
    files: list[str], names: str | None, words: str, tmp_path: Path
) -> None:
    tree(tmp_path, *files)
    if names is not None:
        (tmp_path / "names.json").write_text(names)
    with pytest.raises(InputError, match=words):
        mesh_folder(tmp_path)


def test_no_folder_is_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no folder"):
        mesh_folder(tmp_path / "nowhere")


# Anything at all


def test_any_file_ends_in_an_object_or_a_sentence(tmp_path: Path) -> None:
    """EQUIGRASP_FUZZ says how many files; every 25th that may become an object is baked to the end."""
    legal, baked, sentences = 0, 0, []
    for index in range(FUZZ):
        file, scale = meshes.malformed(index, tmp_path)
        thing = MeshObject("thing", file, scale=scale)
        try:
            samples = bake.prepare(thing._settings()).samples
            assert np.isfinite(samples.distances).all(), index
            assert (samples.distances < 0).sum() >= 20, index
            legal += 1
            if legal % 25 == 0:
                assert thing.load().radius < 0.3, index
                baked += 1
        except InputError as error:
            sentences.append(str(error))
        file.unlink()
    assert 0 < legal < FUZZ
    assert not [sentence for sentence in sentences if "\n" in sentence or len(sentence) > 400]
    print(f"{FUZZ} files: {legal} sampled, {baked} baked to the end, {len(sentences)} refused")
