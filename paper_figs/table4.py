"""Table 4, the ablation, as a script: change one line below, run that row, and read the table.

    uv run python paper_figs/table4.py                              # the table, from what is recorded
    uv run python paper_figs/table4.py --run NO_STEERABILITY --demos 1 --seeds 0 --steps 4000 --camera overhead

Each row is the full model with one line changed. A row of your own is one more `replace`, with a name of its own that
begins with the full model's: seeds of one name are pooled, whatever they were made of. After a run the table is printed
of its tasks alone; what was run on a task that the table has not, or under another name, stands below it. What is run
goes to `studies/table-4/results.jsonl`, a line for each cell; a finished cell is not run again, and a killed run goes
on (`docs/study.md`).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import tables
from loading import load

from equigrasp.cli.study import Study
from equigrasp.config import LegConfig
from equigrasp.exits import exits
from equigrasp.models import MODELS
from equigrasp.study.tables import TABLES

FULL = MODELS["leg-unet"]
assert isinstance(FULL, LegConfig)
NO_KERNEL_LANGUAGE = replace(FULL, name="leg-unet-no-kernel-language", kernel_language=False)
NO_STEERABILITY = replace(FULL, name="leg-unet-no-steerability", kernel="plain")
NO_PHI_LANGUAGE = replace(FULL, name="leg-unet-no-phi-language", phi_language=False)

STUDY = Path("studies") / "table-4"


def rows() -> dict[str, LegConfig]:
    """The rows above, by the names that they have in this file."""
    return {name: value for name, value in globals().items() if name.isupper() and isinstance(value, LegConfig)}


@exits(again="with --run the same command goes on from here")
def main(arguments: Sequence[str] | None = None) -> None:
    """Run a row if one is named, then print the table: of its tasks alone, and what the table has no place for."""
    parser = argparse.ArgumentParser(description="Table 4: run a row, and print what is recorded.")
    parser.add_argument("--run", choices=sorted(rows()), help="a row of this file [default: run nothing]")
    parser.add_argument("--tasks", nargs="+", default=list(TABLES[4].tasks), help="what is trained on")
    parser.add_argument("--demos", type=int, nargs="+", default=[1, 10], help="numbers of demonstrations")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="of demonstrations, weights, scenes")
    parser.add_argument("--steps", type=int, default=40_000, help="of training; 40,000 are the paper's")
    parser.add_argument("--queries", type=int, default=500, help="single shots a cell")
    parser.add_argument("--scenes", type=int, default=100, help="of the paper's protocol, a cell")
    parser.add_argument("--turned", type=int, default=40, help="scenes in which the target alone is turned, a training")
    parser.add_argument("--camera", choices=("fused", "overhead"), default="fused", help="fused is the paper's")
    parser.add_argument("--out", type=Path, default=STUDY, help="the study's folder")
    chosen = parser.parse_args(arguments)
    results = chosen.out / "results.jsonl"
    if chosen.run:
        study = Study(
            models=(f"table4:{chosen.run}",),
            tasks=tuple(chosen.tasks),
            demos=tuple(chosen.demos),
            seeds=tuple(chosen.seeds),
            steps=(chosen.steps,),
            queries=chosen.queries,
            scenes=chosen.scenes,
            turned=chosen.turned,
            camera=chosen.camera,
            out=chosen.out,
        )
        results = study.execute()
    at_hand = [results] if results.exists() else []
    cells, _ = load([*tables.recorded(), *at_hand])
    asked = [task for task in TABLES[4].tasks if not chosen.run or task in chosen.tasks]
    # a row of another task or name is in no grid of table 4
    left = tables.own(load(at_hand)[0], besides=[4])
    drawn = [*tables.grids(4, cells, [], asked), *tables.grids(tables.OWN, left, [])]
    print("\n".join(grid.markdown() for grid in drawn))


if __name__ == "__main__":
    main()
