"""Behaviour of values computed from signals: recorded operations; c/computed.c does the same."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any


def _divide(a: float, b: float) -> float:
    if b != 0.0 or math.isnan(a):
        return a / b
    return math.nan if a == 0.0 else math.copysign(math.inf, a) * math.copysign(1.0, b)


def _or(value: float, function: Callable[..., float]) -> Callable[..., float]:
    """Return the function as in C: a value where Python raises."""

    def found(*arguments: float) -> float:
        try:
            return function(*arguments)
        except ValueError:
            return math.nan
        except OverflowError:
            return value

    return found


def _log(x: float) -> float:
    return -math.inf if x == 0.0 else math.log(x) if x > 0.0 else math.nan


_OPERATIONS: dict[str, Callable[..., float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": _divide,
    "negate": operator.neg,
    "pow": _or(math.inf, math.pow),
    "min": min,
    "max": max,
    "abs": abs,
    "floor": lambda x: float(math.floor(x)) if math.isfinite(x) else x,
    "rint": lambda x: float(round(x)) if math.isfinite(x) else x,
    "hypot": lambda a, b: abs(complex(a, b)),  # by the C library, unlike math.hypot
    "less": lambda a, b: float(a < b),
    "less_equal": lambda a, b: float(a <= b),
    "equal": lambda a, b: float(a == b),
    "log": _log,
    **{
        name: _or(math.inf, getattr(math, name))
        for name in ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "sqrt")
    },
}


class _Floats:
    """Carries out operations on floats."""

    @staticmethod
    def apply(operation: str, *operands: float) -> float:
        return _OPERATIONS[operation](*operands)


def _whole(t: float) -> float:
    """Return a time in whole nanoseconds, as masters count: sums of steps are rounded."""
    return float(round(t * 1e9)) / 1e9


class Computed:
    """Outputs that are expressions of the inputs and the time, at the same instant.

    Attributes
    ----------
    inputs, outputs : their names.
    texts : the expressions that the outputs were made of.
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self.inputs: list[str] = constants["inputs"]
        self.outputs: list[str] = constants["outputs"]
        self.texts: list[str] = constants["texts"]
        self._nodes: list[list[Any]] = constants["nodes"]
        self._results: list[int] = constants["results"]

    def law(self, v: Any, ns: Any, t: Any) -> list[Any]:
        """Return the outputs for the inputs in `v` at time t; `ns.apply` carries out operations."""
        found: list[Any] = []
        for operation, *arguments in self._nodes:
            if operation == "constant":
                found.append(arguments[0])
            elif operation == "symbol":
                found.append(t if arguments[0] == "t" else v[arguments[0]])
            else:
                found.append(ns.apply(operation, *(found[i] for i in arguments)))
        return [found[i] for i in self._results]

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Begin; the outputs are zero where the start values of the inputs give them no value."""
        self._time = start = _whole(start)
        for name, value in zip(self.outputs, self.law(v, _Floats, start), strict=True):
            v[name] = value if math.isfinite(value) else 0.0

    def advance(self, v: dict[str, float], end: float) -> None:
        """Go on to `end`; an output without a value there waits for the inputs of that instant.

        Raises
        ------
        ArithmeticError : an output of no input, which has no finite value.
        """
        end = _whole(end)
        values = self.law(v, _Floats, end)
        if not self.inputs:
            self._check(values, end)
        self._time = end
        found = zip(self.outputs, values, strict=True)
        v.update({name: value for name, value in found if math.isfinite(value)})

    def refresh(self, v: dict[str, float]) -> None:
        """Compute the outputs from the inputs as they are now.

        Raises
        ------
        ArithmeticError : one of them has no finite value.
        """
        values = self.law(v, _Floats, self._time)
        self._check(values, self._time)
        v.update(zip(self.outputs, values, strict=True))

    def _check(self, values: list[float], time: float) -> None:
        for name, value, text in zip(self.outputs, values, self.texts, strict=True):
            if not math.isfinite(value):
                raise ArithmeticError(f"{name} has no finite value at t = {time!r} s: {text[:200]}")

    def snapshot(self) -> dict[str, Any]:
        """Return the time; the outputs are variables."""
        return {"time": self._time}

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`."""
        self._time = saved["time"]
