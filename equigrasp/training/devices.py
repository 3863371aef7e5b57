"""On what a training runs: one process on a processor or a GPU, or several that share each step (DDP by Fabric).

A step's examples are numbered; process r of N takes those from r B to (r + 1) B. So a step of N processes of batch B
sees what a step of one process of batch N B sees, and its gradient, the mean over the processes, is the same one.
"""

from __future__ import annotations

import importlib.util
import inspect
import multiprocessing
import os
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, cast

import joblib
import torch
from torch import Tensor, nn

from equigrasp.augmentation import Augmentation
from equigrasp.errors import InputError, WorkerLostError, unknown
from equigrasp.training.batch import Feed, with_pixels, with_recipes
from equigrasp.training.cuda_graph import Captured

if TYPE_CHECKING:
    from lightning_fabric import Fabric

KINDS = ("cpu", "cuda")
WATCH_EVERY = 0.5
"""Seconds after which a process of several looks whether the one that started it is still there."""


@dataclass(frozen=True)
class Devices:
    """Where a training runs; the bits of its result depend on it.

    Attributes:
        kind: "cpu" or "cuda".
        count: processes, each on a device of its own (a core at least, or a GPU).

    Raises:
        InputError: if there are not so many, or Fabric is wanted and not installed.
    """

    kind: str = "cpu"
    count: int = 1

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise unknown("device", self.kind, KINDS)
        there = torch.cuda.device_count() if self.kind == "cuda" else joblib.cpu_count()
        if not there:
            raise InputError("--device is cuda, but there is no GPU that torch sees here; leave it at auto")
        if self.count < 1:
            raise InputError(f"--devices is {self.count}, but it must be at least 1")
        if self.count > there:
            name = "GPUs" if self.kind == "cuda" else "processor cores"
            raise InputError(f"--devices is {self.count}, but there are {there} {name} for it; ask for at most that")
        if self.count > 1 and importlib.util.find_spec("lightning_fabric") is None:
            raise InputError(
                f"--devices {self.count} needs Lightning's Fabric, which is not installed; "
                "`pip install -e '.[ddp]'` in equigrasp's folder adds it"
            )

    @classmethod
    def found(cls, kind: Literal["auto", "cpu", "cuda"] = "auto", count: int = 1) -> Devices:
        """The devices of a kind; "auto" is cuda where there is a GPU.

        Raises:
            InputError: as for the class.
        """
        return cls(("cuda" if torch.cuda.is_available() else "cpu") if kind == "auto" else kind, count)

    def plan(self) -> dict[str, Any]:
        """What a run's plan says of them; nothing of one processor, which runs had before there was a choice."""
        return {} if self == Devices() else {"devices": {"kind": self.kind, "count": self.count}}

    def run(self, work: Callable[..., str | None], *arguments: Any) -> None:
        """Call `work(process, *arguments)` in each process, this one if one is all, and wait for all.

        With several, all of it must pickle, from one process to the next, and no file is written.

        Args:
            work: gives None, or the sentence that says what is wrong with the input, the same in every process.
            arguments: what it is passed after its `Process`.

        Raises:
            InputError: with that sentence.
            WorkerLostError: if a process was killed; the others are ended.
        """
        alone = self.count == 1
        wrong = work(Process(torch.device(self.kind)), *arguments) if alone else self._launch(work, arguments)
        if wrong:
            raise InputError(wrong)

    def _launch(self, work: Callable[..., str | None], arguments: tuple[Any, ...]) -> str | None:
        from lightning_fabric import Fabric
        from lightning_fabric.strategies import DDPStrategy
        from torch.multiprocessing import ProcessExitedException
        from torch.nn.parallel import DistributedDataParallel

        # the buffers are constants, the same everywhere; torch has renamed how it is told so
        names = inspect.signature(DistributedDataParallel).parameters
        sync = "forward_sync_buffers" if "forward_sync_buffers" in names else "broadcast_buffers"
        options: dict[str, Any] = {sync: False}
        strategy = DDPStrategy(start_method="spawn", **options)
        fabric = Fabric(accelerator=self.kind, devices=self.count, strategy=strategy)
        others = multiprocessing.active_children()
        try:
            return fabric.launch(_RankedWork(work, arguments))
        except ProcessExitedException as error:
            raise WorkerLostError(f"one of {self.count} training processes died ({error})") from None
        finally:
            # after a stop nobody else does: this process would wait for them when it ends, and they for each other
            for each in multiprocessing.active_children():
                if each not in others:
                    each.kill()


class _RankedWork:
    """Calls the work in each of the processes, which ends with the one that started it, however that dies."""

    # not as arguments of the call, because Fabric looks through those for modules, and not through a frozen record
    def __init__(self, work: Callable[..., str | None], arguments: tuple[Any, ...]) -> None:
        self.work, self.arguments, self.starter = work, arguments, os.getpid()

    def __call__(self, fabric: Fabric) -> str | None:
        return self.work(Ranked(fabric), *self.arguments)

    def __setstate__(self, state: dict[str, Any]) -> None:
        # the first that a process does: before it has met the others it may wait for them for half an hour
        vars(self).update(state)
        if os.getpid() != self.starter:
            threading.Thread(target=_end_without, args=(self.starter,), daemon=True).start()


def _end_without(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(WATCH_EVERY)
    os._exit(1)


class Process:
    """The one process of a training.

    Attributes:
        device: where its policy lies.
        rank: which of the processes it is.
        count: how many there are.
    """

    rank, count = 0, 1

    def __init__(self, device: torch.device) -> None:
        self.device = device

    @property
    def writes(self) -> bool:
        """Whether it writes the run's files: one process alone does."""
        return self.rank == 0

    def places(self, batch: int) -> range:
        """Which of a step's examples it takes, `batch` of them."""
        return range(self.rank * batch, (self.rank + 1) * batch)

    def shared(self, policy: nn.Module) -> Callable[[Tensor, Tensor], Tensor]:
        """The policy's forward pass, whose backward leaves the gradient of the whole step's mean loss."""
        return policy

    def feed(self, augmentation: Augmentation) -> Feed:
        """How its steps get their scenes: a GPU paints its own."""
        return with_recipes(augmentation, self.device) if self.device.type == "cuda" else with_pixels()

    def captured(self, work: Callable[..., Tensor]) -> Callable[..., Tensor]:
        """The same work on tensors of the device: on a GPU as a CUDA graph, by which the host asks for it at once."""
        return Captured(work) if self.device.type == "cuda" else work

    def take(self, *tensors: Tensor) -> tuple[Tensor, ...]:
        """Tensors of the host -> on the device; the host does not wait for it."""
        if self.device.type == "cpu":
            return tensors
        return tuple(each.pin_memory().to(self.device, non_blocking=True) for each in tensors)

    def mean(self, values: Tensor) -> Tensor:
        """The mean over all processes, the same in each; all of them must ask."""
        return values

    def wait(self) -> None:
        """Until all processes are here."""


class Ranked(Process):
    """One of several processes of a training, as Fabric started it."""

    def __init__(self, fabric: Fabric) -> None:
        super().__init__(fabric.device)
        self.rank, self.count = fabric.global_rank, fabric.world_size
        self._fabric = fabric

    def shared(self, policy: nn.Module) -> Callable[[Tensor, Tensor], Tensor]:
        """By torch's DistributedDataParallel."""
        return cast(Callable[[Tensor, Tensor], Tensor], self._fabric.setup_module(policy, move_to_device=False))

    def captured(self, work: Callable[..., Tensor]) -> Callable[..., Tensor]:
        """The work as it is: DistributedDataParallel hooks into each backward pass."""
        return work

    def mean(self, values: Tensor) -> Tensor:
        """By an all-reduce."""
        return cast(Tensor, self._fabric.all_reduce(values, reduce_op="mean"))

    def wait(self) -> None:
        """By a barrier."""
        self._fabric.barrier()
