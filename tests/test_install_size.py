"""What an installation takes is what the README says, and each requirement has its reason."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.benchmarks._distributions import PROJECT, WITHOUT, Size, figures_of, sizes

README = (Path(__file__).parents[1] / "README.md").read_text("utf-8")


@pytest.fixture(scope="module")
def found() -> list[Size]:
    """The distributions of this environment that an installation without extras has."""
    return [one for one in sizes() if one.name != PROJECT]  # an editable one takes nothing


def test_the_readme_has_the_megabytes_that_are_measured(found: list[Size]) -> None:
    """Of the six packages that users have chosen, and of what is required beside them."""
    words = re.search(r"(\d+) MB are FMPy, [^;]*; (\d+) MB is\s+what this project requires", README)
    assert words is not None
    measured = [group["megabytes"] for group in figures_of(found)["groups"]]
    assert [int(word) for word in words.groups()] == pytest.approx(measured, rel=0.03)


def test_every_requirement_beside_the_six_says_what_it_would_cost_to_leave_it(
    found: list[Size],
) -> None:
    """None is there without a reason, and no reason is left of one that is gone."""
    added = {one.name for one in found if one.group == "added" and PROJECT in one.required_by}
    assert added == set(WITHOUT)
