"""Turn JSON messages of other tools into columns.

Entries of nested objects get dotted names, those of lists of at most `MAX_ITEMS` the names
`name[0]`, `name[1]`, ... Values of different kinds in a column become doubles if all are numbers,
else text.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.trace.rows.hold import blanks
from cosim.trace.rows.layout import DTYPES, Kind, Signal

MAX_ITEMS = 64
"""Longer lists are left out: pictures or point clouds, no signals."""
MAX_DEPTH = 8
_INT64 = range(-(2**63), 2**63)


def json_columns(
    payloads: Iterable[memoryview], count: int
) -> tuple[list[Signal], list[tuple[NDArray[Any], NDArray[np.bool_]]]]:
    """Return the signals of `count` messages, and values and presence of each.

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
            raise ValueError(f"row {k} is no JSON object")  # noqa: TRY004 - a fault of the file
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
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    column, present = blanks(DTYPES[kind], count), np.zeros(count, np.bool_)
    for k, value in values.items():
        column[k] = _number(value) if kind != "string" else value
        if kind == "string" and not isinstance(value, str):
            column[k] = json.dumps(value)
        present[k] = True
    return column, present


def _number(value: float) -> float:
    try:
        float(value)
    except OverflowError:  # JSON has integers of any length
        return np.inf if value > 0 else -np.inf
    return value
