"""Small meshes for tests: written as files of each format, sound or broken in a given way."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

HANDLE = ((-60.0, -9.0, 0.0), (40.0, 9.0, 20.0))
HEAD = ((40.0, -30.0, 0.0), (64.0, 30.0, 26.0))
"""A hammer of two boxes, lowest and highest corner, in millimetres."""


def box(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def joined(*shapes: trimesh.Trimesh) -> trimesh.Trimesh:
    """All of them as one mesh, overlapping as they do."""
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes[:-1])])
    faces = np.concatenate([shape.faces + start for shape, start in zip(shapes, starts, strict=True)])
    return trimesh.Trimesh(np.concatenate([shape.vertices for shape in shapes]), faces, process=False)


def hammer() -> trimesh.Trimesh:
    return joined(box(*HANDLE), box(*HEAD))


def obj_text(meshes: dict[str, trimesh.Trimesh], materials: dict[str, str] | None = None) -> str:
    """One object for each mesh, which uses the material of that name, if there are any."""
    lines, start = ["mtllib look.mtl"] if materials else [], 1
    for name, mesh in meshes.items():
        lines.append(f"o {name}")
        if materials:
            lines.append(f"usemtl {materials[name]}")
        lines += ["v {} {} {}".format(*vertex) for vertex in mesh.vertices.tolist()]
        lines += ["f {} {} {}".format(*face) for face in (mesh.faces + start).tolist()]
        start += len(mesh.vertices)
    return "\n".join(lines) + "\n"


def write_hammer(folder: Path) -> Path:
    """hammer.obj: Wood.001 is brown, Steel is grey; in millimetres."""
    (folder / "look.mtl").write_text("newmtl brown\nKd 0.6 0.3 0.1\nnewmtl grey\nKd 0.5 0.5 0.5\n")
    file = folder / "hammer.obj"
    meshes = {"Wood.001": box(*HANDLE), "Steel": box(*HEAD)}
    file.write_text(obj_text(meshes, {"Wood.001": "brown", "Steel": "grey"}))
    return file


def write_textured_bar(folder: Path, file: str = "bar.glb") -> Path:
    """A bar along x, y up, metres: red where x < 0, blue elsewhere, by a texture."""
    bar = trimesh.creation.box(extents=[0.1, 0.03, 0.024])
    picture = np.zeros((4, 8, 3), dtype=np.uint8)
    picture[:, :4], picture[:, 4:] = (220, 20, 20), (20, 20, 220)
    uv = np.column_stack([bar.vertices[:, 0] / 0.1 + 0.5, np.full(8, 0.5)])
    # corners at 0 and 1 would wrap round
    uv[:, 0] = uv[:, 0].clip(0.01, 0.99)
    material = PBRMaterial(baseColorTexture=Image.fromarray(picture), name="paint")
    bar.visual = TextureVisuals(uv=uv, material=material)
    scene = trimesh.Scene()
    scene.add_geometry(bar, node_name="bar", geom_name="bar")
    target = folder / file
    exported = scene.export(file_type=target.suffix[1:])
    if isinstance(exported, dict):
        for name, content in exported.items():
            (folder / (target.name if name == "model.gltf" else name)).write_bytes(content)
    else:
        target.write_bytes(exported)
    return target


def write_urdf(folder: Path, body: str) -> Path:
    file = folder / "robot.urdf"
    file.write_text(f'<?xml version="1.0"?><robot name="r">{body}</robot>')
    return file


def link(name: str, geometry: str, extra: str = "") -> str:
    return f'<link name="{name}"><visual>{extra}<geometry>{geometry}</geometry></visual></link>'


def stl(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> bytes:
    """A binary STL, of whatever it is given."""
    corners = np.asarray(vertices, dtype="<f4")[faces]
    records = np.zeros(len(corners), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
    records["corners"] = corners
    return bytes(80) + struct.pack("<I", len(corners)) + records.tobytes()


def malformed(index: int, folder: Path) -> tuple[Path, float]:
    """The mesh of that number, as a file, and a scale: most of them are wrong in one way or another."""
    rng = np.random.default_rng(index)
    kind = index % 16
    mesh = [hammer, lambda: trimesh.creation.icosphere(2, 30.0), lambda: trimesh.creation.torus(40.0, 10.0)][
        index % 3
    ]()
    vertices, faces, scale = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces), 0.0006
    if kind == 0:  # a soup of triangles
        count = int(rng.integers(1, 200))
        vertices, faces = rng.uniform(-50, 50, (3 * count, 3)), np.arange(3 * count).reshape(-1, 3)
    elif kind == 1:  # faces without area
        faces = faces[:, [0, 1, 1]] if rng.random() < 0.5 else np.zeros_like(faces)
    elif kind == 2:  # inside out, all of it or some
        turned = rng.random(len(faces)) < rng.choice([0.1, 0.5, 1.0])
        faces[turned] = faces[turned][:, ::-1]
    elif kind == 3:  # no numbers
        vertices[rng.integers(len(vertices))] = rng.choice([np.nan, np.inf, -np.inf, 3e38])
    elif kind == 4:  # holes
        faces = faces[rng.random(len(faces)) < rng.uniform(0.02, 0.98)]
    elif kind == 5:  # huge and tiny
        scale = float(10.0 ** rng.uniform(-12, 12))
    elif kind == 6:  # flat, nearly flat, a needle
        vertices = vertices * rng.choice([0.0, 1e-9, 1e-4, 0.05, 1.0], 3)
    elif kind == 7:  # noise
        vertices = vertices + rng.normal(0, rng.uniform(0.1, 20), vertices.shape)
    elif kind == 8:  # each face twice, back to back, and scattered copies
        faces = np.concatenate([faces, faces[:, ::-1]])
        copies = [vertices + rng.uniform(-80, 80, 3) for _ in range(int(rng.integers(1, 8)))]
        faces = np.concatenate([faces + i * len(vertices) for i in range(len(copies))])
        vertices = np.concatenate(copies)
    elif kind == 9:  # far from the origin
        vertices = vertices + 10.0 ** rng.uniform(0, 12)
    content = stl(vertices, faces)
    suffix = ".stl"
    if kind in (10, 11, 12, 13):  # a sound file of some format, cut short or with bytes changed
        suffix = [".stl", ".glb", ".ply", ".obj"][int(rng.integers(4))]
        exported = mesh.export(file_type=suffix[1:])
        content = exported.encode() if isinstance(exported, str) else exported
        if kind < 12:
            content = content[: int(rng.integers(len(content)))]
        else:
            changed = bytearray(content)
            for _ in range(int(rng.integers(1, 40))):
                changed[int(rng.integers(len(changed) if rng.random() < 0.5 else min(len(changed), 300)))] = int(
                    rng.integers(256)
                )
            content = bytes(changed)
    elif kind == 14:  # noise with the beginning of some format
        suffix, start = [
            (".stl", b"solid x\nfacet normal"),
            (".glb", b"glTF\x02\0\0\0"),
            (".ply", b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nend_header\n"),
            (".obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf "),
            (".gltf", b'{"asset": {"version": "2.0"}, "nodes": ['),
            (".urdf", b"<robot><link name='a'>"),
        ][int(rng.integers(6))]
        content = start + rng.integers(0, 256, int(rng.integers(2000)), dtype=np.uint8).tobytes()
    elif kind == 15:  # a description that is a lie
        suffix = ".gltf"
        tree = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "children": [0] if rng.random() < 0.3 else []}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": int(rng.integers(-2, 3))}, "indices": 1}]}],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": int(rng.integers(10**7)), "type": "VEC3"},
                {"bufferView": int(rng.integers(3)), "componentType": 5125, "count": 3, "type": "SCALAR"},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": int(rng.integers(10**9))}],
            "buffers": [{"byteLength": 12, "uri": "data:application/octet-stream;base64,AAAAAAAAAAAAAAAA"}],
        }
        content = json.dumps(tree).encode()
    file = folder / f"mesh{index}{suffix}"
    file.write_bytes(content)
    return file, scale
