"""How an environment's grasps grow with the objects in a scene, and with the processes that play."""

from __future__ import annotations

import itertools
import statistics
import time
from collections.abc import Mapping
from typing import Any

from equigrasp.bench.growth import fit
from equigrasp.bench.report import Figure
from equigrasp.bench.throughput import steady_rate
from equigrasp.bench.timing import check_seconds
from equigrasp.bench.world import FEWEST, SUBJECT, Episode, Stages
from equigrasp.engines import Local

OBJECTS = (1, 2, 4, 6, 8)

Grown = tuple[list[Figure], list[dict[str, Any]]]
"""Figures, and the power laws through them."""


def grow_objects(stages: Mapping[int, Stages], seconds: float, seed: int) -> Grown:
    """Milliseconds a grasp, reset and all, by the number of objects in a scene; episodes of each in turn.

    Args:
        stages: by the number of objects.
        seconds: for each number.
        seed: of the first episode, which is not counted.
    """
    check_seconds(seconds)
    times: dict[int, list[float]] = {count: [] for count in stages}
    until = time.perf_counter() + seconds * len(stages)
    for number in itertools.count(seed):
        for count, play in stages.items():
            by_stage, grasps = play(number)
            if number > seed:
                times[count].append(1e3 * sum(by_stage.values()) / grasps)
        if number >= seed + FEWEST and time.perf_counter() >= until:
            break
    figures = [
        Figure("growth", SUBJECT, f"a grasp, objects {count}", "ms", tuple(each)) for count, each in times.items()
    ]
    medians = [statistics.median(each) for each in times.values()]
    return figures, [fit(SUBJECT, "objects", "a grasp", "ms", list(times), medians)]


def grow_workers(episode: Episode, workers: int, seconds: float, seed: int) -> Grown:
    """Milliseconds a grasp by the number of processes, all of them warm: 1, 2, 4 .. `workers`.

    Args:
        episode: plays one; it pickles.
        workers: the most processes.
        seconds: for each number, about.
        seed: of the first episode.
    """
    check_seconds(seconds)
    counts = sorted({*itertools.takewhile(lambda each: each < workers, (2**power for power in range(20))), workers})
    began = time.perf_counter()
    episodes = 0
    while episodes <= FEWEST or time.perf_counter() - began < seconds:
        episode(seed + episodes)
        episodes += 1
    times = {}
    for count in counts:
        times[count] = 1e3 / steady_rate(episode, seed, count * (1 + episodes), seconds, Local(count), count)
    figures = [Figure("growth", SUBJECT, f"a grasp, workers {count}", "ms", (each,)) for count, each in times.items()]
    return figures, [fit(SUBJECT, "workers", "a grasp", "ms", list(times), list(times.values()))]
