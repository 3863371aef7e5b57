"""What the text encoders hear: cosine similarities of instructions, by what differs between them, as a page.

    uv run python paper_figs/text_encoders.py

writes `docs/language.md`: the mean, least and greatest similarity over all pairs of each kind, and what policies that
were recorded make of held-out phrasings. It measures every encoder whose weights are on this machine. CLIP's other
weights are named: `... clip-rn50:/path/to/weights.safetensors`.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import huggingface_hub
import numpy as np
import recorded
import style
from cells import Cell, Way, pooled
from grid import Value
from loading import load

from equigrasp import clip, language
from equigrasp.artefacts import check_writable
from equigrasp.errors import unknown
from equigrasp.exits import exits
from equigrasp.models import MODELS
from tasks import TASKS
from tasks.goal import Goal
from tasks.instructions import GRAMMARS, render

PAGE = Path(__file__).parent.parent / "docs" / "language.md"
COMMAND = "uv run python paper_figs/text_encoders.py"
Pair = tuple[str, str]

BY_PART = TASKS["pick-by-part"].goals
COLORED = TASKS["pick-colored-fruit"].goals
CAPTIONED = TASKS["pick-caption"].goals
LOGOS = TASKS["pick-logo"].goals


def sentences(goal: Goal, which: str) -> list[str]:
    """Every instruction that asks for the goal in that set of phrasings."""
    grammar = GRAMMARS[goal.kind]
    return [render(goal, phrasing) for phrasing in (grammar.seen if which == "seen" else grammar.held_out)]


def paraphrases(goals: Iterable[Goal]) -> list[Pair]:
    """Two demonstrated phrasings of one goal."""
    return [pair for goal in goals for pair in itertools.combinations(sentences(goal, "seen"), 2)]


def held_out(goals: Iterable[Goal]) -> list[Pair]:
    """A demonstrated and a held-out phrasing of one goal."""
    return [pair for goal in goals for pair in itertools.product(sentences(goal, "seen"), sentences(goal, "unseen"))]


def same_frame(goals: Iterable[Goal], differ: Callable[[Goal, Goal], bool]) -> list[Pair]:
    """Two goals in the same demonstrated phrasing: nothing differs but the words that name them."""
    return [
        pair
        for one, other in itertools.combinations(goals, 2)
        if differ(one, other)
        for pair in zip(sentences(one, "seen"), sentences(other, "seen"), strict=True)
    ]


def part_alone(one: Goal, other: Goal) -> bool:
    """Whether the goals name one object and two parts."""
    return one.object == other.object and one.part != other.part


def object_alone(one: Goal, other: Goal) -> bool:
    """Whether the goals name two objects, and the same part and colour."""
    return one.object != other.object and (one.part, one.color) == (other.part, other.color)


def color_alone(one: Goal, other: Goal) -> bool:
    """Whether the goals name one object in two colours."""
    return one.object == other.object and one.color != other.color


KINDS: dict[str, list[Pair]] = {
    "one goal, two demonstrated phrasings": paraphrases(BY_PART),
    "one goal, a demonstrated and a held-out phrasing": held_out(BY_PART),
    "two parts of one object": same_frame(BY_PART, part_alone),
    "two objects, the same part": same_frame(BY_PART, object_alone),
    "one fruit in two colours": same_frame(COLORED, color_alone),
    "two fruits of one colour": same_frame(COLORED, object_alone),
    "two captions, a letter each": same_frame(CAPTIONED, object_alone),
    "two logos": same_frame(LOGOS, object_alone),
}
"""What differs -> pairs of sentences. But for the first two rows, both sentences are in the same phrasing."""


@dataclass(frozen=True)
class Similarity:
    """Cosines over all pairs of a kind."""

    mean: float
    least: float
    greatest: float

    def __str__(self) -> str:
        return f"{self.mean:.3f} ({self.least:.3f} to {self.greatest:.3f})"


def similarity(encoder: str, pairs: list[Pair]) -> Similarity:
    """Cosines of the embeddings of each pair."""
    one, other = (language.embed(encoder, each) for each in zip(*pairs, strict=True))
    cosines = (one.astype(np.float64) * other).sum(axis=1)
    return Similarity(float(cosines.mean()), float(cosines.min()), float(cosines.max()))


def nearest(encoder: str) -> tuple[int, int]:
    """Held-out sentences whose nearest demonstrated sentence asks for the same goal, and all of them.

    Against the demonstrated sentences of all goals of pick-by-part; no training is in it.
    """
    asked = [(index, each) for index, goal in enumerate(BY_PART) for each in sentences(goal, "unseen")]
    known = [(index, each) for index, goal in enumerate(BY_PART) for each in sentences(goal, "seen")]
    cosines = language.embed(encoder, [each for _, each in asked]) @ language.embed(encoder, [e for _, e in known]).T
    owners = np.array([index for index, _ in known])[cosines.argmax(axis=1)]
    return int((owners == [index for index, _ in asked]).sum()), len(asked)


def available(named: list[str]) -> tuple[list[str], list[str]]:
    """The encoders that can read here, and those of which no weights are here; nothing is fetched.

    Raises:
        InputError: if there is no such tower, or a named file is no weights of its.
    """
    for encoder in named:
        name, _, file = encoder.partition(":")
        if name not in clip.TOWERS:
            raise unknown("CLIP tower", name, clip.TOWERS)
        clip.find_weights(name, file)
    cached = [
        name
        for name, tower in clip.TOWERS.items()
        if isinstance(huggingface_hub.try_to_load_from_cache(tower.repository, clip.HUB_FILE), str)
    ]
    found = ["minilm", "hashing", *cached, *named]
    heard = {encoder.partition(":")[0] for encoder in found}
    return found, [name for name in clip.TOWERS if name not in heard]


def heard(cells: Sequence[Cell], task: str = "pick-by-part") -> list[str]:
    """Of policies that were asked for the task in held-out phrasings too: how often they did it, by who read.

    Empty where no policy was asked so. Intervals are Wilson's, 95%.
    """
    asked: dict[Way, dict[str, list[Cell]]] = {}
    for cell in cells:
        if cell.task == task and cell.shots:
            asked.setdefault(replace(cell.way, phrasings=""), {}).setdefault(cell.way.phrasings, []).append(cell)
    both = {way: asked[way] for way in recorded.in_order(asked) if {"seen", "unseen"} <= asked[way].keys()}
    if not both:
        return []
    lines = [
        "",
        f"What trained policies make of it: single shots of {task} in unseen scenes, asked for in demonstrated and in",
        "held-out phrasings (`equigrasp study --phrasings unseen`), % [95% Wilson interval]:",
        "",
        "| policy | reads by | demonstrated | held out |",
        "|---|---|---|---|",
    ]
    for way, tests in both.items():
        reader = way.text_encoder or MODELS[way.model].encoder
        policy = recorded.label(replace(way, text_encoder=None), task, both)
        lines.append(f"| {policy} | {reader} | {percent(tests['seen'])} | {percent(tests['unseen'])} |")
    return lines


def percent(cells: Sequence[Cell]) -> str:
    """Their rate, with its interval."""
    rate = pooled(cells)
    assert rate is not None
    return str(Value.of(rate))


def page(encoders: list[str], missing: list[str]) -> str:
    """The whole page."""
    # a file is the user's own, and where it lies is not said
    names = [encoder.partition(":")[0] for encoder in encoders]
    lines = [
        "# What the text encoders hear",
        "",
        f"`{COMMAND}` wrote this page. A number is the cosine similarity of two",
        "instructions' embeddings: the mean over all pairs of a kind, and the least and the greatest. Instructions are",
        "those of the benchmark's own grammars (`tasks/instructions.py`): pick-by-part for goals, parts and objects,",
        "pick-colored-fruit, pick-caption and pick-logo. Below the first two rows both sentences are in the same",
        "demonstrated phrasing, and only the words that name the goal differ.",
        "",
        "| what differs | pairs | " + " | ".join(names) + " |",
        "|---|---|" + "---|" * len(names),
    ]
    for kind, pairs in KINDS.items():
        cells = [str(similarity(encoder, pairs)) for encoder in encoders]
        lines.append(f"| {kind} | {len(pairs)} | " + " | ".join(cells) + " |")
    lines += [
        "",
        "Of the held-out sentences of pick-by-part, those whose nearest demonstrated sentence (of all goals' together)",
        "asks for the same goal, before any training:",
        "",
        "| encoder | same goal |",
        "|---|---|",
    ]
    for name, encoder in zip(names, encoders, strict=True):
        right, of = nearest(encoder)
        lines.append(f"| {name} | {right} of {of} |")
    if missing:
        lines += ["", f"Not measured, because no weights of it were on this machine: {', '.join(missing)}."]
    lines += heard(load(sorted(style.RESULTS.glob("*.jsonl")))[0])
    return "\n".join(lines) + "\n"


@exits()
def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description="What the text encoders hear, as a page.")
    parser.add_argument("encoders", nargs="*", help="further ones, as clip-rn50:/path/to/weights.safetensors")
    parser.add_argument("--out", type=Path, default=PAGE, help="the page")
    options = parser.parse_args(arguments)
    check_writable(options.out, "--out")
    encoders, missing = available(options.encoders)
    style.save_text(page(encoders, missing), options.out)


if __name__ == "__main__":
    main()
