"""Every model that needs no CLIP under the laws of symmetry, as a page: which hold, which fail, and by how much.

    uv run python paper_figs/laws.py

writes `docs/laws.md`: the laws of `equivariance_tests` for each model with fresh weights, and what trainings that are
recorded have made of it. Another model is an argument, by its name or as `my_module:MY_MODEL`; models on CLIP are taken
with random weights.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import recorded
import style
import symmetry
from cells import Cell
from loading import load

from equigrasp.artefacts import check_writable
from equigrasp.config import ClipConfig, ModelConfig
from equigrasp.exits import exits
from equigrasp.models import MODELS, build, find
from equivariance_tests.check import Finding, check_equivariance
from equivariance_tests.laws import LAWS

PAGE = Path(__file__).parent.parent / "docs" / "laws.md"
COMMAND = "uv run python paper_figs/laws.py"
SEED = 0


def fresh(name: str) -> ModelConfig:
    """A model as it is measured: in float32, by a reader that needs no weights."""
    row = replace(find(name), text_encoder="hashing", precision="float32")
    return replace(row, clip_weights="random") if isinstance(row, ClipConfig) else row


def findings(names: Sequence[str]) -> dict[str, dict[str, Finding]]:
    """Model -> law -> what came of it; laws that say nothing about a model are left out."""
    found: dict[str, dict[str, Finding]] = {}
    for name in names:
        report = check_equivariance(build(fresh(name), SEED).eval(), seed=SEED)
        found[name] = {each.law.name: each for each in report.findings if each.verdict is not None}
    return found


def entry(finding: Finding | None) -> str:
    """The worst case's value, bold with the share of cases that pass if the law fails; blank if it says nothing."""
    if finding is None or finding.verdict is None:
        return ""
    verdict = finding.verdict
    if verdict.passed:
        return f"{verdict.value:.2g}"
    return f"**{verdict.value:.2g}**" + (f" ({100 * verdict.share:.0f}%)" if verdict.share > 0 else "")


def table(found: dict[str, dict[str, Finding]]) -> list[str]:
    """A row for each law that says anything, a column for each model."""
    said = [law for law in LAWS.values() if any(law.name in laws for laws in found.values())]
    lines = [
        "| law | what must hold | at most | " + " | ".join(f"`{name}`" for name in found) + " |",
        "|---|---|---|" + "---|" * len(found),
    ]
    for law in said:
        several = [laws[law.name] for laws in found.values() if law.name in laws]
        verdicts = [each.verdict for each in several if each.verdict is not None]
        bound = f"{verdicts[0].tolerance:g} {verdicts[0].unit}"
        entries = " | ".join(entry(laws.get(law.name)) for laws in found.values())
        lines.append(f"| {law.name} | {law.statement} | {bound} | {entries} |")
    return lines


def trained(cells: Sequence[Cell], task: str = "pick-by-part") -> list[str]:
    """What trained policies keep of it: a row for each way of training that is recorded; empty where none is."""
    rows, drawn = [], symmetry.points(cells, task)
    for way, (errors, _) in drawn.items():
        several = [cell.symmetry for cell in cells if cell.way == way and cell.task == task and cell.symmetry]
        turns = [each["turned"] for each in several]
        followed = f"{sum(turn['followed'] for turn in turns)} of {sum(turn['scenes'] for turn in turns)}"
        numbers = ["" if value is None else f"{value:.2g}" for value in errors.values()]
        rows.append(f"| {recorded.label(way, task, drawn)} | {numbers[0]} | {numbers[1]} | {followed} | {numbers[2]} |")
    if not rows:
        return []
    return [
        "",
        f"## After training on {task}",
        "",
        "Kernel: the worst relative error of Eq. 7 in 4 cases. Scene: of every score, when the whole scene turns by",
        "quarter turns. Followed: the target alone turns in the simulator, and the best grasp comes along within 4",
        "pixels and 10 degrees. A model need not be equivariant to follow: augmentation teaches it too. Policies of",
        "before 29 November 2026 were shown other colours in Scene than `equigrasp equivariance` shows today, whose",
        "numbers are others.",
        "",
        "| trained how | kernel | scene | followed | median degrees off |",
        "|---|---|---|---|---|",
        *rows,
    ]


def page(names: Sequence[str], cells: Sequence[Cell]) -> str:
    """The whole page."""
    lines = [
        "# Every model under the laws",
        "",
        f"`{COMMAND}` wrote this page. Fresh weights (seed {SEED}), float32; a number is the",
        "worst case of a law, bold where the law fails, with the share of cases within the bound where there are any.",
        "Blank: the law says nothing about such a model, as those of kernels about one that has none. `equigrasp",
        "equivariance --run DIR` says the same of a trained policy, with the case that failed; `docs/equivariance.md`",
        "has the proofs, and why a lifted kernel errs at turns that are no quarter turns.",
        "",
        *table(findings(names)),
        *trained(cells),
    ]
    return "\n".join(lines) + "\n"


@exits()
def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and write the page."""
    parser = argparse.ArgumentParser(description="Every model that needs no CLIP under the laws, as a page.")
    parser.add_argument("models", nargs="*", help="further ones, by name or as my_module:MY_MODEL")
    parser.add_argument("--out", type=Path, default=PAGE, help="the page")
    options = parser.parse_args(arguments)
    own = [name for name, row in MODELS.items() if not isinstance(row, ClipConfig)]
    check_writable(options.out, "--out")
    for name in options.models:
        find(name)
    style.save_text(page([*own, *options.models], load(sorted(style.RESULTS.glob("*.jsonl")))[0]), options.out)


if __name__ == "__main__":
    main()
