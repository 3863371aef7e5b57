"""Which part a point of a mesh is on: by names that the file has, by boxes, or by numbers of faces."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equigrasp.errors import InputError, unknown
from tasks.meshes.reference import read_bytes
from tasks.meshes.source import Source

MOST = 32
"""No object has more parts than this."""
_WORDS = re.compile(r"[a-z0-9]+([- ][a-z0-9]+)*")

Corner = tuple[float, float, float]


@dataclass(frozen=True)
class Part:
    """A part by what selects it. One without any of the three has all that the others leave.

    Attributes:
        name: as an instruction says it.
        boxes: pairs of opposite corners, in the file's units and frame.
        groups: names in the file: of objects, groups, materials, nodes or links.
        faces: numbers of faces in the order of the file, from 0.
    """

    name: str
    boxes: tuple[tuple[Corner, Corner], ...] = ()
    groups: tuple[str, ...] = ()
    faces: tuple[int, ...] = ()


PartsGiven = Sequence[str] | Mapping[str, str | Sequence[str]] | str | Path | None


def beside_mesh(file: Path) -> Path:
    """Where the labels of a mesh lie, if it has any: `mug.obj` -> `mug.parts.json`."""
    return file.with_name(f"{file.stem}.parts.json")


def read_parts(given: PartsGiven, file: Path) -> tuple[Part, ...]:
    """The parts from what a user gave.

    Args:
        given: names in the file; or a dict from a part's name to names in the file; or a path of a file of
            labels; or None for the labels beside the mesh, if there are any.
        file: the mesh.

    Raises:
        InputError: if it is none of these, or two parts have one name.
    """
    if given is None:
        labels = beside_mesh(file)
        return _read_labels(labels) if labels.is_file() else ()
    if isinstance(given, str | Path):
        return _read_labels(Path(given))
    if isinstance(given, Mapping):
        parts = [
            Part(name, groups=(names,) if isinstance(names, str) else tuple(names)) for name, names in given.items()
        ]
    else:
        parts = [Part(name, groups=(name,)) for name in given]
    return _checked(parts, file.name)


def to_json(parts: Sequence[Part]) -> list[dict[str, Any]]:
    """Plain values."""
    return [asdict(part) for part in parts]


def from_json(entries: Any, what: str) -> tuple[Part, ...]:
    """Parts from plain values; `what` names the file that they come from.

    Raises:
        InputError: if they are no parts.
    """
    entries = entries.get("parts") if isinstance(entries, dict) else entries
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f'{what} is a list of parts such as {{"name": "handle", "box": [[x, y, z], [x, y, z]]}}')
    parts = []
    for entry in entries:
        extra = set(entry) - {"name", "box", "boxes", "group", "groups", "faces"}
        if extra or not isinstance(entry.get("name"), str):
            wrong = f"the key {sorted(extra)[0]!r}" if extra else "no name"
            raise InputError(f"{what}: a part has {wrong}; it has a name and a box, boxes, group, groups or faces")
        name = entry["name"]
        boxes = [*entry.get("boxes", []), *([entry["box"]] if "box" in entry else [])]
        groups = [*_listed(entry.get("groups", [])), *_listed(entry.get("group", []))]
        faces = _listed(entry.get("faces", []))
        if not all(isinstance(group, str) for group in groups):
            raise InputError(f"{what}: the groups of {name!r} are names")
        if not all(isinstance(face, int) and not isinstance(face, bool) and face >= 0 for face in faces):
            raise InputError(f"{what}: the faces of {name!r} are whole numbers from 0")
        parts.append(Part(name, tuple(_box(box, name, what) for box in boxes), tuple(groups), tuple(faces)))
    return _checked(parts, what)


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def _read_labels(path: Path) -> tuple[Part, ...]:
    try:
        entries = json.loads(read_bytes(path))
    except (ValueError, RecursionError):
        raise InputError(f"{path} is no JSON; it holds the parts of a mesh as a list") from None
    return from_json(entries, path.name)


def _box(box: Any, name: str, what: str) -> tuple[Corner, Corner]:
    def corner(values: Any) -> Corner:
        x, y, z = (float(value) for value in values)
        if not all(map(math.isfinite, (x, y, z))):
            raise ValueError
        return x, y, z

    try:
        low, high = (corner(values) for values in box)
    except (TypeError, ValueError):
        raise InputError(f"{what}: a box of {name!r} is two corners [[x, y, z], [x, y, z]]") from None
    return low, high


def _checked(parts: Sequence[Part], what: str) -> tuple[Part, ...]:
    names = [part.name for part in parts]
    for name in names:
        if not isinstance(name, str) or not _WORDS.fullmatch(name) or len(name) > 30:
            raise InputError(
                f"{what}: {name!r} cannot be said in an instruction; a part's name is lower-case words, as in "
                'parts={"handle": "Handle.001"}'
            )
        if names.count(name) > 1:
            raise InputError(f"{what}: two parts are called {name!r}; give a part several boxes or groups instead")
    if len(parts) > MOST:
        raise InputError(f"{what} has {len(parts)} parts; {MOST} is the most")
    if sum(not (part.boxes or part.groups or part.faces) for part in parts) > 1:
        raise InputError(f"{what}: only one part may have all that the others leave")
    return tuple(parts)


def check_names(parts: Sequence[Part], source: Source, what: str) -> None:
    """Refuse parts that name what the file does not have.

    Raises:
        InputError: it names the nearest that there is.
    """
    known = source.all_names
    for part in parts:
        for group in part.groups:
            if group not in known:
                raise unknown(
                    f"object, group or material for the part {part.name!r} in {what}", group, source.all_names
                )
        if part.faces and max(part.faces) >= len(source.faces):
            last = len(source.faces) - 1
            raise InputError(f"{what} has the faces 0 to {last}, but the part {part.name!r} has {max(part.faces)}")


def label(
    parts: Sequence[Part], source: Source, face: NDArray[np.int64], points: NDArray[np.float64], what: str
) -> NDArray[np.int64]:
    """The part of each point: `(N,)` indices into `parts`, -1 for none. Of two that claim a point the first has it.

    Args:
        parts: the parts.
        source: the mesh as it is in the file.
        face: `(N,)` the face that each point lies on.
        points: `(N, 3)` in the file's units and frame.
        what: names the mesh in errors.

    Raises:
        InputError: if a part has no surface.
    """
    result = np.full(len(points), -1, dtype=np.int64)
    rest = None
    for index, part in enumerate(parts):
        if not (part.boxes or part.groups or part.faces):
            rest = index
            continue
        mine = np.zeros(len(points), dtype=bool)
        for group in part.groups:
            mine |= np.array([group in names for names in source.names])[source.group[face]]
        for box in part.boxes:
            low, high = np.minimum(*box), np.maximum(*box)
            mine |= ((points >= low) & (points <= high)).all(axis=1)
        if part.faces:
            mine |= np.isin(face, np.array(part.faces))
        result[mine & (result < 0)] = index
    if rest is not None:
        result[result < 0] = rest
    for index, part in enumerate(parts):
        if not (result == index).any():
            low, high = source.vertices.min(axis=0), source.vertices.max(axis=0)
            raise InputError(
                f"the part {part.name!r} has none of the surface of {what}, which spans {np.round(low, 4).tolist()} to "
                f"{np.round(high, 4).tolist()} in the file's units"
            )
    return result
