"""What a task is: a row that says which goals there are, which objects fill a scene, and how one speaks."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, is_dataclass
from numbers import Integral
from typing import Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np

from equigrasp.artefacts import checksum
from equigrasp.errors import InputError
from tasks import objects
from tasks.goal import Goal
from tasks.instructions import CHARSET, GRAMMARS, LONGEST, PUNCTUATION, Grammar, PhrasingSet, render
from tasks.objects import ObjectAsset


@runtime_checkable
class OwnObject(Protocol):
    """An object that is not of the suite, such as `tasks.meshes.MeshObject`."""

    @property
    def name(self) -> str:
        """What goals call it."""
        ...

    def load(self) -> ObjectAsset:
        """Its meshes and numbers."""
        ...


@runtime_checkable
class Fingerprinted(Protocol):
    """An object that knows a short name for its content, as `tasks.meshes.MeshObject` does."""

    def fingerprint(self) -> str:
        """The same for the same content, and for no other."""
        ...


@dataclass(frozen=True)
class Task:
    """A row of `tasks.TASKS`, or one of your own.

    Attributes:
        name: as on the command line.
        env_id: the environment's id in Gymnasium.
        goals: everything that can be asked for; an instruction names one of them.
        summary: one phrase on what it asks for.
        objects: fewest and most objects in a scene.
        demonstrated: what one demonstration shows: each "goal" once, or each "object" once, in colours as even
            as chance allows.
        repeated: goals that one demonstration shows a second time, drawn at random.
        trains: whether it may be demonstrated; a task of held-out goals may not.
        own: objects that are not of the suite, by which goals may mean what they name.
        grammars: grammars of one's own, by the kinds that goals name.

    Raises:
        InputError: if the goals are no tuple of goals, `objects` no two whole numbers, or `own` no tuple of objects, or
            one of those is in no goal.
        ValueError: if a scene could not be filled with different objects, a goal or an object's name is there twice,
            or a goal has no grammar or an empty one.
    """

    name: str
    env_id: str
    goals: tuple[Goal, ...]
    summary: str = ""
    objects: tuple[int, int] = (4, 5)
    demonstrated: Literal["goal", "object"] = "goal"
    repeated: int = 0
    trains: bool = True
    own: tuple[OwnObject, ...] = ()
    grammars: Mapping[str, Grammar] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_kinds()
        fewest, most = self.objects
        if not 1 <= fewest <= most <= len(self.pool):
            raise ValueError(
                f"the scenes of {self.name!r} hold {fewest} to {most} different objects, "
                f"but its goals name {len(self.pool)}"
            )
        if self.demonstrated not in ("goal", "object"):
            raise ValueError(f"{self.name!r} demonstrates each 'goal' or each 'object', but not {self.demonstrated!r}")
        if self.repeated < 0:
            raise ValueError(f"{self.name!r} shows {self.repeated} goals again, but it must be 0 or more")
        for goal, count in Counter(self.goals).items():
            if count > 1:
                raise ValueError(
                    f"{self.name!r} has the goal {str(goal)!r} {count} times; list it once, and show more by repeated"
                )
        for name, count in Counter(each.name for each in self.own).items():
            if count > 1:
                raise ValueError(f"{self.name!r} has {count} objects of its own called {name!r}; rename all but one")
        asked = {goal.object for goal in self.goals}
        for each in self.own:
            if each.name not in asked:
                raise InputError(
                    f"{self.name!r} has {each.name!r} among its own objects, but a scene holds only what goals name, "
                    f"and none names it; add Goal({each.name!r}), or leave it out of own"
                )
        for goal in self.goals:
            if not self.grammar(goal).seen or not self.grammar(goal).held_out:
                raise ValueError(f"the grammar {goal.kind!r} needs at least one frame and one held-out sentence")

    def _check_kinds(self) -> None:
        if (
            not isinstance(self.objects, Sequence)
            or len(self.objects) != 2
            or not all(isinstance(count, Integral) and not isinstance(count, bool) for count in self.objects)
        ):
            raise InputError(
                f"how many objects the scenes of {self.name!r} hold is two whole numbers, the fewest and the most, as "
                f"objects=(4, 5), but this is {self.objects!r:.100}"
            )
        object.__setattr__(self, "objects", tuple(map(int, self.objects)))
        if not isinstance(self.goals, Sequence) or isinstance(self.goals, str):
            raise InputError(
                f"what {self.name!r} asks for must be a tuple of goals, but this is {self.goals!r:.100}; one alone "
                "needs a comma, as in goals=(Goal('mug'),)"
            )
        for goal in self.goals:
            if not isinstance(goal, Goal):
                raise InputError(
                    f"{self.name!r} has {goal!r:.100} among its goals, which is a {type(goal).__name__}; a goal is "
                    "written Goal('mug'), or by a part Goal('mug', 'handle')"
                )
        if not isinstance(self.own, Collection) or isinstance(self.own, str | Mapping):
            raise InputError(
                f"what {self.name!r} has of its own must be a tuple of objects, but this is {self.own!r:.100}; one "
                "alone needs a comma, as in own=(duck,), and a dict of objects is own=tuple(objects.values())"
            )
        for each in self.own:
            if not isinstance(each, OwnObject):
                raise InputError(
                    f"{self.name!r} has {each!r:.100} among its own objects, which is a {type(each).__name__}; an "
                    "object of your own has a name and a load(), as a tasks.meshes.MeshObject has"
                )

    @property
    def pool(self) -> tuple[str, ...]:
        """The names of the things that fill its scenes, each once, in the order of the goals."""
        return tuple(dict.fromkeys(goal.name for goal in self.goals))

    def goals_of(self, name: str) -> tuple[Goal, ...]:
        """The goals that ask for the thing of this name."""
        return tuple(goal for goal in self.goals if goal.name == name)

    def grammar(self, goal: Goal) -> Grammar:
        """The grammar that speaks of a goal.

        Raises:
            ValueError: if there is none of the goal's kind.
        """
        known = {**GRAMMARS, **self.grammars}
        if goal.kind not in known:
            raise ValueError(f"there is no grammar {goal.kind!r}; there are {sorted(known)}")
        return known[goal.kind]

    def load(self, goal: Goal) -> ObjectAsset:
        """The thing that a goal asks for, in its colour, called as the goal calls it.

        Raises:
            InputError: if there is no such object, part or colour; it names the nearest.
        """
        own = {each.name: each for each in self.own}
        asset = own[goal.object].load() if goal.object in own else objects.load(goal.object)
        # an object of one's own may be one of the suite's under another name
        asset = asset if asset.name == goal.object else objects.renamed(asset, goal.object)
        return asset if goal.color is None else objects.painted(asset, goal.color)

    def fingerprint(self) -> str:
        """A short name for what is asked for, in which words, of which objects: another row has another.

        A mesh of one's own counts by what it is made of, wherever it lies.

        Raises:
            InputError: if a file of one of its own objects cannot be read.
        """
        spoken = [
            render(goal, each)
            for goal in self.goals
            for each in (*self.grammar(goal).seen, *self.grammar(goal).held_out)
        ]
        own = [_known_by(each) for each in self.own]
        row = [[astuple(goal) for goal in self.goals], spoken, own, self.objects, self.demonstrated, self.repeated]
        return checksum(json.dumps(row).encode())[:10]

    def check(self) -> None:
        """Load every object, look for every part and say every sentence, before a scene is laid out.

        Raises:
            InputError: if a goal asks for what there is not, or lacks what its grammar says, or an instruction would be
                too long or hold characters that Gymnasium's space of instructions has not, could mean another goal, or
                is both held out of demonstrations and said in them; it names the goal or the sentence.
        """
        for goal in self.goals:
            parts = self.load(goal).parts
            if goal.part is not None and goal.part not in parts:
                raise InputError(
                    f"the task {self.name!r} asks for the {goal.object} by its {goal.part!r}, but its parts are "
                    f"{', '.join(parts) or 'none'}"
                )
            grammar = self.grammar(goal)
            for phrasing in (*grammar.seen, *grammar.held_out):
                sentence = render(goal, phrasing)
                if not 0 < len(sentence) <= LONGEST or not set(sentence) <= set(CHARSET):
                    raise InputError(
                        f"the instruction {sentence!r} must have 1 to {LONGEST} characters, each a letter, a digit, "
                        f"a space or one of {PUNCTUATION}"
                    )
            grammar.words(goal)
        self._check_meanings()

    def _check_meanings(self) -> None:
        said: dict[PhrasingSet, dict[str, Goal]] = {which: {} for which in get_args(PhrasingSet)}
        for which, meant in said.items():
            for goal in self.goals:
                for phrasing in self.grammar(goal).phrasings(which):
                    sentence = render(goal, phrasing)
                    other = meant.setdefault(sentence, goal)
                    if (other.name, other.part) != (goal.name, goal.part):
                        raise InputError(
                            f"the task {self.name!r} says {sentence!r} for the goals {str(other)!r} and "
                            f"{str(goal)!r}, so that nobody could tell which is meant; leave one out, or call it "
                            "otherwise"
                        )
                    self._check_look(goal, sentence)
        for sentence in said["unseen"]:
            if sentence in said["seen"]:
                raise InputError(
                    f"the task {self.name!r} holds {sentence!r} out of demonstrations, but has it among the phrasings "
                    "that they use; leave it out of held_out, or out of the frames"
                )

    def _check_look(self, goal: Goal, sentence: str) -> None:
        """Raise an InputError if the sentence fits the same object in another look as well, which may lie beside it."""
        others = [each.name for each in self.goals if each.object == goal.object and each.color != goal.color]
        if others and (goal.color is None or not re.search(rf"\b{re.escape(goal.color)}\b", sentence)):
            raise InputError(
                f"the task {self.name!r} says {sentence!r} for the goal {str(goal)!r}, which fits its {others[0]!r} as "
                "well; leave one out, or give each a color and a kind whose every sentence says {color}"
            )

    def demonstration_goals(self, rng: np.random.Generator) -> tuple[int, ...]:
        """Which goals one demonstration shows, as indices into `goals`; all chance comes from `rng`.

        The paper counts 47 grasps for pick-random-v1, 22 for pick-random-v2 and 23 for pick-by-part.

        Raises:
            InputError: if the task may not be demonstrated.
        """
        if not self.trains:
            raise InputError(
                f"{self.name} is for testing alone: its goals are held out of all training data; "
                f"collect pick-random-v2 and evaluate on {self.name}"
            )
        chosen = list(range(len(self.goals)))
        if self.demonstrated == "object":
            chosen = self._one_of_each_object(rng)
        again = [int(index) for index in rng.integers(len(self.goals), size=self.repeated)]
        return tuple(chosen + again)

    def _one_of_each_object(self, rng: np.random.Generator) -> list[int]:
        """For each object a goal whose colour was used least so far, which spreads few grasps over all colours."""
        by_object: dict[str, list[int]] = {}
        for index, goal in enumerate(self.goals):
            by_object.setdefault(goal.object, []).append(index)
        used = dict.fromkeys((goal.color for goal in self.goals), 0)
        chosen: dict[str, int] = {}
        names = list(by_object)
        for name in (names[place] for place in rng.permutation(len(names))):
            candidates = by_object[name]
            shuffled = [candidates[place] for place in rng.permutation(len(candidates))]
            chosen[name] = min(shuffled, key=lambda index: used[self.goals[index].color])
            used[self.goals[chosen[name]].color] += 1
        return [chosen[name] for name in names]


def _known_by(own: OwnObject) -> Any:
    """What of an object of one's own tells it from others, as JSON."""
    if isinstance(own, Fingerprinted):
        return [own.name, own.fingerprint()]
    # an object of a class that says nothing of itself is known by its name
    return repr(own) if is_dataclass(own) else own.name


def by_part(parts: Mapping[str, tuple[str, ...]]) -> tuple[Goal, ...]:
    """A goal for each part of each object: `by_part({"mug": ("brim", "handle")})`."""
    return tuple(Goal(name, part) for name, listed in parts.items() for part in listed)


def each_of(names: Iterable[str], kind: str = "") -> tuple[Goal, ...]:
    """A goal for each object, by any part, in its own look."""
    return tuple(Goal(name, kind=kind) for name in names)
