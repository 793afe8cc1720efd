"""Unknowns of inequalities as JSON, exact numbers as "p/q": their names follow from the theorem.

A matrix or number has its own name, those of each delay are a list, null where there is none:

    {"P": [["p/q", ...]], "Q": [[["p/q", ...]], null], "eps": "p/q", "gamma": "p/q"}

eps has one number per block of F: one stands for itself, none is null.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from cosim.core import InputError, format_value
from cosim.hinf.exact import from_text, matrix_from_text, matrix_to_text, to_text

if TYPE_CHECKING:
    from cosim.hinf.theorems import Shape

Counts = Mapping[str, int | None]
"""Unknowns by name, and how many of each there are: name[0], name[1], ..; None: itself."""

_BLOCKS = ("eps", "eps_out")
"""One number per block of F: one stands for itself, none is null."""


def counts_of(first: str, delays: int, blocks: int) -> Counts:
    """Return the counts of a functional's unknowns: `first`, Q, R of each delay, eps, gamma."""
    return {first: None, "Q": delays, "R": delays, "eps": blocks, "gamma": None}


def unknowns_to_json(unknowns: Mapping[str, Any], counts: Counts) -> dict[str, Any]:
    """Return the JSON values that `unknowns_from_json` reads; null where there is none."""
    table: dict[str, Any] = {}
    for name, count in counts.items():
        if count is None:
            table[name] = _to_json(unknowns.get(name))
            continue
        each = [_to_json(unknowns.get(f"{name}[{i}]")) for i in range(count)]
        alone = name in _BLOCKS and count < 2
        table[name] = (each[0] if each else None) if alone else each
    return table


def blocks_in(unknowns: Mapping[str, Any]) -> int:
    """Return how many blocks of F unknowns have a number for."""
    return sum(name.startswith("eps[") for name in unknowns)


def _to_json(value: Any) -> Any:
    if value is None:
        return None
    return matrix_to_text(value) if hasattr(value, "nrows") else to_text(value)


def unknowns_from_json(
    data: Mapping[str, Any], shapes: Mapping[str, Shape], counts: Counts, where: str
) -> dict[str, Any]:
    """Read the unknowns of these shapes; messages name `where`.

    Raises
    ------
    InputError : a wrong length or shape, a text that is no number, or a value where there is none.
    """
    unknowns: dict[str, Any] = {}
    for name, count in counts.items():
        place = f"{where}.{name}"
        each = {name: (data[name], place)}
        if count == 1 and name in _BLOCKS:
            each = {f"{name}[0]": (data[name], place)}
        elif count is not None and (count or name not in _BLOCKS):
            what = f"not one per {'block of F' if name in _BLOCKS else 'delay'}"
            values = list_of(data[name], count, place, what)
            each = {f"{name}[{i}]": (value, f"{place}[{i}]") for i, value in enumerate(values)}
        for key, (value, at) in each.items():
            shape = shapes.get(key)
            check_null(value, at, expected=shape is None)
            if shape is not None:
                unknowns[key] = (
                    from_text(value, at)
                    if shape.is_number
                    else matrix_from_text(value, at, shape.height, shape.width)
                )
    return unknowns


def list_of(data: Any, count: int, where: str, what: str) -> list[Any]:
    """Return a list of so many; an `InputError` that says `what` for anything else."""
    if not isinstance(data, list) or len(data) != count:
        raise InputError(what, where=where, expected=f"a list of {count}", got=format_value(data))
    return data


def check_null(value: Any, where: str, *, expected: bool) -> None:
    """Refuse a value where null is `expected`, and null where a value is.

    Raises
    ------
    InputError : naming `where`.
    """
    if (value is None) != expected:
        raise InputError(
            "does not fit the system",
            where=where,
            expected="null" if expected else "a value",
            got=format_value(value),
        )


def numbers_from_json(data: Any, count: int, where: str) -> tuple[Any, ...]:
    """Read a list of so many "p/q" as `fmpq`.

    Raises
    ------
    InputError : another length, a text that is no number.
    """
    values = list_of(data, count, where, "wrong length")
    return tuple(from_text(x, f"{where}[{i}]") for i, x in enumerate(values))


def numbers_to_json(values: tuple[Any, ...]) -> list[str]:
    """Return what `numbers_from_json` reads."""
    return [to_text(value) for value in values]
