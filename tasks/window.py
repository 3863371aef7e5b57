"""A window in which a person watches the hand work (`render_mode="human"`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray


class Window:
    """Pictures of one size, one after the other, in a window of pygame, which opens with the first.

    Args:
        title: of the window.
        rate: pictures a second, at most.

    Raises:
        DependencyNotInstalled: if pygame is missing.
    """

    def __init__(self, title: str, rate: float) -> None:
        try:
            import pygame
        except ImportError:
            raise DependencyNotInstalled(
                "render_mode='human' needs pygame: pip install -e '.[human]' in equigrasp's folder, or use "
                "render_mode='rgb_array'"
            ) from None
        self._pygame: Any = pygame
        self._title = title
        self._rate = rate
        self._surface: Any = None
        self._clock: Any = None

    def show(self, picture: NDArray[np.uint8], words: str) -> None:
        """Show a picture `(rows, columns, 3)` under `words`, and wait for its turn."""
        pygame = self._pygame
        rows, columns, _ = picture.shape
        if self._surface is None:
            pygame.display.init()
            self._surface = pygame.display.set_mode((columns, rows))
            self._clock = pygame.time.Clock()
        pygame.display.set_caption(f"{self._title}: {words}")
        pygame.surfarray.blit_array(self._surface, picture.swapaxes(0, 1))
        pygame.event.pump()
        pygame.display.flip()
        self._clock.tick(self._rate)

    def close(self) -> None:
        """Close the window. Closing twice does nothing more."""
        if self._surface is not None:
            self._pygame.display.quit()
        self._surface = None
