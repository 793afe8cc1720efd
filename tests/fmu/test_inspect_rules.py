"""Every rule has a number, a section or a reason, and an example that breaks it."""

from __future__ import annotations

import re

import pytest

from cosim.fmu import GROUPS, RULES
from cosim.fmu.inspect.findings import Finding
from cosim.fmu.inspect.inspection import describe_root
from cosim.fmu.inspect.markup import parse_xml
from cosim.fmu.inspect.rules import example_description
from docs_site.rules_page import page

WITH_BASE = [code for code, rule in RULES.items() if rule.base]


def findings(description: str) -> list[Finding]:
    """Of a model description, without archive and binaries."""
    root, found = parse_xml(description.encode(), "modelDescription.xml")
    return found if root is None else found + describe_root(root)[1]


@pytest.mark.parametrize("base", ["fmi1", "fmi2", "fmi3"])
def test_the_base_of_the_examples_has_only_notes(base: str) -> None:
    """Or an example would prove nothing."""
    assert [f for f in findings(example_description(base)) if f.level != "note"] == []


@pytest.mark.parametrize("code", WITH_BASE)
def test_the_example_of_a_rule_breaks_it(code: str) -> None:
    """At its usual level, in the description that it is a change of, and nowhere before."""
    rule = RULES[code]
    base = example_description(rule.base)
    assert base.count(rule.old) >= 1
    before = [(f.where, f.what) for f in findings(base) if f.code == code]
    broken = [f for f in findings(rule.broken()) if (f.where, f.what) not in before]
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


def test_every_rule_is_on_the_page_of_rules() -> None:
    """With all that --rule says of it."""
    text = page()
    assert [code for code in RULES if f"`{code}`" not in text] == []
