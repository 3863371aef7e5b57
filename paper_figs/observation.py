"""What a policy sees: one scene as heightmaps of colour and height, by the overhead camera and by the three fused.

    uv run python paper_figs/observation.py

draws `figures/observation.{png,pdf}` from the simulator; it needs no results.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import style
from matplotlib.figure import Figure

from equigrasp.artefacts import check_folder
from equigrasp.exits import exits
from equigrasp.workspace import WORKSPACE
from tasks import camera
from tasks.env import GraspEnv

TASK, SEED = "pick-by-part", 9
"""The first scene with a mug, into which three cameras at the sides do not see."""
HIGHEST = 7.0
"""Of the scale of heights, centimetres."""


def draw(seed: int) -> Figure:
    """The same scene by either camera, colour above height, with axes in centimetres on the table."""
    env = GraspEnv(TASK, camera="overhead")
    try:
        env.reset(seed=seed)
        visible = env.started()[1].visible()
    finally:
        env.close()
    ways = {"one camera overhead": camera.overhead(visible)[0], "three cameras, fused": camera.fused(visible)}
    figure = Figure(figsize=(10.0, 5.0), layout="constrained")
    grid = figure.subplots(2, 2, sharex=True, sharey=True)
    extent = tuple(100 * side for bounds in WORKSPACE.bounds for side in bounds)
    for column, (words, observation) in enumerate(ways.items()):
        grid[0, column].imshow(observation.color, extent=extent, interpolation="nearest")
        grid[0, column].set_title(words, fontsize=12)
        heights = grid[1, column].imshow(
            100 * observation.height, extent=extent, interpolation="nearest", cmap="viridis", vmin=0, vmax=HIGHEST
        )
        grid[1, column].set_xlabel("x (cm)")
    for row, words in enumerate(("colour", "height")):
        grid[row, 0].set_ylabel(f"{words}\ny (cm)", fontsize=11)
    figure.colorbar(heights, ax=grid, shrink=0.5, anchor=(0.0, 0.0), label="above the table (cm)", pad=0.01)
    return figure


@exits()
def main(chosen: Sequence[str] | None = None) -> None:
    """Draw what a policy sees."""
    parser = argparse.ArgumentParser(description="What a policy sees.")
    parser.add_argument("--seed", type=int, default=SEED, help=f"which scene of pick-by-part [{SEED}]")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that the figure is written to")
    options = parser.parse_args(chosen)
    check_folder(options.out, "--out")
    print(*style.save(draw(options.seed), "observation", options.out, colors=256), sep="\n")


if __name__ == "__main__":
    main()
