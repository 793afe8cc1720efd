"""What durations, probabilities and names have to be; the messages say where they are not."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cosim.core import InputError

MAX_NS = 2**53
"""Longest duration a link takes: 104 days. Up to here a double counts nanoseconds exactly."""


def check_duration(where: str, value: Any, *, minimum: int = 0) -> None:
    """Raise `InputError` unless `value` is an integer of nanoseconds in [minimum, 2**53]."""
    if not is_integer(value):
        raise InputError(
            "a duration is an integer number of nanoseconds",
            where=where,
            expected="an integer",
            got=f"{value!r} ({type(value).__name__})",
            hint="multiply seconds by 10**9 and round",
        )
    if not minimum <= value <= MAX_NS:
        raise InputError(
            "duration out of range",
            where=where,
            expected=f"{minimum} to 2**53 ns",
            got=f"{value} ns",
        )


def check_probability(where: str, value: Any) -> None:
    """Raise `InputError` unless `value` is a number in [0, 1]."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        raise InputError(
            "a probability is a number",
            where=where,
            expected="a number from 0 to 1",
            got=f"{value!r} ({type(value).__name__})",
        )
    if not 0.0 <= value <= 1.0:
        raise InputError(
            "probability out of range",
            where=where,
            expected="a number from 0 to 1",
            got=repr(value),
        )


def check_name(where: str, name: Any) -> None:
    """Raise `InputError` unless `name` is a string with something in it."""
    if not isinstance(name, str) or not name:
        raise InputError(
            "a link needs a name", where=where, expected="a non-empty string", got=repr(name)
        )


def is_integer(value: Any) -> bool:
    """Whether `value` is an integer, Python's or NumPy's, and no bool."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def is_finite(value: Any) -> bool:
    """Whether `value` is a finite real number, Python's or NumPy's, and no bool."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.integer, np.floating)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # an integer beyond every double
        return False
