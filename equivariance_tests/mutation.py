"""The table of mutants by laws: what each law measures on each broken thing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from equivariance_tests.law import Verdict, cases
from equivariance_tests.laws import LAWS
from equivariance_tests.mutants import MUTANTS, Mutant


def mutation_table(
    mutants: Sequence[Mutant] = MUTANTS,
    count: int = 4,
    progress: Callable[[Sequence[Mutant]], Iterable[Mutant]] = iter,
) -> dict[str, dict[str, Verdict]]:
    """Every mutant against every law about its kind: mutant's name -> law's name -> verdict.

    Args:
        mutants: which.
        count: cases for each.
        progress: wraps the mutants, for a progress bar.
    """
    return {mutant.name: judge_all(mutant.make(), count) for mutant in progress(mutants)}


def judge_all(subject: Any, count: int) -> dict[str, Verdict]:
    """Every law that is about the subject, by name."""
    return {
        law.name: law.judge(subject, cases(law.turns, min(count, law.count), seed=5))
        for law in LAWS.values()
        if isinstance(subject, law.subject) and law.applies(subject) is None
    }


def as_markdown(table: dict[str, dict[str, Verdict]]) -> str:
    """The table with a number for each law: what was measured, bold where the law noticed, and in how many cases."""
    laws = [law for law in LAWS if any(law in verdicts for verdicts in table.values())]
    lines = ["| mutant | " + " | ".join(laws) + " |", "|---" * (len(laws) + 1) + "|"]
    for name, verdicts in table.items():
        cells = []
        for law in laws:
            verdict = verdicts.get(law)
            # where no case could be measured a law has noticed nothing
            measured = verdict is not None and verdict.cases
            number = f"{verdict.value:.1g}" if measured else ""
            few = f" ({verdict.cases} of {verdict.drawn})" if measured and verdict.silent is not None else ""
            cells.append((f"**{number}**" if measured and not verdict.passed else number) + few)
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"
