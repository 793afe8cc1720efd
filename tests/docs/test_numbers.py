"""Numbers in pages are those that the project computes, and a wrong digit fails the build."""

from __future__ import annotations

import pytest
from shared import share_of

from docs_site import numbers

TABLE = '[third]\nvalue = "1 / 3"\n[bound]\nvalue = "2 / 3"\nrounded = "down"\n'
SLOW = sorted(name for name, own in numbers.table().items() if own.slow)


def faults(text: str) -> list[str]:
    """What is wrong with a page."""
    return list(numbers.faults(numbers.printed_in(text, "page.md"), numbers.table(TABLE)))


def test_the_build_of_the_pages_computes_the_quick_ones() -> None:
    """It finds nothing wrong, and there are some."""
    printed = numbers.all_printed()
    assert len(printed) > 30
    assert len({one.where.partition(":")[0] for one in printed}) >= 5
    numbers.require_quick()


def test_no_name_is_left_over() -> None:
    """What is computed stands in a page."""
    assert {one.name for one in numbers.all_printed()} == set(numbers.table())


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", share_of(SLOW))
def test_the_slow_ones_agree(name: str) -> None:
    """Each, wherever it stands."""
    printed = [one for one in numbers.all_printed() if one.name == name]
    assert printed
    assert list(numbers.faults(printed, numbers.table())) == []


def test_a_wrong_digit_is_seen() -> None:
    """At the digits that are printed, on the side that is asked for, by page and line."""
    for right in ("0.3333", ".333", "0.3", "0.333333333"):
        assert faults(f"x {right}<!-- = third --> s") == []
    for right in ("0.66", "0.666", ".6"):
        assert faults(f"| a | {right}<!-- = bound --> |") == []
    (wrong,) = faults("one line\nx = 0.3334<!-- = third -->")
    assert wrong == "page.md:2: 0.3334 is printed, 1 / 3 is 0.3333"
    assert faults("0.667<!-- = bound -->")
    assert faults("−0.3333<!-- = third -->")
    assert "no 'thrid'" in faults("0.3333<!-- = thrid -->")[0]
    assert "no number" in faults("a third<!-- = third -->")[0]


def test_the_build_fails_where_a_number_differs(monkeypatch: pytest.MonkeyPatch) -> None:
    """With every such number in the message."""
    wrong = [numbers.Printed("1.1681", "networked-exact", "docs/explanation/theory.md:309")]
    monkeypatch.setattr(numbers, "all_printed", lambda: wrong)
    with pytest.raises(ValueError, match=r"theory.md:309: 1.1681 is printed, .* is 1.1671"):
        numbers.require_quick()
