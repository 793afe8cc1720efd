"""The proof of positive definiteness against exact determinants and known matrices."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import flint
import numpy as np

from cosim.hinf.exact import first_bad_pivot, from_text


def _lower(rows: list[list[Fraction]]) -> list[list[Any]]:
    exactly = [[flint.fmpq(x.numerator, x.denominator) for x in row] for row in rows]
    return [row[: i + 1] for i, row in enumerate(exactly)]


def test_definiteness_is_decided_beyond_every_double() -> None:
    """2^-300 on either side of singular, and the Hilbert matrix of order 20 (condition 1e28)."""
    one, tiny = Fraction(1), Fraction(1, 2**300)
    assert first_bad_pivot(_lower([[one, one], [one, one + tiny]])) is None
    assert first_bad_pivot(_lower([[one, one], [one, one - tiny]])) == 1
    assert first_bad_pivot(_lower([[one, one], [one, one]])) == 1
    assert first_bad_pivot(_lower([[0 * one, one], [one, one]])) == 0
    hilbert = [[Fraction(1, i + j + 1) for j in range(20)] for i in range(20)]
    assert first_bad_pivot(_lower(hilbert)) is None
    hilbert[19][19] -= Fraction(1, 10**20)
    assert first_bad_pivot(_lower(hilbert)) == 19


def test_definiteness_agrees_with_leading_minors() -> None:
    """Sylvester's criterion with exact determinants, on matrices of small integers."""
    rng = np.random.default_rng(3)
    outcomes = set()
    for _ in range(200):
        n = int(rng.integers(1, 6))
        G = rng.integers(-2, 3, (n, n))
        M = G @ G.T + int(rng.integers(-1, 2)) * np.eye(n, dtype=int)
        minors = [flint.fmpz_mat(M[:k, :k].tolist()).det() for k in range(1, n + 1)]
        bad = first_bad_pivot(_lower([[Fraction(int(x)) for x in row] for row in M]))
        first = next((k for k, minor in enumerate(minors) if minor <= 0), None)
        assert bad == first
        outcomes.add(bad is None)
    assert outcomes == {True, False}


def test_numbers_are_read_as_written() -> None:
    """Fractions, signs and unreduced ones are what they say."""
    for text in ("0", "-3", "101/20", "-4/6", "1/" + str(2**1074)):
        value = from_text(text, "here")
        assert Fraction(int(value.p), int(value.q)) == Fraction(text)
