"""The Gymnasium space of instructions, and what it cannot be used with."""

from __future__ import annotations

from types import ModuleType
from typing import NoReturn

from gymnasium import spaces
from gymnasium.vector.utils import create_shared_memory

from tasks.instructions import CHARSET, LONGEST


class InstructionSpace(spaces.Text):
    """Sentences of 1 to `LONGEST` characters of `CHARSET`."""

    def __init__(self) -> None:
        super().__init__(LONGEST, charset=CHARSET)


@create_shared_memory.register(InstructionSpace)
def _refuse(space: InstructionSpace, n: int = 1, ctx: ModuleType | None = None) -> NoReturn:
    """Gymnasium 1.4 reads texts from shared memory once, before the first reset, and never again.

    Every instruction would read "aaaa...", and a policy would be trained on that without a word.
    """
    del space, n, ctx
    raise ValueError(
        "AsyncVectorEnv cannot share instructions between processes by memory: make it with shared_memory=False "
        "(gymnasium.make_vec: vector_kwargs={'shared_memory': False})"
    )
