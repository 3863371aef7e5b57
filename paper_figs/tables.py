"""The paper's tables from recorded results, ours beside the paper's: Markdown, LaTeX and CSV.

    uv run python paper_figs/tables.py --results studies/table-1/results.jsonl --table 1

reads files of results, by default all that lie in `paper_figs/results`, and writes `figures/table-N.{md,tex,csv}`, by
default of every table of which something was run; what was trained on another task stands in a table of its own. What
no table of the paper's has, as a task of your own, `--results` draws as `table-own.{md,tex,csv}`. A cell that was not
run is blank, and so is a figure of the paper's that is not known here (`paper.py`). The LaTeX needs `grid.PACKAGES`.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import paper
import style
from cells import FAILURES, Cell, Way, mean_reward, pooled
from grid import Grid, Row, Value, as_csv
from loading import costs_otherwise, load
from recorded import check_there, said

from equigrasp.artefacts import check_folder
from equigrasp.errors import InputError
from equigrasp.exits import exits
from equigrasp.models import MODELS
from equigrasp.study.tables import TABLES, TESTED_ON, Table

OWN = "own"
"""The name, in place of a number, of the table of what no table of the paper's has."""
DRAWN: dict[int | str, Table] = {**TABLES, OWN: Table("cells of your own", (), ())}
DEMOS = (1, 10)
HEADS = ("model", "demonstrations", "whose", "trained on", "steps", "recombination", "seeds")
OURS, PAPER = "ours", "the paper"
BOLD = "Bold: the highest of ours with as many demonstrations; where intervals overlap, that may be chance."
WIDEST = "An interval is as if each scene were all or nothing, which is not too narrow for any rewards."
LANDMARK = "The paper's rows have its own objects, cameras and scenes: a landmark, not a comparison."


def columns(task: str) -> tuple[str, ...]:
    """The tasks that a policy trained on `task` is tested on."""
    return TESTED_ON.get(task, (task,))


def own(cells: Iterable[Cell], besides: Sequence[int] = tuple(TABLES)) -> list[Cell]:
    """The cells that none of these tables has: trained on a task, or tested on one, that is in none of them."""
    return [cell for cell in cells if not any(_has(table, cell) for table in besides)]


def ways(table: int | str, task: str, cells: Iterable[Cell], phrasings: str) -> dict[tuple[str, int], list[Way]]:
    """For each model and number of demonstrations, the table's own first, the ways in which it was run on `task`."""
    found: dict[tuple[str, int], list[Way]] = {(model, demos): [] for demos in DEMOS for model in DRAWN[table].models}
    here = {cell.way for cell in cells if belongs(table, cell) and cell.way.trained_on == task}
    for way in sorted((way for way in here if way.phrasings == phrasings), key=repr):
        found.setdefault((way.model, way.demos), []).append(way)
    return dict(sorted(found.items(), key=lambda each: each[0][1]))


def belongs(table: int | str, cell: Cell) -> bool:
    """Whether a cell is of a table's tasks; models that the paper has not are rows too, ablations by their name.

    Of `OWN` every cell is, as it is drawn of what `own` gives.
    """
    if table == OWN:
        return True
    ablation = cell.way.model.startswith(TABLES[4].models[0])
    return cell.way.trained_on in DRAWN[table].tasks and (table != 4 or ablation)


def label(way: Way) -> str:
    """The model's name, and what sets it apart."""
    return _named(way.model, way.unusual)


def rewards(table: int | str, trained_on: str, cells: Sequence[Cell]) -> Grid:
    """Mean reward in the paper's protocol, percent, with 95% Wilson intervals: our rows, and under each the paper's."""
    tasks = _tests(table, trained_on, cells)
    rows = []
    for (model, demos), variants in ways(table, trained_on, cells, "seen").items():
        rows += _rows(model, demos, trained_on, variants, cells, tasks, _reward)
        if model in DRAWN[table].models:
            known = paper.REWARDS.get(table, {}).get((model, demos), {})
            values = tuple(Value(known[task]) if task in known else None for task in tasks)
            rows.append(Row((model, str(demos), PAPER, trained_on, str(paper.STEPS), "no", ""), values))
    notes = [BOLD, WIDEST, LANDMARK, "Blank: not run here, or not known here from the paper."]
    if table == OWN:
        notes = [BOLD, WIDEST, "Blank: not run."]
    return Grid(
        f"{_title(table, trained_on)}: mean reward, % [95% Wilson interval]", HEADS, tasks, tuple(rows), tuple(notes)
    )


def single_shots(table: int | str, trained_on: str, cells: Sequence[Cell], phrasings: str = "seen") -> Grid:
    """Single shots that reached the goal, percent, with 95% Wilson intervals over all seeds; ours alone."""
    tasks = _tests(table, trained_on, cells)
    rows = [
        row
        for (model, demos), variants in ways(table, trained_on, cells, phrasings).items()
        for row in _rows(model, demos, trained_on, variants, cells, tasks, _shots)
    ]
    title = f"{_title(table, trained_on)}: single shots, {phrasings} phrasings, % [95% Wilson interval]"
    notes = (BOLD, "The paper has no single shots. Blank: not run.")
    return Grid(title, HEADS, tasks, tuple(rows), notes)


def failures(table: int | str, trained_on: str, cells: Sequence[Cell]) -> Grid:
    """Why single shots failed, in percent of all: kinds that add up to what is missing to 100."""
    groups: dict[tuple[Way, str], list[Cell]] = defaultdict(list)
    for cell in cells:
        here = belongs(table, cell) and cell.way.trained_on == trained_on
        if cell.shots and here and cell.way.phrasings == "seen":
            groups[cell.way, cell.task].append(cell)
    counted = {kind for several in groups.values() for cell in several for kind in cell.failures}
    kinds = [*FAILURES, *sorted(counted - set(FAILURES))]
    rows = []
    for (way, task), several in sorted(groups.items(), key=repr):
        correct = pooled(several)
        assert correct is not None
        counts = [sum(cell.failures.get(kind, 0) for cell in several) for kind in kinds]
        values = [Value(100 * count / correct.trials, trials=correct.trials) for count in (*counts, sum(counts))]
        rows.append(Row((*_labels(label(way), way.demos, way, several), task), tuple(values)))
    title = f"{_title(table, trained_on)}: failed single shots by kind, % of all"
    return Grid(title, (*HEADS, "tested on"), (*kinds, "all failures"), tuple(rows))


def costs(lines: Sequence[dict[str, Any]]) -> Grid:
    """Parameters beside the paper's; time and memory of a training step, batch 1."""
    by_model: dict[str, list[tuple[str, dict[str, Any]]]] = defaultdict(list)
    for line, otherwise in zip(lines, costs_otherwise(lines), strict=True):
        by_model[line["model"]].append((_named(line["model"], otherwise), line))
    rows = []
    others = [model for model in (*MODELS, *sorted(by_model)) if model in by_model]
    for model in dict.fromkeys((*TABLES[5].models, *others)):
        known = MODELS[model].paper_parameters if model in MODELS else None
        for name, line in sorted(by_model[model], key=_order) or [(model, None)]:
            values = [None if known is None else Value(known), *[None] * 5]
            device = threads = ""
            if line is not None:
                values[1:] = [
                    Value(line["parameters"] / 1e6, digits=2),
                    Value(line["frozen_parameters"] / 1e6),
                    Value(line["seconds"]["step"], digits=3),
                    Value(line["seconds"]["read_out"], digits=3),
                    Value(line["memory"] / 2**30, digits=2),
                ]
                device, threads = line["device"]["processor"], str(line["threads"])
            rows.append(Row((name, device, threads), tuple(values)))
    names = (
        "the paper: M parameters",
        "ours: M trained",
        "ours: M frozen",
        "ours: s a step",
        "ours: s a read-out",
        "ours: GiB at most",
    )
    notes = (
        f"The paper's training: {paper.COST}; for which of its models is not known here.",
        "Ours: medians at batch 1, random weights. Blank: not measured, or not in the paper.",
    )
    return Grid("Table 5: parameters and time", ("model", "processor", "threads"), names, tuple(rows), notes)


def grids(
    table: int | str, cells: Sequence[Cell], lines: Sequence[dict[str, Any]], tasks: Sequence[str] | None = None
) -> list[Grid]:
    """What is drawn of a table: for each task that is trained on (or these of them), rewards, shots, what failed."""
    if table == 5:
        return [costs(lines)]
    if tasks is None:
        tasks = sorted({cell.way.trained_on for cell in cells}) if table == OWN else DRAWN[table].tasks
    drawn = []
    for task in tasks:
        both = [rewards(table, task, cells), single_shots(table, task, cells)]
        # of the paper's tables a blank one says what was not run
        drawn += [grid for grid in both if table != OWN or any(any(row.values) for row in grid.rows)]
        here = [cell for cell in cells if belongs(table, cell) and cell.way.trained_on == task]
        if any(cell.way.phrasings == "unseen" for cell in here):
            drawn.append(single_shots(table, task, cells, "unseen"))
        kinds = failures(table, task, cells)
        drawn += [kinds] if kinds.rows else []
    return drawn


def was_run(table: int, cells: Sequence[Cell], lines: Sequence[dict[str, Any]]) -> bool:
    """Whether there is any result of ours for a table."""
    if table == 5:
        return bool(lines)
    return any(_has(table, cell) for cell in cells)


def write(table: int | str, drawn: Sequence[Grid], folder: Path = style.FIGURES) -> list[Path]:
    """Write `table-N.{md,tex,csv}`, and give their paths."""
    kinds = {
        "md": "\n".join(grid.markdown() for grid in drawn),
        "tex": "\n".join(grid.latex() for grid in drawn),
        "csv": as_csv(drawn),
    }
    return [style.save_text(text, folder / f"table-{table}.{kind}") for kind, text in kinds.items()]


def recorded() -> list[Path]:
    """All files of results that ship."""
    return sorted(style.RESULTS.glob("*.jsonl"))


def _has(table: int, cell: Cell) -> bool:
    return belongs(table, cell) and cell.task in columns(cell.way.trained_on)


def _tests(table: int | str, trained_on: str, cells: Iterable[Cell]) -> tuple[str, ...]:
    """The columns of what was trained on a task: the table's, or what cells of one's own were tested on."""
    if table != OWN:
        return columns(trained_on)
    tested = sorted({cell.task for cell in cells if cell.way.trained_on == trained_on})
    return tuple(task for task in dict.fromkeys((*columns(trained_on), *tested)) if task in tested)


def _title(table: int | str, trained_on: str) -> str:
    if table == OWN:
        return f"Cells of your own, trained on {trained_on}"
    several = len(DRAWN[table].tasks) > 1
    return f"Table {table}, {DRAWN[table].title}" + (f" trained on {trained_on}" if several else "")


def _rows(
    model: str,
    demos: int,
    trained_on: str,
    variants: list[Way],
    cells: Sequence[Cell],
    tasks: Sequence[str],
    what: Callable[[Sequence[Cell]], Value | None],
) -> list[Row]:
    rows = []
    for way in variants:
        here = [cell for cell in cells if cell.way == way]
        values = tuple(what([cell for cell in here if cell.task == task]) for task in tasks)
        if any(value is not None for value in values):
            rows.append(Row(_labels(label(way), demos, way, here), values, rivals=demos))
    return rows or [Row((model, str(demos), OURS, trained_on, "", "", "not run"), (None,) * len(tasks))]


def _order(cost: tuple[str, dict[str, Any]]) -> tuple[str, str, int]:
    name, line = cost
    return name, line["device"]["processor"], line["threads"]


def _named(model: str, apart: Sequence[str]) -> str:
    return model + "".join(f" ({each})" for each in apart)


def _labels(name: str, demos: int, way: Way, cells: Sequence[Cell]) -> tuple[str, ...]:
    recombination = f"{way.recombination:g}" if way.recombination else "no"
    recombination += "".join(f", {name} {share:g}" for name, share in way.recombined.items())
    return (
        name,
        str(demos),
        OURS,
        way.trained_on,
        str(way.steps),
        recombination,
        str(len({cell.seeds for cell in cells})),
    )


def _reward(cells: Sequence[Cell]) -> Value | None:
    found = mean_reward(cells)
    return None if found is None else Value.of(found)


def _shots(cells: Sequence[Cell]) -> Value | None:
    rate = pooled(cells)
    return None if rate is None else Value.of(rate)


@exits()
def main(arguments: Sequence[str] | None = None) -> None:
    """Write the tables and say where they are."""
    parser = argparse.ArgumentParser(description="The paper's tables from recorded results.")
    parser.add_argument(
        "--results", type=Path, nargs="+", help="files that equigrasp study wrote [default: what ships]"
    )
    parser.add_argument("--table", type=int, nargs="+", choices=sorted(TABLES), help="[default: all with results]")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that they are written to")
    chosen = parser.parse_args(arguments)
    check_folder(chosen.out, "--out")
    check_there(chosen.results or [], "equigrasp study")
    cells, lines = load(chosen.results or recorded())
    if not (cells or lines or chosen.table):
        raise InputError("no line of these files is a result that a table has; `equigrasp study` writes some")
    some = [table for table in sorted(TABLES) if was_run(table, cells, lines)]
    for table in chosen.table or some:
        print(*write(table, grids(table, cells, lines), chosen.out), sep="\n")
    none = ", ".join(str(table) for table in TABLES if table not in some)
    if none and not chosen.table:
        print(f"not written: {none}, as the results are of {said(cells, lines)}; `equigrasp study --table N` runs one")
    # of what ships the paper's tables alone are drawn
    left = own(cells) if chosen.results else []
    if left and chosen.table:
        print(f"left out: what is of {said(left)}; without --table it stands in table-{OWN}")
    elif left:
        print(*write(OWN, grids(OWN, left, []), chosen.out), sep="\n")


if __name__ == "__main__":
    main()
