"""Write a `Tape` as C, in recorded order; values that are used more than once get a name."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence

from cosim.tape.record import FIXED, VARYING, Scalar, Tape, required_places

_CALLS = {"pow": "power", "min": "lesser", "max": "greater", "abs": "fabs"}
"""Operation -> function of c/arithmetic.h or of C, where their names differ."""

_SUM, _PRODUCT, _SIGN, _ATOM = 1, 2, 3, 4
_BINDS = {"+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "negate": _SIGN}
_LONGEST = 160  # characters; a longer expression gets a name


def run_constants(tape: Tape, roots: Iterable[Scalar]) -> list[int]:
    """Return the places to compute once per run: parameters alone decide them, others use them."""
    places = [root.place for root in roots]
    needed = {p for p in places if _is_run_constant(tape, p)}
    for place in required_places(tape, places):
        if tape.operations[place].level == VARYING:
            needed.update(p for p in tape.operations[place].operands if _is_run_constant(tape, p))
    return sorted(needed)


def _is_run_constant(tape: Tape, place: int) -> bool:
    one = tape.operations[place]
    return one.level == FIXED and bool(one.operands)


def statements(
    tape: Tape, targets: Sequence[tuple[str, Scalar]], known: Mapping[int, str] | None = None
) -> str:
    """Return indented C statements that assign the targets; `known` places have a name already."""
    known = known or {}
    places = required_places(tape, [value.place for _, value in targets], known)
    uses = dict.fromkeys(places, 0)
    for place in places:
        if place not in known:
            for operand in tape.operations[place].operands:
                uses[operand] += 1
    for _, value in targets:
        uses[value.place] += 1
    lines: list[str] = []
    text: dict[int, tuple[str, int]] = {}
    for place in places:
        one = tape.operations[place]
        if place in known:
            text[place] = known[place], _ATOM
            continue
        text[place] = _expression(one.name, one.text, [text[p] for p in one.operands])
        if one.operands and (uses[place] > 1 or len(text[place][0]) > _LONGEST):
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
