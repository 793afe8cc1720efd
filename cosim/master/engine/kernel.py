"""The inner loop in machine code: numba over the addresses of the FMUs' functions.

An address is called through an intrinsic that turns an integer into a function pointer, so
that no address becomes part of the compiled code: it is compiled once, and kept on disk.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

CALL_FIELDS = 9
"""Columns of a table of calls: function, component, references, count, column, scratch,
table, own, station."""
FUNCTION, COMPONENT, REFERENCES, COUNT, COLUMN, SCRATCH, TABLE, OWN, STATION = range(CALL_FIELDS)
GET, SET, STEP, RANGE, NOTHING = range(5)
"""What may end a stretch."""
MOVE_FIELDS = 6
"""Columns of a table of moves: table, weight, first, last (of the pairs of columns),
quantized, substituted."""

_INT32, _INT64, _DOUBLE = ir.IntType(32), ir.IntType(64), ir.DoubleType()


@intrinsic  # type: ignore[untyped-decorator]
def _exchange(
    _typing: Any, function: Any, component: Any, references: Any, count: Any, values: Any
) -> Any:
    """fmi2Get... or fmi2Set... at an address."""
    del function, component, references, count, values
    signature = types.int32(*[types.int64] * 5)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT32, [_INT64] * 4)
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def _do_step(_typing: Any, function: Any, component: Any, now: Any, size: Any) -> Any:
    """fmi2DoStep at an address, noSetFMUStatePriorToCurrentPoint true."""
    del function, component, now, size
    signature = types.int32(types.int64, types.int64, types.float64, types.float64)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT32, [_INT64, _DOUBLE, _DOUBLE, _INT32])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        return builder.call(function, [*arguments[1:], ir.Constant(_INT32, 1)])

    return signature, generate


@njit(cache=True)  # type: ignore[untyped-decorator]
def _get(call: Any, k: int, rows: Any, row: int, scratch: Any) -> int:
    """Read a group into row k."""
    at = call[SCRATCH]
    values = row + 8 * call[COLUMN] if at < 0 else scratch.ctypes.data + 4 * at
    status = _exchange(call[FUNCTION], call[COMPONENT], call[REFERENCES], call[COUNT], values)
    if at >= 0:
        for j in range(call[COUNT]):
            rows[k, call[COLUMN] + j] = scratch[at + j]
    return int(status)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _set(call: Any, k: int, rows: Any, base: int, stride: int, tables: Any, scratch: Any) -> int:
    """Set a group from row k, or from the sender's row in use."""
    at = call[SCRATCH]
    if at >= 0:
        for j in range(call[COUNT]):
            scratch[at + j] = np.int32(rows[k, call[COLUMN] + j])
        values = scratch.ctypes.data + 4 * at
    elif call[TABLE] < 0:
        values = base + k * stride + 8 * call[COLUMN]
    else:
        used = tables[call[TABLE], k]
        if used >= 0:
            values = base + used * stride + 8 * call[COLUMN]
        else:
            values = base + k * stride + 8 * call[OWN]
    return int(_exchange(call[FUNCTION], call[COMPONENT], call[REFERENCES], call[COUNT], values))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _move(
    move: Any, k: int, rows: Any, tables: Any, weights: Any, pairs: Any, numbers: Any
) -> None:
    """As `PythonEngine._move`, operation by operation."""
    used = tables[move[0], k]
    if used >= 0:
        share = weights[move[1], k] if move[1] >= 0 else 0.0
        step = numbers[move[4]] if move[4] >= 0 else 0.0
        for j in range(move[2], move[3]):
            value = rows[used, pairs[j, 0]]
            if share > 0.0:
                value = (1.0 - share) * value + share * rows[used + 1, pairs[j, 0]]
            if step != 0.0:
                value = np.rint(value / step) * step
            rows[k, pairs[j, 1]] = value
    elif used == -2 and move[5] >= 0:
        for j in range(move[2], move[3]):
            rows[k, pairs[j, 1]] = numbers[move[5]]


@njit(cache=True)  # type: ignore[untyped-decorator]
def advance(  # noqa: C901, PLR0912 - what happens at a point, in one place
    first: int,
    last: int,
    place: Any,
    rows: Any,
    points: Any,
    seconds: Any,
    sends: Any,
    parts: Any,
    moves: Any,
    sets: Any,
    gets: Any,
    steps: Any,
    tables: Any,
    weights: Any,
    pairs: Any,
    numbers: Any,
    scratch: Any,
    outputs: int,
    bound: float,
) -> tuple[int, int, int, int, int]:
    """Exchange at the points first to last - 1, and step from each but the run's last.

    `place` is kept at (point, whether its row is complete) for whoever is called back. `parts`
    has a row per station: where its moves, its sets and its gets begin and end.

    Returns
    -------
    point, complete rows, what ended it (GET, SET, STEP: a call that was refused; RANGE: an output
    out of it; NOTHING), station (or column of the output), status of the call.
    """
    base, stride = rows.ctypes.data, rows.strides[0]
    end = points.size - 1
    for k in range(first, last):
        place[0], place[1] = k, 0
        row = base + k * stride
        for i in range(sends.shape[0]):
            status = _get(sends[i], k, rows, row, scratch)
            if status > 1:
                return k, k, GET, sends[i, STATION], status
        for p in range(parts.shape[0]):
            for i in range(parts[p, 0], parts[p, 1]):
                _move(moves[i], k, rows, tables, weights, pairs, numbers)
            for i in range(parts[p, 2], parts[p, 3]):
                status = _set(sets[i], k, rows, base, stride, tables, scratch)
                if status > 1:
                    return k, k, SET, sets[i, STATION], status
            for i in range(parts[p, 4], parts[p, 5]):
                status = _get(gets[i], k, rows, row, scratch)
                if status > 1:
                    return k, k, GET, gets[i, STATION], status
        outside = 0
        for j in range(outputs):
            outside += not abs(rows[k, j]) <= bound  # NaN is in no range
        if outside > 0:
            for j in range(outputs):
                if not abs(rows[k, j]) <= bound:
                    return k, k + 1, RANGE, j, 0
        if k == end:
            break
        place[1] = 1
        now, size = seconds[k], (points[k + 1] - points[k]) / 1e9
        for i in range(steps.shape[0]):
            status = _do_step(steps[i, 1], steps[i, 2], now, size)
            if status > 1:
                return k, k + 1, STEP, steps[i, 0], status
    return last, last, NOTHING, 0, 0
