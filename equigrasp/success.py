"""Success rates: trials, what came of them, and shares and mean rewards with their Wilson intervals."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import asdict, dataclass
from statistics import NormalDist
from typing import Any

MOST = 3
"""How many of the mistakes are said in words."""


@dataclass(frozen=True)
class Trial:
    """One grasp and what came of it.

    Attributes:
        seed: what the environment was reset with.
        trial: 0 for the first grasp in the scene.
        goal: index of the goal.
        object: the name of the thing that was asked for.
        part: the goal's part, or None.
        instruction: what was said.
        grasp: (u, v, theta) in pixels, pixels, radians.
        grasped: something was lifted.
        correct_object: the goal's object was lifted and nothing else.
        correct: the goal was reached: the right object, by the right part.
        reason: the judge's word for it.
        lifted: the names of what was lifted.
        held: the part that it was held by, or None where the environment does not say.
    """

    seed: int
    trial: int
    goal: int
    object: str
    part: str | None
    instruction: str
    grasp: tuple[float, float, float]
    grasped: bool
    correct_object: bool
    correct: bool
    reason: str
    lifted: tuple[str, ...]
    held: str | None

    @property
    def asked(self) -> str:
        """What was asked for: "mug", or "mug by handle"."""
        return self.object if self.part is None else f"{self.object} by {self.part}"

    @property
    def taken(self) -> str | None:
        """What was lifted, in the words of `asked`; None where nothing was."""
        if not self.lifted:
            return None
        names = " and ".join(self.lifted)
        return names if self.part is None or self.held is None else f"{names} by {self.held}"


@dataclass(frozen=True)
class Rate:
    """A success rate with its 95% Wilson interval.

    Attributes:
        successes: how many.
        trials: of how many.
        scenes: in how many scenes, where several trials share one; None where each has its own. Trials of a scene
            succeed and fail together: what was not got hold of lies there as before when it is tried again.
    """

    successes: int
    trials: int
    scenes: int | None = None

    @property
    def value(self) -> float:
        """The share of successes; NaN without a trial."""
        return self.successes / self.trials if self.trials else math.nan

    @property
    def interval(self) -> tuple[float, float]:
        """95% Wilson interval; of trials that share scenes as if each scene were all or nothing."""
        return wilson(self.value, self.trials if self.scenes is None else self.scenes)

    def __str__(self) -> str:
        low, high = self.interval
        within = "" if self.scenes is None else f" in {self.scenes} scenes"
        return (
            f"{100 * self.value:.1f}% [{100 * low:.1f}, {100 * high:.1f}] ({self.successes} of {self.trials}{within})"
        )


@dataclass(frozen=True)
class MeanReward:
    """The mean of scenes' summed rewards, each from 0 to 1 (the paper's success rate), with its interval.

    Attributes:
        value: the mean.
        scenes: of how many.
    """

    value: float
    scenes: int

    @property
    def interval(self) -> tuple[float, float]:
        """95% Wilson interval, as if each scene were all or nothing: no rewards with this mean vary more."""
        return wilson(self.value, self.scenes)

    def __str__(self) -> str:
        low, high = self.interval
        return f"{100 * self.value:.1f}% [{100 * low:.1f}, {100 * high:.1f}] ({self.scenes} scenes)"


def wilson(mean: float, count: int) -> tuple[float, float]:
    """95% score interval of the mean of independent numbers from 0 to 1 (Wilson, 1927).

    It has every true mean p from which chance takes what was found so far. Numbers from 0 to 1 with the mean p have the
    variance p (1 - p) at the most, and have it where each is 0 or 1: of a share the interval is Wilson's own, and of
    any others it is not too narrow.

    Args:
        mean: what was found.
        count: of how many numbers; of none the interval is NaN.
    """
    if not count:
        return math.nan, math.nan
    z = NormalDist().inv_cdf(0.975)
    middle = mean + z**2 / (2 * count)
    reach = z * math.sqrt(mean * (1 - mean) / count + (z / (2 * count)) ** 2)
    low, high = ((middle + sign * reach) / (1 + z**2 / count) for sign in (-1, 1))
    # exact where rounding is not
    return (0.0 if mean == 0 else low), (1.0 if mean == 1 else high)


@dataclass(frozen=True)
class Scene:
    """One scene of the paper's protocol: n goals, n + 1 trials, reward 1 / n for each goal reached."""

    seed: int
    goals: int
    reached: int


@dataclass(frozen=True)
class Evaluation:
    """All trials of an evaluation, and the rates drawn from them.

    Attributes:
        trials: in order.
        scenes: one for each scene of the paper's protocol; empty for single shots.
    """

    trials: tuple[Trial, ...]
    scenes: tuple[Scene, ...] = ()

    @property
    def grasped(self) -> Rate:
        """Of all trials, those that lifted something."""
        return self._rate(sum(trial.grasped for trial in self.trials), len(self.trials))

    @property
    def correct_object(self) -> Rate:
        """Of all trials, those that lifted the goal's object and nothing else."""
        return self._rate(sum(trial.correct_object for trial in self.trials), len(self.trials))

    @property
    def correct(self) -> Rate:
        """Of all trials, those that reached the goal: the right object by the right part."""
        return self._rate(sum(trial.correct for trial in self.trials), len(self.trials))

    @property
    def reached(self) -> Rate:
        """Of all goals of the scenes, those that were reached within n + 1 trials."""
        return self._rate(sum(scene.reached for scene in self.scenes), sum(scene.goals for scene in self.scenes))

    def _rate(self, successes: int, trials: int) -> Rate:
        """Single shots have a scene each; trials of the paper's protocol share theirs."""
        return Rate(successes, trials, len(self.scenes) or None)

    @property
    def reward(self) -> MeanReward:
        """Over the scenes, the paper's success rate; NaN without scenes."""
        total = sum(scene.reached / scene.goals for scene in self.scenes)
        return MeanReward(total / len(self.scenes) if self.scenes else math.nan, len(self.scenes))

    @property
    def failures(self) -> dict[str, int]:
        """How many trials failed for each of the judge's reasons; they add up to all that did not reach the goal."""
        return dict(sorted(Counter(trial.reason for trial in self.trials if not trial.correct).items()))

    @property
    def mistaken(self) -> dict[str, dict[str, int]]:
        """For each goal that something else was lifted in place of: what, and in how many trials; most often first."""
        pairs = Counter(
            (trial.asked, trial.taken)
            for trial in self.trials
            if not trial.correct and trial.taken not in (None, trial.asked)
        )
        found: dict[str, dict[str, int]] = {}
        for (asked, taken), count in sorted(pairs.items(), key=lambda pair: (-pair[1], pair[0])):
            found.setdefault(asked, {})[str(taken)] = count
        return found

    def lines(self) -> list[str]:
        """The rates, a line each."""
        lines = [
            f"grasped something     {self.grasped}",
            f"the right object      {self.correct_object}",
            f"by the right part     {self.correct}",
        ]
        if self.scenes:
            lines.append(f"goals reached         {self.reached}")
            lines.append(f"mean reward           {self.reward}")
        pairs = [(count, goal, taken) for goal, others in self.mistaken.items() for taken, count in others.items()]
        often = sorted(pairs, key=lambda pair: -pair[0])[:MOST]
        if often:
            lines.append("most often taken      " + ", ".join(f"{taken} for {goal} ({n})" for n, goal, taken in often))
        return lines

    def rates(self) -> dict[str, Any]:
        """The rates as JSON, with their counts and 95% Wilson intervals."""
        rates = {"grasped": self.grasped, "correct_object": self.correct_object, "correct": self.correct}
        if self.scenes:
            rates["reached"] = self.reached
        listed: dict[str, Any] = {
            name: {"successes": rate.successes, "trials": rate.trials, "interval": list(rate.interval)}
            for name, rate in rates.items()
        }
        if self.scenes:
            reward = self.reward
            listed |= {"reward": reward.value, "reward_interval": list(reward.interval), "scenes": reward.scenes}
        return listed

    def recorded(self) -> dict[str, Any]:
        """The rates, `failures` by kind, and what was `mistaken` for what, as a line of results has them."""
        return {**self.rates(), "failures": self.failures, "mistaken": self.mistaken}

    def to_dict(self) -> dict[str, Any]:
        """Rates and trials as JSON."""
        return {
            "rates": self.rates(),
            "trials": [asdict(trial) for trial in self.trials],
            "scenes": [asdict(scene) for scene in self.scenes],
        }
