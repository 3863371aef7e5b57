"""On a real Ray cluster of two nodes of which one is lost: the same files."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from folders import contents

from equigrasp.cli.common import make_env
from equigrasp.collection import Collection, Place
from equigrasp.demonstrations import collect
from equigrasp.engines import Ray
from equigrasp.errors import InputError, WorkerLostError

if TYPE_CHECKING:
    from ray.cluster_utils import Cluster

    from tasks.env import GraspEnv


@dataclass
class Square:
    """Squares; item 3 is not liked, item 5 kills its process once, item 7 whenever it comes."""

    once: Path

    def __call__(self, item: int) -> int:
        if item == 3:
            raise InputError("3 is not liked")
        if item == 7 or (item == 5 and not self.once.exists()):
            self.once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return item**2


@pytest.fixture(scope="module")
def cluster() -> Iterator[Cluster]:
    """A head and one more node, a CPU each."""
    with pytest.MonkeyPatch.context() as environment:
        # its workers must find this file, and the settings must be there before Ray is first imported
        environment.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
        Ray()._import()
        from ray.cluster_utils import Cluster

        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
        cluster.add_node(num_cpus=1)
        cluster.wait_for_nodes()
        yield cluster
        cluster.shutdown()


def test_ray_survives_workers_and_nodes_and_gives_the_same_files(
    tmp_path: Path, cluster: Cluster, env: GraspEnv, plan: Collection
) -> None:
    """One test, as Ray takes long to start."""
    once = tmp_path / "once"
    assert dict(Ray(address=cluster.address)(Square(once), [4, 5, 6])) == {4: 16, 5: 25, 6: 36}
    assert once.exists()
    with pytest.raises(WorkerLostError, match="the Ray workers of 7 died 4 times"):
        list(Ray(address=cluster.address)(Square(once), [7]))
    with pytest.raises(InputError, match=r"^3 is not liked$"):
        list(Ray(address=cluster.address)(Square(once), [3]))

    def lose_a_node(results: Iterator[tuple[Place, bytes]], total: int) -> Iterator[tuple[Place, bytes]]:
        assert total == 12
        for count, result in enumerate(results):
            yield result
            if count == 2:
                lost.append(cluster.remove_node(next(iter(cluster.worker_nodes)), allow_graceful=False))

    lost: list[object] = []
    small = replace(plan, goals=((3, 11, 3, 7), (20, 0, 1, 2), (5, 6, 8, 9)))
    engine = Ray(address=cluster.address)
    collect(small, partial(make_env, plan.task, "overhead"), tmp_path / "there", engine, lose_a_node)
    assert len(lost) == 1
    collect(small, lambda: env, tmp_path / "here")
    assert contents(tmp_path / "there") == contents(tmp_path / "here")
