"""Record an expression, operation by operation, on a tape: the third way to carry one out.

What is computed in a component, and what the loop looks at, have the bits of the same expression
over the signals of a run (`functions.OF_SIGNALS`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cosim.fmu import Scalar, Tape
from cosim.scenario.functions import OF_SIGNALS, Arithmetic, is_product, products


class _OfTape:
    """Records operations; what depends on numbers alone is computed, as for signals."""

    def __init__(self, tape: Tape, *, raises: bool) -> None:
        self._tape, self._raises = tape, raises

    def _apply(self, operation: str, name: str, *arguments: Any) -> Any:
        if not any(isinstance(a, Scalar) for a in arguments):
            return float(getattr(OF_SIGNALS, name)(*arguments))
        return self._tape.apply(operation, *arguments)

    def divide(self, a: Any, b: Any) -> Any:
        if self._raises or isinstance(a, Scalar) or isinstance(b, Scalar):
            return a / b  # of two numbers it raises, which the binder locates
        return float(OF_SIGNALS.divide(np.float64(a), np.float64(b)))

    def power(self, base: Any, exponent: Any) -> Any:
        if is_product(exponent):
            return products(base, int(exponent), 1.0, self.divide)
        return self._apply("pow", "power", base, exponent)

    def compare(self, sign: str, a: Any, b: Any) -> Any:
        if not isinstance(a, Scalar) and not isinstance(b, Scalar):
            return float(OF_SIGNALS.compare(sign, a, b))
        if sign in (">", ">="):
            a, b = b, a
        word = {"<": "less", ">": "less", "<=": "less_equal", ">=": "less_equal"}.get(sign, "equal")
        found = self._tape.apply(word, a, b)
        return 1.0 - found if sign == "!=" else found

    def both(self, a: Any, b: Any) -> Any:
        return a * b

    def either(self, a: Any, b: Any) -> Any:
        return self.max(a, b)

    def opposite(self, a: Any) -> Any:
        return 1.0 - a

    def _folded(self, name: str, values: tuple[Any, ...]) -> Any:
        result = values[0]
        for value in values[1:]:
            result = self._apply(name, name, result, value)
        return result

    def min(self, *values: Any) -> Any:
        return self._folded("min", values)

    def max(self, *values: Any) -> Any:
        return self._folded("max", values)

    def hypot(self, *values: Any) -> Any:
        return self._folded("hypot", values)

    def floor(self, x: Any) -> Any:
        return self._apply("floor", "floor", x) + 0.0

    def round(self, x: Any) -> Any:
        return self._apply("rint", "round", x) + 0.0

    def ceil(self, x: Any) -> Any:
        return 0.0 - self.floor(-x)

    def log(self, x: Any, base: Any = None) -> Any:
        found = self._apply("log", "log", x)
        return found if base is None else self.divide(found, self._apply("log", "log", base))

    def __getattr__(self, name: str) -> Callable[..., Any]:
        return lambda *arguments: self._apply(name, name, *arguments)


def of_tape(tape: Tape, *, raises: bool) -> Arithmetic:
    """Return the arithmetic that records on a tape.

    raises : where a quotient of numbers alone has no value; else it has that of IEEE 754.
    """
    return _OfTape(tape, raises=raises)
