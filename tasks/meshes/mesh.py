"""MeshObject: a mesh of your own as an object of the suite, baked once and kept. `docs/objects.md` has examples."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Literal, get_args

from PIL import ImageColor

import tasks
from equigrasp.artefacts import PARTIAL, cache_folder, checksum, read_json, write_json
from equigrasp.errors import InputError
from tasks.meshes.anatomy import MeshAnatomy
from tasks.meshes.formats import check_suffix, references
from tasks.meshes.parts import PartsGiven, beside_mesh, read_parts, to_json
from tasks.meshes.reference import read_bytes
from tasks.objects.asset import ObjectAsset, read
from tasks.objects.shape import COLOURS

VERSION = 2
"""Of the pipeline: whoever changes what it writes changes this, and every mesh is baked anew."""

Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
_NAME = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_FILES = ("object.obj", "object.mtl", "object.png", "object.hulls.obj", "object.json", "object.npz")
_NEEDED = {
    "coacd": "coacd",
    "fast_simplification": "fast-simplification",
    "skimage": "scikit-image",
    "trimesh": "trimesh",
    "igl": "libigl",
}
HEAVIEST = 0.3
"""Kilograms: so much the hand lifts of every shape tried, and of some no more; `docs/objects.md` has the table."""
_LONGEST = 1800.0
"""Seconds of the clock, for one object, on however busy a machine."""

# nothing of the working directory, which may have a `tasks` or a `copy.py` of its own, is imported
_START = (
    "import sys; sys.path[:] = filter(None, sys.path); "
    "import runpy; runpy.run_module('tasks.meshes.bake', run_name='__main__')"
)

_State = tuple[int, int, int] | None
_loaded: dict[MeshObject, tuple[dict[Path, _State], ObjectAsset]] = {}
"""What was loaded, and the files that it was made of and was baked to, as they were then: hashing them each time would
take long."""


@dataclass(frozen=True)
class MeshObject:
    """An object of your own: a mesh, how it lies on the table, what it looks like, and what its parts are called.

    Making one checks its settings; `load` reads, bakes and keeps it.

    Attributes:
        name: lower-case words joined by hyphens; an instruction says it with spaces.
        file: OBJ, STL, PLY, GLB, GLTF or URDF. What it refers to lies in its folder.
        scale: metres in a unit of the file; 0.001 for millimetres.
        color: a name ("red", as in CSS or `tasks.objects.shape.COLOURS`), "#rrggbb" or three whole numbers to
            255, instead of the file's own look.
        texture: a picture, laid on by the file's texture coordinates, instead of the file's own look.
        parts: names of objects, groups, materials, nodes or links in the file: a list, or a dict from what an
            instruction says to one or more of them; or the path of a file of labels; or None for the labels
            beside the mesh (`mug.parts.json`), if there are any.
        up: which axis of the file points up; None is z, and y for GLB and glTF, as that format has it.
        pose: "up", as the axis says, or "rest", the stable pose that it most often falls into.
        mass: kilograms, HEAVIEST at the most.

    Raises:
        InputError: if a setting is none of these, or there is no such file.
    """

    name: str
    file: str | Path
    scale: float = 1.0
    color: str | tuple[int, int, int] | None = None
    texture: str | Path | None = None
    parts: PartsGiven = None
    up: Axis | None = None
    pose: Literal["up", "rest"] = "up"
    mass: float = 0.08

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _NAME.fullmatch(self.name) or len(self.name) > 40:
            raise InputError(
                f"an object's name is lower-case words joined by hyphens, as in 'my-mug', not {self.name!r}"
            )
        for field in ("scale", "mass"):
            value = getattr(self, field)
            if isinstance(value, bool) or not isinstance(value, Real) or not math.isfinite(value) or value <= 0:
                raise InputError(f"{field} of {self.name!r} is a number above 0, not {value!r}")
            object.__setattr__(self, field, float(value))
        if self.mass > HEAVIEST:
            raise InputError(
                f"{self.name!r} weighs {self.mass:g} kg, and above {HEAVIEST} kg some shapes slip from the fingers as "
                f"they lift; pass a mass, in kilograms, of {HEAVIEST} or less"
            )
        if self.up is not None and self.up not in get_args(Axis):
            raise InputError(f"up of {self.name!r} is one of {', '.join(get_args(Axis))}, not {self.up!r}")
        if self.pose not in ("up", "rest"):
            raise InputError(f"pose of {self.name!r} is 'up' or 'rest', not {self.pose!r}")
        if self.color is not None and self.texture is not None:
            raise InputError(f"{self.name!r} has a color and a texture; pass one of them")
        # absolute, so that a worker in another folder finds them, and hashable
        object.__setattr__(self, "file", _absolute(self.file, f"the mesh of {self.name!r}"))
        check_suffix(Path(self.file))
        object.__setattr__(self, "color", None if self.color is None else _rgb(self.color, self.name))
        if self.texture is not None:
            object.__setattr__(self, "texture", _absolute(self.texture, f"the texture of {self.name!r}"))
        object.__setattr__(self, "parts", _frozen(self.parts, self.name))

    def load(self) -> ObjectAsset:
        """The object, baked if it was not yet: some ten seconds the first time, and milliseconds from then on.

        What is kept lies under $EQUIGRASP_CACHE, or ~/.cache/equigrasp, by a checksum of the file's content, of
        what it refers to, of its labels, and of the settings. Whichever of these was written anew is read anew, and
        what is kept no more is baked again.

        Raises:
            InputError: if no object can be made of the file; it says why, and what would help.
        """
        states, asset = _loaded.get(self, ({}, None))
        if asset is None or any(_state(file) != state for file, state in states.items()):
            # before anything is read: what is written in the meantime is noticed by the next load
            states = {file: _state(file) for file in (*self._contents(), *self._labels())}
            settings = self._settings()
            folder = _baked(settings, self._checksum(settings))
            asset = self._asset(folder)
            _loaded[self] = states | {folder / name: _state(folder / name) for name in _FILES}, asset
        return asset

    def fingerprint(self) -> str:
        """A checksum of all that it is baked from; not of its name, nor of where its files lie.

        Raises:
            InputError: if a file cannot be read, or its labels are none.
        """
        return self._checksum(self._settings())

    def _contents(self) -> list[Path]:
        """The mesh, what it refers to, and the texture."""
        file = Path(self.file)
        look = self.color is None and self.texture is None
        return [file, *references(file, look), *([Path(self.texture)] if self.texture is not None else [])]

    def _labels(self) -> list[Path]:
        """The file of labels, there or not; none where the parts are given by names."""
        if self.parts is None:
            return [beside_mesh(Path(self.file))]
        return [Path(self.parts)] if isinstance(self.parts, str) else []

    def _settings(self) -> dict[str, Any]:
        """Everything that the baked files depend on, as plain values."""
        file = Path(self.file)
        gltf = file.suffix.lower() in (".glb", ".gltf")
        given: Any = self.parts
        given = dict(given) if _is_pairs(given) else given
        return {
            "file": str(file),
            "look": self.color is None and self.texture is None,
            "color": self.color,
            "texture": None if self.texture is None else str(self.texture),
            "scale": float(self.scale),
            "up": self.up or ("y" if gltf else "z"),
            "pose": self.pose,
            "parts": to_json(read_parts(given, file)),
            "mass": float(self.mass),
        }

    def _checksum(self, settings: dict[str, Any]) -> str:
        plain = {key: value for key, value in settings.items() if key not in ("file", "texture")}
        contents = [[each.name, checksum(read_bytes(each))] for each in self._contents()]
        return checksum(json.dumps([VERSION, plain, contents], sort_keys=True).encode())[:32]

    def _asset(self, folder: Path) -> ObjectAsset:
        numbers = read_json(folder / "object.json", "a baked mesh")
        anatomy = MeshAnatomy(tuple(numbers["parts"]), folder / "object.npz")
        return replace(read("object", anatomy, folder), name=self.name, mass=self.mass)


def _state(file: Path) -> _State:
    """What a file has of its own for as long as nobody writes to it; None where there is none."""
    try:
        state = file.stat()
    except OSError:
        return None
    # a copy may keep the time of the content, but not that of the change
    return state.st_mtime_ns, state.st_ctime_ns, state.st_size


def _baked(settings: dict[str, Any], key: str) -> Path:
    """The folder of the baked files; they are made if they are not there, or not whole.

    A folder appears under its name when all of it is written, so that of two processes that bake the same mesh
    the later one finds the other's files and drops its own.
    """
    cache = cache_folder("objects")
    folder = cache / key
    if _whole(folder):
        return folder
    _check_extra()
    partial = None
    try:
        cache.mkdir(parents=True, exist_ok=True)
        _sweep(cache)
        partial = Path(tempfile.mkdtemp(prefix=PARTIAL, dir=cache))
        _bake_apart(settings, partial)
        write_json(partial / "files.json", {name: checksum((partial / name).read_bytes()) for name in _FILES})
        if folder.exists() and not _whole(folder):
            shutil.rmtree(folder, ignore_errors=True)
        try:
            partial.rename(folder)
        except OSError:
            if not _whole(folder):
                raise
    except OSError as error:
        raise InputError(
            f"{cache} cannot be written ({error.strerror}); set EQUIGRASP_CACHE to a folder of yours"
        ) from None
    finally:
        if partial is not None:
            shutil.rmtree(partial, ignore_errors=True)
    return folder


def _sweep(cache: Path) -> None:
    """Delete what killed bakes left; one that is at work is younger than the longest of them may take."""
    for partial in cache.glob(PARTIAL + "*"):
        with contextlib.suppress(OSError):  # another process swept it
            if time.time() - partial.stat().st_mtime > 2 * _LONGEST:
                shutil.rmtree(partial, ignore_errors=True)


def _whole(folder: Path) -> bool:
    """Whether all files are there, with the content that was written."""
    try:
        sums = read_json(folder / "files.json", "the list of a baked mesh")
        return all(checksum((folder / name).read_bytes()) == sums[name] for name in _FILES)
    except (InputError, OSError, KeyError):
        return False


def _check_extra() -> None:
    for module, package in _NEEDED.items():
        if importlib.util.find_spec(module) is None:
            raise InputError(
                f"a mesh of your own needs {package}; install the extra: pip install -e '.[bake]' in equigrasp's folder"
            )


def _bake_apart(settings: dict[str, Any], out: Path) -> None:
    """Bake in a process of its own, which may crash or be stopped without harm to this one."""
    name = Path(settings["file"]).name
    root = str(Path(tasks.__file__).parents[1])
    paths = os.pathsep.join(filter(None, (root, os.environ.get("PYTHONPATH"))))
    try:
        done = subprocess.run(
            [sys.executable, "-c", _START],
            input=json.dumps({"settings": settings, "out": str(out)}),
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": paths},
            timeout=_LONGEST,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{name} was not baked in {_LONGEST / 60:.0f} minutes; reduce the mesh") from None
    if done.returncode == 3:
        raise InputError(json.loads(done.stdout.splitlines()[-1])["error"])
    if done.returncode:
        # PyBullet greets on the same stream
        said = [line for line in done.stderr.strip().splitlines() if not line.startswith("pybullet build time")]
        how = f"signal {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
        why = ": ".join([how, *(line[:200] for line in said[-1:])])
        raise InputError(f"{name} could not be baked ({why}); simplify the mesh, or export its outer surface")


def _absolute(given: Any, what: str) -> str:
    if not isinstance(given, str | Path):
        raise InputError(f"{what} is the path of a file, not {given!r}")
    path = Path(given).expanduser().absolute()
    if not path.is_file():
        raise InputError(f"{what} is not there: {path}; check the path")
    return str(path)


def _rgb(color: Any, name: str) -> tuple[int, int, int]:
    if isinstance(color, str):
        if color in COLOURS:
            return COLOURS[color]
        try:
            red, green, blue = ImageColor.getrgb(color)[:3]
        except ValueError:
            raise InputError(f"color of {name!r} is a name such as 'red' or '#ff0000', not {color!r}") from None
        return red, green, blue
    channels = tuple(color) if isinstance(color, Iterable) else ()
    whole = all(isinstance(channel, Integral) and not isinstance(channel, bool) for channel in channels)
    if not whole or len(channels) != 3 or not all(0 <= channel <= 255 for channel in channels):
        raise InputError(f"color of {name!r} is three whole numbers from 0 to 255, or a name, not {color!r}")
    red, green, blue = map(int, channels)
    return red, green, blue


def _is_pairs(parts: Any) -> bool:
    return isinstance(parts, tuple) and bool(parts) and all(isinstance(each, tuple) for each in parts)


def _frozen(parts: Any, name: str) -> Any:
    """The parts as something that can be hashed: a string, or a tuple of names, or of pairs of a name and names."""
    if parts is None:
        return None
    if isinstance(parts, str | Path):
        return _absolute(parts, f"the labels of {name!r}")
    pairs = parts.items() if isinstance(parts, Mapping) else parts if _is_pairs(parts) else None
    try:
        if pairs is None:
            frozen: tuple[Any, ...] = tuple(parts)
            names = frozen
        else:
            frozen = tuple((key, (value,) if isinstance(value, str) else tuple(value)) for key, value in pairs)
            names = tuple(each for key, value in frozen for each in (key, *value))
    except (TypeError, ValueError):
        names = (None,)
        frozen = ()
    if not names or not all(isinstance(each, str) for each in names):
        raise InputError(f"parts of {name!r} is a list of names, a dict from part to names, or a path, not {parts!r}")
    return frozen
