"""Checks of what links are declared with; each message names the parameter."""

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
            hint="a longer time" if value < minimum else "a shorter time",
        )


def check_choice(where: str, what: str, value: Any, choices: tuple[str, ...]) -> None:
    """Raise `InputError`, "unknown `what`", unless `value` is one of the choices."""
    if value not in choices:
        raise InputError(
            f"unknown {what}",
            where=where,
            expected="one of " + ", ".join(choices),
            got=repr(value),
        )


def check_delay(link: str, delay: Any, delay_ns: int, kinds: tuple[type, ...], hint: str) -> None:
    """Raise `InputError` unless `delay` is None, or of one of `kinds` and `delay_ns` is 0."""
    if delay is not None and not isinstance(delay, kinds):
        raise InputError(
            "delay of the wrong type",
            where=f"{link}: delay",
            expected=", ".join(f"a {kind.__name__}" for kind in kinds) + " or None",
            got=repr(delay),
            hint=hint,
        )
    if delay is not None and delay_ns != 0:
        raise InputError(
            "a link has one delay",
            where=f"{link}: delay_ns, delay",
            expected="delay_ns = 0 where the delay varies",
            got=f"{delay_ns} ns and a {type(delay).__name__}",
            hint="add the constant part to the delay that varies",
        )


def check_name(where: str, name: Any) -> None:
    """Raise `InputError` unless `name` is a string that is not empty."""
    if not isinstance(name, str) or not name:
        raise InputError(
            "a link needs a name", where=where, expected="a non-empty string", got=repr(name)
        )


def is_integer(value: Any) -> bool:
    """Whether `value` is an integer of Python or NumPy, and not a bool."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def is_number(value: Any) -> bool:
    """Whether `value` is a real number of Python or NumPy, and not a bool."""
    numbers = (int, float, np.integer, np.floating)
    return isinstance(value, numbers) and not isinstance(value, bool)


def is_finite(value: Any) -> bool:
    """Whether `value` is a finite real number of Python or NumPy, and not a bool."""
    try:
        return is_number(value) and math.isfinite(value)
    except OverflowError:  # an integer beyond every double
        return False
