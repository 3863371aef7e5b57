"""The test of the tests: every mutant is killed by the law that is meant to, and no law is idle."""

from __future__ import annotations

import functools

import pytest

from equivariance_tests.law import Verdict
from equivariance_tests.laws import LAWS
from equivariance_tests.mutants import MUTANTS, Mutant
from equivariance_tests.mutation import as_markdown, judge_all, mutation_table
from equivariance_tests.sound import sound


@functools.cache
def verdicts(index: int) -> dict[str, Verdict]:
    return judge_all(MUTANTS[index].make(), 4)


@pytest.mark.parametrize("subject", sound(), ids=lambda subject: subject.name)
def test_what_mutants_are_made_of_is_sound(subject: object) -> None:
    """Without this a mutant could fail for what it shares with all the others."""
    for verdict in judge_all(subject, 12).values():
        assert verdict.passed, f"{verdict}; {verdict.message}"


@pytest.mark.parametrize("index", range(len(MUTANTS)), ids=[mutant.name for mutant in MUTANTS])
def test_the_law_that_is_meant_to_kills_the_mutant(index: int) -> None:
    verdict = verdicts(index)[MUTANTS[index].law]
    assert not verdict.passed, f"{MUTANTS[index].name} survived {verdict}"
    assert verdict.value > 3 * verdict.tolerance, "a kill by a hair's breadth is luck"
    assert "turn by" in verdict.message


def test_there_are_enough_mutants_and_each_has_a_name_of_its_own() -> None:
    assert len({mutant.name for mutant in MUTANTS}) == len(MUTANTS) >= 15


def test_no_law_is_idle() -> None:
    """By the law that each mutant names, which the test above holds them to."""
    assert set(LAWS) - {mutant.law for mutant in MUTANTS} == set()


def test_a_mutant_that_is_none_would_be_noticed() -> None:
    survivor = Mutant("nothing is wrong", "lemma 1", sound()[0].__class__)
    table = mutation_table([Mutant(survivor.name, survivor.law, lambda: sound()[0])], count=2)
    assert all(verdict.passed for verdict in table["nothing is wrong"].values())
    markdown = as_markdown(table)
    assert "**" not in markdown
    assert markdown.startswith("| mutant | mirror | fourier |")
