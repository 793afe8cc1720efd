"""The functions of expressions: what each takes, what becomes of units, and what is recorded.

An expression has one form, operations recorded on a tape; who carries them out (`cosim.tape`, the
kernel of a run, an FMU of computed values) gives the same bits. A power with a whole exponent from
-9 to 9 is made of products, which are the same on every machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import Any, Final, Literal, NamedTuple

Rule = Literal["same", "root", "of angle", "to angle", "plain"]
"""What becomes of units: as the arguments, their root, an angle taken or given, none at all."""
Apply = Callable[..., Any]
"""Carries out or records an operation, given its name and its operands."""
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


def called(apply: Apply, name: str, *values: Any) -> Any:
    """Apply a function of `FUNCTIONS`."""
    match name, values:
        case "min" | "max" | "hypot", _:
            return reduce(lambda a, b: apply(name, a, b), values)
        # + 0.0: none of them gives a negative zero
        case "floor", (x,):
            return apply("+", apply("floor", x), 0.0)
        case "round", (x,):
            return apply("+", apply("rint", x), 0.0)
        case "ceil", (x,):
            return apply("-", 0.0, called(apply, "floor", apply("negate", x)))
        case "log", (x, base):
            return apply("/", apply("log", x), apply("log", base))
    return apply(name, *values)


def power(apply: Apply, base: Any, exponent: Any) -> Any:
    """Apply a power."""
    number = isinstance(exponent, float) and abs(exponent) <= LARGEST_EXPONENT
    if not number or exponent != int(exponent):
        return apply("pow", base, exponent)
    if exponent == 0.0:
        return 1.0
    found = reduce(lambda a, b: apply("*", a, b), [base] * abs(int(exponent)))
    return found if exponent > 0.0 else apply("/", 1.0, found)


def compared(apply: Apply, sign: str, a: Any, b: Any) -> Any:
    """Apply a comparison: 1 where it is true, else 0."""
    match sign:
        case ">" | ">=":
            return compared(apply, sign.replace(">", "<"), b, a)
        case "<":
            return apply("less", a, b)
        case "<=":
            return apply("less_equal", a, b)
        case "==":
            return apply("equal", a, b)
    return opposite(apply, apply("equal", a, b))


def both(apply: Apply, a: Any, b: Any) -> Any:
    """Apply a and b."""
    return apply("*", a, b)


def either(apply: Apply, a: Any, b: Any) -> Any:
    """Apply a or b."""
    return apply("max", a, b)


def opposite(apply: Apply, a: Any) -> Any:
    """Apply not a."""
    return apply("-", 1.0, a)
