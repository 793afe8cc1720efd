"""Bounds as text: rounded to few digits, but only to the side on which they still hold."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction


def at_most(value: float | Fraction | str | None, digits: int = 7) -> str:
    """Return an upper bound, such as a certified gamma, rounded up to significant digits.

    value : a finite double, a fraction, "p/q", or None, for no bound. A double that few digits
        name exactly (they read back as it) is not rounded.
    """
    return _outward(value, digits, ROUND_CEILING)


def at_least(value: float | Fraction | str | None, digits: int = 7) -> str:
    """Return a lower bound, such as a delay or a rate of decay, rounded down; see `at_most`."""
    return _outward(value, digits, ROUND_FLOOR)


def _outward(value: float | Fraction | str | None, digits: int, rounding: str) -> str:
    if value is None:
        return "none"
    exact = Fraction(value)
    context = Context(prec=digits, rounding=rounding)
    rounded = context.divide(Decimal(exact.numerator), Decimal(exact.denominator))
    try:
        nearest = f"{float(exact):.{digits}g}"
    except OverflowError:
        return str(rounded)
    is_exact = Fraction(float(nearest)) == exact
    return nearest if is_exact else f"{float(rounded):.{digits}g}"
