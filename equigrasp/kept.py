"""What acting keeps of instructions: their embeddings and the kernels made from them, as long as the weights stay.

A kernel depends on the instruction and the weights alone, and a robot hears the same instruction again and again. An
embedding that is kept is known by its identity: a kernel is taken from here for the very tensor that `embedding` gave
out, and for no other, so that training and the laws of symmetry, which bring tensors of their own, never meet it.
Several threads may act with one policy.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

MOST = 64
"""Instructions that are kept, of a policy; 64 kernels of 33 pixels and 8 channels are 38 MB."""


@dataclass(eq=False)
class Entry:
    """What is kept of a batch of instructions: their embeddings `(B, D)` and, once it was asked for, their kernel."""

    embedding: Tensor
    kernel: Tensor | None = None


class Kept:
    """The latest embeddings of a policy, and the kernel of each, with a copy of the weights that made them.

    The weights are compared, bit for bit, at every call: torch's count of writes to a tensor would be cheaper, but
    neither its own fused Adam nor a write through `.data` is counted. Copied or pickled, it is empty.
    """

    def __init__(self) -> None:
        self._entries: OrderedDict[tuple[str, ...], Entry] = OrderedDict()
        self._all: tuple[Entry, ...] = ()
        self._settings: object = None
        self._weights: list[Tensor] = []
        self._lock = threading.Lock()

    def clear(self) -> None:
        """Forget all."""
        with self._lock:
            self._entries.clear()
            self._all = ()

    def embedding(
        self,
        instructions: tuple[str, ...],
        module: nn.Module | None,
        settings: Hashable,
        make: Callable[[], Tensor],
    ) -> Tensor:
        """The embeddings of a batch of instructions, `(B, D)`: the tensor that it gave before, if nothing changed.

        Args:
            instructions: B of them.
            module: makes the kernels, if there are any.
            settings: what else they depend on; all is forgotten when the module, its weights or these change.
            make: makes the embeddings.
        """
        weights = [] if module is None else [each.detach() for each in (*module.parameters(), *module.buffers())]
        with self._lock:
            if self._settings != (module, settings) or not same(weights, self._weights):
                self._entries.clear()
                self._all = ()
                self._settings = module, settings
                self._weights = [each.clone() for each in weights]
            if instructions not in self._entries:
                self._entries[instructions] = Entry(make())
            self._entries.move_to_end(instructions)
            # a batch that is larger than all that may be kept is kept for this call alone
            while len(self._entries) > 1 and sum(map(len, self._entries)) > MOST:
                self._entries.popitem(last=False)
            self._all = tuple(self._entries.values())
            return self._entries[instructions].embedding

    def kernel(self, embedding: Tensor, make: Callable[[Tensor], Tensor]) -> Tensor:
        """What `make` gives for an embedding: kept if the embedding is one that is, made anew if not."""
        # a tuple, which no other thread changes: torch traces no lock
        entry = next((each for each in self._all if each.embedding is embedding), None)
        if entry is None:
            return make(embedding)
        # outside the lock, or threads would make their kernels one after the other; of one instruction they may make
        # two, the same bits
        if entry.kernel is None:
            entry.kernel = make(embedding)
        return entry.kernel

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy of a policy, in this process or in another, makes its own."""
        return type(self), ()


def same(some: list[Tensor], others: list[Tensor]) -> bool:
    """Whether tensors are alike, bit for bit, in type and place too; a NaN is like nothing."""
    return len(some) == len(others) and all(
        one.dtype == other.dtype and one.device == other.device and torch.equal(one, other)
        for one, other in zip(some, others, strict=True)
    )
