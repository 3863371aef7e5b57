"""A file that holds one mesh -> Source. OBJ is read by `obj.py`, the rest by trimesh.

Formats are plain data: nothing is unpickled, nothing fetched, and a file refers to files of its own folder only.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equigrasp.errors import InputError
from tasks.meshes.obj import obj_references, read_obj
from tasks.meshes.reference import beside, read_bytes, shrunk
from tasks.meshes.source import LIMIT, PLAIN, Source, joined, source

MESHES = (".obj", ".glb", ".gltf", ".ply", ".stl")
"""Endings of files that hold one mesh, the richest format first."""


def references(path: Path, look: bool) -> list[Path]:
    """All files that a mesh file needs besides itself, each once.

    Args:
        path: the file, of MESHES.
        look: whether materials and textures count.

    Raises:
        InputError: if one is missing or lies outside the folder.
    """
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return obj_references(path) if look else []
    if suffix in (".glb", ".gltf"):
        return _gltf_references(path)
    if suffix == ".ply" and look:
        return _ply_references(path)
    return []


def read(path: Path, look: bool = True) -> Source:
    """Read a file that holds one mesh.

    Args:
        path: the file, of MESHES.
        look: whether to read its materials too.

    Raises:
        InputError: if it is missing, damaged, too large or without faces.
    """
    suffix = path.suffix.lower()
    references(path, look)
    if suffix == ".obj":
        return read_obj(path, look)
    content = read_bytes(path)
    if suffix == ".stl":
        _check_stl(path, content)
    if suffix == ".ply":
        _check_ply(path, content)
    return joined(_by_trimesh(path, look), path.name)


def _by_trimesh(path: Path, look: bool) -> list[Source]:
    import trimesh

    try:
        scene = trimesh.load_scene(path, process=False)
        sources = []
        for node in sorted(scene.graph.nodes_geometry):
            transform, name = scene.graph[node]
            mesh = scene.geometry[name]
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
                sources.append(_of_trimesh(mesh, frozenset({str(node), str(name)}), look).moved(np.array(transform)))
            if sum(len(each.faces) for each in sources) > LIMIT:
                break
        return sources
    except InputError:
        raise
    except MemoryError:
        raise InputError(f"{path.name} does not fit into memory; reduce it") from None
    except Exception as error:  # a parser of damaged bytes raises whatever comes first
        reason = f"{type(error).__name__}: {error}".split("\n")[0][:120]
        raise InputError(
            f"{path.name} is damaged, or no {path.suffix[1:].upper()} ({reason}); export it again"
        ) from None


def _of_trimesh(mesh: Any, names: frozenset[str], look: bool) -> Source:
    faces = np.asarray(mesh.faces, dtype=np.int64)
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError("a face names a vertex that is not there")
    visual = mesh.visual
    colors: NDArray[np.float64] | tuple[int, int, int] = PLAIN
    uv, image = getattr(visual, "uv", None), None
    if uv is not None:
        uv = np.asarray(uv, dtype=np.float64)[faces][..., :2]
    material = getattr(visual, "material", None)
    name = getattr(material, "name", None)
    if name:
        names = names | {str(name)}
    if look and material is not None:
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        flat = getattr(material, "baseColorFactor", None)
        flat = getattr(material, "diffuse", None) if flat is None else flat
        if flat is not None:
            values = np.asarray(flat)
            # as trimesh has it: whole numbers to 255, or fractions
            values = values * 255.0 if np.issubdtype(values.dtype, np.floating) else values
            colors = tuple(int(value) for value in np.clip(values[:3], 0, 255))  # ty: ignore[invalid-assignment]
    if look and material is None and getattr(visual, "kind", None) == "face":
        colors = np.asarray(visual.face_colors, dtype=np.float64)[:, :3]
    elif look and material is None and getattr(visual, "kind", None) == "vertex":
        colors = np.asarray(visual.vertex_colors, dtype=np.float64)[faces][..., :3]
    picture = None if image is None or uv is None else shrunk(image, "inside the file")
    return source(vertices, faces, names, colors, uv, picture)


def _gltf_references(path: Path) -> list[Path]:
    content = read_bytes(path)
    if path.suffix.lower() == ".glb":
        if content[:4] != b"glTF" or len(content) < 20:
            raise InputError(f"{path.name} is no GLB: it does not begin as one; export it again")
        total, length = struct.unpack("<I", content[8:12])[0], struct.unpack("<I", content[12:16])[0]
        if total > len(content) or 20 + length > len(content):
            raise InputError(f"{path.name} is cut short: {len(content)} of {total} bytes are there; copy it again")
        content = content[20 : 20 + length]
    try:
        tree = json.loads(content)
        entries = [*tree.get("buffers", []), *tree.get("images", [])]
        uris = [entry["uri"] for entry in entries if "uri" in entry]
        # counts that a reader would allocate before it looks
        counts = [int(entry.get("count", 0)) for entry in tree.get("accessors", [])]
        nodes = len(tree.get("nodes", []))
        # each mesh may be drawn by many nodes, which multiplies its faces
    except (ValueError, AttributeError, TypeError, KeyError, RecursionError):
        raise InputError(f"{path.name} is damaged: its description is no glTF; export it again") from None
    if any(count < 0 or count > 3 * LIMIT for count in counts) or nodes > 10_000:
        raise InputError(f"{path.name} has more than {LIMIT:,} faces or 10,000 nodes; reduce it")
    return [beside(path, str(uri), "file") for uri in uris if not str(uri).startswith("data:")]


def _ply_references(path: Path) -> list[Path]:
    found = []
    for line in _ply_header(path, read_bytes(path)):
        words = line.split(maxsplit=2)
        if words[:2] == ["comment", "TextureFile"] and len(words) == 3:
            found.append(beside(path, words[2], "texture"))
    return found


def _ply_header(path: Path, content: bytes) -> list[str]:
    end = content.find(b"end_header", 0, 100_000)
    if not content.startswith(b"ply") or end < 0:
        raise InputError(f"{path.name} is no PLY: its header is missing or cut short; export it again")
    return content[:end].decode("utf-8", errors="replace").splitlines()


def _check_ply(path: Path, content: bytes) -> None:
    """A header that promises more than the file can hold would cost memory before it fails."""
    for line in _ply_header(path, content):
        words = line.split()
        if words[:1] == ["element"] and (len(words) != 3 or not words[2].isdigit() or int(words[2]) > len(content)):
            raise InputError(f"{path.name} is damaged: its header says {line[:60]!r}; export it again")


def _check_stl(path: Path, content: bytes) -> None:
    """A binary STL says how many faces it has, 50 bytes each; one in text ends as it began."""
    count = struct.unpack("<I", content[80:84])[0] if len(content) >= 84 else -1
    # first, as the header of a binary one is free to say "solid" too
    if count >= 0 and 84 + 50 * count == len(content):
        return
    start, end = content[:2000].lower(), content[-2000:].lower()
    if start.startswith(b"solid") and b"facet" in start:
        if b"endsolid" not in end:
            raise InputError(f"{path.name} is cut short: its last line, endsolid, is missing; copy it again")
        return
    if start.startswith(b"solid") and end.strip().split(b"\n")[-1].startswith(b"endsolid"):
        raise InputError(f"{path.name} holds no faces, so there is nothing to grasp; export it as a triangle mesh")
    said = "it is shorter than its header" if count < 0 else f"{count:,} faces take {84 + 50 * count:,} bytes"
    raise InputError(f"{path.name} is no sound STL: {said}, and it has {len(content):,}; copy it again")
