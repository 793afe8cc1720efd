"""The functions of expressions, and the three ways to carry them out.

Exact, and so the same on every machine, are + - * /, sqrt, abs, min, max, floor, ceil, round,
comparisons, and powers with a whole exponent from -9 to 9, which are products. The others are
those of the C library, value by value (the last bit of NumPy's own varies by processor): the same
on machines of one kind, and elsewhere up to rounding.

A signal of a run has an IEEE 754 value everywhere, 1 / 0 included: `OfSignals`, for a point or a
whole run. A number that a study or a scenario sets has to be one: `OfNumbers` raises. What
`cosim.scenario.computed` makes into a component is recorded there, operation by operation.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any, Final, Literal, NamedTuple, Protocol

import numpy as np

Rule = Literal["same", "root", "of angle", "to angle", "plain"]
"""What becomes of units: as the arguments, their root, an angle taken or given, none at all."""
LARGEST_EXPONENT: Final = 9
"""Of a power of what has a unit, and of one that is made of products."""


class Signature(NamedTuple):
    """Fewest and most arguments of a function, and what becomes of their units."""

    least: int
    most: int
    rule: Rule


FUNCTIONS: Final[dict[str, Signature]] = {
    "abs": Signature(1, 1, "same"),
    "sqrt": Signature(1, 1, "root"),
    "min": Signature(2, 64, "same"),
    "max": Signature(2, 64, "same"),
    "hypot": Signature(2, 9, "same"),
    "floor": Signature(1, 1, "same"),
    "ceil": Signature(1, 1, "same"),
    "round": Signature(1, 1, "same"),
    "sin": Signature(1, 1, "of angle"),
    "cos": Signature(1, 1, "of angle"),
    "tan": Signature(1, 1, "of angle"),
    "asin": Signature(1, 1, "to angle"),
    "acos": Signature(1, 1, "to angle"),
    "atan": Signature(1, 1, "to angle"),
    "atan2": Signature(2, 2, "to angle"),
    "exp": Signature(1, 1, "plain"),
    "log": Signature(1, 2, "plain"),
}
CONSTANTS: Final = {"pi": math.pi, "e": math.e}


class Arithmetic(Protocol):
    """Carries out what a part of an expression says; also has every name of `FUNCTIONS`."""

    def divide(self, a: Any, b: Any) -> Any:
        """Return a / b."""

    def power(self, base: Any, exponent: Any) -> Any:
        """Return base ** exponent."""

    def compare(self, sign: str, a: Any, b: Any) -> Any:
        """Return whether a < b, or another sign of `COMPARISONS`."""

    def both(self, a: Any, b: Any) -> Any:
        """Return a and b."""

    def either(self, a: Any, b: Any) -> Any:
        """Return a or b."""

    def opposite(self, a: Any) -> Any:
        """Return not a."""

    def __getattr__(self, name: str) -> Any: ...


COMPARISONS: Final[dict[str, Callable[[Any, Any], Any]]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}


def folded(function: Callable[[Any, Any], Any], values: Sequence[Any]) -> Any:
    """Return function(function(a, b), c) ... of one value or more."""
    result = values[0]
    for value in values[1:]:
        result = function(result, value)
    return result


def products(base: Any, exponent: int, one: Any, divide: Callable[[Any, Any], Any]) -> Any:
    """Return a whole power by products: the same rounding on every processor."""
    result = folded(operator.mul, [base] * abs(exponent) or [one])
    return result if exponent >= 0 else divide(1.0, result)


def is_product(exponent: Any) -> bool:
    """Whether a power with this exponent is made of products."""
    number = isinstance(exponent, int | float)
    return number and abs(exponent) <= LARGEST_EXPONENT and exponent == int(exponent)


class _OfSignals:
    """Floats, or arrays of one length; every operation has a value, as in IEEE 754."""

    divide = staticmethod(np.divide)
    abs = staticmethod(np.abs)
    sqrt = staticmethod(np.sqrt)
    both = staticmethod(operator.and_)
    either = staticmethod(operator.or_)
    opposite = staticmethod(np.logical_not)

    @staticmethod
    def power(base: Any, exponent: Any) -> Any:
        if is_product(exponent):
            return products(base, int(exponent), np.ones_like(base), np.divide)
        return np.vectorize(_pow, otypes=[float])(base, exponent)

    @staticmethod
    def compare(sign: str, a: Any, b: Any) -> Any:
        return COMPARISONS[sign](a, b)

    @staticmethod
    def min(*values: Any) -> Any:
        return folded(np.minimum, values)

    @staticmethod
    def max(*values: Any) -> Any:
        return folded(np.maximum, values)

    @staticmethod
    def hypot(*values: Any) -> Any:
        return folded(np.hypot, values)

    # + 0.0: none of them gives a negative zero
    @staticmethod
    def floor(x: Any) -> Any:
        return np.floor(x) + 0.0

    @staticmethod
    def ceil(x: Any) -> Any:
        return np.ceil(x) + 0.0

    @staticmethod
    def round(x: Any) -> Any:
        return np.rint(x) + 0.0

    @staticmethod
    def log(x: Any, base: Any = None) -> Any:
        found = _by_value(_log)(x)
        return found if base is None else np.divide(found, _by_value(_log)(base))

    def __getattr__(self, name: str) -> Any:
        found = _BY_VALUE.get(name)
        if found is None:
            raise AttributeError(name)
        return found


def _by_value(function: Callable[..., float]) -> Callable[..., Any]:
    many = np.vectorize(function, otypes=[float])
    return lambda *a: many(*a) if any(np.ndim(x) for x in a) else np.float64(function(*a))


def _no_number(function: Callable[..., float]) -> Callable[..., float]:
    """Return the function, not a number where it has no value."""

    def found(*arguments: float) -> float:
        try:
            return function(*arguments)
        except ValueError:
            return math.nan

    return found


def _pow(base: float, exponent: float) -> float:
    """Return base ** exponent as in IEEE 754, without exceptions."""
    if base < 0.0 or (base == 0.0 and exponent < 0.0):
        if base < 0.0 and exponent == math.floor(exponent):
            return _raised(base, exponent)
        return math.nan if base < 0.0 else math.inf
    return _raised(base, exponent)


def _raised(base: float, exponent: float) -> float:
    try:
        return math.pow(base, exponent)
    except OverflowError:
        return -math.inf if base < 0.0 and exponent % 2.0 == 1.0 else math.inf


def _exp(x: float) -> float:
    try:
        return math.exp(x)
    except OverflowError:
        return math.inf


def _log(x: float) -> float:
    return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan


_BY_VALUE: Final = {
    **{
        name: _by_value(_no_number(getattr(math, name)))
        for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2")
    },
    "exp": _by_value(_exp),
}


class _OfNumbers:
    """Python's numbers; what has no finite value raises. A power is that of the C library."""

    divide = staticmethod(operator.truediv)
    both = staticmethod(operator.and_)
    either = staticmethod(operator.or_)
    opposite = staticmethod(operator.not_)
    abs = staticmethod(abs)
    min = staticmethod(min)
    max = staticmethod(max)
    floor = staticmethod(math.floor)
    ceil = staticmethod(math.ceil)
    round = staticmethod(round)

    @staticmethod
    def compare(sign: str, a: Any, b: Any) -> Any:
        return COMPARISONS[sign](a, b)

    @staticmethod
    def power(base: Any, exponent: Any) -> Any:
        found = operator.pow(float(base), float(exponent))  # whole numbers would grow for ever
        if isinstance(found, complex):
            raise ValueError("a root of a negative number")  # noqa: TRY004 - no value, as of sqrt
        return found

    @staticmethod
    def hypot(*values: Any) -> Any:
        return float(folded(np.hypot, values))

    def __getattr__(self, name: str) -> Any:
        if name not in FUNCTIONS:
            raise AttributeError(name)
        return getattr(math, name)


OF_SIGNALS: Final[Arithmetic] = _OfSignals()
OF_NUMBERS: Final[Arithmetic] = _OfNumbers()
