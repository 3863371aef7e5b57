"""Success in test scenes against training steps, and the table of final rates, from `equigrasp evaluate --record`.

    uv run python paper_figs/evaluated.py
    uv run python paper_figs/evaluated.py --results studies/pick-by-part.jsonl --out studies

reads `results/easier-hand/pick-by-part.jsonl`, or another such file by `--results`, and draws
`figures/evaluated.{png,pdf}` and `figures/evaluated.md`. Evaluations of weights on the way (`--step`) make the curve.
(`learning.py` draws the validation scenes of a study.)
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace

import paper
import recorded
import style
from cells import UNSPLIT, Cell, Way, mean_reward, pooled, total
from grid import Grid, Row, Value
from loading import evaluated
from matplotlib.figure import Figure

from equigrasp.exits import exits
from equigrasp.success import Rate

RESULTS = style.RESULTS / "easier-hand" / "pick-by-part.jsonl"
EASIER = "recorded with an easier hand than today's"
"""What must be said of `RESULTS`."""
LEG = "leg-unet"
"""The paper's own model by our name."""
DASHES = ("-", "--", ":", "-.")
"""Of the first, second, ... line of one model's colour and filling."""
COMMAND = "equigrasp evaluate --record FILE"


def lines(cells: Sequence[Cell]) -> dict[Way, list[tuple[int, Rate]]]:
    """Way (its steps set to 0) -> step and rate of single shots, pooled over its seeds, where there are two steps.

    Steps at which not all of a way's seeds were evaluated are left out: points of a line are of the same trainings.
    """
    groups: dict[Way, dict[int, list[Cell]]] = defaultdict(lambda: defaultdict(list))
    for cell in cells:
        if cell.shots and cell.way.phrasings == "seen":
            groups[replace(cell.way, steps=0)][cell.way.steps].append(cell)
    found = {}
    for way in recorded.in_order(groups):
        by_step = groups[way]
        every = {cell.seeds for several in by_step.values() for cell in several}
        full = [step for step in sorted(by_step) if {cell.seeds for cell in by_step[step]} == every]
        points = [(step, rate) for step in full if (rate := pooled(by_step[step])) is not None]
        if len(points) > 1:
            found[way] = points
    return found


def curve(cells: Sequence[Cell], oracle: Sequence[Rate] = (), task: str = "pick-by-part", said: str = "") -> Figure:
    """The figure, with 95% Wilson intervals as bands; empty but for the oracle where nothing has two steps.

    Args:
        cells: of `loading.evaluated`.
        oracle: its rates, as `loading.evaluated` gives them.
        task: what was tested on.
        said: what a reader must know of the results, for the title.
    """
    drawn = lines(cells)
    figure, axes = style.figure(9.0, max(4.2, 1.0 + 0.42 * len(drawn)))
    looks = recorded.looks(drawn)
    models: dict[tuple[str, bool], list[Way]] = defaultdict(list)
    for way, points in drawn.items():
        look = looks[way]
        alike = models[way.model, way.recombination > 0]
        alike.append(way)
        steps, values = [step for step, _ in points], [100 * rate.value for _, rate in points]
        axes.plot(
            steps,
            values,
            DASHES[(len(alike) - 1) % len(DASHES)],
            color=look.color,
            marker=look.marker,
            mfc=look.filling,
            label=recorded.label(way, task, drawn, steps=False).replace(", ", ",\n", 1),
        )
        low, high = ([100 * rate.interval[end] for _, rate in points] for end in (0, 1))
        axes.fill_between(steps, low, high, color=look.color, alpha=0.12, lw=0)
    if oracle:
        rate = total(oracle)
        axes.axhline(100 * rate.value, color="0.35", lw=1, ls=":", label=f"the oracle, {100 * rate.value:.1f}%")
    axes.set_xlabel("training steps (batch 1)")
    axes.set_ylabel("goal reached (%)\none grasp, no retries")
    axes.set_xlim(left=0)
    axes.set_ylim(0, 102)
    if drawn or oracle:
        figure.legend(loc="outside right upper", fontsize=9, frameon=False)
    axes.set_title(f"{f'{task}, {said}' if said else task}\ntest scenes, 95% Wilson intervals", fontsize=10)
    return figure


def final(cells: Sequence[Cell]) -> dict[Way, list[Cell]]:
    """Each way at its last step, phrasings aside -> its cells, of either kind of phrasing."""
    groups: dict[Way, list[Cell]] = defaultdict(list)
    last: dict[Way, int] = {}
    for cell in cells:
        way = replace(cell.way, phrasings="seen")
        groups[way].append(cell)
        training = replace(way, steps=0)
        last[training] = max(way.steps, last.get(training, 0))
    ways = [way for way in groups if way.steps == last[replace(way, steps=0)]]
    return {way: groups[way] for way in recorded.in_order(ways)}


def table(cells: Sequence[Cell], oracle: Sequence[Rate] = (), task: str = "pick-by-part") -> Grid:
    """Final rates, percent, all seeds pooled; below them the oracle's and the paper's own."""
    found, body = final(cells), []
    for way, several in found.items():
        by_phrasing = [[cell for cell in several if cell.way.phrasings == each] for each in ("seen", "unseen")]
        rates = [pooled(each) for each in by_phrasing]
        reward = mean_reward(by_phrasing[0])
        values = [None if rate is None else Value.of(rate) for rate in rates]
        seeds = str(len({cell.seeds for cell in several}))
        body.append(
            Row(
                (recorded.label(way, task, found), seeds),
                (*values, None if reward is None else Value.of(reward)),
            )
        )
    if oracle:
        body.append(Row(("the oracle", ""), (Value.of(total(oracle)), None, None)))
    for (model, demos), rewards in paper.REWARDS[6].items():
        if model == LEG and task in rewards:
            name = f"{model} in the paper, {demos} demo" + ("s" if demos > 1 else "") + f", {paper.STEPS:,} steps"
            body.append(Row((name, ""), (None, None, Value(rewards[task]))))
    heads, columns = ("trained how", "seeds"), ("goal reached", "unseen phrasings", "mean reward")
    return Grid(f"{task}: final weights, %", heads, columns, tuple(body), NOTES)


def failures(cells: Sequence[Cell], task: str = "pick-by-part") -> Grid:
    """What the final policies' single shots on seen phrasings were instead of a success, counted."""
    body = []
    found = {way: [cell for cell in several if cell.way.phrasings == "seen"] for way, several in final(cells).items()}
    kinds = list(dict.fromkeys(kind for several in found.values() for cell in several for kind in cell.failures))
    kinds.sort(key=lambda kind: (kind == UNSPLIT, kind))
    for way, several in found.items():
        rate = pooled(several)
        if rate is not None:
            counts = [sum(cell.failures.get(kind, 0) for cell in several) for kind in kinds]
            numbers = tuple(Value(count, digits=0) for count in (*counts, rate.trials))
            body.append(Row((recorded.label(way, task, found),), numbers))
    return Grid(f"{task}: failed single shots", ("trained how",), (*kinds, "of so many"), tuple(body))


NOTES = (
    "The paper's rows have its own objects, cameras and scenes: a landmark, not a comparison.",
    "Blank: not evaluated, or not in the paper.",
)


@exits()
def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the figure and write the table; where nothing backs them, say what does, and write nothing."""
    parser = recorded.command_line("evaluated", [RESULTS])
    parser.add_argument("--task", default="pick-by-part", help="what was tested on")
    options = recorded.asked(parser, arguments, COMMAND)
    cells, oracle = evaluated(options.results, options.task)
    if not cells:
        print(f"evaluated: no evaluation of {options.task} is in these files; `{COMMAND}` writes some")
        return
    said = EASIER if options.results == [RESULTS] else ""
    grids = [table(cells, oracle, options.task), failures(cells, options.task)]
    recorded.write("evaluated", curve(cells, oracle, options.task, said), grids, options.out)


if __name__ == "__main__":
    main()
