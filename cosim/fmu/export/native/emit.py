"""Write a `Tape` as C, in recorded order; values that are used more than once get a name."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence

from cosim.fmu.export.native.tape import FIXED, VARYING, Scalar, Tape

_CALLS = {"pow": "power", "min": "lesser", "max": "greater", "abs": "fabs"}
"""Operation -> function of c/arithmetic.h or of C, where their names differ."""

_SUM, _PRODUCT, _SIGN, _ATOM = 1, 2, 3, 4
_BINDS = {"+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "negate": _SIGN}
_LONGEST = 160  # characters; a longer expression gets a name


def required_places(tape: Tape, roots: Iterable[int], known: Mapping[int, str]) -> list[int]:
    """Return the places to compute for `roots`, in order; `known` ones need no operands."""
    found: set[int] = set()
    ahead = list(roots)
    while ahead:
        place = ahead.pop()
        if place not in found:
            found.add(place)
            if place not in known:
                ahead.extend(tape.nodes[place].operands)
    return sorted(found)


def run_constants(tape: Tape, roots: Iterable[Scalar]) -> list[int]:
    """Return the places to compute once per run: parameters alone decide them, others use them."""
    places = [root.place for root in roots]
    needed = {p for p in places if _is_run_constant(tape, p)}
    for place in required_places(tape, places, {}):
        if tape.nodes[place].level == VARYING:
            needed.update(p for p in tape.nodes[place].operands if _is_run_constant(tape, p))
    return sorted(needed)


def _is_run_constant(tape: Tape, place: int) -> bool:
    node = tape.nodes[place]
    return node.level == FIXED and bool(node.operands)


def statements(
    tape: Tape, targets: Sequence[tuple[str, Scalar]], known: Mapping[int, str] | None = None
) -> str:
    """Return indented C statements that assign the targets; `known` places have a name already."""
    known = known or {}
    places = required_places(tape, [value.place for _, value in targets], known)
    uses = dict.fromkeys(places, 0)
    for place in places:
        if place not in known:
            for operand in tape.nodes[place].operands:
                uses[operand] += 1
    for _, value in targets:
        uses[value.place] += 1
    lines: list[str] = []
    text: dict[int, tuple[str, int]] = {}
    for place in places:
        node = tape.nodes[place]
        if place in known:
            text[place] = known[place], _ATOM
            continue
        text[place] = _expression(node.operation, node.text, [text[p] for p in node.operands])
        if node.operands and (uses[place] > 1 or len(text[place][0]) > _LONGEST):
            lines.append(f"const double t{place} = {text[place][0]};")
            text[place] = f"t{place}", _ATOM
    lines += [f"{target} = {text[value.place][0]};" for target, value in targets]
    return "".join(
        textwrap.fill(
            line,
            width=100,
            initial_indent="    ",
            subsequent_indent="        ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        + "\n"
        for line in lines
    )


def _expression(operation: str, text: str, operands: list[tuple[str, int]]) -> tuple[str, int]:
    if operation in ("symbol", "constant"):
        return text, _SIGN if text.startswith("-") else _ATOM
    binds = _BINDS.get(operation)
    if binds is None:
        arguments = ", ".join(argument for argument, _ in operands)
        return f"{_CALLS.get(operation, operation)}({arguments})", _ATOM
    if operation == "negate":
        inner, inner_binds = operands[0]
        return f"-({inner})" if inner_binds <= binds else f"-{inner}", binds
    (left, left_binds), (right, right_binds) = operands
    left = f"({left})" if left_binds < binds else left
    right = f"({right})" if right_binds <= binds else right  # a - (b - c), a + (b + c)
    return f"{left} {operation} {right}", binds
