"""Which variables equations depend on, and on which not linearly: run once, without numbers."""

from __future__ import annotations

from collections.abc import Iterable
from types import SimpleNamespace
from typing import Any

Names = frozenset[int]
_NONE: Names = frozenset()


class Dependence:
    """An expression: the variables in it, and those that it is not linear in."""

    __slots__ = ("bent", "used")

    def __init__(self, used: Names, bent: Names = _NONE) -> None:
        self.used, self.bent = used, bent

    def __neg__(self) -> Dependence:
        return self

    def __add__(self, other: Any) -> Dependence:
        used, bent = _of(other)
        return Dependence(self.used | used, self.bent | bent)

    __radd__ = __sub__ = __rsub__ = __add__

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, Dependence):
            return function_of(self, other)
        return 0.0 if other == 0 else self

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Dependence:
        return function_of(self, other) if isinstance(other, Dependence) else self

    def __rtruediv__(self, other: Any) -> Any:
        return function_of(self) if other else 0.0

    def __pow__(self, power: int) -> Dependence:
        return function_of(self)

    def __abs__(self) -> Dependence:
        return function_of(self)


def _of(value: Any) -> tuple[Names, Names]:
    return (value.used, value.bent) if isinstance(value, Dependence) else (_NONE, _NONE)


def function_of(*values: Any) -> Dependence:
    """Return a function of expressions that is not linear."""
    used = frozenset().union(*(_of(value)[0] for value in values))
    return Dependence(used, used)


_FUNCTIONS = ("sin", "cos", "asin", "atan2", "sqrt", "exp", "min", "max")
DEPENDENCE = SimpleNamespace(
    coupled_drag=lambda v, w, *_: (function_of(v, w),) * 2,
    **dict.fromkeys(_FUNCTIONS, function_of),
)
"""The functions of equations, for `Dependence`."""


def variables_of(rows: Iterable[Any]) -> tuple[Names, Names]:
    """Return the variables in the rows, and those that some row is not linear in."""
    by_row = [_of(row) for row in rows]
    return frozenset().union(*(a for a, _ in by_row)), frozenset().union(*(b for _, b in by_row))
