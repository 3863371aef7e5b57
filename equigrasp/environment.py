"""What the method asks of an environment, so that it never needs to import one.

`tasks.env.GraspEnv` has all of it; a user's own suite or robot needs no more.
"""

from __future__ import annotations

from typing import Any, Protocol

from equigrasp.grasp import Grasp, Observation


class Environment(Protocol):
    """Gymnasium's `reset` and `step`, and the current observation and instruction as records.

    `reset`'s info has `goal` (a dict with `index`, `name`, `part`, `kind` and `words`, as in `Demonstration`) and
    `trials_left` (n + 1 for n goals);
    `step`'s has `outcome` (a dict with `lifted`, `correct_object`, `reason`, and `part`, the part that the hand held,
    where that is known) and the next `goal` as well.
    """

    @property
    def observation(self) -> Observation:
        """What the cameras see now."""
        ...

    @property
    def instruction(self) -> str:
        """The current goal's sentence."""
        ...

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict]:
        """Begin an episode; `options={"goal": k}` asks for the task's k-th goal."""
        ...

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict]:
        """Try the grasp `(u, v, bin)`; gives observation, reward, terminated, truncated, info."""
        ...


class DemonstratedEnvironment(Environment, Protocol):
    """An environment with an oracle that can demonstrate."""

    def oracle(self, tries: int = 1) -> tuple[Grasp, float]:
        """A grasp for the current goal, from the true scene, and its quality in [0, 1].

        Of several tries the first that succeeds from the state as it is now, which stays.
        """
        ...

    def close(self) -> None:
        """Free what it holds; closing twice does nothing more."""
        ...
