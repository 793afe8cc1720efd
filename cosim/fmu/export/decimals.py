"""Round numbers for start values: 1, 2, 5 times a power of ten."""

from __future__ import annotations

import math


def round_below(value: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most `value` > 0."""
    exponent = math.floor(math.log10(value))
    # written as decimals, so that they read as such
    found = [float(f"{digit}e{exponent + more}") for more in (-1, 0) for digit in (1, 2, 5)]
    return max(number for number in found if number <= value)
