"""Task by task: where every model stands on every task that it was tested on.

    uv run equigrasp study --models leg-unet fcgq vit --tasks pick-random-v1 pick-random-v2 pick-by-part
    uv run python paper_figs/by_task.py --results studies/own/results.jsonl

reads files of results, by default all that lie in `paper_figs/results`, and draws `figures/by-task.{png,pdf}`, and
`by-task.md` with the same numbers: single shots with 95% Wilson intervals, a row for each task, without recombination
on the left, with it beside that, and with hard negatives or in crowded scenes (ringed) on the right, where there are
such; the best of each task stands first in the table. Only policies of the same training task, demonstrations and steps
share a row. (`by_task_short.py` draws what one demonstration gives alone, `ablations.py` the ablations.)
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import recorded
from cells import Cell, Way, mean_reward, pooled
from grid import Grid, Row, Value
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from equigrasp.models import MODELS
from equigrasp.study.tables import TABLES, TESTED_ON
from equigrasp.success import Rate

COMMAND = "equigrasp study --table 1"
KINDS = WITHOUT, WITH, HARD, CROWDED, BOTH = (
    "without recombination",
    "with recombination",
    "recombination, hard negatives",
    "recombination, crowded",
    "recombination, hard negatives, crowded",
)
PANELS = {
    WITHOUT: (WITHOUT,),
    WITH: (WITH,),
    "with recombination, and hard negatives\nor crowded scenes (ringed)": (HARD, CROWDED, BOTH),
}
"""Of each side by side: its title, and which kinds it has."""
SPREAD = 0.72
"""Of a row, how much its models take, one below the other."""
ROW = 0.21
"""How high a row is, in inches."""
ABLATIONS = TABLES[4].models[1:]
TRAINED_ON = [task for table in (1, 2, 6) for task in TABLES[table].tasks]
ORDER = [test for task in TRAINED_ON for test in TESTED_ON.get(task, (task,))]
"""The suite's tasks as the tables have them."""
Rates = Mapping[tuple[str, str], Rate]
"""Model and one of `KINDS` -> its single shots."""


@dataclass(frozen=True)
class Place:
    """What policies must share to be compared: how they were trained, but for model and recombination, and the test."""

    trained_on: str
    demos: int
    steps: int
    camera: str
    tested_on: str

    @property
    def training(self) -> str:
        """A line on how they were trained."""
        demonstrations = f"{self.demos} demo" + ("s" if self.demos > 1 else "")
        return f"{self.trained_on}, {demonstrations}, {self.length}"

    @property
    def length(self) -> str:
        """The same without the task and its demonstrations."""
        camera = "" if self.camera == "overhead" else f", {self.camera} camera"
        return f"{self.steps:,} steps{camera}"


def kind(way: Way) -> str:
    """Which of `KINDS` it is; shares are told from none alone."""
    if way.recombination == 0:
        return WITHOUT
    return {(False, False): WITH, (True, False): HARD, (False, True): CROWDED, (True, True): BOTH}[
        way.hard_negatives > 0, way.crowded > 0
    ]


def rates(cells: Sequence[Cell]) -> dict[Place, dict[tuple[str, str], Rate]]:
    """For each place, single shots over all seeds by model and one of `KINDS`; of several shares the largest counts.

    A model that was read out otherwise than its row says is one of its own.
    """
    groups: dict[Place, dict[Way, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in cells:
        way = cell.way
        if _own(cell):
            groups[Place(way.trained_on, way.demos, way.steps, way.camera, cell.task)][way].append(cell)
    found = {}
    for place in sorted(groups, key=_position):
        ways = sorted(groups[place], key=lambda way: (way.recombination, way.hard_negatives, way.crowded))
        pools = {(", ".join([way.model, *way.otherwise]), kind(way)): pooled(groups[place][way]) for way in ways}
        found[place] = {key: rate for key, rate in pools.items() if rate is not None}
    return found


def _own(cell: Cell) -> bool:
    """Whether it has single shots, in demonstrated phrasings that were read by the encoder its model lists.

    Which encoder a model lists that is not of `MODELS` is not known here: each of its is drawn.
    """
    way = cell.way
    listed = way.text_encoder is None or way.model not in MODELS
    return bool(cell.shots) and way.phrasings == "seen" and listed and way.pretrained is not False


def place_among(task: str) -> tuple[int, str]:
    """By which tasks are sorted: the suite's as the tables have them, and then others by their names."""
    return (ORDER.index(task) if task in ORDER else len(ORDER), task)


def _position(place: Place) -> tuple[object, ...]:
    return (place_among(place.trained_on), place.demos, place.steps, place.camera, place_among(place.tested_on))


def panels(cells: Sequence[Cell]) -> Figure | None:
    """The figure; None where nothing was run.

    A row of one model, however read out, is left to the table, and the ablations to `ablations.py`, where others are.
    """
    found = rates(cells)
    if not found:
        return None
    drawn = compared(found) or found
    models = recorded.models(model for row in drawn.values() for model, _ in row)
    heights, headings, height = spread(drawn)
    there = {each for row in drawn.values() for _, each in row} | {WITHOUT, WITH}
    titles = [title for title, kinds in PANELS.items() if there.intersection(kinds)]
    figure = Figure(figsize=(1.2 + 2.9 * len(titles), 1.3 + ROW * height), layout="constrained")
    sides = figure.subplots(1, len(titles), sharey=True)
    for axes, title in zip(sides, titles, strict=True):
        for place, row in drawn.items():
            axes.axhspan(heights[place] - 0.4, heights[place] + 0.4, color="0.95", lw=0, zorder=0)
            dots(axes, heights[place], {key: rate for key, rate in row.items() if key[1] in PANELS[title]}, models)
        axes.set_xlim(-3, 103)
        axes.tick_params(labelsize=8)
        axes.set_xlabel("goal reached (%), one grasp", fontsize=9)
        axes.set_title(title, fontsize=9)
        axes.grid(alpha=0.25, axis="x")
    for training, at in headings.items():
        sides[0].text(-3, at, f" {training}", fontsize=8, weight="bold", va="center")
    sides[0].set_yticks(list(heights.values()), labels=[place.tested_on for place in heights], fontsize=8)
    sides[0].set_ylim(height - 0.4, -0.6)
    figure.legend(handles=keys(models), loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    figure.suptitle(
        "bold: how they were trained; below: the test; unseen scenes, no retries, 95% Wilson intervals", fontsize=10
    )
    return figure


def compared(found: Mapping[Place, Rates]) -> dict[Place, Rates]:
    """The rows without the ablations, where at least two models are left, however read out."""
    kept = {
        place: {key: rate for key, rate in row.items() if key[0].partition(", ")[0] not in ABLATIONS}
        for place, row in found.items()
    }
    return {place: row for place, row in kept.items() if len({model.partition(", ")[0] for model, _ in row}) > 1}


def spread(places: Iterable[Place], heading: float = 0.9) -> tuple[dict[Place, float], dict[str, float], float]:
    """Where each row stands, where the heading of each training stands above its rows, and how high all are."""
    heights, headings, height = {}, {}, 0.0
    for training, several in itertools.groupby(places, key=lambda place: place.training):
        headings[training] = height
        height += heading
        for place in several:
            heights[place] = height
            height += 1.0
    return heights, headings, height


def dots(axes: Axes, at: float, row: Rates, models: Sequence[str]) -> None:
    """A row's points at that height, each of `models` below the last: hollow without recombination, crowded ringed."""
    dress = recorded.series(models)
    for (model, each), rate in row.items():
        color, _, marker = dress[model]
        axes.errorbar(
            100 * rate.value,
            at + offset(models.index(model), len(models)),
            xerr=recorded.bars([rate]),
            color=color,
            marker=marker,
            mfc="white" if each == WITHOUT else color,
            mec="black" if each in (CROWDED, BOTH) else color,
            ms=5,
            lw=1,
            ls="",
        )


def offset(index: int, count: int) -> float:
    """By how much of a row the model of that index stands below the row's middle."""
    return SPREAD * ((index + 0.5) / count - 0.5)


def keys(models: Sequence[str]) -> list[Line2D]:
    """What a legend has of them."""
    dress = recorded.series(models)
    return [Line2D([], [], color=dress[each][0], marker=dress[each][2], ls="", label=each) for each in models]


def table(cells: Sequence[Cell]) -> Grid:
    """The figure's numbers, percent, a column for each model."""
    drawn = rates(cells)
    models = recorded.models(model for row in drawn.values() for model, _ in row)
    body = []
    for title in KINDS:
        for place, row in drawn.items():
            values: list[Value | None] = []
            for model in models:
                rate = row.get((model, title))
                values.append(None if rate is None else Value.of(rate))
            if any(value is not None for value in values):
                body.append(Row((f"{place.training}, {title}", place.tested_on), tuple(values)))
    return Grid("single shots, %", ("trained on", "tested on"), tuple(models), tuple(body), ("Blank: not run.",))


def best_ways(cells: Sequence[Cell]) -> dict[str, tuple[Way, list[Cell]]]:
    """For each task, of the fewest demonstrations, who reached the most goals in single shots, and its cells."""
    groups: dict[str, dict[Way, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    own = [cell for cell in cells if _own(cell)]
    fewest: dict[str, int] = {}
    for cell in own:
        fewest[cell.task] = min(cell.way.demos, fewest.get(cell.task, cell.way.demos))
    for cell in own:
        if cell.way.demos == fewest[cell.task]:
            groups[cell.task][cell.way].append(cell)
    found = {}
    for task in sorted(groups, key=place_among):
        rates = {way: rate for way, several in groups[task].items() if (rate := pooled(several)) is not None}
        way = max(recorded.in_order(rates), key=lambda each: rates[each].value)
        found[task] = way, groups[task][way]
    return found


def best(cells: Sequence[Cell]) -> Grid:
    """The table of `best_ways`; percent."""
    found, body = best_ways(cells), []
    ways = [way for way, _ in found.values()]
    for task, (way, several) in found.items():
        goal, reward = pooled(several), mean_reward(several)
        values = (
            None if goal is None else Value.of(goal),
            None if reward is None else Value.of(reward),
        )
        body.append(Row((task, recorded.label(way, task, ways)), values))
    return Grid("the best of each task, %", ("tested on", "trained how"), ("goal reached", "mean reward"), tuple(body))


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw it from files of results; where none backs it, say what makes one, and draw nothing."""
    recorded.every_task("by-task", panels, COMMAND, (best, table), arguments)


if __name__ == "__main__":
    main()
