"""Work for other processes in a module that imports nothing, so that they start at once."""

from __future__ import annotations

import time


def nap(seed: int) -> int:
    """An episode of one grasp that takes no processor, so that two processes have twice as many anywhere."""
    time.sleep(0.02)
    return 1
