"""`check_equivariance`: aim every law that applies at a module, and get a report that can be trusted.

    report = check_equivariance(MyKernel(), expected_failures={"lemma 1": "C_90 has no quarter turn"})
    assert report.passed, report

A law that was expected to fail and holds is an error too: an excuse must not outlive its reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from equigrasp.errors import InputError, unknown
from equivariance_tests.law import Law, Verdict, cases
from equivariance_tests.laws import LAWS
from equivariance_tests.wrapping import subjects_of

Status = Literal["holds", "fails", "fails as expected", "holds unexpectedly", "says nothing"]


@dataclass(frozen=True)
class Finding:
    """One law and what came of it.

    Attributes:
        law: the law.
        subject: name of what it was aimed at.
        verdict: what was measured; None where the law says nothing about the subject.
        reason: why it was expected to fail, or why it says nothing; None otherwise.
    """

    law: Law
    subject: str
    verdict: Verdict | None
    reason: str | None = None

    @property
    def status(self) -> Status:
        """In one word or two."""
        if self.verdict is None:
            return "says nothing"
        if self.reason is None:
            return "holds" if self.verdict.passed else "fails"
        return "holds unexpectedly" if self.verdict.passed else "fails as expected"

    @property
    def sound(self) -> bool:
        """Whether nothing needs to be done about it."""
        return self.status not in ("fails", "holds unexpectedly")

    def lines(self) -> list[str]:
        """For a terminal: the verdict, and below it whatever explains it."""
        if self.verdict is None:
            return [f"-    {self.law.name}: says nothing, {self.reason}"]
        mark = {"holds": "ok  ", "fails": "FAIL", "fails as expected": "xfail", "holds unexpectedly": "XPASS"}
        lines = [f"{mark[self.status]} {self.verdict}"]
        if self.status != "holds":
            lines += [f"       {self.law.statement} ({self.law.source})", f"       {self.verdict.message}"]
        if self.reason is not None:
            lines.append(f"       expected to fail: {self.reason}")
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "law": self.law.name,
            "statement": self.law.statement,
            "source": self.law.source,
            "subject": self.subject,
            "status": self.status,
            "reason": self.reason,
            "verdict": None if self.verdict is None else self.verdict.to_dict(),
        }


@dataclass(frozen=True)
class Report:
    """All findings about one module.

    Attributes:
        name: the module's class, or what it was trained as.
        findings: in the order of LAWS.
    """

    name: str
    findings: tuple[Finding, ...]

    @property
    def passed(self) -> bool:
        """Whether every law holds that should, and no other; where all of turns are silent, nothing has been shown."""
        return bool(self._measured) and not self._unturned and all(finding.sound for finding in self.findings)

    @property
    def _measured(self) -> list[Finding]:
        return [finding for finding in self.findings if finding.verdict is not None]

    @property
    def _unturned(self) -> list[str]:
        """Why no law about turns could be measured; empty where one was, or where none was asked for."""
        about = [finding for finding in self.findings if finding.law.of_turns]
        if any(finding.verdict is not None for finding in about):
            return []
        return list(dict.fromkeys(f"{finding.subject}: {finding.reason}" for finding in about))

    def __str__(self) -> str:
        good, silent = sum(finding.sound for finding in self._measured), len(self.findings) - len(self._measured)
        head = f"{self.name}: {good} of {len(self._measured)} laws as they should be"
        head += f", {silent} more say nothing" if silent else ""
        lines = [line for finding in self.findings for line in finding.lines()]
        lines += [f"FAIL no law about turns could be measured: {'; '.join(self._unturned)}"] if self._unturned else []
        return "\n".join([head, *(f"  {line}" for line in lines)])

    def to_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {"name": self.name, "passed": self.passed, "laws": [each.to_dict() for each in self.findings]}


def check_equivariance(
    module: Any,
    laws: Iterable[str] | None = None,
    expected_failures: Mapping[str, str] | None = None,
    embedding_size: int | None = None,
    seed: int = 0,
    progress: Callable[[list[Any]], Iterable[Any]] = iter,
) -> Report:
    """Measure the laws on a kernel or a policy (and on the kernel that a policy has as `kappa`).

    Args:
        module: a module with escnn `in_type` and `out_type` from embeddings `(B, D)` to kernels
            `(B, out_type.size, in_type.size, k, k)`; or a policy from `(B, 4, H, W)` and `(B, D)` to scores.
        laws: names from `LAWS`; by default all that are about such a module.
        expected_failures: names of laws that the module is known to break, each with the reason.
        embedding_size: D, where the module has no attribute of that name.
        seed: of group elements, scenes and embeddings.
        progress: wraps the list of laws, for a progress bar.

    Raises:
        InputError: if the module does not do what its types declare, a law's name is unknown, or an excuse has no
            reason or is about nothing that was measured.
    """
    if isinstance(laws, str):
        raise InputError(f"laws are names in a list, but this is {laws!r}; pass [{laws!r}]")
    if not isinstance(seed, int) or seed < 0:
        raise InputError(f"the seed is {seed!r}, but it must be a whole number from 0")
    excuses = dict(expected_failures or {})
    names = list(LAWS) if laws is None else list(laws)
    for name in (*names, *excuses):
        if name not in LAWS:
            raise unknown("law", name, LAWS)
    for name, reason in excuses.items():
        if not isinstance(reason, str) or not reason.strip():
            raise InputError(
                f"the law {name!r} is expected to fail without a reason ({reason!r}); say why in a sentence"
            )
        if name not in names:
            raise InputError(f"the law {name!r} is expected to fail but is not among those to check; leave it out")
    subjects = subjects_of(module, embedding_size)
    pairs = [(LAWS[name], subject) for name in names for subject in subjects if isinstance(subject, LAWS[name].subject)]
    for name in excuses:
        if not any(law.name == name for law, _ in pairs):
            raise InputError(f"the law {name!r} is not about {type(module).__name__}; leave it out")
    findings = []
    for law, subject in progress(pairs):
        silent = law.applies(subject)
        verdict = None if silent is not None else law.judge(subject, cases(law.turns, law.count, seed))
        if verdict is None or not verdict.cases:
            findings.append(Finding(law, subject.name, None, silent or law.silence))
        else:
            findings.append(Finding(law, subject.name, verdict, excuses.get(law.name)))
    for name in excuses:
        if not any(each.law.name == name and each.verdict is not None for each in findings):
            raise InputError(f"the law {name!r} says nothing about {type(module).__name__}; leave its excuse out")
    if not findings:
        raise InputError(f"none of these laws is about {type(module).__name__}: {', '.join(names)}")
    return Report(type(module).__name__, tuple(findings))
