"""A demonstration as the bytes of a file, an `.npz` of which nothing is ever unpickled, and what may be in one."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from equigrasp import language
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration, Grasp, Observation
from equigrasp.workspace import WORKSPACE


def check(demonstration: Demonstration) -> None:
    """Refuse what a file would not give back as it is, and what no policy could be trained on.

    Raises:
        InputError: if the heightmap has another size than the workspace's, the grasp lies beside it, the instruction is
            none, a name, word or number is of another type than `Demonstration` says, or a text holds the character of
            code 0.
    """
    shape = demonstration.observation.shape
    if shape != WORKSPACE.shape:
        raise InputError(
            f"a demonstration's heightmap is {WORKSPACE.shape} pixels, as the workspace, but this is {shape}; make it "
            "by `equigrasp.heightmap.fuse`"
        )
    if not WORKSPACE.contains(demonstration.grasp):
        raise InputError(f"a demonstration's grasp lies on the heightmap, but this is {demonstration.grasp!r}")
    language.check(demonstration.instruction)
    for name in ("task", "target", "kind"):
        _check_type(name, getattr(demonstration, name), str, "a string")
    part = demonstration.part
    if part is not None and not (isinstance(part, str) and part):
        raise InputError(f"a demonstration's part is a string, or None where any part would do, but this is {part!r}")
    words = demonstration.words
    if not isinstance(words, tuple) or not all(isinstance(word, str) for word in words):
        raise InputError(
            f"a demonstration's words are a tuple of strings, as ('mug', 'handle') or ('mug',), but these are {words!r}"
        )
    for text in (
        demonstration.instruction,
        demonstration.task,
        demonstration.target,
        part or "",
        demonstration.kind,
        *words,
    ):
        _check_text(text)
    for name in ("goal", "demo", "seed"):
        _check_type(name, getattr(demonstration, name), int | np.integer, "a whole number")
    _check_type("quality", demonstration.quality, float | int | np.floating, "a number")
    if not math.isfinite(demonstration.quality):
        raise InputError(f"a demonstration's quality is a finite number, but this is {demonstration.quality}")


def _check_type(name: str, value: object, kind: Any, said: str) -> None:
    if not isinstance(value, kind):
        raise InputError(f"a demonstration's {name} is {said}, but this is {value!r:.100}")


def _check_text(text: str) -> None:
    # numpy fills its strings up with these, and takes those at the end off again
    if "\0" in text:
        raise InputError(
            f"a demonstration's texts hold no character of code 0, but this is {text!r:.100}; leave it out"
        )


def encode(demonstration: Demonstration) -> bytes:
    """A demonstration as the bytes of an `.npz`; the same demonstration gives the same bytes."""
    grasp = demonstration.grasp
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer,
        color=demonstration.observation.color,
        height=demonstration.observation.height,
        instruction=np.array(demonstration.instruction),
        grasp=np.array([grasp.u, grasp.v, grasp.theta]),
        task=np.array(demonstration.task),
        target=np.array(demonstration.target),
        part=np.array(demonstration.part or ""),
        kind=np.array(demonstration.kind),
        words=np.array(demonstration.words, dtype=np.str_),
        indices=np.array([demonstration.goal, demonstration.demo, demonstration.seed], dtype=np.int64),
        quality=np.array(demonstration.quality),
    )
    return buffer.getvalue()


def decode(content: bytes) -> Demonstration:
    """The inverse of `encode`.

    Raises:
        InputError: if the bytes are not a demonstration's.
    """
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return _read(arrays)
    except Exception as error:  # which of many depends on what of the zip or its arrays is damaged
        raise InputError(f"{type(error).__name__}: {error}") from None


def _read(arrays: Mapping[str, NDArray]) -> Demonstration:
    goal, demo, seed = (int(value) for value in arrays["indices"])
    return Demonstration(
        observation=Observation(arrays["color"], arrays["height"]),
        instruction=str(arrays["instruction"]),
        grasp=Grasp(*arrays["grasp"]),
        task=str(arrays["task"]),
        goal=goal,
        target=str(arrays["target"]),
        part=str(arrays["part"]) or None,
        kind=str(arrays["kind"]),
        words=tuple(str(word) for word in arrays["words"]),
        demo=demo,
        seed=seed,
        quality=float(arrays["quality"]),
    )
