"""Success on pick-by-part against training steps, and the table of final rates, from recorded results.

    uv run python paper_figs/pick_by_part.py

reads `results/easier-hand/pick-by-part.jsonl`, which `equigrasp evaluate --record` wrote, or another such file by
`--results`, and draws `figures/pick-by-part.{png,pdf}` and `figures/pick-by-part.md`.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import paper
import style
from matplotlib.figure import Figure

from equigrasp.success import Rate

RESULTS = style.RESULTS / "easier-hand" / "pick-by-part.jsonl"
LABELS = {
    ("leg-steerable", 1, True): "1 demonstration, recombination",
    ("leg-steerable", 1, False): "1 demonstration",
    ("leg-steerable", 10, True): "10 demonstrations, recombination",
    ("leg-unet", 1, True): "leg-unet, 1 demonstration, recombination",
}
STYLES = {variant: (*look, label) for (variant, label), look in zip(LABELS.items(), style.SERIES, strict=False)}
PAPER = tuple(
    f"| LEG-UNet in the paper | {demos} | no | {paper.STEPS} | | | | {rewards['pick-by-part']}% |"
    for (model, demos), rewards in paper.REWARDS[6].items()
    if model == "leg-unet"
)
"""LEG, Table 6, by its own objects and protocol: rewards over up to n + 1 trials, not single shots."""
Variant = tuple[str, int, bool]


def variant(cell: dict[str, Any]) -> Variant:
    """Model, demonstrations, whether recombination was used."""
    run = cell["run"]
    return run["model"]["name"], run["demos"], run["training"]["recombination"] > 0


def pooled(cells: list[dict[str, Any]], actor: str, name: str) -> Rate:
    """One rate over several runs: their successes and trials added up."""
    counts = [cell[actor][name] for cell in cells if actor in cell]
    return Rate(sum(each["successes"] for each in counts), sum(each["trials"] for each in counts))


def oracles(cells: list[dict[str, Any]], protocol: str) -> list[dict[str, Any]]:
    """Cells with an oracle, one for each set of scenes: runs that were tested on the same scenes share theirs."""
    chosen = {
        (cell["phrasings"], cell["seed"]): cell for cell in cells if cell["protocol"] == protocol and "oracle" in cell
    }
    return list(chosen.values())


def group(cells: list[dict[str, Any]], **wanted: object) -> dict[tuple[Variant, int], list[dict[str, Any]]]:
    """Cells that have the wanted values, by variant and step."""
    groups: dict[tuple[Variant, int], list[dict[str, Any]]] = defaultdict(list)
    for cell in cells:
        if all(cell[key] == value for key, value in wanted.items()):
            groups[variant(cell), cell["step"]].append(cell)
    return dict(sorted(groups.items()))


def curve(cells: list[dict[str, Any]]) -> Figure:
    """Rate of correct parts on single-shot queries against steps, one line a variant, 95% Wilson intervals."""
    figure, axes = style.figure()
    lines: dict[Variant, list[tuple[int, Rate]]] = defaultdict(list)
    for (name, step), several in group(cells, protocol="single-shot", phrasings="seen").items():
        lines[name].append((step, pooled(several, "policy", "correct")))
    for name, points in lines.items():
        if name not in STYLES or len(points) < 2:
            continue
        color, line, marker, label = STYLES[name]
        steps = [step for step, _ in points]
        axes.plot(
            steps, [100 * rate.value for _, rate in points], line, color=color, marker=marker, label=label, zorder=3
        )
        axes.fill_between(
            steps,
            [100 * rate.interval[0] for _, rate in points],
            [100 * rate.interval[1] for _, rate in points],
            color=color,
            alpha=0.18,
            lw=0,
        )
    oracle = pooled(oracles(cells, "single-shot"), "oracle", "correct")
    axes.axhline(100 * oracle.value, color="0.35", lw=1, ls=":", label=f"oracle, {100 * oracle.value:.1f}%")
    axes.set_xlabel("training steps (batch 1)")
    axes.set_ylabel("right object by the right part (%)\none grasp, no retries")
    axes.set_ylim(40, 101)
    axes.legend(loc="lower right", fontsize=9)
    axes.set_title(
        "an easier hand than today's; leg-steerable unless named\npick-by-part, unseen scenes, 95% Wilson intervals",
        fontsize=10,
    )
    return figure


def table(cells: list[dict[str, Any]]) -> str:
    """Final rates as Markdown: the last step of each variant, all runs pooled."""
    rows = [
        "| model | demonstrations | recombination | steps | runs | single shot | unseen phrasings | mean reward |",
        "|---|---|---|---|---|---|---|---|",
    ]
    last = dict(group(cells).keys())
    for (name, step), several in group(cells).items():
        if last[name] != step:
            continue

        def rate(wanted: dict[str, str], several: list[dict[str, Any]] = several) -> str:
            chosen = [cell for cell in several if all(cell[key] == value for key, value in wanted.items())]
            return str(pooled(chosen, "policy", "correct")) if chosen else ""

        paper = [cell for cell in several if cell["protocol"] == "paper"]
        reward = sum(cell["policy"]["reward"] for cell in paper) / len(paper) if paper else None
        runs = len({(cell["run"]["data_seed"], cell["run"]["training"]["seed"]) for cell in several})
        rows.append(
            f"| {name[0]} | {name[1]} | {'yes' if name[2] else 'no'} | {step} | {runs} "
            f"| {rate({'protocol': 'single-shot', 'phrasings': 'seen'})} "
            f"| {rate({'protocol': 'single-shot', 'phrasings': 'unseen'})} "
            f"| {'' if reward is None else f'{100 * reward:.1f}%'} |"
        )
    shots = pooled(oracles(cells, "single-shot"), "oracle", "correct")
    rewards = [cell["oracle"]["reward"] for cell in oracles(cells, "paper")]
    mean = f"{100 * sum(rewards) / len(rewards):.1f}%" if rewards else ""
    rows.append(f"| oracle | | | | | {shots} | | {mean} |")
    return "\n".join([*rows, *PAPER]) + "\n"


def failures(cells: list[dict[str, Any]]) -> str:
    """Failures of the final policies by kind as Markdown, over all single shots on seen phrasings."""
    rows = [
        "| model | demonstrations | recombination | nothing lifted | another object | another part | of |",
        "|---|---|---|---|---|---|---|",
    ]
    shots = group(cells, protocol="single-shot", phrasings="seen")
    last = dict(shots.keys())
    for (name, step), several in shots.items():
        if last[name] == step:
            grasped, right, part = (pooled(several, "policy", key) for key in ("grasped", "correct_object", "correct"))
            columns = (
                *name[:2],
                "yes" if name[2] else "no",
                grasped.trials - grasped.successes,
                grasped.successes - right.successes,
                right.successes - part.successes,
                grasped.trials,
            )
            rows.append(f"| {' | '.join(map(str, columns))} |")
    return "\n".join(rows) + "\n"


def read(path: Path = RESULTS) -> list[dict[str, Any]]:
    """The recorded evaluations, one dict each."""
    return [json.loads(line) for line in path.read_text().splitlines()]


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw the figure and write the table."""
    parser = argparse.ArgumentParser(description="Success on pick-by-part against steps: figure and table.")
    parser.add_argument("--results", type=Path, default=RESULTS, help="what `equigrasp evaluate --record` wrote")
    parser.add_argument("--out", type=Path, default=style.FIGURES, help="the folder that they are written to")
    options = parser.parse_args(arguments)
    if not options.results.is_file():
        parser.error(f"there is no file {options.results}; `equigrasp evaluate --record {options.results}` writes one")
    cells = read(options.results)
    style.save(curve(cells), "pick-by-part", options.out)
    style.save_text(f"{table(cells)}\n{failures(cells)}", options.out / "pick-by-part.md")
    print(table(cells), failures(cells), sep="\n")


if __name__ == "__main__":
    main()
