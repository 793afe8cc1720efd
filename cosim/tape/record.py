"""Record the arithmetic of equations, operation by operation, by running them over `Scalar`s.

From the recorded `Tape`, `print_c` writes C that performs the same operations in the same order, so
that native and Python FMUs agree to the last bit; `evaluate` carries it out in Python. A computer
algebra system would regroup sums and products: equal as mathematics, different in the last bits.

Equal operations on equal operands are one (common subexpressions); nothing else is
rewritten. Control flow that depends on a value cannot be recorded and is refused.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import Any, NoReturn

CONSTANT = 0
"""Level of a value that depends on nothing."""
FIXED = 1
"""Level of a value that depends on parameters alone."""
VARYING = 2
"""Level of a value that may change during a run."""

OPERATIONS = (
    *("+", "-", "*", "/", "negate", "pow", "min", "max", "sin", "cos", "exp", "log", "sqrt"),
    *("abs", "asin", "atan2", "tan", "acos", "atan", "floor", "rint", "hypot"),
    *("less", "less_equal", "equal"),
)
"""All there are, by their number in the programs of c/tape.c and, behind two others, kernel.c."""
_COMMUTES = ("+", "*")


@dataclass(frozen=True)
class Operation:
    """Its name, the places of its operands, the text of a "constant" or "symbol"."""

    name: str
    operands: tuple[int, ...]
    text: str
    level: int


class Tape:
    """All recorded operations, in order of their first use."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self._known: dict[tuple[Any, ...], int] = {}

    def symbol(self, text: str, level: int = VARYING) -> Scalar:
        """Record a value that C has under the name `text`."""
        return self._recorded("symbol", (), text, level)

    def constant(self, value: float) -> Scalar:
        """Record a number.

        Raises
        ------
        OverflowError : an integer that is not exactly a double.
        """
        number = float(value)
        if number != value and not math.isnan(number):
            raise OverflowError(f"{value!r} is not exactly a double")
        return self._recorded("constant", (), repr(number), CONSTANT)

    def scalar(self, value: Any) -> Scalar:
        """Return a number as a constant of this tape; a `Scalar` of it as it is."""
        return value if isinstance(value, Scalar) else self.constant(value)

    def apply(self, operation: str, *operands: Any) -> Scalar:
        """Record an operation; its operands are `Scalar`s of this tape or numbers."""
        places = tuple(self.scalar(a).place for a in operands)
        level = max(self.operations[place].level for place in places)
        return self._recorded(operation, places, "", level)

    def _recorded(self, operation: str, operands: tuple[int, ...], text: str, level: int) -> Scalar:
        # a + b and b + a have the same bits
        same = tuple(sorted(operands)) if operation in _COMMUTES else operands
        key = (operation, same, text)
        if key not in self._known:
            self._known[key] = len(self.operations)
            self.operations.append(Operation(operation, operands, text, level))
        return Scalar(self, self._known[key])


class Scalar:
    """A value on a `Tape`; arithmetic with it is recorded."""

    __slots__ = ("place", "tape")

    def __init__(self, tape: Tape, place: int) -> None:
        self.tape, self.place = tape, place

    def __add__(self, other: Any) -> Scalar:
        return self.tape.apply("+", self, other)

    def __radd__(self, other: Any) -> Scalar:
        return self.tape.apply("+", other, self)

    def __sub__(self, other: Any) -> Scalar:
        return self.tape.apply("-", self, other)

    def __rsub__(self, other: Any) -> Scalar:
        return self.tape.apply("-", other, self)

    def __mul__(self, other: Any) -> Scalar:
        return self.tape.apply("*", self, other)

    def __rmul__(self, other: Any) -> Scalar:
        return self.tape.apply("*", other, self)

    def __truediv__(self, other: Any) -> Scalar:
        return self.tape.apply("/", self, other)

    def __rtruediv__(self, other: Any) -> Scalar:
        return self.tape.apply("/", other, self)

    def __pow__(self, other: Any) -> Scalar:
        return self.tape.apply("pow", self, other)

    def __neg__(self) -> Scalar:
        return self.tape.apply("negate", self)

    def __abs__(self) -> Scalar:
        return self.tape.apply("abs", self)

    def _branch(self, *_: object) -> NoReturn:
        raise TypeError("an equation must not branch on a value: C is made from one run of it")

    __bool__ = __float__ = __lt__ = __le__ = __gt__ = __ge__ = _branch
    __eq__ = __ne__ = _branch
    __hash__ = None  # type: ignore[assignment]


class Functions:
    """The namespace of functions for equations over recorded scalars."""

    def __init__(self, tape: Tape) -> None:
        self._tape = tape

    def __getattr__(self, name: str) -> Any:
        if name not in ("sin", "cos", "asin", "atan2", "exp", "log", "sqrt", "min", "max"):
            raise AttributeError(f"the C shell has no function {name}")
        return lambda *arguments: self._tape.apply(name, *arguments)


def required_places(tape: Tape, roots: Iterable[int], known: Container[int] = ()) -> list[int]:
    """Return the places to compute for `roots`, in order; `known` ones need no operands."""
    found: set[int] = set()
    ahead = list(roots)
    while ahead:
        place = ahead.pop()
        if place not in found:
            found.add(place)
            if place not in known:
                ahead.extend(tape.operations[place].operands)
    return sorted(found)
