"""Work on a GPU captured as a CUDA graph: hundreds of small kernels that the host asks for with one call.

A training step of ours is some thousand kernels of a few microseconds each, and asking for them one by one takes the
host longer than the GPU takes to run them.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

EAGER = 3
"""Calls that are done as they are before one is captured: the first ones allocate, plan and make what is kept."""


class Captured:
    """`work` on tensors of a GPU: done as it is three times, then captured, and replayed from then on.

    A replay runs the same kernels on the same memory, so its results are the same bits. What the work does to tensors
    of its own, as weights, is done at each call; what it does in Python, at the first four alone.

    Args:
        work: takes tensors of the same shapes at each call, in one place, and gives one. It must neither ask for a
            value nor take anything from the host.
    """

    def __init__(self, work: Callable[..., Tensor]) -> None:
        self._work = work
        self._calls = 0
        self._graph: torch.cuda.CUDAGraph | None = None
        self._stream = torch.cuda.Stream()
        self._inputs: list[Tensor] = []
        self._result: Tensor | None = None

    def __call__(self, *tensors: Tensor) -> Tensor:
        """What `work` gives for them; the host does not wait for it."""
        if self._calls < EAGER:
            self._calls += 1
            return self._eager(*tensors)
        if self._graph is None:
            self._graph = self._capture(*tensors)
        for kept, tensor in zip(self._inputs, tensors, strict=True):
            kept.copy_(tensor, non_blocking=True)
        self._graph.replay()
        assert self._result is not None
        return self._result.clone()

    def _eager(self, *tensors: Tensor) -> Tensor:
        # on the stream of the capture, or memory that autograd keeps would be bound to another
        self._stream.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(self._stream):
            result = self._work(*tensors)
        torch.cuda.current_stream().wait_stream(self._stream)
        return result

    def _capture(self, *tensors: Tensor) -> torch.cuda.CUDAGraph:
        self._inputs = [each.clone() for each in tensors]
        graph = torch.cuda.CUDAGraph()
        # other threads of this process may ask the GPU for something meanwhile
        with torch.cuda.graph(graph, stream=self._stream, capture_error_mode="thread_local"):
            self._result = self._work(*self._inputs)
        return graph
