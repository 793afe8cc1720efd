"""Arithmetic expressions of one variable x: what an axis sets each of its places to."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable
from typing import Any, Final

from cosim.core import InputError

_BINARY: Final[dict[type[ast.operator], Callable[[float, float], float]]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}
_UNARY: Final[dict[type[ast.unaryop], Callable[[float], float]]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
}
_CALLS: Final[dict[str, Callable[..., float]]] = {
    **{name: getattr(math, name) for name in ("sqrt", "exp", "log", "sin", "cos", "tan", "floor")},
    "abs": abs,
    "min": min,
    "max": max,
    "round": round,
}
_NAMES: Final = {"pi": math.pi, "e": math.e}
_LONGEST = 200


class Expression:
    """An expression such as `0.5 * x + 0.01`: numbers, x, pi, e, + - * / **, usual functions.

    Raises
    ------
    InputError : the text is not such an expression.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        try:
            if len(text) > _LONGEST:
                raise SyntaxError  # noqa: TRY301 - refused like any other
            tree = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise self._refused() from error
        self._check(tree)
        self._tree = tree

    def __call__(self, x: Any) -> float:
        """Return the value at x.

        Raises
        ------
        InputError : x is not a number, or there is no finite value.
        """
        try:
            value = float(self._value(self._tree, x))
        except (TypeError, ValueError, ArithmeticError) as error:
            raise self._refused(f"no value at x = {x!r} ({error})") from error
        if not math.isfinite(value):
            raise self._refused(f"{value} at x = {x!r}")
        return value

    def _check(self, node: ast.AST) -> None:
        match node:
            case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
                return
            case ast.Name(id=name) if name == "x" or name in _NAMES:
                return
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                self._check(left)
                self._check(right)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                self._check(operand)
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if name in _CALLS:
                for argument in args:
                    self._check(argument)
            case _:
                raise self._refused()

    def _value(self, node: ast.AST, x: Any) -> Any:
        match node:
            case ast.Constant(value=value):
                return float(value) if isinstance(value, int) else value
            case ast.Name(id=name):
                return x if name == "x" else _NAMES[name]
            case ast.BinOp(left=left, op=op, right=right):
                return _BINARY[type(op)](self._value(left, x), self._value(right, x))
            case ast.UnaryOp(op=op, operand=operand):
                return _UNARY[type(op)](self._value(operand, x))
            case ast.Call(func=ast.Name(id=name), args=args):
                return _CALLS[name](*(self._value(a, x) for a in args))
        raise self._refused()

    def _refused(self, got: str | None = None) -> InputError:
        return InputError(
            "not an expression of x",
            where=self.text[:_LONGEST],
            expected=f"numbers, x, pi, e, + - * / ** and {', '.join(sorted(_CALLS))}",
            got=got or repr(self.text[:_LONGEST]),
        )
