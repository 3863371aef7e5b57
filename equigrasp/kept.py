"""What acting keeps of instructions: their embeddings and the kernels made from them, as long as the weights stay.

A kernel depends on the instruction and the weights alone, and a robot hears the same instruction again and again. An
embedding that is kept is known by its identity: a kernel is taken from here for the very tensor that `embedding` gave
out, and for no other, so that training and the laws of symmetry, which bring tensors of their own, never meet it.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable

import torch
from torch import Tensor, nn

MOST = 64
"""Instructions that are kept, of a policy; 64 kernels of 33 pixels and 8 channels are 38 MB."""


class Kept:
    """The latest embeddings of a policy, and the kernel of each, with a copy of the weights that made them.

    The weights are compared, bit for bit, at every call: torch's count of writes to a tensor would be cheaper, but
    neither its own fused Adam nor a write through `.data` is counted.
    """

    def __init__(self) -> None:
        self._embeddings: OrderedDict[tuple[str, ...], Tensor] = OrderedDict()
        self._kernels: dict[int, Tensor] = {}
        self._settings: object = None
        self._weights: list[Tensor] = []

    def clear(self) -> None:
        """Forget all."""
        self._embeddings.clear()
        self._kernels.clear()

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
        if self._settings != (module, settings) or not same(weights, self._weights):
            self.clear()
            self._settings = module, settings
            self._weights = [each.clone() for each in weights]
        if instructions not in self._embeddings:
            self._embeddings[instructions] = make()
        self._embeddings.move_to_end(instructions)
        # a batch that is larger than all that may be kept is kept for this call alone
        while len(self._embeddings) > 1 and sum(map(len, self._embeddings)) > MOST:
            _, oldest = self._embeddings.popitem(last=False)
            self._kernels.pop(id(oldest), None)
        return self._embeddings[instructions]

    def kernel(self, embedding: Tensor, make: Callable[[Tensor], Tensor]) -> Tensor:
        """What `make` gives for an embedding: kept if the embedding is one that is, made anew if not."""
        # an id is a tensor's own only as long as the tensor is there, as the kept ones are
        if not any(each is embedding for each in self._embeddings.values()):
            return make(embedding)
        if id(embedding) not in self._kernels:
            self._kernels[id(embedding)] = make(embedding)
        return self._kernels[id(embedding)]

    def __deepcopy__(self, memo: object) -> Kept:
        """A copy of a policy makes its own."""
        return Kept()


def same(some: list[Tensor], others: list[Tensor]) -> bool:
    """Whether tensors are alike, bit for bit, in type and place too; a NaN is like nothing."""
    return len(some) == len(others) and all(
        one.dtype == other.dtype and one.device == other.device and torch.equal(one, other)
        for one, other in zip(some, others, strict=True)
    )
