"""How long the rest of a study takes, from what its finished cells took; nothing is guessed where none has."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from statistics import fmean
from typing import Any

from equigrasp.study.matrix import Job


def seconds(job: Job, trained: bool, tests: int, lines: Iterable[Mapping[str, Any]]) -> float | None:
    """Seconds of one worker for a job.

    Args:
        job: the job.
        trained: whether its training is done.
        tests: how many of its tests are missing.
        lines: of finished cells; those of the same model, camera, threads and device count.

    Returns:
        The estimate, without the demonstrations' time; None if no such cell is finished.
    """
    settings = job.settings, job.camera, job.threads, job.device
    alike: list[dict[str, Any]] = [
        {"seconds": {}, **line}
        for line in lines
        if (line.get("config"), line.get("camera"), line.get("threads"), line.get("training_device", "cpu")) == settings
    ]
    step = _mean((line["seconds"].get("train"), line["seconds"].get("train_steps")) for line in alike)
    query = _mean((line["seconds"].get("single_shot"), line["queries"]) for line in alike)
    scene = _mean((line["seconds"].get("paper"), line["scenes"]) for line in alike)
    turn = _mean((line["seconds"].get("equivariance"), line["turned"]) for line in alike)
    count = len(job.candidates)
    queries = (job.protocol.validation * count if count > 1 and not trained else 0) + tests * job.protocol.queries
    total = 0.0
    for each, needed in (
        (step, 0 if trained else job.steps),
        (query, queries),
        (scene, tests * job.protocol.scenes),
        (turn, 0 if trained else job.protocol.turned),
    ):
        if needed and each is None:
            return None
        total += needed * (each or 0.0)
    return total


def spoken(seconds: float) -> str:
    """As "40 s", "12 min", "3.5 h" or "2.1 days"."""
    for limit, unit, name in ((90, 1, "s"), (90 * 60, 60, "min")):
        if seconds < limit:
            return f"{seconds / unit:.0f} {name}"
    hours = seconds / 3600
    return f"{hours:.1f} h" if hours < 48 else f"{hours / 24:.1f} days"


def _mean(pairs: Iterable[tuple[float | None, int | None]]) -> float | None:
    ratios = [took / count for took, count in pairs if took and count]
    return fmean(ratios) if ratios else None
