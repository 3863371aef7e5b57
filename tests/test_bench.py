"""The stopwatch is right about known times, and `equigrasp bench` gives figures that can be."""

from __future__ import annotations

import json
import math
import os
import threading
import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import cast

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from light import nap
from small import SMALL

from equigrasp.augmentation import Example
from equigrasp.bench import flops, fresh, growth, startup, timing, world_growth
from equigrasp.bench.model_figures import Setting, heads, opponent, race_figures, told_apart
from equigrasp.bench.report import Figure, Report, milliseconds, ratio, table
from equigrasp.bench.steps import Size, Workload, ready, step_on_noise
from equigrasp.bench.throughput import Lap, laps, rate, steady_rate
from equigrasp.bench.timing import Timing, measure, race
from equigrasp.bench.world import stage_figures, worker_figures
from equigrasp.cli.bench import Bench
from equigrasp.config import LegConfig, ModelConfig
from equigrasp.correlation import correlate
from equigrasp.engines import Local
from equigrasp.errors import InputError
from equigrasp.grasp import Demonstration
from equigrasp.models import MODELS, build
from equigrasp.plan import Training
from equigrasp.policy import LegPolicy
from tasks.env import GraspEnv
from tasks.stages import REST, STAGES, Stopwatch, stages


class Clock:
    """A clock that moves when it is told to, and drifts: the n-th second lasts longer on a machine that gets busy."""

    def __init__(self) -> None:
        self.now = 0.0
        self.slowness = 1.0

    def __call__(self) -> float:
        return self.now

    def work(self, seconds: float, slower: float = 1.0) -> Callable[[], None]:
        def run() -> None:
            self.now += seconds * self.slowness
            self.slowness *= slower

        return run


# The stopwatch


def test_a_call_takes_what_it_takes() -> None:
    clock = Clock()
    for seconds in (1e-5, 0.003, 0.7):
        timed = measure(clock.work(seconds), 2.0, clock)
        assert timed.median == pytest.approx(seconds)
        assert len(timed.seconds) >= timing.FEWEST


@pytest.mark.parametrize("first", [0.001, 0.15, 3.0])
@pytest.mark.parametrize("later", [0.001, 0.0133, 0.019, 0.7])
def test_a_block_takes_20_ms_at_the_least_however_long_the_first_call(first: float, later: float) -> None:
    clock, calls = Clock(), 0

    def work() -> None:
        nonlocal calls
        clock.now += later if calls else first
        calls += 1

    timed = measure(work, 1.0, clock)
    assert timed.median == pytest.approx(later)
    # all blocks are alike, and the first call is in none
    assert (calls - 1) * later >= 0.02 * len(timed.seconds) * (1 - 1e-9)


@pytest.mark.parametrize("first", [0.001, 0.15, 0.5])
def test_the_clock_is_not_read_at_each_call(first: float) -> None:
    clock, calls, readings = Clock(), 0, 0

    def work() -> None:
        nonlocal calls
        clock.now += 0.001 if calls else first
        calls += 1

    def read() -> float:
        nonlocal readings
        readings += 1
        return clock.now

    measure(work, 1.0, read)
    assert readings < calls / 3


@given(st.floats(1.05, 20), st.floats(1.0, 1.2))
def test_a_ratio_outlives_a_drift(factor: float, slower: float) -> None:
    """Every call is slower than the one before; the blocks in turn still tell the factor, a block after another not."""
    clock = Clock()
    times = race({"one": clock.work(0.2, slower), "other": clock.work(0.2 * factor, slower)}, 1.0, clock)
    ratios = times["other"].over(times["one"])
    whole = ratios[: len(ratios) // 2 * 2]
    assert math.prod(whole) ** (1 / len(whole)) == pytest.approx(factor)


def test_timed_one_after_the_other_the_same_drift_deceives() -> None:
    clock = Clock()
    one = measure(clock.work(0.2, 1.2), 1.0, clock)
    other = measure(clock.work(0.2 * 1.5, 1.2), 1.0, clock)
    assert other.median / one.median > 2 * 1.5


def test_a_variant_that_sleeps_is_found_slower_by_its_sleep() -> None:
    times = race({"as it is": lambda: time.sleep(0.002), "slowed": lambda: time.sleep(0.022)}, 0.2)
    slowed, plain = times["slowed"], times["as it is"]
    # a sleep never ends early, and the shortest of many is little late even on a busy machine
    assert min(slowed.seconds) >= 0.022 > min(plain.seconds)
    figure = ratio("step", "slowed / as it is", "ratio", slowed, plain)
    assert figure.median > 1
    assert len(figure.values) == len(plain.seconds)


@given(st.lists(st.floats(0.001, 100), min_size=1, max_size=30))
def test_a_figure_is_finite_ordered_and_json(values: list[float]) -> None:
    figure = milliseconds("step", "mine", "step", Timing(tuple(values)))
    said = json.loads(json.dumps(figure.to_dict(), allow_nan=False))
    first, third = said["quartiles"]
    close = 1 + 1e-12
    assert 0 < said["minimum"] <= first * close
    assert first <= said["median"] * close
    assert said["median"] <= third * close <= said["maximum"] * close**2
    assert said["blocks"] == len(values)
    assert len(table([figure])) == 3


# What else is counted


def test_operations_are_those_of_the_definition() -> None:
    a, b = torch.randn(3, 5), torch.randn(5, 7)
    assert flops.count(lambda: a @ b) == 2 * 3 * 5 * 7
    assert flops.count(lambda: a.to(torch.complex64) @ b.to(torch.complex64)) == 8 * 3 * 5 * 7
    image, weight = torch.randn(1, 2, 8, 8), torch.randn(4, 2, 3, 3)
    assert flops.count(lambda: torch.conv2d(image, weight, padding=1)) == 2 * 4 * 2 * 9 * 64
    assert flops.count(lambda: torch.fft.fft(torch.randn(6, 32, dtype=torch.complex64))) == 5 * 6 * 32 * 5
    assert flops.count(lambda: torch.fft.rfft2(torch.randn(6, 32, 16))) == 2.5 * 6 * 32 * 16 * 9
    # without the FFTs only its two small matrix products would be left
    assert flops.count(lambda: correlate(torch.randn(1, 2, 30, 30), torch.randn(1, 3, 2, 5, 5))) > 60_000


def test_a_fresh_process_has_a_peak_of_its_own() -> None:
    held = bytearray(b"x") * (300 * 2**20)
    here = fresh.peak_memory()
    there = fresh.in_fresh_process(fresh.peak_memory, limit=300)
    assert here > len(held) / 2**20
    assert 5 < there < here - 200
    del held
    # the kernel counts to within some pages a thread
    assert fresh.peak_memory() > here - 10


def test_a_process_that_does_not_come_back_is_said_to_not_fit() -> None:
    with pytest.raises(ValueError, match="'as it should'"):
        fresh.in_fresh_process(int, "as it should", limit=300)
    with pytest.raises(fresh.DidNotFitError, match=r"killed \(exit code 9\)"):
        fresh.in_fresh_process(os._exit, 9, limit=300)
    with pytest.raises(fresh.DidNotFitError, match="longer than 0 s"):
        fresh.in_fresh_process(time.sleep, 600, limit=0.1)


class NoKernelError(RuntimeError):
    """Pickles, and does not unpickle: what it is made of is not what it keeps."""

    def __init__(self, what: str, why: str) -> None:
        super().__init__(f"{what}: {why}")


def oops() -> None:
    raise NoKernelError("no", "kernel for this")


def holding() -> None:
    raise ValueError("held", threading.Lock())


def test_an_error_that_cannot_be_sent_is_said_all_the_same() -> None:
    with pytest.raises(RuntimeError, match="NoKernelError: no: kernel for this"):
        fresh.in_fresh_process(oops, limit=300)
    with pytest.raises(RuntimeError, match=r"ValueError: \('held', <unlocked _thread.lock"):
        fresh.in_fresh_process(holding, limit=300)


def test_a_rate_leaves_starts_and_ends_out() -> None:
    """Two processes do one a second each; one starts 5 s late, begins with a slow one, and ends 10 s late."""
    early = [Lap(1, t, t + 1.0, 1) for t in range(30)]
    late = [Lap(2, 5.0, 9.0, 1)] + [Lap(2, 9.0 + t, 10.0 + t, 1) for t in range(31)]
    assert rate(early + late) == pytest.approx(2)
    assert rate(early) == pytest.approx(1)
    with pytest.raises(InputError, match="fewer processes"):
        rate([Lap(1, 0.0, 1.0, 1), Lap(2, 0.0, 1.0, 1)])


def test_a_process_that_starts_late_is_waited_for() -> None:
    """Two processes do one a second each, but the second starts when eight are done."""

    def late(work: Callable[[int], Lap], items: Sequence[int]) -> Generator[tuple[int, Lap]]:
        for item in items:
            process, began = (1, item) if item < 8 else (1 + item % 2, 8 + (item - 8) // 2)
            yield item, Lap(process, began, began + 1.0, 1)

    assert steady_rate(abs, 0, 8, 4.0, late, 2) == pytest.approx(2)


def test_laps_are_the_work() -> None:
    found = laps(abs, [-3, 4], Local(1))
    assert [lap.amount for lap in found] == [3, 4]
    assert all(lap.began <= lap.ended for lap in found)


def test_a_power_law_is_found_and_something_else_is_seen() -> None:
    x = [1.0, 2.0, 4.0, 8.0]
    law = growth.PowerLaw.through(x, [3 * each**1.5 for each in x])
    assert (law.coefficient, law.exponent, law.worst) == pytest.approx((3, 1.5, 1))
    assert growth.PowerLaw.through(x, [5 + each**2 for each in x]).worst > 1.2


@pytest.mark.parametrize("name", ["leg-unet", "leg-steerable", "fcgq", "leg-equivariant-local"])
def test_every_point_of_growth_can_be_built(name: str) -> None:
    axes = growth.axes(MODELS[name])
    assert set(axes) < set(growth.AXES)
    for axis, points in axes.items():
        assert len({point.value for point in points}) == len(points) > 1
        ends = [points[0], points[-1]] if axis in ("coefficients", "kernel size") else []
        for point in ends:
            with torch.device("meta" if name == "fcgq" else "cpu"):
                build(ready(point.config, "hashing"))
    if name == "leg-steerable":
        finest = max(axes["bins"], key=lambda point: point.value)
        size = replace(finest.size, shape=(32, 64))
        step_on_noise(ready(finest.config, "hashing"), size, Training(steps=1, seed=0))()


def test_a_step_on_noise_does_not_get_sure_of_itself() -> None:
    """Its times would be those of denormal gradients: a step that learned one label took up to 1.7 times as long."""
    step = step_on_noise(SMALL, Size(1, (64, 64)), Training(steps=1, seed=0, learning_rate=1e-2, threads=1))
    losses = [float(step()) for _ in range(60)]
    assert min(losses[-20:]) > 0.5 * losses[0]


# The simulator


def test_a_stopwatch_counts_each_moment_once() -> None:
    clock = Clock()
    watch = Stopwatch(clock)
    for stage, seconds in (("scene", 1.0), ("settle", 2.0)):
        watch.enter(stage)
        clock.work(seconds)()
    watch.leave()
    clock.work(4.0)()
    watch.leave()
    clock.work(8.0)()
    seconds = watch.finish()
    assert (seconds["settle"], seconds["scene"], seconds[REST]) == (2.0, 5.0, 8.0)
    assert sum(seconds.values()) == clock.now


def test_stages_make_up_an_episode_and_change_nothing(env: GraspEnv) -> None:
    before = [getattr(owner, name) for functions in STAGES.values() for owner, name in functions]
    began = time.perf_counter()
    seconds, grasps = stages(env, 5)
    assert grasps >= 4
    assert sum(seconds.values()) <= time.perf_counter() - began
    # the overhead camera alone was used, and a judge takes no time to speak of
    assert all(seconds[stage] > 0 for stage in (*STAGES, REST))
    assert before == [getattr(owner, name) for functions in STAGES.values() for owner, name in functions]
    assert stages(env, 5)[1] == grasps


def test_stages_and_workers_become_figures() -> None:
    found = stage_figures(lambda seed: ({"grasp": 0.02}, 2), 0.01, 0) + worker_figures(lambda seed: 3, 1, 0.01, 0)
    assert [each.what for each in found] == [
        "grasp, a grasp",
        "grasps a CPU-second, all in",
        "grasps a second, 1 process",
    ]
    assert found[0].median == pytest.approx(10)
    assert found[2].median > 0


# The step


def test_parts_are_the_steps_own_and_leave_its_bits_alone(demonstrations: list[Demonstration]) -> None:
    def trained(between: bool) -> dict[str, torch.Tensor]:
        training = Training(steps=2, seed=0, threads=1)
        work = Workload(build(ready(MODELS["leg-steerable"], "hashing"), 0), demonstrations[:3], training)
        work.step()
        if between:
            parts = work.parts()
            assert list(parts) == [
                *("augmentation", "data", "augmentation in numbers"),
                *("phi", "kernel", "correlation", "read-out", "loss", "optimiser"),
            ]
            for name, part in parts.items():
                if name != "optimiser":
                    part()
        work.step()
        return work.state.tensors()

    plain, timed = trained(False), trained(True)
    assert all(torch.equal(value, timed[name]) for name, value in plain.items())


def test_the_optimiser_is_timed_with_gradients_whatever_was_timed_before(demonstrations: list[Demonstration]) -> None:
    work = Workload(build(ready(MODELS["leg-steerable"], "hashing"), 0), demonstrations[:3], Training(steps=2, seed=0))
    parts = work.parts()
    for part in parts.values():
        part()
    before = {name: value.detach().clone() for name, value in work.state.parameters.items()}
    parts["optimiser"]()
    assert not any(torch.equal(value, before[name]) for name, value in work.state.parameters.items())


def test_augmentation_is_timed_on_other_examples_at_each_call(demonstrations: list[Demonstration]) -> None:
    """A scene that is put together anew takes twice as long as one that moves, so one example would say nothing."""
    work = Workload(build(ready(MODELS["leg-steerable"], "hashing"), 0), demonstrations[:3], Training(steps=2, seed=0))
    drawn = work.parts()["augmentation"]
    grasps = [example.grasp for _ in range(5) for example in cast("list[Example]", drawn())]
    assert len(set(grasps)) == 5


def test_an_act_is_timed_as_users_act_and_a_step_as_one_trains(demonstrations: list[Demonstration]) -> None:
    work = Workload(build(ready(MODELS["leg-steerable"], "hashing"), 0), demonstrations[:3], Training(steps=2, seed=0))
    for call, training in ((work.act, False), (work.step, True), (work.act, False), (work.gradient, True)):
        call()
        assert work.policy.training == training


# The command


def test_the_command_gives_finite_figures_as_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "bench.json"
    kinds = ("observation", "simulator", "inference", "step")
    report = Bench(
        only=kinds, models=("leg-steerable",), seconds=0.02, threads=1, workers=1, batch=1, out=out
    ).execute()
    assert isinstance(report, Report)
    said = json.loads(out.read_text(), parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))
    assert {each["group"] for each in said["figures"]} == set(kinds)
    for each in said["figures"]:
        numbers = [each["median"], each["minimum"], each["maximum"], *each["quartiles"]]
        assert all(math.isfinite(number) and number >= 0 for number in numbers), each
        assert each["median"] > 0 or each["group"] == "simulator", each
    whats = {(each["group"], each["what"]) for each in said["figures"]}
    assert {("step", "phi"), ("step", "peak memory"), ("step", "of the peak"), ("inference", "act")} <= whats
    assert said["machine"]["torch"] == torch.__version__
    assert "| step | leg-steerable | correlation |" in capsys.readouterr().out


def test_a_kernel_that_hears_nothing_is_measured_as_well() -> None:
    report = Bench(only=("inference",), models=("leg-unet-no-kernel-language",), seconds=0.02, threads=1).execute()
    assert {"act", "operations"} <= {each.what for each in report.figures}


def test_threads_are_raced_in_turn(capsys: pytest.CaptureFixture[str]) -> None:
    threads = torch.get_num_threads()
    try:
        report = Bench(only=("inference",), models=("leg-steerable",), against="threads=1", seconds=0.02).execute()
    finally:
        torch.set_num_threads(threads)
    assert [each.what for each in report.figures] == ["in turn", "in turn", "ratio"]
    assert 0 < report.figures[-1].median < math.inf


def test_a_model_is_raced_with_itself_and_read_out_as_it_is() -> None:
    """Both are timed, so that equal ones differ by chance; at another resolution the two would be called otherwise."""
    race_of_one = Bench(
        only=("inference",),
        models=("leg-steerable",),
        against="leg-steerable",
        read_out="full",
        seconds=0.02,
        threads=1,
    )
    one, other, both = race_of_one.execute().figures
    assert [one.subject, other.subject] == ["leg-steerable", "leg-steerable again"]
    assert both.subject == "leg-steerable again / leg-steerable"
    assert len(one.values) == len(other.values) == len(both.values) >= timing.FEWEST
    assert one.values != other.values


def test_two_models_of_one_name_are_called_by_what_differs(demonstrations: list[Demonstration]) -> None:
    half = MODELS["leg-steerable"]
    assert isinstance(half, LegConfig)
    full = replace(half, stride=1, text_encoder="clip-rn50")
    setting = Setting(demonstrations[:2], Training(steps=1, seed=0, threads=1), "hashing", 0.02)
    one, other, both = race_figures(full, half, ["inference"], setting)
    # who reads is never timed
    assert [one.subject, other.subject] == ["leg-steerable with stride=1", "leg-steerable with stride=2"]
    assert both.subject == f"{other.subject} / {one.subject}"
    assert both.values == tuple(b / a for a, b in zip(one.values, other.values, strict=True))


LIFTED = replace(
    cast("LegConfig", MODELS["leg-unet"]),
    **{name: getattr(SMALL, name) for name in ("kernel_size", "maximum_frequency", "channels", "widths")},
    text_encoder="hashing",
)


@pytest.mark.parametrize("broken", [False, True])
def test_our_head_and_the_literal_one_do_the_same_work(demonstrations: list[Demonstration], broken: bool) -> None:
    """Forward and backward from the same features to the same gradients of psi; a literal one of other turns does not.

    The two sum in another order, and float32's rounding grows with the squares of their scores.
    """
    work = Setting(demonstrations[:2], Training(steps=1, seed=0, threads=1), "hashing", 0.02).workload(LIFTED)
    psi = list(cast("LegPolicy", work.policy).kappa.parameters())
    gradients = []
    for order, head in ((LIFTED.group_order, "ours"), (36 if broken else LIFTED.group_order, "literal")):
        heads(replace(LIFTED, group_order=order), work)[head]()
        gradients.append(torch.cat([each.grad.flatten() for each in psi if each.grad is not None]))
    ours, theirs = gradients
    assert ours.abs().max() > 0
    assert ((ours - theirs).abs().max() < 1e-4 * ours.abs().max()) != broken


def test_the_literal_reading_is_raced_step_act_and_head(demonstrations: list[Demonstration]) -> None:
    setting = Setting(demonstrations[:2], Training(steps=1, seed=0, threads=1), "hashing", 0.02)
    figures = race_figures(LIFTED, "literal", ["step", "inference"], setting)
    ratios = {(each.group, each.subject, each.what): each.median for each in figures if each.unit == "x"}
    assert set(ratios) == {
        ("step", "leg-unet", "head, literal by sums / ours"),
        ("step", "leg-unet", "head, literal by FFT / ours"),
        ("step", "literal / leg-unet", "ratio"),
        ("inference", "literal / leg-unet", "ratio"),
    }
    assert all(0 < each < math.inf for each in ratios.values())


def test_both_heads_grow_over_the_order_of_the_lift(demonstrations: list[Demonstration]) -> None:
    setting = Setting(demonstrations[:2], Training(steps=1, seed=0, threads=1), "hashing", 0.02)
    figures, fits = growth.grow_group(LIFTED, setting, (12, 36))
    assert {each.what for each in figures} == {
        f"head, {head}, group order {order}" for head in ("ours", "literal") for order in (12, 36)
    }
    assert [each["what"] for each in fits] == ["head, ours", "head, literal"]


@given(*[st.sampled_from([*MODELS.values()])] * 2, st.booleans())
def test_names_in_a_race_are_never_alike(one: ModelConfig, other: ModelConfig, renamed: bool) -> None:
    mine, theirs = told_apart(one, replace(other, name=one.name) if renamed else other)
    assert mine != theirs


def test_what_a_model_lacks_is_said_for_each_axis() -> None:
    lacking = ("kernel size", "coefficients", "bins", growth.GROUP_AXIS)
    report = Bench(only=("growth",), models=("fcgq",), axes=lacking, seconds=0.02, threads=1).execute()
    assert report.skipped == {f"growth of fcgq with {axis}": f"it has no {axis}" for axis in lacking}
    assert not report.figures


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"models": ("leg-unt",)}, "no model 'leg-unt'; did you mean 'leg-unet'"),
        ({"seconds": 0.0}, "--seconds is 0, but"),
        ({"seconds": -1.0}, "--seconds is -1"),
        ({"seconds": math.nan}, "--seconds is nan"),
        ({"against": "leg-unt"}, "did you mean 'leg-unet'"),
        ({"against": "threads=0"}, "takes a whole number from 1 to 1024"),
        ({"against": "threads=99999999999"}, "takes a whole number from 1 to 1024"),
        ({"against": "literal", "models": ("leg-steerable",)}, "which leg-steerable has not; add --models leg-unet"),
        ({"against": "leg-unet", "only": ("simulator",)}, "--against races step and inference, and not simulator"),
        ({"only": ("growth",), "axes": ("pixel",)}, "no axis of growth 'pixel'; did you mean 'pixels'"),
        ({"only": ("observation",), "axes": ("pixels",)}, "--axes are of growth, which is not among what is measured"),
        ({"only": ("observation",), "axes": ("pixels",)}, "; say --only observation growth"),
        ({"axes": ("pixels",)}, "; say --only growth"),
        ({"against": "leg-unet", "axes": ("pixels",)}, "which --against does not race; leave one of them out"),
        ({"only": ("observation", "start-up"), "models": ("vit",)}, "is of no model (start-up, observation); leave"),
        ({"only": ("growth",), "axes": ("workers",), "models": ("vit",)}, "is of no model (growth over workers);"),
        ({"against": "vit", "read_out": "full", "models": ("leg-unet",)}, "vit has its own resolution of the read-out"),
        ({"workers": 0}, "--workers is 0"),
        ({"batch": 0}, "--batch is 0"),
        ({"task": "pick-by-prat"}, "did you mean 'pick-by-part'"),
        ({"text_encoder": "hashin"}, "did you mean 'hashing'"),
        ({"out": Path("no-such-folder/bench.json")}, "there is no folder no-such-folder"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_mistake_is_one_sentence_before_anything_is_measured(settings: dict, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        Bench(**settings).execute()
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_any_model_may_be_raced_with_any_other() -> None:
    assert opponent("fcgq", [MODELS["vit"]]) == MODELS["fcgq"]
    assert opponent("fcgq", [MODELS["leg-unet"]], "full") == replace(MODELS["fcgq"], stride=1)
    for against in ("literal", "threads=12"):
        assert opponent(against, [MODELS["leg-unet"]], "full") == against
    assert opponent("threads=12", list(MODELS.values())) == "threads=12"


def test_a_start_is_of_this_package_whatever_lies_in_the_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "equigrasp.py").write_text("raise SystemExit('somebody else')\n")
    monkeypatch.chdir(tmp_path)
    startup.start(startup.STARTS["import equigrasp"])()


def test_a_figure_of_one_value_has_no_spread() -> None:
    line = table([Figure("step", "mine", "peak memory", "MiB", (12.0,))])[-1]
    assert line == "| step | mine | peak memory | 12 MiB |  |  |  |"


def test_grasps_are_measured_over_objects_and_over_processes() -> None:
    costs = {1: 0.002, 4: 0.008}

    def stages_of(count: int) -> Callable[[int], tuple[dict[str, float], int]]:
        return lambda seed: ({"settle": costs[count], "rest": 0.002 * costs[count]}, 2)

    figures, (law,) = world_growth.grow_objects({count: stages_of(count) for count in costs}, 0.01, seed=0)
    assert [figure.what for figure in figures] == ["a grasp, objects 1", "a grasp, objects 4"]
    assert law["law"]["exponent"] == pytest.approx(1.0)
    assert law["points"][0][1] == pytest.approx(1.002)
    figures, (law,) = world_growth.grow_workers(nap, 2, 0.05, seed=0)
    assert [x for x, _ in law["points"]] == [1, 2]
    assert law["points"][1][1] < law["points"][0][1]
