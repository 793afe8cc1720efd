"""Write link_step.h: the steps of a link as C, translated from `cosim.network.stepping`.

The steps decide on values, which a `Tape` cannot record, and use no more of Python than integers,
comparisons, `max` and `if`: their source is translated statement by statement.
"""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, get_args, get_type_hints

from cosim.network import Order, stepping

_HEAD = """/* What becomes of a message of a link: the sender's queue, the channel, the receiver.
   Translated, statement by statement, from cosim/network/stepping.py. */

#ifndef LINK_STEP_H
#define LINK_STEP_H

#include <stdint.h>
"""
_MAX = "static inline int64_t link_max(int64_t a, int64_t b) { return b > a ? b : a; }"
_OPERATORS: dict[type, str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.And: "&&",
    ast.Or: "||",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
}


@cache
def link_step_header() -> str:
    """Return the text of link_step.h.

    Each step is a function of pointers to its arguments; a class of them is a struct.
    """
    shapes: dict[str, Any] = {}
    functions = [_function(step, shapes) for step in (stepping.send, stepping.receive)]
    codes = {name: value for name, value in vars(stepping).items() if isinstance(value, int)}
    lines = [_HEAD, *(f"#define LINK_{name} INT64_C({code})" for name, code in codes.items())]
    lines += [
        f"#define ORDER_{order.upper().replace('-', '_')} {number}"
        for number, order in enumerate(get_args(Order))
    ]
    for name, of in shapes.items():
        lines.append(f"\ntypedef struct {{\n    int64_t {', '.join(of._fields)};\n}} Link{name};")
        if of._field_defaults:
            values = ", ".join(f"INT64_C({value})" for value in of._field_defaults.values())
            lines.append(f"#define LINK_{name.upper()}_AT_FIRST {{{values}}}")
    return "\n".join([*lines, "", _MAX, *functions, "", "#endif", ""])


def _function(step: Callable[..., Any], shapes: dict[str, Any]) -> str:
    """Translate a step; add the classes it takes and returns to `shapes`."""
    hints = get_type_hints(step)
    result = hints.pop("return")
    arguments = []
    for name, hint in hints.items():
        of = (*get_args(hint), hint)[0]  # of a state and what a step makes of it, the state
        shapes[of.__name__] = of
        arguments.append(f"const Link{of.__name__} *{name}")
    shapes[result.__name__] = result
    head = f"\nstatic inline Link{result.__name__} link_{step.__name__}("
    signature = head + (",\n" + " " * (len(head) - 1)).join(arguments) + ") {"
    nodes = ast.parse(textwrap.dedent(inspect.getsource(step))).body[0].body  # type: ignore[attr-defined]
    stores = [n for part in nodes for n in ast.walk(part) if isinstance(n, ast.Name)]
    names = dict.fromkeys(n.id for n in stores if isinstance(n.ctx, ast.Store))
    body = [f"int64_t {', '.join(names)};"] if names else []
    body += _statements(nodes, {*names})
    return "\n".join([signature, *(textwrap.indent(line, "    ") for line in body), "}"])


def _statements(nodes: list[ast.stmt], names: set[str]) -> Iterator[str]:
    """Yield the lines of statements, indented within; `names` are the local variables."""
    for node in nodes:
        match node:
            case ast.Expr(value=ast.Constant(value=str())):
                continue  # the docstring
            case ast.Assign(targets=[ast.Name(id=name)], value=value):
                yield f"{name} = {_alone(value, names)};"
            case ast.If(test=test, body=body, orelse=orelse):
                yield f"if ({_alone(test, names)}) {{"
                yield from _inside(body, names)
                if orelse:
                    yield "} else {"
                    yield from _inside(orelse, names)
                yield "}"
            case ast.Return(value=ast.Call(func=ast.Name(id=shape), args=args, keywords=[])):
                values = ", ".join(_alone(arg, names) for arg in args)
                line = f"return (Link{shape}){{{values}}};"
                yield textwrap.fill(line, 90, subsequent_indent="    ")
            case _:
                raise _untranslatable(node)


def _inside(nodes: list[ast.stmt], names: set[str]) -> Iterator[str]:
    for line in _statements(nodes, names):
        yield textwrap.indent(line, "    ")


def _alone(node: ast.expr, names: set[str]) -> str:
    """Return an expression that needs no parentheses around it."""
    text = _expression(node, names)
    return text[1:-1] if text.startswith("(") else text


def _expression(node: ast.expr, names: set[str]) -> str:
    """Return an expression, in parentheses unless it is a single word or call."""
    operands: list[ast.expr] = []
    match node:
        case ast.Constant(value=int() as value):
            text = f"INT64_C({value})"
        case ast.Name(id=name) if name in names:
            text = name
        case ast.Name(id=name) if isinstance(getattr(stepping, name, None), int):
            text = f"LINK_{name}"
        case ast.Attribute(value=ast.Name(id=name), attr=attribute):
            text = f"{name}->{attribute}"
        case ast.Call(func=ast.Name(id="max"), args=[a, b], keywords=[]):
            text = f"link_max({_alone(a, names)}, {_alone(b, names)})"
        case ast.IfExp(test=a, body=b, orelse=c):
            yes, no = _expression(b, names), _expression(c, names)
            text = f"({_expression(a, names)} ? {yes} : {no})"
        case (
            ast.BinOp(left=a, op=operator, right=b)
            | ast.Compare(left=a, ops=[operator], comparators=[b])
        ) if type(operator) in _OPERATORS:
            operands = [a, b]
        case ast.BoolOp(op=operator, values=operands):
            pass
        case _:
            raise _untranslatable(node)
    if operands:
        parts = [_expression(part, names) for part in operands]
        text = f"({f' {_OPERATORS[type(operator)]} '.join(parts)})"
    return text


def _untranslatable(node: ast.AST) -> TypeError:
    return TypeError(f"a step of a link has no C for: {ast.unparse(node)}")
