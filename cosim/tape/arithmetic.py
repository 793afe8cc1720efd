"""Carry out recorded operations in Python: on floats, or on arrays of one length.

Every operation has a value, as in IEEE 754: 1 / 0 is infinite, the root of -1 is not a number.
Exact, and so the same on every machine, are + - * /, sqrt, abs, min, max, floor, rint and
comparisons. The others are those of the C library, value by value (the last bit of NumPy's own
varies by processor): the same on machines of one kind, and elsewhere up to rounding.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from cosim.tape.record import Operation


def evaluate(operations: Sequence[Operation], values: Mapping[str, Any]) -> list[Any]:
    """Return the value of each recorded operation.

    Parameters
    ----------
    values : by symbol, a float or an array (n,).
    """
    found: list[Any] = []
    with np.errstate(all="ignore"):
        taken = {name: v if np.ndim(v) else np.float64(v) for name, v in values.items()}
        for one in operations:
            if one.name == "symbol":
                found.append(taken[one.text])
            elif one.name == "constant":
                found.append(np.float64(one.text))
            else:
                found.append(_WAYS[one.name](*(found[place] for place in one.operands)))
    return found


def compute(name: str, *operands: float) -> float:
    """Return the value of one operation on numbers."""
    with np.errstate(all="ignore"):
        return float(_WAYS[name](*map(np.float64, operands)))


def _by_value(function: Callable[..., float]) -> Callable[..., Any]:
    many = np.vectorize(function, otypes=[float])
    return lambda *a: many(*a) if any(np.ndim(x) for x in a) else np.float64(function(*a))


def _or_nan(function: Callable[..., float]) -> Callable[..., float]:
    def found(*arguments: float) -> float:
        try:
            return function(*arguments)
        except ValueError:
            return math.nan

    return found


def _power(base: float, exponent: float) -> float:
    if base == 0.0 and exponent < 0.0:
        return math.inf
    try:
        return math.pow(base, exponent)
    except ValueError:
        return math.nan
    except OverflowError:
        return -math.inf if base < 0.0 and exponent % 2.0 == 1.0 else math.inf


def _exp(x: float) -> float:
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def _log(x: float) -> float:
    return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan


_WAYS: Final[dict[str, Callable[..., Any]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": np.divide,
    "negate": operator.neg,
    "pow": _by_value(_power),
    "min": np.minimum,
    "max": np.maximum,
    "exp": _by_value(_exp),
    "log": _by_value(_log),
    "sqrt": np.sqrt,
    "abs": np.abs,
    "floor": np.floor,
    "rint": np.rint,
    "hypot": np.hypot,
    "less": lambda a, b: (a < b) * 1.0,
    "less_equal": lambda a, b: (a <= b) * 1.0,
    "equal": lambda a, b: (a == b) * 1.0,
    **{
        name: _by_value(_or_nan(getattr(math, name)))
        for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2")
    },
}
