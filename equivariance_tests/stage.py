"""Where policies are put to their laws: how large the table is, where objects lie, what is asked, what is answered.

A policy that says how far its scores see (`reach`) gets a table on which the premise of Eq. 2 holds: from its grasps of
the target it sees neither another object nor the border, and no further apart than that are they. Any other policy
gets one of three places in a row.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from equigrasp.errors import InputError
from equivariance_tests.law import Case
from equivariance_tests.scenes import Arrangement, Blobs, PlaneMotion, Scene, arrangement, lattice, render
from equivariance_tests.silence import FARTHEST
from equivariance_tests.subjects import PolicySubject

NEAR = 24
"""A policy's grasp of the target is its best within so many pixels of the target's centre."""
JITTER, SPREAD, WIDTH = 4.0, 8.0, 4.0
"""How far objects lie from their places, their Gaussians from their centres, and how wide those are, pixels."""
TABLE, CONTRAST, RISE = 90.0, 40.0, 0.02
"""Colour of the bare table, levels of colour for a value of one, and metres."""
ROOM = 0.98
"""Share of the range of colours that objects may take: between pixels they may be brighter than at any."""
GAP = 76 / 128
"""Of a table's rows: between places of objects on the table of a policy without a reach."""
SHIFT = 4
"""Pixels along each axis: laws move the target by no more."""


@dataclass(frozen=True)
class Stage:
    """The table of a policy's scenes.

    Attributes:
        rows: pixels, a multiple of 32, which every U-Net here takes.
        columns: likewise.
        gap: pixels between places of objects, which lie in a row through the middle.
    """

    rows: int
    columns: int
    gap: float


def stage(subject: PolicySubject, seed: int = 0) -> Stage:
    """The table for a policy in the case of that seed: as small as its reach allows, without one of its sizes."""
    reach = seen(subject)
    if reach is None:
        side = subject.side(seed)
        return Stage(side, 2 * side, GAP * side)
    # a Gaussian is cut off at 6 widths; the target is put on the grid, which moves it by a cell at most
    thing, loose = SPREAD + 6 * WIDTH, JITTER + SHIFT + grid(subject)
    margin = NEAR + reach + loose
    gap = margin + thing + JITTER
    # the target lies in the middle; what is beside it may see the border
    return Stage(_whole(2 * margin), _whole(2 * (gap + thing + JITTER)), gap)


def seen(subject: PolicySubject) -> float | None:
    """How far its scores see, pixels; None where that is not said, or as good as all of the table."""
    return None if subject.reach is None or subject.reach > FARTHEST else subject.reach


def grid(subject: PolicySubject) -> int:
    """Pixels: what reads out at full resolution may halve the image inside."""
    return max(2, subject.stride)


def scene_and_motion(subject: PolicySubject, case: Case) -> tuple[Arrangement, PlaneMotion]:
    """Three objects, and how the target moves: about its centre, and by a few pixels.

    Quarter turns of policies with a reach are those that the grid has: about a cell's centre or corner, with a shift
    by whole cells.
    """
    gap = stage(subject, case.seed).gap
    places = ((-gap, 0.0), (0.0, 0.0), (gap, 0.0))
    scene = shown(arrangement(4, case.seed, places, JITTER, 1.0, SPREAD, WIDTH, positive=True))
    if seen(subject) is None:
        return scene, PlaneMotion(case.degrees, (case.x, case.y), scene.target.centre)
    scene = _target_in_the_middle(scene)
    if case.degrees % 90:
        return scene, PlaneMotion(case.degrees, (case.x, case.y), scene.target.centre)
    cell = grid(subject)
    # corners of cells lie between pixels: half a pixel to the left of the middle one and above it; y is up
    half = cell / 2 * (case.seed % 2)
    x, y = scene.target.centre
    centre = (cell * round(x / cell) - 0.5 + half, cell * round(y / cell) + 0.5 - half)
    shift = (float(cell * round(case.x / cell)), float(cell * round(case.y / cell)))
    return replace(scene, target=replace(scene.target, centre=centre)), PlaneMotion(case.degrees, shift, centre)


def without_target(scene: Arrangement) -> Arrangement:
    """The others alone."""
    return replace(scene, target=replace(scene.target, weight=0 * scene.target.weight))


def cells(rows: int, columns: int, stride: int) -> Tensor:
    """Centres of the read-out's cells, `(rows * columns, 2)` x, y in pixels from the middle, y up."""
    # a cell of stride 2 is centred half a pixel to the right of and below its first pixel
    half = (stride - 1) / 2
    return lattice(rows, columns) * stride + torch.tensor([half, -half], dtype=torch.float64)


def visible(thing: Blobs) -> Blobs:
    """The object as a camera may see it: fainter where a colour would leave 0 .. 255, and nowhere below the table."""
    weight = thing.weight.clone()
    weight[3:] = weight[3:].clamp(min=0)
    side = 2 * math.ceil(float(thing.centres.norm(dim=1).max()) + 3 * thing.width) + 1
    colour = render(replace(thing, weight=weight, centre=(0.0, 0.0)), side, side)[:3]
    brighter, darker = ROOM * (255 - TABLE) / CONTRAST, ROOM * TABLE / CONTRAST
    beyond = max(1.0, float(colour.max()) / brighter, -float(colour.min()) / darker)
    return replace(thing, weight=weight / beyond)


def shown(scene: Arrangement) -> Arrangement:
    """Each object `visible`."""
    return Arrangement(visible(scene.target), tuple(visible(each) for each in scene.others))


def observe(image: Tensor) -> Tensor:
    """Values of order one, `(4, rows, columns)`, as an observation: colour 0 .. 255, about 90, and height in metres.

    Beyond what a camera sees a value is cut off, at each pixel alone, so that it turns with the scene.
    """
    return torch.cat([(TABLE + CONTRAST * image[:3]).clamp(0, 255), (RISE * image[3:]).clamp(min=0)])


def words(subject: PolicySubject, case: Case) -> Tensor:
    """The embedding of an instruction, `(1, D)`, a random unit vector."""
    rng = torch.Generator().manual_seed(case.seed)
    return torch.nn.functional.normalize(torch.randn(1, subject.embedding_size, generator=rng)).to(subject.dtype)


def respond_to_scenes(subject: PolicySubject, embedding: Tensor, scenes: list[Scene], table: Stage) -> Tensor:
    """Scores of scenes on a table, `(len(scenes), bins, h, w)`."""
    return respond(subject, embedding, [observe(render(each, table.rows, table.columns)) for each in scenes])


@torch.no_grad()
def respond(subject: PolicySubject, embedding: Tensor, observations: list[Tensor]) -> Tensor:
    """Scores of observations, `(len(observations), bins, h, w)`, each asked for alone, as a robot asks.

    What a module shares between the scenes of one batch would cancel in a comparison of the two.
    """
    # copied: a module may write into what it is given
    asked = [each[None].to(subject.dtype, copy=True) for each in observations]
    # and its answer may be memory that it writes the next one to
    answers = [subject.scores(each, embedding.clone()).clone() for each in asked]
    for scene, scores in zip(asked, answers, strict=True):
        rows, columns = (side // subject.stride for side in scene.shape[2:])
        if tuple(scores.shape) != (1, subject.bins, rows, columns):
            raise InputError(
                f"{subject.name} makes scores {tuple(scores.shape)} of a scene of {scene.shape[2]} x {scene.shape[3]} "
                f"pixels, where they are (1, {subject.bins}, {rows}, {columns}); does it keep something of another one?"
            )
    return torch.cat(answers)


def are_scores(scores: Tensor) -> bool:
    """Whether they can be compared: numbers, or minus infinity, which forbids a grasp, and not that alone."""
    return not bool(scores.isnan().any()) and bool(scores.max().isfinite())


def change(after: Tensor, before: Tensor) -> Tensor:
    """`after - before`: 0 where both forbid a grasp, infinite where one alone does."""
    return torch.where(after == before, torch.zeros_like(after), after - before)


def effect(present: Tensor, absent: Tensor) -> float:
    """The most that something does to a score, by its presence; where it does nothing but allow or forbid, the score.

    0 where no score changes.
    """
    changed = change(present, absent)
    changed = changed[changed.isfinite()]
    if changed.any():
        return float(changed.abs().max())
    once = present.isfinite() != absent.isfinite()
    return float(torch.where(present.isfinite(), present, absent)[once].abs().max()) if once.any() else 0.0


def _target_in_the_middle(scene: Arrangement) -> Arrangement:
    """The target and whatever lies in the middle change places."""
    middle = min((scene.target, *scene.others), key=lambda each: abs(each.centre[0])).centre
    freed = scene.target.centre
    others = tuple(replace(each, centre=freed) if each.centre == middle else each for each in scene.others)
    return Arrangement(replace(scene.target, centre=middle), others)


def _whole(pixels: float) -> int:
    return 32 * math.ceil(pixels / 32)
