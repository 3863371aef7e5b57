"""Pixel and metre, bin and angle, and how SE(2) acts: every conversion of the project lives here.

World: x along the workspace's length, y along its depth, z up, metres; the origin is the middle of the table.
Heightmap: pixel (u, v) is centred at x = x_min + (u + 1/2) p, y = y_max - (v + 1/2) p, for a pixel size p.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from equigrasp.grasp import Grasp, Observation

LEAST_SEEN = 0.2
"""Share of a heightmap that cameras see at the least, of a table that is not black."""


@dataclass(frozen=True)
class Motion:
    """An element g = (R(angle), translation) of SE(2) in world coordinates: p -> R p + t.

    Attributes:
        angle: radians, counter-clockwise seen from above.
        x: metres.
        y: metres.
    """

    angle: float = 0.0
    x: float = 0.0
    y: float = 0.0

    def matrix(self) -> NDArray[np.float64]:
        """The homogeneous `(3, 3)` matrix."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[c, -s, self.x], [s, c, self.y], [0.0, 0.0, 1.0]])

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Move points `(..., 2)` in metres."""
        points = np.asarray(points, dtype=np.float64)
        matrix = self.matrix()
        return points @ matrix[:2, :2].T + matrix[:2, 2]

    def __matmul__(self, other: Motion) -> Motion:
        """The composition: first `other`, then this one."""
        x, y = self([other.x, other.y])
        return Motion(self.angle + other.angle, float(x), float(y))

    def inverse(self) -> Motion:
        """The motion that undoes this one."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return Motion(-self.angle, -(c * self.x + s * self.y), s * self.x - c * self.y)

    def about(self, x: float, y: float) -> Motion:
        """This motion with its rotation about the point (x, y) in metres instead of the origin."""
        return Motion(x=x, y=y) @ self @ Motion(x=-x, y=-y)


@dataclass(frozen=True)
class Workspace:
    """The table top as a grid: sizes in metres, pixels and bins, and every conversion between them.

    Attributes:
        length: extent along world x, metres.
        depth: extent along world y, metres.
        rows: H, pixels along y.
        columns: W, pixels along x.
        bins: number of orientations in [0, pi); bin i is centred on i * pi / bins.

    Raises:
        ValueError: if pixels would not be square, or a size is not positive.
    """

    length: float = 1.0
    depth: float = 0.5
    rows: int = 160
    columns: int = 320
    bins: int = 36

    def __post_init__(self) -> None:
        if min(self.length, self.depth, self.rows, self.columns, self.bins) <= 0:
            raise ValueError(f"a Workspace needs positive sizes, but this is {self}")
        if not math.isclose(self.length / self.columns, self.depth / self.rows, rel_tol=1e-9):
            raise ValueError(
                f"a Workspace needs square pixels, but {self.length} m / {self.columns} columns is not "
                f"{self.depth} m / {self.rows} rows"
            )

    @property
    def pixel(self) -> float:
        """Side of a pixel, metres."""
        return self.length / self.columns

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, `(H, W)`."""
        return self.rows, self.columns

    @property
    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """((x_min, x_max), (y_min, y_max)) in metres."""
        return (-self.length / 2, self.length / 2), (-self.depth / 2, self.depth / 2)

    def to_pixel(self, points: ArrayLike) -> NDArray[np.float64]:
        """World `(..., 2)` x, y in metres -> `(..., 2)` u, v in pixels (not rounded)."""
        points = np.asarray(points, dtype=np.float64)
        u = (points[..., 0] + self.length / 2) / self.pixel - 0.5
        v = (self.depth / 2 - points[..., 1]) / self.pixel - 0.5
        return np.stack([u, v], axis=-1)

    def to_world(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Pixels `(..., 2)` u, v -> world `(..., 2)` x, y in metres."""
        pixels = np.asarray(pixels, dtype=np.float64)
        x = (pixels[..., 0] + 0.5) * self.pixel - self.length / 2
        y = self.depth / 2 - (pixels[..., 1] + 0.5) * self.pixel
        return np.stack([x, y], axis=-1)

    def contains(self, grasp: Grasp) -> bool:
        """Whether the grasp's pixel lies in the heightmap."""
        return -0.5 <= grasp.u < self.columns - 0.5 and -0.5 <= grasp.v < self.rows - 0.5

    def to_angle(self, index: int) -> float:
        """Bin -> angle of the closing axis in radians."""
        return index * math.pi / self.bins

    def to_bin(self, theta: float) -> int:
        """Angle of the closing axis in radians -> the nearest bin, modulo pi."""
        return nearest_bin(theta, self.bins)

    def to_action(self, grasp: Grasp) -> NDArray[np.int64]:
        """Grasp -> `(u, v, bin)`, the action of the environments; the pixel is clipped to the heightmap."""
        u = min(max(math.floor(grasp.u + 0.5), 0), self.columns - 1)
        v = min(max(math.floor(grasp.v + 0.5), 0), self.rows - 1)
        return np.array([u, v, self.to_bin(grasp.theta)], dtype=np.int64)

    def to_grasp(self, action: ArrayLike) -> Grasp:
        """`(u, v, bin)` -> Grasp at the pixel's centre and the bin's angle."""
        u, v, index = (int(value) for value in np.asarray(action))
        return Grasp(u, v, self.to_angle(index))

    def move_grasp(self, motion: Motion, grasp: Grasp) -> Grasp:
        """T_g on a grasp: its point moves by g, its closing axis turns by g's angle."""
        u, v = self.to_pixel(motion(self.to_world([grasp.u, grasp.v])))
        return Grasp(float(u), float(v), grasp.theta + motion.angle)

    def pixel_map(self, motion: Motion) -> NDArray[np.float64]:
        """The `(3, 3)` matrix that takes (u, v, 1) to where g moves that pixel's centre, in pixels."""
        to_world, to_pixel = self._units
        return to_pixel @ motion.matrix() @ to_world

    @functools.cached_property
    def _units(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """From (u, v, 1) to (x, y, 1) in metres, and back, `(3, 3)` each."""
        to_world = np.array(
            [
                [self.pixel, 0.0, 0.5 * self.pixel - self.length / 2],
                [0.0, -self.pixel, self.depth / 2 - 0.5 * self.pixel],
                [0.0, 0.0, 1.0],
            ]
        )
        # exact where the numbers of pixels to a metre are whole, so that a move by whole pixels is one
        to_pixel = np.array(
            [
                [self.columns / self.length, 0.0, (self.columns - 1) / 2],
                [0.0, -self.rows / self.depth, (self.rows - 1) / 2],
                [0.0, 0.0, 1.0],
            ]
        )
        return to_world, to_pixel

    def move_observation(
        self, motion: Motion, observation: Observation, table: NDArray[np.uint8] | None = None, level: float = 0.0
    ) -> Observation:
        """T_g on an observation: (T_g o)(p) = o(g^-1 p), interpolated bilinearly.

        What comes in from outside the heightmap is bare table: its height and its colour.
        Height is a scalar: it moves and does not change.

        Args:
            motion: g.
            observation: o.
            table: `table_color(observation)`, where it is known: it takes as long as the motion.
            level: how high the table lies, metres; under a camera of one's own it may seem to be off 0.
        """
        pixel_map = self.pixel_map(motion)
        outside = tuple(int(value) for value in (table_color(observation) if table is None else table))
        return Observation(
            warp(observation.color, pixel_map, observation.shape, outside),
            warp(observation.height, pixel_map, observation.shape, level),
        )


def was_seen(observation: Observation) -> NDArray[np.bool_]:
    """`(H, W)`: where a camera saw something; what none saw is black and at height 0 (`equigrasp.heightmap.fuse`).

    A heightmap of which less than `LEAST_SEEN` is anything else is taken for one of a black table, seen all over.
    """
    red, green, blue = np.moveaxis(observation.color, -1, 0)
    seen = (observation.height != 0) | ((red | green | blue) > 0)
    return seen if np.count_nonzero(seen) >= LEAST_SEEN * seen.size else np.ones_like(seen)


def table_color(observation: Observation) -> NDArray[np.uint8]:
    """The median colour `(3,)` of the bare table where it was seen (of all that was seen where no table shows)."""
    seen = was_seen(observation)
    bare = observation.color[seen & (np.abs(observation.height) < 0.002)]
    pixels = bare if len(bare) else observation.color[seen]
    # counted, not sorted: the middle value, or the mean of the two, rounded down
    middle = [(len(pixels) - 1) // 2, len(pixels) // 2]
    counts = [np.bincount(channel, minlength=256).cumsum() for channel in pixels.T]
    return np.array([int(np.searchsorted(each, middle, side="right").sum()) // 2 for each in counts], dtype=np.uint8)


def warp(
    image: NDArray,
    pixel_map: NDArray[np.float64],
    shape: tuple[int, int],
    outside: float | tuple[int, ...],
) -> NDArray:
    """Move an image by an affine map of its pixels, interpolated bilinearly.

    Pillow cuts interpolated colours off to whole numbers, so that they are half a level too dark in the mean. They stay
    so: rounded ones would be other examples, and other trainings.

    Args:
        image: `(h, w)` float32, or `(h, w, 3)` uint8.
        pixel_map: `(3, 3)`, takes (u, v, 1) in the image to (u, v, 1) in the result, in pixel centres.
        shape: (rows, columns) of the result.
        outside: the value where nothing of the image comes to lie.
    """
    from PIL import Image

    rows, columns = shape
    moved = Image.fromarray(image).transform(
        (columns, rows),
        Image.Transform.AFFINE,
        data=tuple(backward(pixel_map).ravel()),
        resample=Image.Resampling.BILINEAR,
        fillcolor=outside,
    )
    return np.array(moved)


def backward(pixel_map: NDArray[np.float64]) -> NDArray[np.float64]:
    """The way back of a map of pixel centres, `(2, 3)`, in coordinates from the first pixel's corner: Pillow's."""
    return (_CORNER @ inverse(pixel_map) @ _CENTRE)[:2]


def inverse(affine: NDArray[np.float64]) -> NDArray[np.float64]:
    """The inverse of an affine map of the plane, `(3, 3)` with the last row 0, 0, 1.

    Written out: LAPACK's wakes threads of its own even for nine numbers, and where torch's hold the cores it took a
    millisecond, thirty times for a drawn example (docs/speed.md).
    """
    (a, b, u), (c, d, v), _ = affine.tolist()
    det = a * d - b * c
    return np.array([[d / det, -b / det, (b * v - d * u) / det], [-c / det, a / det, (c * u - a * v) / det], [0, 0, 1]])


def nearest_bin(theta: float, bins: int) -> int:
    """Angle of the closing axis in radians -> the nearest of so many bins over [0, pi), modulo pi."""
    return math.floor(theta * bins / math.pi + 0.5) % bins


_CORNER = np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 1.0]])
_CENTRE = np.array([[1.0, 0.0, -0.5], [0.0, 1.0, -0.5], [0.0, 0.0, 1.0]])
"""From pixel centres to coordinates that start at the first pixel's corner, and back."""
WORKSPACE = Workspace()
"""The benchmark's workspace: 1.0 m x 0.5 m, 160 x 320 pixels of 3.125 mm, 36 bins of 5 degrees."""
