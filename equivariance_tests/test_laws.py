"""The laws, by hypothesis: for the project's own kernels, lift, action and policies, or for yours by the option."""

from __future__ import annotations

import functools
import math
from typing import Any

import pytest
import torch
from hypothesis import example, given, settings
from torch import Tensor, nn
from torch.nn import functional

from equigrasp import fields
from equigrasp.kernel import LiftedKernel, SteerableKernel
from equigrasp.policy import LegPolicy
from equivariance_tests import mutants, sound, strategies
from equivariance_tests.kernel_laws import respond
from equivariance_tests.law import Case, Law, cases
from equivariance_tests.laws import LAWS
from equivariance_tests.plugin import expected_failures, subjects
from equivariance_tests.scenes import (
    HALF_BAND,
    Arrangement,
    Blobs,
    PlaneMotion,
    Scene,
    Waves,
    lattice,
    moved,
    render,
    turn,
)
from equivariance_tests.subjects import ActionSubject, KernelSubject
from equivariance_tests.wrapping import kernel_subject, policy_subject


class CellMeans(nn.Module):
    """A phi that turns with each object exactly: the mean of each cell, relative to the table."""

    stride, reach = 2, 0.5

    def forward(self, observation: Tensor, embedding: Tensor) -> Tensor:
        """`(B, 4, H, W)` -> `(B, 8, H / 2, W / 2)`."""
        table, unit = ([90.0, 90.0, 90.0, 0.0], [40.0, 40.0, 40.0, 0.02])
        values = (observation - observation.new_tensor(table).view(4, 1, 1)) / observation.new_tensor(unit).view(
            4, 1, 1
        )
        return functional.avg_pool2d(values, 2).repeat(1, 2, 1, 1)


def seeded(make: Any, seed: int = 0) -> Any:
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return make()


@functools.cache
def steerable(size: int = 33) -> KernelSubject:
    return kernel_subject(seeded(lambda: SteerableKernel(16, 3, size)), 16)


@functools.cache
def lifted(order: int = 72) -> KernelSubject:
    return kernel_subject(
        seeded(lambda: LiftedKernel(16, 3, 33, 16, group_order=order, exact_quarter_turns=order % 4 == 0)), 16
    )


@functools.cache
def own(name: str) -> Any:
    """The project's own subjects, for which every law holds."""
    return {
        "SteerableKernel 33": steerable,
        "SteerableKernel 17": lambda: steerable(17),
        "exact phi, SteerableKernel": lambda: policy_subject(
            LegPolicy(CellMeans(), seeded(lambda: SteerableKernel(512)), "hashing", "float32")
        ),
        "lift over C_72": sound.lift,
        "Motion and Workspace": lambda: ActionSubject("Motion and Workspace"),
    }[name]()


OWN = (
    "SteerableKernel 33",
    "SteerableKernel 17",
    "exact phi, SteerableKernel",
    "lift over C_72",
    "Motion and Workspace",
)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    yours = [(each.name, each) for each in subjects(metafunc.config)]
    # a policy and its kernel may have one name
    named = yours or [(name, own(name)) for name in OWN]
    if "aimed_together" in metafunc.fixturenames:
        metafunc.parametrize("aimed_together", [[subject for _, subject in named]], ids=[" and ".join(dict(named))])
    if "aimed" not in metafunc.fixturenames:
        return
    excuses = expected_failures(metafunc.config)
    rows = []
    for name, subject in named:
        for law in LAWS.values():
            if isinstance(subject, law.subject) and law.applies(subject) is None:
                marks = _excused(excuses.get(law.name))
                rows.append(pytest.param((law, subject), id=f"{name}: {law.name}", marks=marks))
    metafunc.parametrize("aimed", rows)


def _excused(reason: str | None) -> list[pytest.MarkDecorator]:
    # a crash is no failure of a law
    return [] if reason is None else [pytest.mark.xfail(strict=True, reason=reason, raises=AssertionError)]


def test_the_law_holds(aimed: tuple[Law, Any], request: pytest.FixtureRequest) -> None:
    law, subject = aimed
    tolerance = law.tolerance[subject.dtype]
    measured = []
    profile = strategies.profile()

    # of a module of yours, the same cases every time, as `check_equivariance` has
    @settings(profile, derandomize=profile.derandomize or bool(subjects(request.config)))
    @given(strategies.cases(law.turns))
    def holds(drawn: Case) -> None:
        case = law.admitted(subject, drawn)
        measurement = law.measure(subject, case)
        if measurement is not None:
            measured.append(measurement)
            assert measurement.value <= tolerance, (
                f"{law.statement} ({law.source}): {measurement.value:.3g} is more than {tolerance:.3g} {law.unit}; "
                f"{case}: {measurement.message}"
            )

    for each in cases(law.turns, law.count) if subjects(request.config) else ():
        holds = example(each)(holds)
    holds()
    if not measured and law.name in expected_failures(request.config):
        pytest.fail(f"the law {law.name!r} says nothing about {subject.name}; leave its excuse out", pytrace=False)
    if not measured:
        # of the project's own modules each law that applies can be measured
        assert subjects(request.config), f"{law.name}: no case of {subject.name} could be measured"
        pytest.skip(f"{law.name} says nothing about {subject.name}: {law.silence}")


def test_a_law_about_turns_could_be_measured(aimed_together: list[Any]) -> None:
    """As `check_equivariance` asks: where all are silent, nothing has been shown."""
    assert any(
        law.judge(subject, cases(law.turns, law.count)).cases
        for law in LAWS.values()
        for subject in aimed_together
        if law.of_turns and isinstance(subject, law.subject) and law.applies(subject) is None
    ), "no law about turns could be measured"


# How well: the figures that the documentation quotes


@pytest.mark.parametrize(("law", "tolerance"), [("steerability", 2e-4), ("steerability, wide band", 1e-3)])
def test_the_exact_kernel_over_200_kernels_and_angles(law: str, tolerance: float) -> None:
    verdict = LAWS[law].judge(steerable(), cases("any", 200, seed=11))
    assert verdict.cases == 200
    assert verdict.value <= tolerance, verdict


@pytest.mark.parametrize(("law", "tolerance"), [("eq. 2, whole bins", 1.0), ("eq. 2, any turn", 1.5)])
def test_the_exact_kernels_grasp_follows_on_100_scenes_each(law: str, tolerance: float) -> None:
    verdict = LAWS[law].judge(steerable(), cases(LAWS[law].turns, 100, seed=12))
    assert verdict.cases == 100
    assert verdict.share == 1.0, verdict.message
    assert verdict.value <= tolerance


def test_the_lifts_honest_figures() -> None:
    """C_72 is exact at quarter turns, C_90 is not; between them both err as psi's interpolation does."""
    quarter, any_turn = LAWS["lemma 1"], LAWS["steerability"]
    assert quarter.judge(lifted(72)).passed
    assert quarter.judge(lifted(90)).value > 1e-4
    for order in (72, 90):
        verdict = any_turn.judge(lifted(order), cases("any", 20, seed=3))
        assert 2e-4 < verdict.value < 1e-1, verdict
        follows = LAWS["eq. 2, any turn"].judge(lifted(order), cases("any", 10, seed=3))
        assert follows.share >= 0.9, follows.message


def test_a_kernel_that_is_not_steerable_does_not_follow() -> None:
    verdict = LAWS["eq. 2, any turn"].judge(sound.kernel(change=mutants.noise(30)), cases("any", 10, seed=3))
    assert verdict.share < 0.5


# Lemma 2: exact where turns map the grid to itself, and elsewhere as far as the bands reach


def lemma_2_gap(width: float, degrees: float) -> float:
    """How far (T_g K) * (T_g o) is from T_g (K * o), both sampled on Z^2, for Gaussians K and o of one width."""
    taps = lattice(61, 61)
    rng = torch.Generator().manual_seed(0)
    draw = functools.partial(torch.randn, dtype=torch.float64, generator=rng)
    k = Blobs(draw(1, 5), 2 * draw(5, 2), width=width)
    o = Blobs(draw(1, 5), 2 * draw(5, 2), width=width)
    motion = PlaneMotion(degrees)
    x = 3 * draw(8, 2)

    def correlate(kernel: Scene, scene: Scene, points: Tensor) -> Tensor:
        return respond(kernel(taps).view(1, 1, 61, 61), scene, points)[0]

    turned = correlate(moved(k, motion), moved(o, motion), x)
    expected = correlate(k, o, motion.inverse(x))
    return float((turned - expected).abs().max() / expected.abs().max())


def test_lemma_2_is_exact_where_the_turn_maps_the_grid_to_itself() -> None:
    assert lemma_2_gap(0.5, 90) < 1e-13
    assert lemma_2_gap(0.5, 180) < 1e-13


def test_lemma_2_off_the_grid_needs_a_band_limit() -> None:
    """By Poisson's sum: exact as far as the bands of K and o together stay within 2 pi."""
    assert lemma_2_gap(0.5, 45) > 1e-2
    assert lemma_2_gap(1.0, 45) < 1e-3
    assert lemma_2_gap(2.0, 45) < 1e-12


# What the laws rest on: scenes, and the strategies that draw them


@strategies.profile()
@given(strategies.wave_scenes(), strategies.plane_motions())
def test_a_scene_is_within_its_band_however_it_is_moved(scene: Waves, motion: PlaneMotion) -> None:
    assert scene.band <= HALF_BAND
    points = lattice(9, 9)
    torch.testing.assert_close(moved(scene, motion)(motion(points)), scene(points), rtol=0, atol=1e-9)


@strategies.profile()
@given(strategies.plane_motions())
def test_a_motion_and_its_inverse_undo_each_other(motion: PlaneMotion) -> None:
    points = lattice(5, 7)
    torch.testing.assert_close(motion.inverse(motion(points)), points, rtol=0, atol=1e-9)
    torch.testing.assert_close(motion(motion.inverse(points)), points, rtol=0, atol=1e-9)


def test_a_quarter_turn_is_counter_clockwise_with_y_up() -> None:
    assert (turn(90) @ torch.tensor([1.0, 0.0], dtype=torch.float64)).tolist() == [0, 1]
    image = render(
        Blobs(torch.ones(1, 1, dtype=torch.float64), torch.tensor([[6.0, 2.0]], dtype=torch.float64)), 21, 21
    )
    turned = render(
        moved(Blobs(torch.ones(1, 1, dtype=torch.float64), torch.tensor([[6.0, 2.0]])), PlaneMotion(90.0)), 21, 21
    )
    torch.testing.assert_close(turned, torch.rot90(image, 1, (1, 2)), rtol=0, atol=1e-15)


@strategies.profile()
@given(strategies.blob_scenes())
def test_an_object_has_next_to_no_energy_beyond_half_of_nyquist(thing: Blobs) -> None:
    spectrum = torch.fft.fft2(render(thing, 65, 65)).abs().square().sum(dim=0)
    k = 2 * math.pi * torch.fft.fftfreq(65, dtype=torch.float64)
    beyond = torch.hypot(k[:, None], k[None]) > HALF_BAND
    assert spectrum[beyond].sum() < 1e-8 * spectrum.sum()


@strategies.profile()
@given(strategies.arrangements(), strategies.plane_motions())
def test_only_the_target_moves(scene: Arrangement, motion: PlaneMotion) -> None:
    about = PlaneMotion(motion.degrees, motion.shift, scene.target.centre)
    elsewhere = torch.tensor([other.centre for other in scene.others], dtype=torch.float64)
    changed = scene.with_target_moved(about)
    torch.testing.assert_close(changed(elsewhere), scene(elsewhere), rtol=0, atol=1e-6)
    at = torch.tensor([scene.target.centre], dtype=torch.float64) + 3
    torch.testing.assert_close(changed(about(at)), scene(at), rtol=0, atol=1e-6)


@strategies.profile()
@given(strategies.steerable_settings(), strategies.embeddings(6))
def test_every_setting_of_the_exact_kernel_is_steerable(values: dict[str, Any], embedding: Tensor) -> None:
    module = seeded(lambda: SteerableKernel(6, **values))
    subject = kernel_subject(module, 6)
    assert module.out_type == fields.even_type(values["maximum_frequency"])
    assert module(embedding.float()).shape[1:] == (module.out_type.size, values["channels"], *[values["size"]] * 2)
    for law in ("lemma 1", "steerability", "bins turn"):
        verdict = LAWS[law].judge(subject, cases(LAWS[law].turns, 2, seed=4))
        assert verdict.passed, verdict


@strategies.profile()
@given(strategies.lifted_settings())
def test_every_setting_of_the_lift_is_exact_at_quarter_turns(values: dict[str, Any]) -> None:
    subject = kernel_subject(seeded(lambda: LiftedKernel(6, **values)), 6)
    verdict = LAWS["lemma 1"].judge(subject, cases("quarter", 2, seed=4))
    assert verdict.passed, verdict
