"""The figures of an environment: its cameras, its stages, its grasps a CPU-second, and what more processes bring."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping

from equigrasp.bench.report import Figure, milliseconds
from equigrasp.bench.throughput import steady_rate
from equigrasp.bench.timing import check_seconds, race
from equigrasp.engines import Local

Stages = Callable[[int], tuple[dict[str, float], int]]
"""From an episode's seed to seconds by stage, and how many grasps it was."""
Episode = Callable[[int], int]
"""From an episode's seed to how many grasps it was."""

SUBJECT = "pybullet"
FEWEST = 3
"""Episodes, and items for each process, that are timed even if they take longer than the budget."""


def observation_figures(cameras: Mapping[str, Callable[[], object]], seconds: float) -> list[Figure]:
    """Rendering and fusing one observation, by the cameras' name; all in turn."""
    times = race(cameras, seconds)
    return [milliseconds("observation", name, "observe", each) for name, each in times.items()]


def stage_figures(stages: Stages, seconds: float, seed: int) -> list[Figure]:
    """Milliseconds a grasp by stage, and grasps a CPU-second, episode by episode; the first one is not counted."""
    check_seconds(seconds)
    stages(seed)
    times: list[dict[str, float]] = []
    rates: list[float] = []
    until = time.perf_counter() + seconds
    for number in itertools.count(seed + 1):
        before = time.process_time()
        by_stage, grasps = stages(number)
        rates.append(grasps / (time.process_time() - before))
        times.append({stage: spent / grasps for stage, spent in by_stage.items()})
        if len(times) >= FEWEST and time.perf_counter() >= until:
            break
    figures = [
        Figure("simulator", SUBJECT, f"{stage}, a grasp", "ms", tuple(1e3 * each[stage] for each in times))
        for stage in times[0]
    ]
    figures.append(Figure("simulator", SUBJECT, "grasps a CPU-second, all in", "", tuple(rates)))
    return figures


def worker_figures(episode: Episode, workers: int, seconds: float, seed: int) -> list[Figure]:
    """Grasps a second of one process and of several, and how many times as many; all processes are warm.

    One process is measured before and after the several.

    Args:
        episode: plays one; it pickles.
        workers: how many processes; 1 leaves the comparison out.
        seconds: for each of the three.
        seed: of the first episode.
    """
    check_seconds(seconds)
    before, episodes = _one(episode, seconds, seed)
    figures = [Figure("simulator", SUBJECT, "grasps a second, 1 process", "", (before,))]
    if workers == 1:
        return figures
    count = workers * (1 + max(FEWEST, episodes))
    together = steady_rate(episode, seed, count, seconds, Local(workers), workers)
    after, _ = _one(episode, seconds, seed)
    alone = math.sqrt(before * after)
    return [
        Figure("simulator", SUBJECT, "grasps a second, 1 process", "", (before, after)),
        Figure("simulator", SUBJECT, f"grasps a second, {workers} processes", "", (together,)),
        Figure("simulator", SUBJECT, f"speed-up of {workers} processes", "x", (together / alone,)),
    ]


def _one(episode: Episode, seconds: float, seed: int) -> tuple[float, int]:
    """Grasps a second in this process, and how many episodes that were, without the first."""
    episode(seed)
    began, grasps = time.perf_counter(), 0
    for count in itertools.count(1):
        grasps += episode(seed + count)
        spent = time.perf_counter() - began
        if count >= FEWEST and spent >= seconds:
            return grasps / spent, count
    raise AssertionError
