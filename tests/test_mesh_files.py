"""What a mesh's files say: read alike however they are spelt, and read anew whenever one of them is written anew."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshes
import numpy as np
import pytest
import trimesh
from PIL import Image

from equigrasp.errors import InputError
from tasks.meshes import MeshObject, formats, mesh
from tasks.meshes.source import Source

# Written anew


def write_mug(folder: Path) -> None:
    """mug.obj with materials and a texture, a URDF of it, labels, and a texture to pass."""
    (folder / "look.mtl").write_text("newmtl glaze\nmap_Kd glaze.png\nnewmtl clay\nKd 0.5 0.5 0.5\n")
    for name in ("glaze.png", "other.png"):
        Image.new("RGB", (4, 4), (0, 200, 0)).save(folder / name)
    shapes = {"handle": meshes.box(*meshes.HANDLE), "body": meshes.box(*meshes.HEAD)}
    (folder / "mug.obj").write_text(meshes.obj_text(shapes, {"handle": "glaze", "body": "clay"}))
    meshes.write_urdf(folder, meshes.link("mug", '<mesh filename="mug.obj" scale="0.001 0.001 0.001"/>'))
    for name in ("mug.parts.json", "labels.json"):
        (folder / name).write_text('[{"name": "handle", "groups": ["handle"]}]')


def edit(name: str, old: str, new: str) -> Callable[[Path], Any]:
    return lambda folder: (folder / name).write_text((folder / name).read_text().replace(old, new))


def repaint(name: str) -> Callable[[Path], None]:
    return lambda folder: Image.new("RGB", (4, 4), (200, 0, 0)).save(folder / name)


OTHER_MATERIAL = edit("look.mtl", "Kd 0.5", "Kd 0.9")
OTHER_CORNER = edit("mug.obj", "v 64.0", "v 66.0")
OTHER_LABEL = '[{"name": "grip", "groups": ["handle"]}]'
EDITS: dict[str, tuple[dict[str, Any], Callable[[Path], Any]]] = {
    "the mesh": ({}, OTHER_CORNER),
    "its materials": ({}, OTHER_MATERIAL),
    "their texture": ({}, repaint("glaze.png")),
    "the texture that was passed": ({"texture": "other.png"}, repaint("other.png")),
    "the labels beside it": ({}, lambda folder: (folder / "mug.parts.json").write_text(OTHER_LABEL)),
    "no labels beside it any more": ({}, lambda folder: (folder / "mug.parts.json").unlink()),
    "labels elsewhere": ({"parts": "labels.json"}, lambda folder: (folder / "labels.json").write_text(OTHER_LABEL)),
    "labels beside a URDF": (
        {"file": "robot.urdf"},
        lambda folder: (folder / "robot.parts.json").write_text('[{"name": "all", "groups": ["mug"]}]'),
    ),
    "a URDF's mesh": ({"file": "robot.urdf"}, OTHER_CORNER),
    "the materials of a URDF's mesh": ({"file": "robot.urdf"}, OTHER_MATERIAL),
}


@pytest.mark.parametrize("what", EDITS)
def test_what_is_written_anew_is_loaded_anew_and_nothing_else_is(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings, change = EDITS[what]
    write_mug(tmp_path)
    monkeypatch.chdir(tmp_path)
    # baking takes seconds; the checksum that it is asked for stands for what comes of it
    asked: list[str] = []
    monkeypatch.setattr(mesh, "_loaded", {})
    monkeypatch.setattr(mesh, "_baked", lambda _, key: asked.append(key) or Path(key))
    monkeypatch.setattr(MeshObject, "_asset", lambda _, folder: folder)

    def made() -> MeshObject:
        given: dict[str, Any] = {"name": "mug", "file": "mug.obj", **settings}
        return MeshObject(**given)

    thing = made()
    before = thing.load()
    assert thing.load() is before
    assert made().load() is before
    change(tmp_path)
    after = thing.load()
    assert after != before
    assert made().load() is after
    assert asked == [str(before), str(after)]


def test_a_mesh_that_is_gone_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_mug(tmp_path)
    monkeypatch.setattr(mesh, "_loaded", {})
    monkeypatch.setattr(mesh, "_baked", lambda _, key: Path(key))
    monkeypatch.setattr(MeshObject, "_asset", lambda _, folder: folder)
    thing = MeshObject("mug", tmp_path / "mug.obj")
    thing.load()
    (tmp_path / "mug.obj").unlink()
    with pytest.raises(InputError, match="there is no file"):
        thing.load()


def test_what_was_deleted_or_damaged_where_baked_meshes_are_kept_is_baked_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the same process too, which has loaded it before."""
    write_mug(tmp_path)
    kept = tmp_path / "cache"
    baked: list[str] = []

    def bake(settings: dict[str, Any], out: Path) -> None:
        baked.append(settings["file"])
        for name in mesh._FILES:
            (out / name).write_text(name)

    monkeypatch.setenv("EQUIGRASP_CACHE", str(kept))
    monkeypatch.setattr(mesh, "_loaded", {})
    monkeypatch.setattr(mesh, "_bake_apart", bake)
    monkeypatch.setattr(MeshObject, "_asset", lambda _, folder: (folder, len(baked)))
    thing = MeshObject("mug", tmp_path / "mug.obj")
    folder, _ = thing.load()  # ty: ignore[not-iterable]
    for count, spoil in enumerate(
        (
            lambda: None,
            lambda: shutil.rmtree(kept),
            lambda: (folder / "object.png").unlink(),
            lambda: (folder / "object.obj").write_text("cut"),
        ),
        start=1,
    ):
        spoil()
        assert thing.load() == (folder, count)
        assert thing.load() is thing.load()
        assert all((folder / name).read_text() == name for name in mesh._FILES)


# STL


def ascii_stl() -> str:
    text = meshes.hammer().export(file_type="stl_ascii")
    assert isinstance(text, str)
    return text


def mixed(text: str) -> str:
    """A letter in upper case after each that is not, as in "sOlId" or "eNdFaCeT"."""
    return re.sub(r"([a-z])([a-z])", lambda pair: pair[1] + pair[2].upper(), text)


@pytest.mark.parametrize("spelt", [str.lower, str.upper, mixed])
def test_an_stl_in_text_may_be_in_any_case(spelt: Callable[[str], str], tmp_path: Path) -> None:
    file = tmp_path / "m.stl"
    file.write_text(spelt(ascii_stl()))
    assert_same_mesh(formats.read(file), meshes.hammer())
    file.write_text(spelt(ascii_stl())[:-200])
    with pytest.raises(InputError, match="is cut short: its last line, endsolid, is missing"):
        formats.read(file)
    file.write_text(spelt("solid nothing\nendsolid nothing\n"))
    with pytest.raises(InputError, match="holds no faces"):
        formats.read(file)


@pytest.mark.parametrize("header", [b"", b"solid", b"solid facet", b"SOLID facet normal endsolid", bytes(range(80))])
def test_a_binary_stl_may_say_anything_in_its_header(header: bytes, tmp_path: Path) -> None:
    hammer = meshes.hammer()
    file = tmp_path / "m.stl"
    file.write_bytes(header.ljust(80) + meshes.stl(hammer.vertices, hammer.faces)[80:])
    assert_same_mesh(formats.read(file), hammer)


def assert_same_mesh(source: Source, shape: trimesh.Trimesh) -> None:
    np.testing.assert_allclose(source.vertices[source.faces], shape.triangles, atol=1e-4)


# OBJ

LINES = "\n".join(["mtllib look.mtl", "o thing", *(f"v {x} {y} 0" for x in (0, 1) for y in (0, 1))])
OBJ = f"{LINES}\nvt 0.25 0.75\nusemtl red\nf 1/1 2/1 3/1\nusemtl dark green\nf 2 4 3\n"
MTL = "newmtl red\nKd 1 0 0\nnewmtl dark green\nKd 0 0.5 0\n"


def read_obj(folder: Path, obj: str, mtl: str = MTL, encoding: str = "utf-8") -> Source:
    (folder / "look.mtl").write_text(mtl, encoding=encoding)
    (folder / "m.obj").write_text(obj, encoding=encoding)
    return formats.read(folder / "m.obj")


def spread(text: str, between: str) -> str:
    """The same lines with something else after each keyword."""
    return "\n".join(line.replace(" ", between, 1) for line in text.split("\n"))


SPELT: dict[str, Callable[[str], str]] = {
    "a tab after the keyword": lambda text: spread(text, "\t"),
    "spaces and tabs after the keyword": lambda text: spread(text, " \t  "),
    "white space around": lambda text: "\n".join(f"\t {line} \t" for line in text.split("\n")),
    "the lines of Windows": lambda text: text.replace("\n", "\r\n"),
    "comments behind numbers": lambda text: "\n".join(
        f"{line} # 1 and so on" if line[:2] in ("v ", "vt", "f ", "Kd") else line for line in text.split("\n")
    ),
}


@pytest.mark.parametrize("how", SPELT)
def test_an_obj_says_the_same_however_it_is_spelt(how: str, tmp_path: Path) -> None:
    plain = read_obj(tmp_path, OBJ)
    assert len(plain.faces) == 2
    assert {"thing", "red", "dark green"} == set(plain.all_names)
    assert plain.colors[:, 0].tolist() == [[255, 0, 0], [0, 127.5, 0]]
    assert_same_source(read_obj(tmp_path, SPELT[how](OBJ), SPELT[how](MTL)), plain)


def test_a_mark_of_byte_order_is_no_part_of_the_first_line(tmp_path: Path) -> None:
    for text in (OBJ, OBJ.partition("o thing\n")[2]):
        plain = read_obj(tmp_path, text)
        assert_same_source(read_obj(tmp_path, text, encoding="utf-8-sig"), plain)


def assert_same_source(one: Source, other: Source) -> None:
    for name in ("vertices", "faces", "colors", "uv", "texture", "group"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.names == other.names


def test_one_line_may_name_several_material_files_or_one_with_spaces(tmp_path: Path) -> None:
    plain = read_obj(tmp_path, OBJ)
    red, green = MTL.split("newmtl dark")
    (tmp_path / "a.mtl").write_text(red)
    (tmp_path / "b.mtl").write_text("newmtl dark" + green)
    several = OBJ.replace("look.mtl", "a.mtl b.mtl")
    assert_same_source(read_obj(tmp_path, several), plain)
    assert [file.name for file in formats.references(tmp_path / "m.obj", look=True)] == ["a.mtl", "b.mtl"]
    # a file of the whole name comes first
    (tmp_path / "a.mtl b.mtl").write_text(MTL)
    assert_same_source(read_obj(tmp_path, several), plain)
    assert [file.name for file in formats.references(tmp_path / "m.obj", look=True)] == ["a.mtl b.mtl"]


@pytest.mark.parametrize(
    ("names", "words"),
    [
        ("my look.mtl.mtl", "names the material file 'my look.mtl.mtl', which is not there"),
        ("look.mtl gone.mtl", "names the material file 'gone.mtl', which is not there"),
        ("look.mtl ../secret.mtl", "'../secret.mtl' outside its own folder"),
        (f"{'x' * 300} {'y' * 300}", "material file 'x"),
    ],
)
def test_a_missing_material_file_is_named(names: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=words):
        read_obj(tmp_path, OBJ.replace("look.mtl", names))


def test_a_name_keeps_its_sign_of_number(tmp_path: Path) -> None:
    """Only behind numbers is it a comment: a material may be called so."""
    named = read_obj(tmp_path, OBJ.replace("usemtl red", "usemtl red #2"), MTL.replace("newmtl red", "newmtl red #2"))
    assert "red #2" in named.all_names
    assert named.colors[0, 0].tolist() == [255, 0, 0]
