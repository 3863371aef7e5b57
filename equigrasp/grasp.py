"""The three records that flow through everything: Grasp, Observation, Demonstration.

They hold plain numpy arrays and floats, cost no torch, and are frozen: to change one is to make another
with `dataclasses.replace`. How they are placed in the world, and how SE(2) acts on them, is `workspace.py`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equigrasp.errors import InputError


@dataclass(frozen=True)
class Grasp:
    """A planar grasp: where the hand goes, and along which line its fingers close.

    Attributes:
        u: column of the heightmap in pixels; pixel centres are whole numbers; grows with world x.
        v: row of the heightmap in pixels; pixel centres are whole numbers; grows as world y falls.
        theta: angle of the closing axis (the line between the fingertips) in radians, counter-clockwise
            from world +x seen from above, modulo pi because the gripper is its own mirror. Kept in [0, pi).

    Raises:
        ValueError: if a value is not a finite number.
    """

    u: float
    v: float
    theta: float

    def __post_init__(self) -> None:
        for name in ("u", "v", "theta"):
            value = float(getattr(self, name))
            if not math.isfinite(value):
                raise ValueError(f"a Grasp needs finite numbers, but {name} is {value}")
            object.__setattr__(self, name, value)
        theta = self.theta % math.pi
        object.__setattr__(self, "theta", 0.0 if theta == math.pi else theta)

    def __repr__(self) -> str:
        return f"Grasp(u={self.u:.1f}, v={self.v:.1f}, theta={math.degrees(self.theta):.1f} deg)"


@dataclass(frozen=True, eq=False)
class Observation:
    """An orthographic RGB-D heightmap of the workspace, seen from above.

    Attributes:
        color: `(H, W, 3)` uint8, RGB.
        height: `(H, W)` float32, metres above the table, finite.

    Raises:
        ValueError: if the shapes or dtypes are others, or a height is not finite.
    """

    color: NDArray[np.uint8]
    height: NDArray[np.float32]

    def __post_init__(self) -> None:
        if self.color.dtype != np.uint8 or self.color.ndim != 3 or self.color.shape[2] != 3:
            raise ValueError(
                f"an Observation's color is (H, W, 3) uint8, but this is {self.color.shape} {self.color.dtype}"
            )
        if self.height.dtype != np.float32 or self.height.shape != self.color.shape[:2]:
            raise ValueError(
                f"an Observation's height is {self.color.shape[:2]} float32 like its color, "
                f"but this is {self.height.shape} {self.height.dtype}"
            )
        if not np.isfinite(self.height).all():
            missing = np.count_nonzero(~np.isfinite(self.height))
            raise InputError(
                f"an Observation's heights are finite, but {missing} of these are NaN or infinite; give what was not "
                "seen the height of the table, 0"
            )

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, `(H, W)`."""
        rows, columns = self.height.shape
        return rows, columns

    def same(self, other: Observation) -> bool:
        """Whether both hold the same bits."""
        return np.array_equal(self.color, other.color) and np.array_equal(self.height, other.height)

    def __repr__(self) -> str:
        rows, columns = self.shape
        low, high = 1000 * float(self.height.min()), 1000 * float(self.height.max())
        return f"Observation({rows}x{columns}, height {low:.0f} .. {high:.0f} mm)"


@dataclass(frozen=True, eq=False)
class Demonstration:
    """One successful grasp of a demonstrator, the oracle or a robot: what it saw, what it was told, what it did.

    The paper's "demonstration" of a task is a set of these (23 for pick-by-part);
    `demo` says to which set this one belongs.

    Attributes:
        observation: the heightmap before the grasp.
        instruction: the sentence.
        grasp: the grasp that succeeded.
        task: the task's name: one of `tasks.TASKS`, or of one's own.
        goal: index of the goal among the task's goals.
        target: name of the object that was to be grasped, as the demonstrator knows it.
        part: name of the part to grasp it by, or None where any part would do.
        kind: what kind of goal it is; sentences of one kind name their goals alike.
        words: the words in the sentence that say which goal is meant, in the kind's own order, such as
            ("mug", "handle") or ("blue", "banana").
        demo: index of the set of demonstrations.
        seed: what the environment was reset with, so that the scene can be made again.
        quality: the oracle's own score of the grasp, in [0, 1].
    """

    observation: Observation
    instruction: str
    grasp: Grasp
    task: str
    goal: int
    target: str
    part: str | None
    kind: str
    words: tuple[str, ...]
    demo: int
    seed: int
    quality: float

    def __repr__(self) -> str:
        return f"Demonstration({self.task}, demo {self.demo}, {self.instruction!r}, {self.grasp}, seed {self.seed})"
