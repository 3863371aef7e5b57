"""A folder of meshes as objects of the suite: plain folders, and the layouts of YCB and of GraspNet-1Billion.

Nothing is downloaded: the folder is what its user has.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from equigrasp.errors import InputError
from tasks.meshes.formats import SUFFIXES, references
from tasks.meshes.mesh import MeshObject
from tasks.meshes.mesh_file import MESHES
from tasks.meshes.reference import read_bytes

YCB = re.compile(r"(\d{3})(?:-([a-z]))?_(.+)")
"""A folder of YCB: 003_cracker_box, 065-a_cups."""
YCB_FILES = (
    "google_16k/textured.obj",
    "google_64k/textured.obj",
    "google_512k/textured.obj",
    "textured_simple.obj",
    "textured.obj",
    "poisson/textured.obj",
    "tsdf/textured.obj",
    "google_16k/nontextured.ply",
    "google_16k/nontextured.stl",
    "poisson/nontextured.ply",
    "poisson/nontextured.stl",
    "tsdf/nontextured.ply",
    "tsdf/nontextured.stl",
)
"""Where the mesh of an object lies in its folder, the best first: as YCB has it, then as YCB-Video has it."""
GRASPNET = re.compile(r"\d{3}")
"""A folder of GraspNet: 000 to 087."""
GRASPNET_FILES = ("textured.obj", "nontextured_simplified.ply", "nontextured.ply")
NAMES = "names.json"


def mesh_folder(path: str | Path, **settings: Any) -> dict[str, MeshObject]:
    """The objects of a folder by name, sorted; nothing is read of the meshes, nor baked, before `load`.

    - YCB: `003_cracker_box/google_16k/textured.obj` is "cracker-box"; `065-a_cups` is "cups-a".
    - GraspNet: `000/textured.obj`, also below `models/`, is "graspnet-000".
    - Any other folder: each mesh file is called as the file, and a subfolder with one mesh as the folder. Of
      several files of one name the URDF counts, else OBJ, GLB, glTF, PLY, STL, in this order; what a URDF
      names is no object of its own.

    A file `names.json` in it, `{"000": "cracker-box"}`, gives names to folders or files (without their endings).

    Args:
        path: the folder.
        settings: of every object, as for `MeshObject`: scale, up, pose, mass, color.

    Raises:
        InputError: if it is no folder, has no meshes, or two of its objects get one name.
    """
    folder = Path(path).expanduser()
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}; check the path")
    if (folder / "models").is_dir() and not any(True for _ in _found(folder)):
        names, folder = _names(folder), folder / "models"
        names = {**_names(folder), **names}
    else:
        names = _names(folder)
    objects: dict[str, MeshObject] = {}
    keys = set()
    for key, name, file in _found(folder):
        keys.add(key)
        name = names.get(key, name)
        if name in objects:
            raise InputError(
                f"{file} and {objects[name].file} would both be called {name!r}; name one in {folder / NAMES}"
            )
        objects[name] = MeshObject(name=name, file=file, **settings)
    if not objects:
        known = ", ".join(suffix[1:].upper() for suffix in SUFFIXES)
        raise InputError(f"{folder} holds no meshes ({known}), nor folders of YCB's or GraspNet's layout")
    for key in names:
        if key not in keys:
            raise InputError(f"{NAMES} names {key!r}, but there is no such object in {folder}")
    return dict(sorted(objects.items()))


def _found(folder: Path) -> Iterator[tuple[str, str, Path]]:
    """Each object's key in names.json, its name and its file."""
    yield from _loose(folder)
    for child in sorted(each for each in folder.iterdir() if each.is_dir()):
        ycb = YCB.fullmatch(child.name)
        if ycb is not None:
            file = _first(child, YCB_FILES)
            name = ycb[3] if ycb[2] is None else f"{ycb[3]}-{ycb[2]}"
        elif GRASPNET.fullmatch(child.name):
            file, name = _first(child, GRASPNET_FILES), f"graspnet-{child.name}"
        else:
            meshes = [file for _, _, file in _loose(child)]
            file, name = meshes[0] if len(meshes) == 1 else None, child.name
        if file is not None:
            yield child.name, _said(name), file


def _loose(folder: Path) -> Iterator[tuple[str, str, Path]]:
    """The mesh files that lie in a folder itself."""
    files = [each for each in sorted(folder.iterdir()) if each.suffix.lower() in SUFFIXES and each.is_file()]
    urdfs = [file for file in files if file.suffix.lower() == ".urdf"]
    named = {each for urdf in urdfs for each in references(urdf, look=False)}
    taken = {urdf.stem for urdf in urdfs}
    for urdf in urdfs:
        yield urdf.stem, _said(urdf.stem), urdf
    for suffix in MESHES:
        for file in files:
            if file.suffix.lower() == suffix and file.resolve() not in named and file.stem not in taken:
                taken.add(file.stem)
                yield file.stem, _said(file.stem), file


def _first(folder: Path, names: tuple[str, ...]) -> Path | None:
    return next((folder / name for name in names if (folder / name).is_file()), None)


def _said(name: str) -> str:
    """A name as MeshObject wants it: lower case, with hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "object"


def _names(folder: Path) -> dict[str, str]:
    file = folder / NAMES
    if not file.is_file():
        return {}
    try:
        names = json.loads(read_bytes(file))
    except (ValueError, RecursionError):
        names = None
    if not isinstance(names, dict) or not all(isinstance(name, str) for name in names.values()):
        raise InputError(f'{file} is an object of names, as in {{"000": "cracker-box"}}')
    return names
