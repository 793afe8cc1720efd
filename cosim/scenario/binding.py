"""Bind a parsed expression to a scope: a function of the values of the names in it.

Dimensions are checked: terms that are added or compared must have the same one. A plain number
takes the SI unit of the other operand; a variable without a unit goes with every dimension.
What it says is recorded on a tape (`cosim.tape`), whose operations are carried out for signals at a
point or over a whole run and for numbers that a study sets, and are copied to the tape of a
component or of what the loop looks at.
"""

from __future__ import annotations

import ast
import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache, partial, reduce
from typing import Any, Literal, NamedTuple, Protocol

from cosim.core import ANGLE, NUMBER_ONLY, TIME, Dimension, InputError
from cosim.scenario.expression import Expression, ExpressionError, reference_of
from cosim.scenario.functions import (
    CONSTANTS,
    FUNCTIONS,
    LARGEST_EXPONENT,
    Apply,
    both,
    called,
    compared,
    either,
    opposite,
    power,
)
from cosim.tape import Scalar, Tape, compute, evaluate

Kind = Literal["truth", "number"]


def _unchanged(value: Any) -> Any:
    return value


class Meaning(NamedTuple):
    """Kind of a name, its dimension (None: unknown) and its conversion to SI."""

    kind: Kind
    dimension: Dimension | None
    to_si: Callable[[Any], Any] = _unchanged


class Scope(Protocol):
    """Resolves the names of expressions."""

    def meaning(self, reference: str) -> Meaning:
        """Return the meaning of `component.variable`; an `InputError` if it has none."""


class Node(NamedTuple):
    """A bound part of an expression.

    value : on the tape of the expression, or a number.
    plain : a number without a unit, which takes the unit of the other operand.
    literal : the value of a number written in the text.
    scaled : a product with a plain number, which may stand for one with a unit.
    """

    kind: Kind
    dimension: Dimension | None
    value: Scalar | float
    plain: bool = False
    literal: float | None = None
    scaled: bool = False


@dataclass(frozen=True)
class BoundExpression:
    """An expression that can be evaluated.

    Attributes
    ----------
    names : the names it depends on, in the order of its values; "t" is the time.
    tape : what it says, recorded; its symbols are the names.
    parts : by place on the tape, the part of the text that says the operation.
    faults : parts of numbers alone that have no value, and why.
    meanings : of the names.
    """

    expression: Expression
    names: tuple[str, ...]
    node: Node
    tape: Tape
    parts: Mapping[int, ast.expr]
    faults: Sequence[tuple[ast.expr, str]]
    meanings: Mapping[str, Meaning]

    def __reduce__(self) -> tuple[Callable[..., BoundExpression], tuple[Any, ...]]:
        """Pickle the text and the meanings of its names: all else follows from them."""
        return _bind_again, (self.expression.text, self.meanings, self.node.kind)

    def __call__(self, values: Sequence[Any]) -> Any:
        """Evaluate at the values of `names`, numbers or arrays; true or false of a condition."""
        given = dict(zip(self.names, values, strict=True))
        result = self._result(evaluate(self.tape.operations, given))
        return result if self.node.kind == "number" else result != 0.0

    def _result(self, found: Sequence[Any]) -> Any:
        """Return its value, of the values of the operations."""
        value = self.node.value
        return found[value.place] if isinstance(value, Scalar) else value

    def recorded(self, values: Sequence[Any], tape: Tape, *, raises: bool = False) -> Any:
        """Record it on a tape, at values of `names` there; a number where it depends on none.

        raises : where an operation on numbers has no value; else it has that of IEEE 754.

        Raises
        ------
        ExpressionError : says the column.
        """
        if raises:
            self._raise_fault()
        given = dict(zip(self.names, values, strict=True))
        found: list[Any] = []
        for place, one in enumerate(self.tape.operations):
            operands = [found[p] for p in one.operands]
            if one.name == "symbol":
                found.append(given[one.text])
            elif one.name == "constant":
                found.append(float(one.text))
            elif any(isinstance(x, Scalar) for x in operands):
                found.append(tape.apply(one.name, *operands))
            else:
                found.append(compute(one.name, *operands))
                why = _why_none(one.name, found[-1], operands) if raises else None
                if why is not None:
                    raise self._no_value(self.parts[place], why)
        return self._result(found)

    def number(self, **values: Any) -> float:
        """Return the number that it is at values of its names, given by name.

        Raises
        ------
        ExpressionError : it has no finite value there; says the column and the values.
        """
        at = ", ".join(f"{name} = {value!r}" for name, value in values.items())
        tree, wrong = self.expression.tree, self.expression.wrong
        try:
            if not all(isinstance(value, numbers.Real) for value in values.values()):
                raise wrong(tree, "no number", "numbers")
            self._raise_fault()
            given = {name: float(values[name]) for name in self.names}
            found = evaluate(self.tape.operations, given)
            for place, one in enumerate(self.tape.operations):
                why = _why_none(one.name, found[place], [found[p] for p in one.operands])
                if why is not None:
                    raise self._no_value(self.parts[place], why)
            number = float(self._result(found))
            if not math.isfinite(number):
                raise wrong(tree, f"the value is {number}", "a finite number")
        except OverflowError as error:
            raise wrong(tree, f"the value is out of range, {at}") from error
        except ExpressionError as error:
            error.what += f", {at}" if at else ""
            error.args = (error.text(),)
            raise
        return number

    def _raise_fault(self) -> None:
        for part, why in self.faults:
            raise self._no_value(part, why)

    def _no_value(self, part: ast.expr, why: str) -> ExpressionError:
        return self.expression.wrong(part, f"there is no value here ({why})")


_ALWAYS = {"+", "-", "*", "negate", "symbol", "constant"}
"""Operations that a fault is never counted at: what is too large for them is seen in the result."""


def _why_none(name: str, value: float, operands: Sequence[float]) -> str | None:
    """Return why an operation on finite numbers has no finite value; None if it has one."""
    if name in _ALWAYS or math.isfinite(value) or not all(map(math.isfinite, operands)):
        return None
    if name == "/" and operands[1] == 0.0:
        return "division by zero"
    if name == "pow" and math.isnan(value):
        return "root of a negative number"
    if name == "pow" and operands[0] == 0.0:
        return "negative power of zero"
    return "out of range" if name in ("/", "pow", "exp", "hypot") else "outside its domain"


def check_name(reference: str) -> None:
    """Refuse a name without a dot between component and variable."""
    if "." not in reference.strip("."):
        raise InputError(
            f"there is no name {reference!r}",
            expected="component.variable, as in plant.eta.z; t is the time",
            hint=f"the name of its component and a dot before it, as plant.{reference}",
        )


class AnyName:
    """A scope that accepts every name: only the form of an expression is checked."""

    def meaning(self, reference: str) -> Meaning:
        """Return a number of unknown dimension."""
        check_name(reference)
        return Meaning("number", None)


def bind(expression: Expression, scope: Scope, wanted: Kind | None = "truth") -> BoundExpression:
    """Bind the names of an expression and check its dimensions; `wanted` None: of either kind.

    Raises
    ------
    ExpressionError : an unknown name, an unsupported form, incompatible dimensions; says the
        column.
    """
    binder = _Binder(expression, scope)
    try:
        node = binder.visit(expression.tree)
    except RecursionError as error:
        raise ExpressionError("the expression is nested too deep", expression.text, 1) from error
    if (
        wanted is not None
        and node.kind != wanted
        and not (wanted == "truth" and isinstance(scope, AnyName))
    ):
        was = "a number" if node.kind == "number" else "a condition"
        raise expression.wrong(
            expression.tree,
            f"this is {was}",
            "something that is true or false, as in plant.eta.z > 5 m"
            if wanted == "truth"
            else "a number",
        )
    return BoundExpression(
        *(expression, tuple(binder.names), node, binder.tape, binder.parts, binder.faults),
        binder.meanings,
    )


@dataclass(frozen=True)
class Given:
    """A scope of numbers that are given by plain names, without time: the x of a study."""

    given: tuple[str, ...] = ()

    def meaning(self, reference: str) -> Meaning:
        """Return a number of unknown dimension; an `InputError` for another name."""
        if reference not in self.given:
            known = [*self.given, *CONSTANTS]
            raise InputError(
                f"there is no name {reference!r}", expected=f"{', '.join(known)}, numbers"
            )
        return Meaning("number", None)


@lru_cache(1024)
def formula(text: str, *names: str) -> BoundExpression:
    """Return the number that a text says, of these names alone; see `BoundExpression.number`.

    Raises
    ------
    ExpressionError : as `bind`.
    """
    return bind(Expression(text), Given(names), "number")


@dataclass(frozen=True)
class _KnownMeanings:
    """A scope of names whose meanings are known."""

    meanings: Mapping[str, Meaning]

    def meaning(self, reference: str) -> Meaning:
        return self.meanings[reference]


def _bind_again(text: str, meanings: Mapping[str, Meaning], kind: Kind) -> BoundExpression:
    return bind(Expression(text), _KnownMeanings(meanings), kind)


_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
}
_SIGNS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
}


class _Binder:
    def __init__(self, expression: Expression, scope: Scope) -> None:
        self._expression, self._scope = expression, scope
        self._lenient = isinstance(scope, AnyName)
        self.names: list[str] = []
        self.meanings: dict[str, Meaning] = {}
        self.tape = Tape()
        self.parts: dict[int, ast.expr] = {}
        self.faults: list[tuple[ast.expr, str]] = []

    def _at(self, node: ast.expr) -> Apply:
        """Return what records an operation that a part of the text says, or computes it."""

        def apply(name: str, *operands: Any) -> Any:
            if any(isinstance(x, Scalar) for x in operands):
                found = self.tape.apply(name, *operands)
                self.parts.setdefault(found.place, node)
                return found
            value = compute(name, *operands)
            why = _why_none(name, value, operands)
            if why is not None:
                self.faults.append((node, why))
            return value

        return apply

    def visit(self, node: ast.expr) -> Node:  # noqa: PLR0911 - one per form
        match node:
            case ast.Name() if node.id in self._expression.quantities:
                found = self._expression.quantities[node.id]
                return Node("number", found.dimension, found.si, literal=found.si)
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
            raise self._expression.wrong(
                node, "an expression cannot contain this value", "a number"
            )
        try:
            number = float(value)
        except OverflowError:
            number = float("inf")
        if number == float("inf"):
            raise self._expression.wrong(node, "this number is out of range")
        return self._plain(number)

    def _plain(self, number: float) -> Node:
        return Node("number", None, number, plain=True, literal=number)

    def _named(self, node: ast.expr) -> Node:
        reference = reference_of(node)
        if reference is None:
            raise self._expression.wrong(
                node,
                "an expression cannot contain this form",
                "names, numbers, + - * / **, comparisons, and, or, not, "
                + ", ".join(sorted(FUNCTIONS)),
            )
        if reference in CONSTANTS and isinstance(node, ast.Name):
            return self._plain(CONSTANTS[reference])
        if reference == "t" and not isinstance(self._scope, Given):
            meaning = Meaning("number", TIME)
        else:
            try:
                meaning = self._scope.meaning(reference)
            except InputError as error:
                raise self._located(node, error) from error
        self.meanings[reference] = meaning
        if reference not in self.names:
            self.names.append(reference)
        value = self.tape.symbol(reference)
        if meaning.kind == "truth":
            return Node("truth", None, compared(self._at(node), "!=", value, 0.0))
        return Node("number", meaning.dimension, meaning.to_si(value))

    def _located(self, node: ast.expr, error: InputError) -> ExpressionError:
        located = self._expression.wrong(node, error.what, error.expected)
        located.hint = error.hint
        located.args = (located.text(),)
        return located

    def _logical(self, node: ast.BoolOp) -> Node:
        parts = [self._truth(value).value for value in node.values]
        join = partial(both if isinstance(node.op, ast.And) else either, self._at(node))
        return Node("truth", None, reduce(join, parts))

    def _truth(self, node: ast.expr) -> Node:
        found = self.visit(node)
        if found.kind != "truth":
            if self._lenient and reference_of(node) is not None:
                return Node("truth", None, found.value)
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
            return Node("truth", None, opposite(self._at(node), inner.value))
        if isinstance(node.op, ast.Invert):
            raise self._expression.wrong(node, "an expression cannot contain this operator", "not")
        part = self._number(node.operand)
        if isinstance(node.op, ast.UAdd):
            return part
        literal = None if part.literal is None else -part.literal
        return part._replace(value=-part.value, literal=literal)

    def _arithmetic(self, node: ast.BinOp) -> Node:
        if isinstance(node.op, ast.Pow):
            return self._power(node)
        if type(node.op) not in _OPERATORS:
            wrong = self._expression.wrong
            raise wrong(node, "an expression cannot contain this operator", "+ - * / **")
        a, b = self._number(node.left), self._number(node.right)
        plain = a.plain and b.plain
        if isinstance(node.op, ast.Add | ast.Sub):
            measured, scaled = self._same(node, a, b), a.scaled and b.scaled
        else:
            measured = self._product(a, b, -1 if isinstance(node.op, ast.Div) else 1)
            scaled = a.plain or b.plain or a.scaled or b.scaled
        value = self._at(node)(_OPERATORS[type(node.op)], a.value, b.value)
        return Node("number", measured, value, plain, scaled=scaled)

    def _product(self, a: Node, b: Node, sign: int) -> Dimension | None:
        if a.plain and b.plain:
            return None
        one = NUMBER_ONLY if a.plain else a.dimension
        two = NUMBER_ONLY if b.plain else b.dimension
        return None if one is None or two is None else one * two.power(Fraction(sign))

    def _power(self, node: ast.BinOp) -> Node:
        base, exponent = self._number(node.left), self._number(node.right)
        literal = exponent.literal if exponent.plain else None
        known = literal is not None and abs(literal) <= LARGEST_EXPONENT
        bare = base.plain or base.dimension in (None, NUMBER_ONLY)
        if not known and not (
            bare and (exponent.plain or exponent.dimension in (None, NUMBER_ONLY))
        ):
            raise self._expression.wrong(
                node.right,
                "this exponent is not supported",
                f"a number from -{LARGEST_EXPONENT} to {LARGEST_EXPONENT} of what has a unit",
            )
        measured = base.dimension
        if measured is not None and literal is not None:
            measured = measured.power(Fraction(literal).limit_denominator(64))
        value = power(self._at(node), base.value, exponent.value)
        return Node("number", measured, value, base.plain and exponent.plain, scaled=base.scaled)

    def _compared(self, node: ast.Compare) -> Node:
        parts = [self._number(part) for part in (node.left, *node.comparators)]
        checks = []
        for i, op in enumerate(node.ops):
            sign = _SIGNS.get(type(op))
            if sign is None:
                raise self._expression.wrong(
                    node, "this comparison is not supported", " ".join(_SIGNS.values())
                )
            self._same(node.comparators[i], parts[i], parts[i + 1])
            checks.append(compared(self._at(node), sign, parts[i].value, parts[i + 1].value))
        return Node("truth", None, reduce(partial(both, self._at(node)), checks))

    def _called(self, node: ast.Call) -> Node:
        name = node.func.id if isinstance(node.func, ast.Name) else None
        if name not in FUNCTIONS or node.keywords:
            unknown = InputError.unknown("function", name or "?", FUNCTIONS)
            raise self._located(node, unknown)
        least, most, rule = FUNCTIONS[name]
        parts = [self._number(argument) for argument in node.args]
        if not least <= len(parts) <= most:
            many = f"{least}" if least == most else f"{least} to {most}"
            raise self._expression.wrong(node, f"{name} takes {many} values")
        plain = all(part.plain for part in parts)
        measured = None if plain else NUMBER_ONLY
        if rule in ("of angle", "plain"):
            for argument, part in zip(node.args, parts, strict=True):
                self._number_like(argument, part, name, angle=rule == "of angle")
        else:
            common = parts[0].dimension
            for argument, part in zip(node.args[1:], parts[1:], strict=True):
                common = self._same(argument, parts[0]._replace(dimension=common), part)
            if rule == "to angle":
                if len(parts) == 1:
                    self._number_like(node.args[0], parts[0], name, angle=False)
                measured, plain = ANGLE, False
            else:
                root = rule == "root" and common is not None
                measured = common.power(Fraction(1, 2)) if root and common else common
        value = called(self._at(node), name, *(part.value for part in parts))
        return Node("number", measured, value, plain, scaled=any(p.scaled for p in parts))

    def _number_like(self, node: ast.expr, part: Node, name: str, *, angle: bool) -> None:
        """Refuse an argument with a unit, an angle apart where one is taken.

        A product with a plain number passes, as in sin(0.5 * t): the number may be 0.5 rad/s.
        """
        known = part.dimension
        if known is None or part.plain or part.scaled or known == NUMBER_ONLY:
            return
        if not (angle and known == ANGLE):
            raise self._expression.wrong(
                node,
                f"{name} takes {'an angle' if angle else 'a number without unit'}",
                f"{'an angle or ' if angle else ''}a number; this is in {known}: divide by a unit",
            )

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
