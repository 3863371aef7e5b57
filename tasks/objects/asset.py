"""ObjectAsset: a baked object, ready for a simulator. Loading reads one small JSON and parses no mesh."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

BAKED = Path(__file__).parent / "baked"

# The palette has room to grow: a colour's texture coordinate must not move when another is added.
PALETTE_SLOTS = 32


def baked_file(name: str, suffix: str, folder: Path = BAKED) -> Path:
    """The file of an object: `suffix` is ".obj", ".hulls.obj" or ".json". Lower case, as some disks have no other."""
    return folder / f"{name.lower()}{suffix}"


class Anatomy(Protocol):
    """Where an object is, and its parts: what a drawn `Shape` and a user's mesh both know of themselves."""

    @property
    def parts(self) -> tuple[str, ...]:
        """The names an instruction may use."""
        ...

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance: points `(N, 3)` metres in the frame of the drawing -> `(N,)` metres, negative inside."""
        ...

    def part_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The part at points `(N, 3)` metres in the frame of the drawing: `(N,)` indices into `parts`, -1 for none."""
        ...


@dataclass(frozen=True, eq=False)
class ObjectAsset:
    """An object with its meshes and the numbers that placing and grasping it take.

    Object frame: the origin is the centre of mass (uniform density), z is up in the resting pose, metres. Yaw
    is as drawn: tools point their business end along +x; animals look along +x, their back towards +y; a mug's
    handle is at +x.

    In PyBullet, for a client `p` (the inertial frame is the object frame, and the OBJ brings its texture)::

        collision = p.createCollisionShape(p.GEOM_MESH, fileName=str(asset.collision))
        visual = p.createVisualShape(p.GEOM_MESH, fileName=str(asset.visual))
        body = p.createMultiBody(0.08, collision, visual, [x, y, asset.rest_height])
        p.changeVisualShape(body, -1, textureUniqueId=-1, rgbaColor=colour)  # all of it in one colour instead

    Attributes:
        name: as in OBJECTS.
        parts: the names of parts that an instruction may use, in order.
        visual: OBJ in natural colours; its faces take their colour from a palette shared by all objects.
        collision: OBJ of convex hulls, a group each, which loads as a compound.
        radius: metres, the planar distance from the origin to the furthest point.
        footprint: `(K, 2)` metres, the silhouette from above at rest: outlines and a grid inside, 3 mm apart.
        rest_height: metres, z of the origin when the object lies on PyBullet's table, which keeps hulls 1 mm
            (their collision margin) clear of it.
        shape: the shape it was baked from.
        centre: `(3,)` metres, the origin in the frame of the shape's drawing.
        paint: sRGB 0 .. 255, all of it in one colour; None for its own look.
        mass: kilograms.
    """

    name: str
    parts: tuple[str, ...]
    visual: Path
    collision: Path
    radius: float
    footprint: NDArray[np.float64]
    rest_height: float
    shape: Anatomy
    centre: NDArray[np.float64]
    paint: tuple[int, int, int] | None = None
    mass: float = 0.08

    def part_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The nearest part: points `(N, 3)` metres in the object frame -> `(N,)` indices into `parts`.

        -1 for a piece that has no name, and for points over 10 mm away from the object.
        """
        return self.shape.part_at(np.asarray(points, dtype=np.float64) + self.centre)

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance: points `(N, 3)` metres in the object frame -> `(N,)` metres, negative inside."""
        return self.shape.distance(np.asarray(points, dtype=np.float64) + self.centre)

    def __repr__(self) -> str:
        return f"ObjectAsset({self.name!r}, parts={self.parts}, radius={self.radius * 1000:.0f} mm)"


def read(name: str, shape: Anatomy, folder: Path = BAKED) -> ObjectAsset:
    """Read a baked object from `folder`.

    Raises:
        FileNotFoundError: if it has not been baked; the message names the command that does.
    """
    path = baked_file(name, ".json", folder)
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing; bake it with `python -m tasks.objects.bake {name}`.")
    numbers = json.loads(path.read_text())
    footprint, centre = np.array(numbers["footprint"]), np.array(numbers["centre"])
    # Assets are cached and shared: nobody may move another's object.
    footprint.setflags(write=False)
    centre.setflags(write=False)
    return ObjectAsset(
        name=name,
        parts=shape.parts,
        visual=baked_file(name, ".obj", folder),
        collision=baked_file(name, ".hulls.obj", folder),
        radius=numbers["radius"],
        footprint=footprint,
        rest_height=numbers["rest_height"],
        shape=shape,
        centre=centre,
    )
