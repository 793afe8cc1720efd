"""No error of a description is missed, and none is found where the standard allows a change."""

from __future__ import annotations

import pytest
from fmu import mutated
from fmu.packed import example


def test_every_mutation_is_judged_as_the_standard_does() -> None:
    """Seven hundred: by hand, the rules' examples, every causality, variability and initial."""
    found = mutated.scores(mutated.our_errors)
    assert {group: score for group, score in found.items() if any(score)} == {}


def test_the_score_counts_what_is_missed_and_what_is_refused_wrongly() -> None:
    """A judge that allows all misses what is forbidden; one that forbids all refuses the rest."""
    forbidden = [each.name for each in mutated.mutations() if not each.allowed]
    lax, strict = mutated.scores(lambda _: []), mutated.scores(lambda text: [text])
    assert sorted(name for score in lax.values() for name in score.missed) == sorted(forbidden)
    assert sum(len(score.false_alarms) for score in strict.values()) > 100


@pytest.mark.slow
def test_fmpy_finds_nothing_that_the_standard_forbids_and_the_check_misses() -> None:
    """What FMPy objects to and the check does not is allowed: FMPy's false alarms."""
    fmpy = mutated.fmpy_problems
    known = {problem for base in ("fmi2", "fmi3") for problem in fmpy(example(base))}
    sample = list(mutated.mutations())[::7]
    for each in sample:
        if set(fmpy(each.description)) - known and not mutated.our_errors(each.description):
            assert each.allowed, each.name
