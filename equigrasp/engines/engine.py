"""Where work runs: in this process, in several on this machine, or on a Ray cluster.

An engine maps a callable over items and yields `(item, result)` as they come, in no particular order:

    with closing(ENGINES["local"](workers=2)(work, items)) as results:
        for item, result in results:
            ...

The callable is copied once to each worker, so what it keeps on itself (an environment, say) is made once there
and used again. Items and results travel by pickle between processes of one user and never touch a file: whoever
iterates writes the results, and a worker needs no disk in common with it.
"""

from __future__ import annotations

import importlib.util
import itertools
import logging
import os
import socket
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import cloudpickle

from equigrasp.engines.worker import Worker, answering, call, working
from equigrasp.errors import InputError, WorkerLostError

Item = TypeVar("Item")
Result = TypeVar("Result")

DEATHS = 3
"""So often Ray runs an item again whose worker or node died; an item that kills its worker must not do so forever."""


IN_FLIGHT = 1000
"""At most so many items are handed to Ray before results come back."""


class Engine(Protocol):
    """Maps a callable over items; see the module."""

    def __call__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Generator[tuple[Item, Result]]:
        """Yield `(item, work(item))` as they come; closing the iterator stops the workers.

        Raises:
            WorkerLostError: if a worker died.
        """
        ...


@dataclass(frozen=True)
class Local:
    """This machine. One worker is this very process; more are processes of their own (see `equigrasp.engines.worker`).

    Attributes:
        workers: how many [default: 1].
        address: not for this engine.

    Raises:
        InputError: if there is no worker, or an address.
    """

    workers: int | None = None
    address: str | None = None

    def __post_init__(self) -> None:
        check_workers(self.workers)
        if self.address is not None:
            raise InputError(f"--address is {self.address}, but that is a Ray cluster's; add --engine ray")

    def __call__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Generator[tuple[Item, Result]]:
        """As `Engine`."""
        workers = min(self.workers or 1, len(items))
        if workers <= 1:
            return ((item, work(item)) for item in items)
        return _in_processes(work, items, workers)


@dataclass(frozen=True)
class Ray:
    """A Ray cluster: the one at the address, or one started on this machine for as long as the work takes.

    Every node must have the same versions installed, and one is this machine. A worker or a node that dies costs
    the items that it had in hand, which others run again.

    Attributes:
        workers: how many items run at once [default: one for each CPU of the cluster].
        address: `HOST:PORT` of a cluster that this machine is a node of [default: start one here].

    Raises:
        InputError: if there is no worker, Ray is not installed, or nothing answers at the address.
    """

    workers: int | None = None
    address: str | None = None

    def __post_init__(self) -> None:
        check_workers(self.workers)
        if importlib.util.find_spec("ray") is None:
            raise InputError(
                "--engine ray needs Ray, which is not here; `pip install -e '.[ray]'` in equigrasp's folder adds it"
            )
        if self.address is not None:
            check_address(self.address)

    def __call__(self, work: Callable[[Item], Result], items: Sequence[Item]) -> Generator[tuple[Item, Result]]:
        """As `Engine`."""
        ray = self._import()
        from ray.exceptions import NodeDiedError, RayTaskError, WorkerCrashedError

        try:
            self._start(ray)
            run = ray.remote(num_cpus=1, max_retries=DEATHS)(call)
            copied, left, running = cloudpickle.dumps(work), iter(items), {}
            limit = self.workers or IN_FLIGHT
            while True:
                while len(running) < limit and (item := next(left, None)) is not None:
                    running[run.remote(copied, item)] = item
                if not running:
                    return
                (done,), _ = ray.wait(list(running), num_returns=1)
                item = running.pop(done)
                try:
                    result = ray.get(done)
                except RayTaskError as error:
                    raise error.cause from error
                except (WorkerCrashedError, NodeDiedError):
                    raise WorkerLostError(
                        f"the Ray workers of {item} died {DEATHS + 1} times; is there memory enough?"
                    ) from None
                yield item, result
        finally:
            ray.shutdown()

    def _import(self) -> Any:
        # read when Ray is imported: under `uv run` it would copy the working directory to every worker and
        # install a whole environment there; it would report its use; it would warn about GPUs that we don't ask for
        os.environ.setdefault("RAY_ENABLE_UV_RUN_RUNTIME_ENV", "0")
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        import ray

        return ray

    def _start(self, ray: Any) -> None:
        quiet: dict[str, Any] = {"logging_level": logging.ERROR, "log_to_driver": False}
        if self.address is None:
            ray.init("local", num_cpus=self.workers, include_dashboard=False, **quiet)
        else:
            ray.init(self.address, **quiet)


ENGINES: dict[str, type[Local] | type[Ray]] = {"local": Local, "ray": Ray}
"""The engines by their name on the command line."""


def check_workers(workers: int | None) -> None:
    """Raise InputError unless there is at least one worker."""
    if workers is not None and workers < 1:
        raise InputError(f"--workers is {workers}, but it must be at least 1")


def check_address(address: str) -> None:
    """Raise InputError unless something listens at HOST:PORT; Ray itself would wait for it for many minutes."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal():
        raise InputError(f"--address is {address!r}, but it must be HOST:PORT, as `ray start --head` prints it")
    try:
        socket.create_connection((host, int(port)), timeout=5).close()
    except (OSError, OverflowError) as error:
        raise InputError(f"--address is {address}, but no Ray cluster answers there: {error}") from None


def _in_processes(
    work: Callable[[Item], Result], items: Sequence[Item], workers: int
) -> Generator[tuple[Item, Result]]:
    left = iter(items)
    with working(work, workers) as idle:
        running: dict[Worker, Item] = {}

        def give(worker: Worker) -> None:
            for item in itertools.islice(left, 1):
                worker.ask(item)
                running[worker] = item

        for worker in idle:
            give(worker)
        while running:
            for worker in answering(running):
                item, result = running.pop(worker), worker.answer()
                give(worker)
                yield item, result
