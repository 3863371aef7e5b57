"""What is done beside torch's threads has none of its own: they would wait for a core that torch's hold.

numpy's linear algebra has, for a matrix of nine numbers as well.
"""

from __future__ import annotations

import multiprocessing
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from equigrasp.augmentation import Augmentation
from equigrasp.grasp import Demonstration
from equigrasp.heightmap import Camera, fuse


def by_others(work: Callable[[int], object], times: int) -> float:
    """The share of the CPU time of some calls that threads other than this one spent."""
    work(0)
    time.sleep(0.2)  # threads of earlier work go on waiting for the next for a while
    process, own = time.process_time(), time.thread_time()
    for number in range(times):
        work(number)
    process, own = time.process_time() - process, time.thread_time() - own
    return 1 - own / process


def pictures(number: int) -> list[Camera]:
    """Three small pictures of a table from above, of a camera that is turned a little differently each time."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("zx", [0.1 * number, np.pi]).as_matrix()
    pose[2, 3] = 0.5
    intrinsics = np.array([[40.0, 0.0, 20.0], [0.0, 40.0, 20.0], [0.0, 0.0, 1.0]])
    color, depth = np.full((40, 40, 3), 200, dtype=np.uint8), np.full((40, 40), 0.5, dtype=np.float32)
    return [Camera(color, depth, intrinsics, pose) for _ in range(3)]


def draw(augmentation: Augmentation, number: int) -> None:
    augmentation.sample(np.random.default_rng(number))


def join_pictures(number: int) -> None:
    fuse(pictures(number))


def halve(number: int) -> None:
    """Half of the work is another thread's."""

    def spin() -> None:
        until = time.thread_time() + 0.01
        while time.thread_time() < until:
            pass

    other = threading.Thread(target=spin)
    other.start()
    spin()
    other.join()


@pytest.fixture
def fresh(monkeypatch: pytest.MonkeyPatch) -> Iterator[Executor]:
    """A process whose libraries may have two threads each, as by themselves on two cores; tests allow one."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "2")
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        yield pool


@pytest.mark.parametrize("share", [0.0, 1.0], ids=["moved", "recombined"])
def test_an_example_is_drawn_by_one_thread(demonstrations: list[Demonstration], share: float, fresh: Executor) -> None:
    drawing = partial(draw, Augmentation(demonstrations, share))
    assert fresh.submit(by_others, drawing, 100).result() < 0.02


def test_pictures_are_fused_by_one_thread(fresh: Executor) -> None:
    assert fresh.submit(by_others, join_pictures, 200).result() < 0.02


def test_work_of_another_thread_is_seen(fresh: Executor) -> None:
    """The broken version."""
    assert fresh.submit(by_others, halve, 10).result() > 0.3
