"""Demonstrations of a user's own are stored as they are, or refused in one sentence before anything is written."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from folders import contents

from equigrasp import demonstrations
from equigrasp.artefacts import checksum
from equigrasp.collection import Collection, file_name
from equigrasp.demonstration_file import decode, encode
from equigrasp.demonstrations import MANIFEST, load, store
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.workspace import WORKSPACE

FILE = "demo-000-grasp-001.npz"


def scene(shape: tuple[int, int] = WORKSPACE.shape) -> Observation:
    height = np.zeros(shape, dtype=np.float32)
    height[20:30, 40:80] = 0.03
    return Observation(np.full((*shape, 3), 90, dtype=np.uint8), height)


def demonstration(number: int) -> Demonstration:
    return Demonstration(
        observation=scene(),
        instruction="pick up the mug by its handle",
        grasp=Grasp(60 + number / 100, 25, 1.2),
        task="my-table",
        goal=number,
        target="mug",
        part="handle",
        kind="part",
        words=("mug", "handle"),
        demo=0,
        seed=number,
        quality=1.0,
    )


SHOWN = [demonstration(number) for number in range(3)]
PLAN = Collection("my-table", goals=((0, 1, 2),), seed=0, camera="my-camera")

REFUSED = [
    ({"observation": scene((96, 128))}, r"heightmap is \(160, 320\) pixels.* this is \(96, 128\)"),
    ({"grasp": Grasp(383.5, 25, 1.2)}, r"grasp lies on the heightmap, but this is Grasp\(u=383.5"),
    ({"instruction": ""}, "says what to grasp, but this is ''"),
    ({"instruction": None}, "says what to grasp, but this is None"),
    ({"task": "your-table"}, "of task 'your-table', but its plan of 'my-table'"),
    ({"target": None}, "target is a string, but this is None"),
    ({"kind": 3}, "kind is a string, but this is 3"),
    ({"part": ""}, "part is a string, or None where any part would do, but this is ''"),
    ({"words": None}, "words are a tuple of strings.* these are None"),
    ({"words": "mug"}, "words are a tuple of strings.* these are 'mug'"),
    ({"words": ("mug", 3)}, "words are a tuple of strings.* 3"),
    ({"instruction": "pick up the mug by its handle\0"}, r"no character of code 0, but this is 'pick .*\\x00'"),
    ({"target": "mug\0"}, r"no character of code 0, but this is 'mug\\x00'"),
    ({"part": "\0"}, r"no character of code 0, but this is '\\x00'"),
    ({"kind": "pa\0rt"}, r"no character of code 0, but this is 'pa\\x00rt'"),
    ({"words": ("mug", "handle\0")}, r"no character of code 0, but this is 'handle\\x00'"),
    ({"seed": None}, "seed is a whole number, but this is None"),
    ({"quality": None}, "quality is a number, but this is None"),
    ({"quality": float("nan")}, "quality is a finite number, but this is nan"),
]


@pytest.mark.parametrize(("change", "sentence"), REFUSED)
def test_what_a_file_would_not_give_back_is_refused_and_nothing_is_written(
    tmp_path: Path, change: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InputError, match=f"^{FILE} cannot be stored: .*{sentence}") as error:
        store(PLAN, [SHOWN[0], replace(SHOWN[1], **change), SHOWN[2]], tmp_path / "data")
    assert "\n" not in str(error.value)
    assert not contents(tmp_path)


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-50])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def lose(path: Path) -> None:
    path.unlink()


@pytest.mark.parametrize(
    ("damage", "finished"), [(cut, True), (empty, True), (lose, True), (cut, False), (empty, False)]
)
def test_a_folder_with_a_damaged_file_is_refused_and_stays_as_it_is(
    tmp_path: Path, damage: Callable[[Path], None], finished: bool
) -> None:
    folder = tmp_path / "data"
    store(PLAN, SHOWN, folder)
    if not finished:
        (folder / MANIFEST).unlink()
    damage(folder / FILE)
    before = contents(folder)
    with pytest.raises(InputError, match=f"{FILE} is damaged or lost .*choose another folder, or delete") as error:
        store(PLAN, SHOWN, folder)
    assert "\n" not in str(error.value)
    assert contents(folder) == before


def put(folder: Path, content: bytes) -> None:
    """A file's content and its checksum."""
    (folder / FILE).write_bytes(content)
    manifest = json.loads((folder / MANIFEST).read_text())
    manifest["files"][FILE] = checksum(content)
    (folder / MANIFEST).write_text(json.dumps(manifest))


def other(**arrays: Any) -> bytes:
    """A demonstration's file with other arrays in it; None takes one out."""
    with np.load(io.BytesIO(encode(SHOWN[1]))) as whole:
        changed = {**whole, **arrays}
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **{name: value for name, value in changed.items() if value is not None})
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "EOFError"),
        (other(words=np.array("mug")), "TypeError"),
        (other(quality=np.ones((2, 2))), "TypeError"),
        (other(target=np.array(None)), "ValueError: Object arrays cannot be loaded"),
        (other(grasp=None), "KeyError"),
        (other(instruction=np.array(" ")), "says what to grasp"),
        (other(quality=np.array(np.inf)), "quality is a finite number"),
        (encode(replace(SHOWN[1], observation=scene((96, 128)))), "pixels"),
    ],
)
def test_a_file_that_is_no_demonstration_is_one_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    store(PLAN, SHOWN, tmp_path / "data")
    put(tmp_path / "data", content)
    with pytest.raises(InputError, match=rf"{FILE} is no demonstration \(.*{sentence}.*collect it again") as error:
        load(tmp_path / "data")
    assert "\n" not in str(error.value)


def test_a_damaged_bit_is_an_error_of_one_kind() -> None:
    """Zip headers can ask for passwords and unknown compressions."""
    whole = encode(SHOWN[0])
    for place in [*range(60), *range(len(whole) - 120, len(whole))]:
        for bit in range(8):
            content = bytearray(whole)
            content[place] ^= 1 << bit
            with contextlib.suppress(InputError):
                decode(bytes(content))


def test_more_than_a_thousand_grasps_are_loaded_in_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """File names grow longer from grasp 1000 on."""
    plan = Collection("my-table", goals=((0,) * 1002, (0, 0)), seed=0, camera="my-camera")
    names = [file_name(*place) for place in plan.grasps()]
    for name in names:
        (tmp_path / name).write_text(name)
    files = {name: checksum(name.encode()) for name in sorted(names)}
    (tmp_path / MANIFEST).write_text(json.dumps({**plan.plan(), "files": files}))
    # each says its own name in the place of a real one, a thousand of which would take a while
    monkeypatch.setattr(demonstrations, "decode", lambda content: replace(SHOWN[0], instruction=content.decode()))
    assert [each.instruction for each in load(tmp_path)] == names
