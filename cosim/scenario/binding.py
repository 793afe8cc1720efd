"""Bind a parsed condition to a scope: a function of the values of the signals it names.

Dimensions are checked: terms that are added or compared must have the same one. A plain number
takes the SI unit of the other operand; a variable without a unit goes with every dimension.
Values are floats, or arrays of one length, so one function serves a point and a whole run.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np

from cosim.core import InputError
from cosim.scenario.expression import Expression, ExpressionError, reference_of
from cosim.scenario.quantity import NUMBER_ONLY, TIME, Dimension

Function = Callable[[Sequence[Any]], Any]
Kind = Literal["truth", "number"]


def _unchanged(value: Any) -> Any:
    return value


class Meaning(NamedTuple):
    """Kind of a name, its dimension (None: unknown) and its conversion to SI."""

    kind: Kind
    dimension: Dimension | None
    to_si: Callable[[Any], Any] = _unchanged


class Scope(Protocol):
    """Resolves the names of conditions."""

    def meaning(self, reference: str) -> Meaning:
        """Return the meaning of `component.variable`; an `InputError` if it has none."""


class Node(NamedTuple):
    """A bound part of a condition.

    plain : a number without a unit, which takes the unit of the other operand.
    literal : the value of a number written in the text.
    """

    kind: Kind
    dimension: Dimension | None
    run: Function
    plain: bool = False
    literal: float | None = None


@dataclass(frozen=True)
class BoundCondition:
    """A condition that can be evaluated.

    Attributes
    ----------
    names : the names it depends on, in the order of its values; "t" is the time.
    meanings : of the names.
    """

    expression: Expression
    names: tuple[str, ...]
    node: Node
    meanings: Mapping[str, Meaning] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Callable[..., BoundCondition], tuple[Any, ...]]:
        """Pickle the text and the meanings of its names: its functions cannot be pickled."""
        return _bind_again, (self.expression.text, self.meanings, self.node.kind)

    def __call__(self, values: Sequence[Any]) -> Any:
        """Evaluate at the values of `names`; true or false where it is a condition."""
        with np.errstate(all="ignore"):
            return self.node.run([v if np.ndim(v) else np.float64(v) for v in values])


def check_name(reference: str) -> None:
    """Refuse a name without a dot between component and variable."""
    if "." not in reference.strip("."):
        raise InputError(
            f"there is no name {reference!r}",
            expected="component.variable, as in plant.eta.z; t is the time",
        )


class AnyName:
    """A scope that accepts every name: only the form of a condition is checked."""

    def meaning(self, reference: str) -> Meaning:
        """Return a number of unknown dimension."""
        check_name(reference)
        return Meaning("number", None)


def bind(expression: Expression, scope: Scope, wanted: Kind = "truth") -> BoundCondition:
    """Bind the names of a condition and check its dimensions.

    Raises
    ------
    ExpressionError : an unknown name, an unsupported form, incompatible dimensions; says the
        column.
    """
    binder = _Binder(expression, scope)
    try:
        node = binder.visit(expression.tree)
    except RecursionError as error:
        raise ExpressionError("the condition is nested too deep", expression.text, 1) from error
    if node.kind != wanted and not (wanted == "truth" and isinstance(scope, AnyName)):
        was = "a number" if node.kind == "number" else "a condition"
        raise expression.wrong(
            expression.tree,
            f"this is {was}",
            "something that is true or false, as in plant.eta.z > 5 m"
            if wanted == "truth"
            else "a number",
        )
    return BoundCondition(expression, tuple(binder.names), node, binder.meanings)


@dataclass(frozen=True)
class _KnownMeanings:
    """A scope of names whose meanings are known."""

    meanings: Mapping[str, Meaning]

    def meaning(self, reference: str) -> Meaning:
        return self.meanings[reference]


def _bind_again(text: str, meanings: Mapping[str, Meaning], kind: Kind) -> BoundCondition:
    return bind(Expression(text), _KnownMeanings(meanings), kind)


_ARITHMETIC: dict[type[ast.operator], Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: np.divide,
}
_COMPARISON: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_CALLS: dict[str, tuple[int, int, Callable[..., Any]]] = {
    "abs": (1, 1, np.abs),
    "sqrt": (1, 1, np.sqrt),
    "min": (2, 9, lambda *a: _folded(np.minimum, a)),
    "max": (2, 9, lambda *a: _folded(np.maximum, a)),
    "hypot": (2, 9, lambda *a: _folded(np.hypot, a)),
}


def _power(base: Any, exponent: float) -> Any:
    """Return base ** exponent with the same rounding on every processor.

    An integer exponent by products, any other by the C library, value by value: the last bit of
    NumPy's own power varies.
    """
    if exponent == int(exponent):
        result = _folded(operator.mul, [base] * abs(int(exponent)) or [np.ones_like(base)])
        return result if exponent >= 0 else np.divide(1.0, result)
    return np.vectorize(_pow, otypes=[float])(base, exponent)


def _pow(base: float, exponent: float) -> float:
    """Return base ** exponent as in IEEE 754, without exceptions."""
    if base < 0.0 or (base == 0.0 and exponent < 0.0):
        return math.nan if base < 0.0 else math.inf
    try:
        return math.pow(base, exponent)
    except OverflowError:
        return math.inf


def _folded(function: Callable[[Any, Any], Any], values: Sequence[Any]) -> Any:
    result = values[0]
    for value in values[1:]:
        result = function(result, value)
    return result


class _Binder:
    def __init__(self, expression: Expression, scope: Scope) -> None:
        self._expression, self._scope = expression, scope
        self._lenient = isinstance(scope, AnyName)
        self.names: list[str] = []
        self.meanings: dict[str, Meaning] = {}

    def visit(self, node: ast.expr) -> Node:  # noqa: PLR0911 - one per form
        match node:
            case ast.Name() if node.id in self._expression.quantities:
                found = self._expression.quantities[node.id]
                return Node("number", found.dimension, lambda _: found.si, literal=found.si)
            case ast.Constant() if not isinstance(node.value, str):
                return self._constant(node)
            case ast.BoolOp():
                return self._logical(node)
            case ast.UnaryOp():
                return self._unary(node)
            case ast.BinOp():
                return self._arithmetic(node)
            case ast.Compare():
                return self._compared(node)
            case ast.Call():
                return self._called(node)
            case _:
                return self._named(node)

    def _constant(self, node: ast.Constant) -> Node:
        value = node.value
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._expression.wrong(node, "a condition cannot contain this value", "a number")
        try:
            number = float(value)
        except OverflowError:
            number = float("inf")
        if number == float("inf"):
            raise self._expression.wrong(node, "this number is out of range")
        return Node("number", None, lambda _: number, plain=True, literal=number)

    def _named(self, node: ast.expr) -> Node:
        reference = reference_of(node)
        if reference is None:
            raise self._expression.wrong(
                node,
                "a condition cannot contain this form",
                "names, numbers, + - * / **, comparisons, and, or, not, "
                + ", ".join(sorted(_CALLS)),
            )
        if reference == "t":
            meaning = Meaning("number", TIME)
        else:
            try:
                meaning = self._scope.meaning(reference)
            except InputError as error:
                raise self._located(node, error) from error
        self.meanings[reference] = meaning
        if reference not in self.names:
            self.names.append(reference)
        place = self.names.index(reference)
        if meaning.kind == "truth":
            return Node("truth", None, lambda values: values[place] != 0)
        return Node("number", meaning.dimension, lambda values: meaning.to_si(values[place]))

    def _located(self, node: ast.expr, error: InputError) -> ExpressionError:
        located = self._expression.wrong(node, error.what, error.expected)
        located.hint = error.hint
        located.args = (located.text(),)
        return located

    def _logical(self, node: ast.BoolOp) -> Node:
        parts = [self._truth(value) for value in node.values]
        together = operator.and_ if isinstance(node.op, ast.And) else operator.or_
        return Node("truth", None, lambda v: _folded(together, [part.run(v) for part in parts]))

    def _truth(self, node: ast.expr) -> Node:
        found = self.visit(node)
        if found.kind != "truth":
            if self._lenient and reference_of(node) is not None:
                return Node("truth", None, found.run)
            raise self._expression.wrong(
                node, "a number is neither true nor false", "a comparison, as in plant.eta.z > 5 m"
            )
        return found

    def _number(self, node: ast.expr) -> Node:
        found = self.visit(node)
        if found.kind != "number":
            raise self._expression.wrong(node, "this is a truth value, not a number")
        return found

    def _unary(self, node: ast.UnaryOp) -> Node:
        if isinstance(node.op, ast.Not):
            inner = self._truth(node.operand)
            return Node("truth", None, lambda v: np.logical_not(inner.run(v)))
        if isinstance(node.op, ast.Invert):
            raise self._expression.wrong(node, "a condition cannot contain this operator", "not")
        part = self._number(node.operand)
        sign = -1.0 if isinstance(node.op, ast.USub) else 1.0
        literal = None if part.literal is None else sign * part.literal
        return part._replace(run=lambda v: sign * part.run(v), literal=literal)

    def _arithmetic(self, node: ast.BinOp) -> Node:
        if isinstance(node.op, ast.Pow):
            return self._power(node)
        function = _ARITHMETIC.get(type(node.op))
        if function is None:
            wrong = self._expression.wrong
            raise wrong(node, "a condition cannot contain this operator", "+ - * / **")
        a, b = self._number(node.left), self._number(node.right)
        if isinstance(node.op, ast.Add | ast.Sub):
            measured, plain = self._same(node, a, b), a.plain and b.plain
        else:
            sign = -1 if isinstance(node.op, ast.Div) else 1
            measured, plain = self._product(a, b, sign), a.plain and b.plain
        return Node("number", measured, lambda v: function(a.run(v), b.run(v)), plain)

    def _product(self, a: Node, b: Node, sign: int) -> Dimension | None:
        if a.plain and b.plain:
            return None
        one = NUMBER_ONLY if a.plain else a.dimension
        two = NUMBER_ONLY if b.plain else b.dimension
        return None if one is None or two is None else one * two.power(Fraction(sign))

    def _power(self, node: ast.BinOp) -> Node:
        base, exponent = self._number(node.left), self._number(node.right)
        power = exponent.literal
        if power is None or not exponent.plain or abs(power) > 9:
            raise self._expression.wrong(
                node.right, "this exponent is not supported", "a number from -9 to 9"
            )
        measured = base.dimension and base.dimension.power(Fraction(power).limit_denominator(64))
        return Node("number", measured, lambda v: _power(base.run(v), power), base.plain)

    def _compared(self, node: ast.Compare) -> Node:
        parts = [self._number(part) for part in (node.left, *node.comparators)]
        checks = []
        for i, op in enumerate(node.ops):
            function = _COMPARISON.get(type(op))
            if function is None:
                raise self._expression.wrong(
                    node, "this comparison is not supported", "< <= > >= == !="
                )
            self._same(node.comparators[i], parts[i], parts[i + 1])
            checks.append((function, parts[i].run, parts[i + 1].run))
        return Node(
            "truth",
            None,
            lambda v: _folded(operator.and_, [f(a(v), b(v)) for f, a, b in checks]),
        )

    def _called(self, node: ast.Call) -> Node:
        name = node.func.id if isinstance(node.func, ast.Name) else None
        if name not in _CALLS or node.keywords:
            unknown = InputError.unknown("function", name or "?", _CALLS)
            raise self._located(node, unknown)
        least, most, function = _CALLS[name]
        parts = [self._number(argument) for argument in node.args]
        if not least <= len(parts) <= most:
            many = f"{least}" if least == most else f"{least} to {most}"
            raise self._expression.wrong(node, f"{name} takes {many} values")
        first = parts[0]
        measured, plain = first.dimension, all(part.plain for part in parts)
        for argument, part in zip(node.args[1:], parts[1:], strict=True):
            measured = self._same(argument, first._replace(dimension=measured), part)
        if name == "sqrt" and measured is not None:
            measured = measured.power(Fraction(1, 2))
        return Node("number", measured, lambda v: function(*(p.run(v) for p in parts)), plain)

    def _same(self, node: ast.expr, a: Node, b: Node) -> Dimension | None:
        """Return the common dimension of two parts."""
        if a.plain or a.dimension is None:
            return b.dimension
        if b.plain or b.dimension is None or _alike(a, b):
            return a.dimension
        raise self._expression.wrong(
            node,
            "the units are incompatible",
            f"both in {a.dimension}; one is in {b.dimension}",
        )


def _alike(a: Node, b: Node) -> bool:
    """Whether dimensions are equal, or an angle in the text meets a variable without radians."""
    if a.dimension == b.dimension or a.dimension is None or b.dimension is None:
        return True
    written, variable = (a, b) if a.literal is not None else (b, a)
    lenient = written.literal is not None and variable.dimension is not None
    return bool(
        lenient
        and variable.dimension
        and variable.dimension.angle == 0
        and written.dimension
        and written.dimension.without_angle() == variable.dimension
    )
