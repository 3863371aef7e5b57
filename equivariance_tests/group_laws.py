"""How the laws of SE(2)'s action and of the lift are measured, against lie_learn's groups."""

from __future__ import annotations

import math

import numpy as np
import torch

from equigrasp import fields
from equigrasp.grasp import Grasp, Observation
from equigrasp.workspace import WORKSPACE
from equivariance_tests.kernel_laws import compare, respond
from equivariance_tests.law import Case, Measurement
from equivariance_tests.reference import SE2, SO2
from equivariance_tests.scenes import QUARTER_BAND, PlaneMotion, blobs, moved, waves
from equivariance_tests.subjects import ActionSubject, LiftSubject

MATRIX = "3x3 matrix"
POINTS = np.array([[0.0, 0.0], [0.3, 0.0], [0.0, 0.2], [-0.17, 0.11]])
"""Metres; three of them fix an element of SE(2)."""


def group(subject: ActionSubject, case: Case) -> Measurement:
    """Composition and inverse of the action on points are lie_learn's in SE(2)."""
    rng = np.random.default_rng(case.seed)
    parameters = [(math.radians(case.degrees), 0.01 * case.x, 0.01 * case.y)]
    parameters.append((rng.uniform(-3, 3), rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3)))
    g, h = (subject.motion(*each) for each in parameters)
    g_matrix, h_matrix = (_matrix(each) for each in parameters)
    product = SE2.compose(g_matrix, h_matrix, parameterization=MATRIX)
    inverse = np.linalg.inv(g_matrix)
    measured = np.concatenate([(g @ h)(POINTS), g.inverse()(POINTS)])
    expected = np.concatenate([_apply(product, POINTS), _apply(inverse, POINTS)])
    return compare(torch.tensor(measured), torch.tensor(expected), "the moved point", "lie_learn's")


def grasps(subject: ActionSubject, case: Case) -> Measurement:
    """T_g on a grasp: its point moves by lie_learn's SE(2), its closing axis turns by its SO(2), modulo pi."""
    rng = np.random.default_rng(case.seed)
    element = (math.radians(case.degrees), 0.01 * case.x, 0.01 * case.y)
    grasp = Grasp(float(rng.uniform(0, 319)), float(rng.uniform(0, 159)), float(rng.uniform(0, math.pi)))
    found = subject.workspace.move_grasp(subject.motion(*element), grasp)
    point = _apply(_matrix(element), WORKSPACE.to_world([[grasp.u, grasp.v]]))
    turned = SO2.compose(np.array(element[0]), np.array(grasp.theta), parameterization="ANG").item()
    expected = torch.tensor([[*WORKSPACE.to_pixel(point)[0] / 100, math.cos(2 * turned), math.sin(2 * turned)]])
    angle = (math.cos(2 * found.theta), math.sin(2 * found.theta))
    measured = torch.tensor([[found.u / 100, found.v / 100, *angle]], dtype=torch.float64)
    result = compare(measured, expected, "T_g of the grasp", "lie_learn's")
    return Measurement(result.value, f"{grasp} went to {found}; {result.message}")


def observations(subject: ActionSubject, case: Case) -> Measurement:
    """T_g on an observation: (T_g o)(p) = o(g^-1 p); height is a scalar, it moves and does not change."""
    thing = blobs(4, case.seed, positive=True)
    pixels = WORKSPACE.shape
    v, u = np.mgrid[: pixels[0], : pixels[1]]
    points = torch.from_numpy(WORKSPACE.to_world(np.stack([u, v], axis=-1)).reshape(-1, 2) / WORKSPACE.pixel)
    motion = PlaneMotion(case.degrees)

    def picture(values: torch.Tensor) -> Observation:
        image = values.unflatten(1, pixels).numpy()
        color = np.clip(40 * image[:3], 0, 255).round().astype(np.uint8).transpose(1, 2, 0)
        return Observation(np.ascontiguousarray(color), (0.02 * image[3]).astype(np.float32))

    found = subject.workspace.move_observation(
        subject.motion(math.radians(case.degrees), 0.0, 0.0), picture(thing(points))
    )
    expected = picture(moved(thing, motion)(points))
    result = compare(
        torch.from_numpy(found.height), torch.from_numpy(expected.height), "the moved height", "the height there"
    )
    # the two pictures' colours are rounded to whole numbers at different places
    color = np.abs(found.color.astype(int) - expected.color.astype(int)).max() - 1
    value = max(result.value, max(color, 0) / 255)
    return Measurement(value, f"in row {result.message.removeprefix('output ')} (metres); colour off by {color + 1}")


def lift_permutes(subject: LiftSubject, case: Case) -> Measurement:
    """A.2.3 at quarter turns, tap by tap: L(g x)_j = L(x)_(j - g), the regular representation of C_n."""
    n, k = subject.order, subject.size
    rng = torch.Generator().manual_seed(case.seed)
    lifted = subject.lift(torch.randn(2, k * k, dtype=torch.float64, generator=rng)).unflatten(2, (k, k))
    # a kernel turned clockwise as an image has K(g x) at x
    turned = torch.rot90(lifted, -round(case.degrees / 90), (2, 3))
    expected = torch.roll(lifted, round(case.degrees * n / 360), 0)
    return compare(turned.flatten(1), expected.flatten(1), "L(g x)", f"the shifted L (C_{n})")


def lift_turns(subject: LiftSubject, case: Case) -> Measurement:
    """A.2.3 for every g in C_n, as far as a smooth psi can be interpolated."""
    n, k = subject.order, subject.size
    degrees = 360 * max(1, round(case.degrees * n / 360) % n) / n
    psi = waves(2, QUARTER_BAND / 2, case.seed)(fields.grid(k))
    lifted = subject.lift(psi).unflatten(2, (k, k))
    scene, motion = blobs(2, case.seed + 1), PlaneMotion(degrees)
    x = 5 * torch.randn(6, 2, dtype=torch.float64, generator=torch.Generator().manual_seed(case.seed))
    turned = respond(lifted, moved(scene, motion), x)
    expected = torch.roll(respond(lifted, scene, motion.inverse(x)), round(degrees * n / 360), 0)
    return compare(turned, expected, "f(T_g o)", f"the shifted f (C_{n}, {degrees:g} degrees)")


def _matrix(element: tuple[float, float, float]) -> np.ndarray:
    return SE2.change_parameterization(np.array(element), "rotation-translation", MATRIX)


def _apply(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return SE2.transform(matrix, MATRIX, points, "C")
