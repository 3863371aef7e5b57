"""Recombination of colours: a demonstrated object in a demonstrated colour that it was not shown in.

One demonstration shows each thing in one colour, and a policy takes the one for the other: "the pink banana" is
whatever is pink, or whatever is a banana. Which of a demonstrator's words is the colour is known of goals of one kind;
how a colour looks is seen on the thing that was meant by it. Put on another thing, with that thing's own shades, it is
meant by the same word. So a policy sees combinations that no demonstration shows, those among them that the benchmark
holds out for testing.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from equigrasp.augmentation.cutouts import Cutout, Scene
from equigrasp.augmentation.rephrasing import frame
from equigrasp.grasp import Demonstration

KIND = "colored object"
"""Goals of this kind are said in two words: a colour, and the thing that has it."""
KEPT = 1000
"""Painted objects that are kept, some 7 MB: all of one demonstration of pick-random-v2, 22 things in 22 paints."""
LUMINANCE = np.array([0.299, 0.587, 0.114])
"""How bright red, green and blue are (ITU-R BT.601)."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Painted(Cutout):
    """An object in another paint. Its `color` stays its own; what is put down is painted when it is first asked for.

    Attributes:
        paint: `(3,)`, its new paint, as `paint` has it.
        table: `(3,)`, the colour of the table that it stood on.
    """

    paint: NDArray[np.float64]
    table: NDArray[np.uint8]

    @classmethod
    def of(cls, cutout: Cutout, name: str, paint: NDArray[np.float64], table: NDArray[np.uint8]) -> Painted:
        """A cutout in that paint, under that name."""
        own = cutout.color, cutout.height, cutout.mask, cutout.corner
        return cls(*own, name, cutout.number, paint=paint, table=table)

    @functools.cached_property
    def pixels(self) -> NDArray[np.uint8]:
        """`(h, w, 3)`: the colours that it is put down in."""
        return repaint(self, self.paint, self.table)


class Palette:
    """The colours and the coloured things of some demonstrations; empty if they show every thing in every colour.

    Args:
        scenes: the demonstrations, taken apart.

    Attributes:
        scenes: those whose target may have another colour.
        colors: each colour's word, and the paint `(3,)` of each thing that was shown in it.
        frames: sentences with a colour and a thing left open, each once.
    """

    def __init__(self, scenes: Sequence[Scene]) -> None:
        colored = [each for each in scenes if is_colored(each.demonstration)]
        shown = {each.demonstration.words for each in colored}
        colors, things = ({words[place] for words in shown} for place in (0, 1))
        self.scenes = tuple(colored) if len(shown) < len(colors) * len(things) else ()
        self.colors: dict[str, list[NDArray[np.float64]]] = {}
        for each in self.scenes:
            self.colors.setdefault(each.demonstration.words[0], []).append(paint(each.target))
        found = [frame(each.demonstration) for each in self.scenes]
        self.frames = tuple(dict.fromkeys(each for each in found if each is not None))
        self._painted: dict[tuple[int, str, int], Painted] = {}

    @property
    def sentences(self) -> tuple[str, ...]:
        """Every sentence that `sentence` may give."""
        things = dict.fromkeys(each.demonstration.words[1] for each in self.scenes)
        return tuple(said(frame, color, thing) for thing in things for color in self.colors for frame in self.frames)

    def has(self, scene: Scene) -> bool:
        """Whether a scene's target may have another colour, and there are sentences to ask for it."""
        return bool(self.frames) and any(each is scene for each in self.scenes)

    def color(self, rng: np.random.Generator) -> str:
        """One of the colours, each as likely."""
        return list(self.colors)[int(rng.integers(len(self.colors)))]

    def painted(self, scene: Scene, color: str, rng: np.random.Generator) -> Painted:
        """A scene's target in a colour, as one of the things that were shown in it has it."""
        paints = self.colors[color]
        index = int(rng.integers(len(paints)))
        key = next(place for place, each in enumerate(self.scenes) if each is scene), color, index
        if key not in self._painted:
            if len(self._painted) >= KEPT:
                self._painted.pop(next(iter(self._painted)))
            name = f"{color} {scene.demonstration.words[1]}"
            self._painted[key] = Painted.of(scene.target, name, paints[index], scene.table)
        return self._painted[key]

    def sentence(self, scene: Scene, color: str, rng: np.random.Generator) -> str:
        """What asks for a scene's target in a colour, in the words of one of the demonstrations."""
        return said(self.frames[int(rng.integers(len(self.frames)))], color, scene.demonstration.words[1])


def is_colored(demonstration: Demonstration) -> bool:
    """Whether its words are a colour and the thing that has it."""
    return demonstration.kind == KIND and len(demonstration.words) == 2


def said(frame: str, color: str, thing: str) -> str:
    """The sentence about that thing in that colour."""
    return frame.replace(chr(0), color).replace(chr(1), thing)


def paint(cutout: Cutout) -> NDArray[np.float64]:
    """The median colour `(3,)` of an object."""
    return np.median(cutout.color[cutout.height > 0], axis=0)


def repaint(cutout: Cutout, new: NDArray[np.float64], table: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """An object's pixels `(h, w, 3)`, its shades of its own paint as shades of another; what is beside it stays.

    Of several cameras together an object's heights reach a pixel further than its colours do. So what looks like the
    table rather than like any shade of the object's paint is table.

    Args:
        cutout: the object.
        new: `(3,)`, the other paint, as `paint` has it.
        table: `(3,)`, the table's colour.
    """
    own = paint(cutout)
    shade = (cutout.color @ LUMINANCE) / max(float(own @ LUMINANCE), 1.0)
    painted = np.clip(shade[..., None] * new, 0, 255).astype(np.uint8)
    nearest = (cutout.color @ own / max(float(own @ own), 1.0))[..., None] * own
    off_paint, off_table = (np.abs(cutout.color - each).max(axis=-1) for each in (nearest, table.astype(np.float64)))
    return np.where(((cutout.height > 0) & (off_paint <= off_table))[..., None], painted, cutout.color)
