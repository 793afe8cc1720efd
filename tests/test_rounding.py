"""Bounds as text hold as they are printed."""

from __future__ import annotations

import random
from fractions import Fraction

from cosim.core import at_least, at_most


def test_a_bound_is_rounded_to_its_side() -> None:
    """The text of an upper bound is never below it, that of a lower bound never above."""
    draw = random.Random(1)  # noqa: S311 - numbers to round
    for _ in range(300):
        value = draw.uniform(-1, 1) * 10.0 ** draw.randint(-30, 30)
        for digits in (2, 5, 7):
            up, down = at_most(value, digits), at_least(value, digits)
            assert Fraction(down) <= Fraction(value) <= Fraction(up)
            assert len(up.lstrip("-").split("e")[0].replace(".", "").lstrip("0")) <= digits + 1
    assert (at_most("1/3", 3), at_least("1/3", 3)) == ("0.334", "0.333")
    assert (at_most("2/3", 3), at_least("-1/3", 3)) == ("0.667", "-0.334")


def test_a_double_that_few_digits_name_is_that_double() -> None:
    """5.0455 is printed as it is written, though its double lies beside that decimal."""
    assert (at_most(5.0455), at_least(5.0455), at_most(1e-7)) == ("5.0455", "5.0455", "1e-07")
    assert at_most(5.04547301, 7) == "5.045474"
    assert at_most(None) == "none"
    assert at_most(str(10**400)).endswith("E+400")
