"""Shape: a solid with named parts. An object of the suite is one Shape; all else is made from it.

Frame of drawing: z up, the table at z = 0, the object in its resting pose. What reaches below the table is
cut off, so that a round animal gets the flat flank that it lies on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tasks.objects.solid import Distance, joined

METRE = 1000.0  # millimetres

# A contact or a pixel is on an object to within a few millimetres; beyond this a point belongs to no part.
REACH = 0.010

# Points measured at once: temporaries that stay in the processor's cache save a quarter of the time.
BLOCK = 16384

# Natural colours (sRGB). A colour's place is its slot in the baked palette: append, never reorder.
COLOURS: dict[str, tuple[int, int, int]] = {
    "steel": (178, 182, 192),
    "dark steel": (112, 116, 126),
    "black": (44, 44, 50),
    "wood": (170, 108, 58),
    "orange": (236, 116, 20),
    "red": (206, 42, 40),
    "cream": (240, 228, 204),
    "sand": (222, 164, 84),
    "mane": (128, 66, 22),
    "mauve": (146, 116, 134),
    "pink": (206, 150, 156),
    "slate": (122, 128, 136),
    "ivory": (240, 232, 206),
    "navy": (44, 72, 148),
    "ink": (18, 16, 18),
    "yellow": (246, 214, 34),
    "lime": (200, 208, 44),
    "leaf": (60, 134, 48),
    "flesh": (228, 230, 150),
    "rind": (38, 62, 30),
    "blue": (62, 108, 206),
    "white": (246, 246, 242),
    "violet": (118, 44, 178),
    "magenta": (218, 36, 138),
}


@dataclass(frozen=True)
class Mark:
    """Paint on a piece: seeds, a letter, a logo. It changes the colour and nothing else.

    Attributes:
        solid: what of the piece's surface lies in here is painted; millimetres.
        colour: a key of COLOURS.
        blur: millimetres that its border may be off in the mesh; finer ones take more faces.
    """

    solid: Distance
    colour: str
    blur: float = 0.5


@dataclass(frozen=True)
class Part:
    """One piece of an object: what it is called, where it is, and its colour.

    Attributes:
        name: the name an instruction uses, or None for a piece that nobody is asked to grasp.
        solid: the piece itself, in millimetres.
        colour: a key of COLOURS.
        marks: painted on it one after the other, so the later covers the earlier.
    """

    name: str | None
    solid: Distance
    colour: str
    marks: tuple[Mark, ...] = ()


@dataclass(frozen=True)
class Shape:
    """An object: the union of its pieces. Pieces of one name make up one part, perhaps in several colours.

    A point belongs to its nearest piece, so pieces that meet must overlap a little: the border runs where
    their distances are equal, and a seam of distance zero would be a wall inside the object.

    Attributes:
        pieces: at least one of them named; where two are equally near, the earlier one has the point.
        blend: millimetres within which the surfaces of neighbouring pieces run together.
        faces: about how many triangles its mesh has, before borders and marks are cut in.
        sectors: into how many sectors about the z axis it is cut before convex hulls are sought. A round wall then
            takes fewer of them, and a round body, of several, keeps its shape and the flat that it rests on.

    Raises:
        ValueError: if no piece is named, or a colour is unknown.
    """

    pieces: tuple[Part, ...]
    blend: float = 0.0
    faces: int = 1300
    sectors: int = 1

    def __post_init__(self) -> None:
        if not self.parts:
            raise ValueError("A shape needs at least one named part.")
        for paint in [paint for piece in self.pieces for paint in (piece, *piece.marks)]:
            if paint.colour not in COLOURS:
                raise ValueError(f"Unknown colour {paint.colour!r}; there are {', '.join(COLOURS)}.")

    @property
    def parts(self) -> tuple[str, ...]:
        """The names an instruction may use, in the order of the drawing."""
        return tuple(dict.fromkeys(piece.name for piece in self.pieces if piece.name is not None))

    def distances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance to each piece, whole as drawn: points `(N, 3)` metres -> `(pieces, N)` metres."""
        p = np.ascontiguousarray(np.asarray(points, dtype=np.float64).T) * METRE
        result = np.empty((len(self.pieces), p.shape[1]))
        for start in range(0, p.shape[1], BLOCK):
            block = p[:, start : start + BLOCK]
            for row, piece in enumerate(self.pieces):
                result[row, start : start + BLOCK] = piece.solid(block)
        return result / METRE

    def distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Signed distance to the object: points `(N, 3)` metres -> `(N,)` metres, negative inside."""
        union = joined(list(self.distances(points)), self.blend / METRE)
        return np.maximum(union, -np.asarray(points, dtype=np.float64)[:, 2])

    def piece_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The nearest piece: points `(N, 3)` metres -> `(N,)` indices into `pieces`."""
        return self.distances(points).argmin(axis=0)

    def colour_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The colour of the surface at the points `(N, 3)` metres -> `(N,)`, places in COLOURS."""
        slots = list(COLOURS)
        nearest = self.piece_at(points)
        p = np.ascontiguousarray(np.asarray(points, dtype=np.float64).T) * METRE
        result = np.empty(len(nearest), dtype=np.int64)
        for row, piece in enumerate(self.pieces):
            mine = nearest == row
            colours = np.full(np.count_nonzero(mine), slots.index(piece.colour))
            for mark in piece.marks:
                colours[mark.solid(p[:, mine]) < 0.0] = slots.index(mark.colour)
            result[mine] = colours
        return result

    def part_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The part of the nearest piece: points `(N, 3)` metres -> `(N,)` indices into `parts`.

        -1 where the nearest piece has no name, or is further away than REACH.
        """
        distances = self.distances(points)
        names = np.array([-1 if piece.name is None else self.parts.index(piece.name) for piece in self.pieces])
        return np.where(distances.min(axis=0) <= REACH, names[distances.argmin(axis=0)], -1).astype(np.int64)
