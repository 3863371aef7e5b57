"""What a study has done, what it misses and how long that takes, in lines for a reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from equigrasp.plan import WEIGHTS
from equigrasp.study import estimate
from equigrasp.study.matrix import Job


def listing(
    jobs: Sequence[Job], missing: Sequence[Job], lines: Sequence[Mapping[str, Any]], folder: Path, workers: int
) -> list[str]:
    """A line for each job, then sums.

    Args:
        jobs: all of the study.
        missing: those of which tests are missing, with these tests alone.
        lines: of finished cells.
        folder: the study's.
        workers: trainings at the same time.
    """
    left = {job.run: job.tests for job in missing}
    said, known, unknown = [], [0.0], 0
    for job in jobs:
        tests = left.get(job.run, ())
        state = f"{len(job.tests) - len(tests)} of {len(job.tests)} cells done"
        if tests:
            took = estimate.seconds(job, (folder / job.run / WEIGHTS).exists(), len(tests), lines)
            state += f"; missing: {', '.join(tests)}; "
            state += "time unknown" if took is None else f"about {estimate.spoken(took)}"
            known.append(took or 0.0)
            unknown += took is None
        said.append(f"{job}: {state}")
    cells = sum(len(job.tests) for job in jobs)
    missed = sum(map(len, left.values()))
    said.append(f"{cells} cells: {cells - missed} done, {missed} missing, from {len(left)} trainings")
    if len(left) > unknown:
        # no training is split between workers
        took = estimate.spoken(max(*known, sum(known) / workers))
        said.append(f"{len(left) - unknown} of these trainings and their tests: about {took} with --workers {workers}")
    if unknown:
        said.append(
            f"time unknown: {unknown} of them, of whose model and camera no cell is finished; finish a short one"
        )
    return said
