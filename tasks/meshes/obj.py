"""Wavefront OBJ with its MTL, read line by line: the order of faces and all their names are kept."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from equigrasp.errors import InputError
from tasks.meshes.reference import beside, read_image, read_text
from tasks.meshes.source import LIMIT, PLAIN, Source, joined


def obj_references(path: Path) -> list[Path]:
    """The material files that an OBJ names, and the textures that those name.

    Raises:
        InputError: if one is missing or lies outside the folder.
    """
    found: list[Path] = []
    for library in _libraries(path):
        found.append(library)
        for material in _materials(library).values():
            found += [material[1]] if material[1] is not None else []
    return list(dict.fromkeys(found))


def read_obj(path: Path, look: bool) -> Source:
    """Read an OBJ.

    Args:
        path: the file.
        look: whether to read its materials too.

    Raises:
        InputError: if it is not an OBJ; the message has the line.
    """
    vertices: list[tuple[float, ...]] = []
    tinted: list[tuple[float, ...] | None] = []
    texels: list[tuple[float, float]] = []
    corners: list[tuple[int, int, int]] = []
    corner_texels: list[tuple[int, int, int]] = []
    labels: list[int] = []
    keys: dict[tuple[str, str, str], int] = {}
    current = ["", "", ""]
    places = {"o": 0, "g": 1, "usemtl": 2}
    key = -1
    for number, line in enumerate(read_text(path).replace("\\\n", " ").split("\n"), start=1):
        word, rest = _keyword(line)
        # behind numbers; a name may have the sign in it
        items = rest.partition("#")[0].split()
        try:
            if word == "v":
                values = tuple(map(float, items))
                vertices.append(values[:3])
                tinted.append(values[3:6] if len(values) >= 6 else None)
                if len(values) < 3:
                    raise ValueError("a vertex has three coordinates")
            elif word == "vt":
                across, up = [*map(float, items[:2]), 0.0][:2]
                texels.append((across, up))
            elif word == "f":
                if key < 0:
                    key = keys.setdefault((current[0], current[1], current[2]), len(keys))
                fan = [_corner(item, len(vertices), len(texels)) for item in items]
                if len(fan) < 3:
                    raise ValueError("a face has three corners or more")
                for b, c in itertools.pairwise(fan[1:]):
                    corners.append((fan[0][0], b[0], c[0]))
                    corner_texels.append((fan[0][1], b[1], c[1]))
                    labels.append(key)
                if len(corners) > LIMIT:
                    raise InputError(f"{path.name} has more than {LIMIT:,} faces; reduce it")
            elif word in places:
                current[places[word]] = rest
                key = -1
        except (ValueError, IndexError, OverflowError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(
                f"{path.name} is not a sound OBJ: line {number} ({line.strip()[:40]!r}): {error}"
            ) from None
    if not corners:
        return joined([], path.name)
    faces = np.array(corners, dtype=np.int64)
    uv = np.full((len(faces), 3, 2), np.nan, dtype=np.float32)
    if texels:
        index = np.array(corner_texels, dtype=np.int64)
        with np.errstate(over="ignore"):
            uv = np.where(index[..., None] >= 0, np.array(texels)[index], np.nan).astype(np.float32)
    group = np.array(labels, dtype=np.int64)
    materials = {}
    for library in _libraries(path) if look else []:
        materials |= _materials(library)
    colors, texture, images = _look(list(keys), group, materials)
    if look and any(tint is not None for tint in tinted):
        own = np.array([PLAIN if tint is None else tint for tint in tinted], dtype=np.float32)
        scale = 255.0 if np.nanmax(own) <= 1.0 or all(t is None or max(t) <= 1.0 for t in tinted) else 1.0
        has = np.array([tint is not None for tint in tinted])
        own[has] *= scale
        colors = np.where(has[faces][..., None], np.nan_to_num(own)[faces], colors)
    return Source(
        np.array(vertices, dtype=np.float64),
        faces,
        colors.astype(np.float32),
        uv,
        texture,
        tuple(images),
        group,
        tuple(frozenset(name for name in each if name) for each in keys),
    )


def _keyword(line: str) -> tuple[str, str]:
    """The first word of a line and what follows it, by whatever white space they are apart."""
    word, rest = [*line.split(maxsplit=1), "", ""][:2]
    return word, rest.rstrip()


def _corner(item: str, vertices: int, texels: int) -> tuple[int, int]:
    """Indices of vertex and texture coordinate from "3", "3/4", "3//5" or "-1/-1/-1"."""
    parts = item.split("/")
    vertex = int(parts[0])
    texel = int(parts[1]) if len(parts) > 1 and parts[1] else 0
    vertex = vertex - 1 if vertex > 0 else vertices + vertex
    texel = texel - 1 if texel >= 0 else texels + texel
    if not 0 <= vertex < vertices or int(parts[0]) == 0:
        raise ValueError(f"there is no vertex {parts[0]}")
    if texel >= texels or texel < -1:
        raise ValueError(f"there is no texture coordinate {parts[1]}")
    return vertex, texel


def _look(
    keys: list[tuple[str, str, str]], group: NDArray[np.int64], materials: dict[str, tuple[tuple, Path | None]]
) -> tuple[NDArray[np.float32], NDArray[np.int64], list[NDArray[np.uint8]]]:
    """Colours `(F, 3, 3)`, textures `(F,)` and images by the materials of the groups."""
    files = list(dict.fromkeys(file for _, file in materials.values() if file is not None))
    images = [read_image(file) for file in files]
    flat = np.array([materials.get(key[2], (PLAIN, None))[0] for key in keys], dtype=np.float32)
    textures = [materials.get(key[2], (PLAIN, None))[1] for key in keys]
    index = np.array([-1 if file is None else files.index(file) for file in textures], dtype=np.int64)
    return np.repeat(flat[group][:, None], 3, axis=1), index[group], images


def _libraries(path: Path) -> list[Path]:
    said = [_keyword(line) for line in read_text(path).split("\n") if line.lstrip().startswith("mtllib")]
    names = dict.fromkeys(rest for word, rest in said if word == "mtllib" and rest)
    return list(dict.fromkeys(file for each in names for file in _library_files(path, each)))


def _library_files(path: Path, names: str) -> list[Path]:
    """What one line names: a file whose name may have spaces, or else several files."""
    try:
        return [beside(path, names, "material file")]
    except InputError as error:
        whole = error
    found: list[Path] = []
    wrong: list[InputError] = []
    for name in names.split():
        try:
            found.append(beside(path, name, "material file"))
        except InputError as error:
            wrong.append(error)
    if wrong:
        # where no word is a file, one name with spaces was meant
        raise wrong[0] if found else whole
    return found


def _materials(path: Path) -> dict[str, tuple[tuple, Path | None]]:
    """Colour (sRGB 0 to 255) and texture of each material."""
    result: dict[str, tuple[tuple, Path | None]] = {}
    name = ""
    for line in read_text(path).split("\n"):
        word, rest = _keyword(line)
        if word == "newmtl":
            name = rest
            result[name] = (PLAIN, None)
        elif word == "Kd" and name:
            try:
                values = np.clip(np.array(rest.split()[:3], dtype=np.float64), 0.0, 1.0) * 255.0
            except ValueError:
                values = np.full(3, np.nan)
            if values.shape != (3,) or not np.isfinite(values).all():
                raise InputError(f"{path.name}: the colour of the material {name!r} is {rest!r}, not three numbers")
            result[name] = (tuple(values.tolist()), result[name][1])
        elif word == "map_Kd" and name and rest:
            # options such as -s 1 1 1 come before the name, which may have spaces where there are none
            file = rest.split()[-1] if rest.startswith("-") else rest
            result[name] = (result[name][0], beside(path, file, "texture"))
    return result
