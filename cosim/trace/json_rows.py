"""JSON messages of other tools to columns.

Objects inside objects get dotted names, lists of at most `MAX_ITEMS` entries `name[0]`,
`name[1]`, ... A column is of the kind of all its values; where they are of several, numbers
become doubles and everything else text.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.trace.layout import Kind, Signal

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

MAX_ITEMS = 64
"""Longer lists are left out; they are pictures or point clouds, not signals."""
MAX_DEPTH = 8
_INT64 = range(-(2**63), 2**63)


def json_columns(
    payloads: Iterable[memoryview], count: int
) -> tuple[list[Signal], list[tuple[NDArray[Any], NDArray[np.bool_] | None]]]:
    """The signals that occur in `count` messages, in order of appearance; a column for each.

    Raises
    ------
    ValueError : a message is not JSON, or no object.
    """
    found: dict[str, dict[int, Any]] = {}
    for k, payload in enumerate(payloads):
        try:
            row = json.loads(bytes(payload))
        except (ValueError, RecursionError) as error:
            raise ValueError(f"row {k} is not JSON: {error}") from error
        if not isinstance(row, dict):
            raise ValueError(f"row {k} is no JSON object")  # noqa: TRY004 - of the file, not ours
        for name, value in _leaves(row, "", 0):
            found.setdefault(name, {})[k] = value
    signals, columns = [], []
    for name, values in found.items():
        kind = _kind(values.values())
        signals.append(Signal(name or "_", kind=kind))
        columns.append(_column(kind, values, count))
    return signals, columns


def _leaves(value: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict) and depth < MAX_DEPTH:
        for key, inner in value.items():
            yield from _leaves(inner, f"{name}.{key}" if name else key, depth + 1)
    elif isinstance(value, list) and depth < MAX_DEPTH:
        for i, inner in enumerate(value if len(value) <= MAX_ITEMS else ()):
            yield from _leaves(inner, f"{name}[{i}]", depth + 1)
    elif value is not None and not isinstance(value, dict | list):
        yield name, value


def _kind(values: Any) -> Kind:
    types = {type(value) for value in values}
    if types == {bool}:
        return "bool"
    if types == {int} and all(value in _INT64 for value in values):
        return "int"
    return "float" if types <= {int, float} else "string"


def _column(
    kind: Kind, values: dict[int, Any], count: int
) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    blanks: dict[Kind, tuple[Any, Any]] = {
        "float": (np.nan, np.float64),
        "int": (0, np.int64),
        "bool": (False, np.bool_),
        "string": ("", object),
    }
    blank, dtype = blanks[kind]
    column = np.full(count, blank, dtype)
    present = np.zeros(count, np.bool_)
    for k, value in values.items():
        column[k] = _as_text(value) if kind == "string" else _as_number(value)
        present[k] = True
    return column, None if present.all() else present


def _as_text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _as_number(value: float) -> float:
    try:
        float(value)
    except OverflowError:  # JSON has integers of any length
        return np.inf if value > 0 else -np.inf
    return value
