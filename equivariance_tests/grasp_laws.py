"""How the laws of grasps are measured: Eq. 2 for kernels and for policies, and what whole policies owe.

Errors are the larger of a distance in cells of the read-out and an angle in bins, so that one tolerance says both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from equigrasp.errors import InputError
from equigrasp.grasp import Grasp
from equigrasp.read_out import ReadOut
from equivariance_tests.kernel_laws import compare
from equivariance_tests.law import Case, Measurement
from equivariance_tests.scenes import (
    Arrangement,
    Blobs,
    PlaneMotion,
    Scene,
    arrangement,
    blobs,
    lattice,
    meant,
    moved,
    render,
)
from equivariance_tests.stage import (
    NEAR,
    are_scores,
    cells,
    effect,
    observe,
    respond,
    respond_to_scenes,
    scene_and_motion,
    shown,
    stage,
    visible,
    without_target,
    words,
)
from equivariance_tests.subjects import KernelSubject, PolicySubject, representation

OUTSHONE = 0.9
"""Of the target's best score, what the others' may be."""
SMALL = 500.0
"""Times what the objects do to the scores: larger ones are no measure of an error, beyond that of rounding."""
BLOCK = 4
"""Pixels between the Gaussians of the object that a policy means."""
FEW = 6
"""Bins: of fewer, three at the least, an angle may be off by 45 degrees, where a bin and a half is more."""
TIED = 16
"""Roundings of the best score: angles that differ by less are as good as each other."""
NOT_FINITE = Measurement(math.inf, "a score is not finite")
STEP = 32
"""Pixels: a U-Net of five halvings commutes with shifts by no less."""


def eq_2_kernel(subject: KernelSubject, case: Case) -> Measurement | None:
    """Argmax f(o with g.b) = g argmax f(o): among fixed others the object that the kernel means moves alone.

    Others lie so far off that no grasp of the target sees two objects, which is what Eq. 2 needs: f is local. What is
    no scalar in the scene (`in_type`) turns with the target.
    """
    rho = representation(subject.in_type, case.degrees)
    if subject.read_out is None or rho is None:
        return None
    kernel = subject.kernel(case.seed)
    reach = kernel.shape[-1] // 2
    gap, margin = 2.0 * reach + 22, reach + 16
    slots = [(gap * i, gap * j) for i in (-1, 0, 1) for j in (-0.5, 0.5)]
    rows, columns = int(gap + 2 * margin) + 1, int(2 * (gap + margin)) + 1
    scene = arrangement(subject.in_type.size, case.seed, slots, quieter=1.0)
    target = meant(kernel, subject.read_out[case.seed % len(subject.read_out)])
    scene = replace(scene, target=replace(target, centre=scene.target.centre))
    motion = PlaneMotion(case.degrees, (case.x, case.y), scene.target.centre)
    scene = _outshone(subject, kernel, scene, rows, columns)

    turned = replace(scene, target=replace(scene.target, weight=rho @ scene.target.weight))
    before, after = _scores_of_kernel(subject, kernel, [scene, turned.with_target_moved(motion)], rows, columns)
    if not np.isfinite(before).all() or not np.isfinite(after).all():
        return NOT_FINITE
    return follow(before, after, motion, rows, columns, 1)


def _outshone(subject: KernelSubject, kernel: Tensor, scene: Arrangement, rows: int, columns: int) -> Arrangement:
    """The others fainter where the best grasp would be theirs: of a kernel of a few taps it may be (condition 2)."""
    target, others = _scores_of_kernel(subject, kernel, [scene.target, without_target(scene)], rows, columns)
    best, rival = float(target.max()), float(others.max())
    if not best > 0 or not rival > OUTSHONE * best:
        return scene
    share = OUTSHONE * best / rival
    return replace(scene, others=tuple(replace(each, weight=share * each.weight) for each in scene.others))


def _scores_of_kernel(
    subject: KernelSubject, kernel: Tensor, scenes: Sequence[Scene], rows: int, columns: int
) -> np.ndarray:
    images = torch.stack([render(each, rows, columns) for each in scenes])
    field = subject.correlate(images.to(kernel), kernel.expand(len(images), -1, -1, -1, -1))
    return torch.einsum("io,bohw->bihw", subject.read_out, field).numpy()


def eq_2_policy(subject: PolicySubject, case: Case) -> Measurement | None:
    """Eq. 2 for phi and kappa together: the best grasp of the object that the policy means, when it moves alone."""
    embedding, table = words(subject, case), stage(subject, case.seed)
    scene, motion = scene_and_motion(subject, case)
    target = meant_by_policy(subject, embedding, scene, case.seed)
    scene = replace(scene, target=replace(target, centre=scene.target.centre))
    there = (motion.about[0] + motion.shift[0], motion.about[1] + motion.shift[1])
    before, after = respond_to_scenes(subject, embedding, [scene, scene.with_target_moved(motion)], table)
    if not are_scores(before) or not are_scores(after):
        return NOT_FINITE
    before, after = _near(before, scene.target.centre, subject.stride), _near(after, there, subject.stride)
    return follow(before, after, motion, table.rows, table.columns, subject.stride)


def meant_by_policy(subject: PolicySubject, embedding: Tensor, scene: Arrangement, seed: int) -> Blobs:
    """The object that a policy means, to first order: the gradient of one score, smoothed by Gaussians.

    `meant` is the same for a kernel, whose score is linear. Any other object would do for the law, but its best
    grasp may be one of many that are nearly as good, whose order a hundredth of a pixel decides. A policy without
    gradients, as one that computes in numpy, gets the scene's own target.
    """
    table, thing = stage(subject, seed), scene.target
    rows, columns = table.rows, table.columns
    x, y = thing.centre
    u, v = round(columns // 2 + x), round(rows // 2 - y)
    gradient = _gradient(subject, embedding, render(without_target(scene), rows, columns), (seed, v, u))
    if gradient is None or not gradient.isfinite().all():
        return thing
    blocks = torch.nn.functional.avg_pool2d(gradient[:, v - NEAR : v + NEAR, u - NEAR : u + NEAR].double(), BLOCK)
    # a block is centred between pixels, right of and below its first one
    half = (BLOCK - 1) / 2
    points = BLOCK * lattice(*blocks.shape[1:]) + torch.tensor([half, -half], dtype=torch.float64)
    kept = points.norm(dim=1) < NEAR
    weight = blocks.flatten(1)[:, kept]
    if not weight.any():
        return thing
    meant = visible(Blobs(weight * (0.5 * weight.numel() ** 0.5 / weight.norm()), points[kept], width=3.0))
    return meant if meant.weight.any() else thing


def _gradient(subject: PolicySubject, embedding: Tensor, image: Tensor, at: tuple[int, int, int]) -> Tensor | None:
    """Of the score of a bin, modulo their number, and of the cell of a row's and a column's pixel, by the image."""
    image = image.to(subject.dtype).requires_grad_()
    index, row, column = at
    try:
        scores = subject.scores(observe(image)[None], embedding)[0]
        score = scores[index % len(scores), row // subject.stride, column // subject.stride]
        return torch.autograd.grad(score, image, allow_unused=True)[0] if score.requires_grad else None
    except (InputError, RuntimeError):
        # what is wrong without gradients as well is said when the scenes are shown
        return None


def quarter_turn(subject: PolicySubject, case: Case) -> Measurement | None:
    """The worse of a smooth scene and a rough one: edges, noise, a table that is no one colour, darker places.

    A turn by 90 degrees moves pixels and interpolates nothing, so that it is exact whatever the picture is.
    """
    found = [each for each in (smooth_quarter_turn(subject, case), _rough_quarter_turn(subject, case)) if each]
    return max(found, key=lambda each: each.value, default=None)


def smooth_quarter_turn(subject: PolicySubject, case: Case) -> Measurement | None:
    """f(T_g o) = T_g rho(g) f(o) for quarter turns of a square scene of `subject.sides`: every score of every cell."""
    side = subject.side(case.seed)
    return _quarter_turn(subject, case, observe(_two_things(case.seed, side)))


def _rough_quarter_turn(subject: PolicySubject, case: Case) -> Measurement | None:
    side = subject.side(case.seed)
    rng = torch.Generator().manual_seed(case.seed)
    slope = torch.linspace(-0.4, 0.4, side, dtype=torch.float64)
    grain = 2 * torch.rand(4, side, side, dtype=torch.float64, generator=rng) - 1
    # by a lamp in a corner the table is brighter there
    light = torch.stack([slope[:, None] + slope] * 3 + [0 * grain[3]])
    found = _quarter_turn(subject, case, observe(_two_things(case.seed, side) + light + grain))
    return found and replace(found, message=f"of a rough scene, {found.message}")


def _two_things(seed: int, side: int) -> Tensor:
    scene = shown(arrangement(4, seed, [(-25, -20), (20, 25)], 8.0, 1.0, 12.0, 5.0, positive=True))
    return render(scene, side, side)


def _quarter_turn(subject: PolicySubject, case: Case, image: Tensor) -> Measurement | None:
    """Of an observation `(4, side, side)`.

    Relative to the largest score, or to 500 times what the scene does to any, where that is less: a constant that
    hides what it does hides no error. Scores that are those of a bare table, as where grasps are forbidden by -1e9,
    are no measure either.
    """
    quarter = round(case.degrees / 90)
    table = observe(torch.zeros_like(image))
    # in float64: beside cells that are forbidden by -1e9 a difference of float32 is rounded to whole numbers
    scenes = [image, torch.rot90(image, quarter, (1, 2)), table]
    before, after, bare = respond(subject, words(subject, case), scenes).double()
    bins = len(before)
    # of one bin, every angle is that bin
    if quarter * bins % 2 and bins > 1:
        return None
    if not are_scores(before) or not are_scores(after):
        return NOT_FINITE

    def turned(scores: Tensor) -> Tensor:
        return torch.roll(torch.rot90(scores, quarter, (1, 2)), quarter * bins // 2, 0)

    expected = turned(before)
    forbidden = expected == -math.inf
    if not torch.equal(after == -math.inf, forbidden):
        return Measurement(math.inf, "a grasp is forbidden, minus infinity, where its turned twin is allowed")
    done = SMALL * effect(before, bare)
    if not done:
        return Measurement(math.inf, "no score depends on what is on the table")
    counted = turned(before != bare) & expected.isfinite()
    # of one that allows and forbids alone, all that it allows
    counted = counted if counted.any() else ~forbidden
    middle = float(expected[counted].mean())
    after, expected = (each.masked_fill(forbidden, middle) - middle for each in (after, expected))
    result = compare(after.flatten(1), expected.flatten(1), "f(T_g o)", "T_g rho(g) f(o)")
    if not math.isfinite(result.value):
        return result
    largest = float(expected[counted].abs().max())
    error = float((after - expected).abs().max())
    return Measurement(error / min(largest or done, done), result.message.replace("output", "bin", 1))


def translation(subject: PolicySubject, case: Case) -> Measurement | None:
    """The best grasp of an object moves with it; by whole halvings of the U-Net, over bare table."""
    rng = np.random.default_rng(case.seed)
    thing = visible(blobs(4, case.seed, spread=12.0, width=5.0, positive=True))
    start, step = float(rng.integers(-2, 0)) * STEP, float(rng.integers(1, 4)) * STEP
    ends, motion = ((start, 0.0), (start + step, 0.0)), PlaneMotion(0.0, (step, 0.0))
    table, scenes = stage(subject, case.seed), [moved(thing, PlaneMotion(0.0, end)) for end in ends]
    scores = respond_to_scenes(subject, words(subject, case), scenes, table)
    if not all(are_scores(each) for each in scores):
        return NOT_FINITE
    before, after = (_near(each, end, subject.stride) for each, end in zip(scores, ends, strict=True))
    return follow(before, after, motion, table.rows, table.columns, subject.stride)


def peaks(scores: np.ndarray, stride: int) -> list[Grasp]:
    """The best grasp, then those at its cell whose angle is as good; refined, in full-resolution pixels.

    None at all where another cell is as good: which of them an argmax takes says nothing.
    """
    read_out = ReadOut(scores.shape[1], scores.shape[2], stride, len(scores))
    first, row, column = (int(i) for i in np.unravel_index(int(scores.argmax()), scores.shape))
    angles = scores[:, row, column]
    largest = angles[first]
    # of this cell alone: elsewhere a score may be -1e9, where a grasp is forbidden, beside which all angles are alike
    rounding = np.finfo(scores.dtype).eps * np.abs(angles[np.isfinite(angles)]).max()
    as_good = scores >= largest - TIED * rounding
    if as_good.any(axis=0).sum() > 1:
        return []
    found = [read_out.best(scores)]
    for index in np.flatnonzero(as_good[:, row, column]):
        if index != first:
            raised = scores.copy()
            raised[index, row, column] = np.nextafter(largest, np.inf, dtype=scores.dtype)
            found.append(read_out.best(raised))
    return found


def follow(
    before: np.ndarray, after: np.ndarray, motion: PlaneMotion, rows: int, columns: int, stride: int
) -> Measurement | None:
    """How far the best grasp of `after` is from T_g of that of `before`, in cells or bins, whichever is more.

    Where several angles are equally good, before and after, Eq. 2 is about their sets: the nearest counts, and where
    all are, as of one bin or of frequency 0 alone, no angle is wrong. Where several cells are, nothing is said.
    """
    if not np.isfinite(before.max()) or not np.isfinite(after.max()):
        return Measurement(math.inf, "every grasp near the target is forbidden")
    ways, ways_after = peaks(before, stride), peaks(after, stride)
    if not ways or not ways_after:
        return None
    best = ways[0]
    x, y = best.u - columns // 2, rows // 2 - best.v
    point = motion(torch.tensor([[x, y]], dtype=torch.float64))[0]
    expected = Grasp(
        float(point[0]) + columns // 2, rows // 2 - float(point[1]), best.theta + math.radians(motion.degrees)
    )
    if len(ways_after) != len(ways):
        ways_after = ways_after[:1]
    found = min(ways_after, key=lambda each: _apart(each, expected))
    cells = math.hypot(found.u - expected.u, found.v - expected.v) / stride
    bins = 0.0 if len(ways_after) == len(after) else _apart(found, expected) * len(after) / 180
    # of three bins none is further off than one and a half
    bins *= max(1.0, FEW / len(after)) if len(after) > 2 else 1.0
    return Measurement(
        max(cells, bins), f"{best} should have gone to {expected}, went to {found}: {cells:.1f} cells, {bins:.1f} bins"
    )


def _apart(one: Grasp, other: Grasp) -> float:
    """Degrees between their angles, modulo 180."""
    return math.degrees(abs((one.theta - other.theta + math.pi / 2) % math.pi - math.pi / 2))


def _near(scores: Tensor, centre: tuple[float, float], stride: int) -> np.ndarray:
    rows, columns = scores.shape[1:]
    points = cells(rows, columns, stride)
    outside = (points - points.new_tensor(centre)).norm(dim=1) > NEAR
    return scores.masked_fill(outside.unflatten(0, (rows, columns)), float(scores.min())).numpy()
