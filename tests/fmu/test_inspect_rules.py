"""Every rule has a number, a section or a reason, and an example that breaks it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from fmu.packed import example, inspected, pack

from cosim.core import InputError
from cosim.fmu import describe_fmu
from cosim.fmu.inspect import GROUPS, RULES, inspect_fmu

WITH_BASE = [code for code, rule in RULES.items() if rule.base]


def findings(description: str, folder: Path) -> list[Any]:
    """Of a model description, without those of the files that its FMU has and lacks."""
    beside = {"binary-sources-only", "sources-unlisted", "documentation"}
    return [f for f in inspected(description, folder).findings if f.code not in beside]


@pytest.mark.parametrize("base", ["fmi1", "fmi2", "fmi3"])
def test_the_base_of_the_examples_has_only_notes(base: str, tmp_path: Path) -> None:
    """Or an example would prove nothing."""
    assert [f for f in findings(example(base), tmp_path) if f.level != "note"] == []


@pytest.mark.parametrize("code", WITH_BASE)
def test_the_example_of_a_rule_breaks_it(code: str, tmp_path: Path) -> None:
    """At its usual level, in the description that it is a change of, and nowhere before."""
    rule = RULES[code]
    base = example(rule.base)
    assert rule.broken() == base.replace(rule.old, rule.new, 1) != base
    before = [(f.where, f.what) for f in findings(base, tmp_path) if f.code == code]
    after = findings(rule.broken(), tmp_path)
    broken = [f for f in after if (f.where, f.what) not in before]
    levels = [f.level for f in broken if f.code == code]
    # FMI 2 forbids a start that is not finite, FMI 3 does not
    assert levels[:1] == ["error" if code == "start-number" else rule.level]


def test_numbers_are_unique_and_follow_their_groups() -> None:
    """A letter of a group and two digits, counted up; nothing of a rule is empty."""
    numbers = [rule.number for rule in RULES.values()]
    assert numbers == sorted(numbers, key=lambda n: (list(GROUPS).index(n[0]), n))
    assert len(set(numbers)) == len(numbers)
    for rule in RULES.values():
        assert re.fullmatch(r"[FXDVCSTBR]\d\d", rule.number)
        assert rule.why
        assert rule.example
        assert all(re.fullmatch(r"\d(\.\d+)*|", section) for section in (rule.fmi2, rule.fmi3))


@pytest.mark.parametrize("code", WITH_BASE)
def test_a_run_takes_an_fmu_unless_the_rule_says_that_it_does_not(
    code: str, tmp_path: Path
) -> None:
    """What it breaks by a variable or a Clock stands in its log."""
    rule = RULES[code]
    fmu = pack({"modelDescription.xml": rule.broken().encode()}, tmp_path / "Example.fmu")
    if not rule.runs or code in UNREADABLE:
        with pytest.raises(InputError, match=r"not a valid FMU|cannot be run") as caught:
            describe_fmu(fmu)
        assert caught.value.where is not None
        return
    departures = describe_fmu(fmu).departures
    named = any(f"({rule.number}, {code})" in one for one in departures)
    levels = [f.level for f in inspect_fmu(fmu).findings if f.code == code]
    assert named == ("error" in levels and rule.number[0] in "VC")


UNREADABLE = ("kind-none", "type-name")
"""Their examples break another rule as well: that there is nothing to run, or no such type."""
