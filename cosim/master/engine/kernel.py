"""The inner loop in machine code: numba over the addresses of the FMUs' functions.

Operations are the lines of a table of integers and are read by address: a view of an array per
call would cost more than the call.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from cosim.master.engine.calls import byte, exchange_2, exchange_3, load, step_2, step_3
from cosim.master.engine.program import ENDED
from cosim.master.exchange import TOO_LARGE, WARNING

(
    KIND,
    FUNCTION,
    COMPONENT,
    REFERENCES,
    COUNT,
    OFFSET,
    OWN,
    TABLE,
    POINTS_ROW,
    AHEAD,
    VALUES,
    TYPE,
    SCRATCH,
    WAY,
    RESULTS,
) = range(15)
"""Columns of the table of operations; those that most runs need come first, in one cache line.
OFFSET and OWN in bytes; SCRATCH in elements of 8 bytes; TABLE is the address of a table of rows, 0
for none, of a move its number; COUNT of a step is whether it is final, of an adjustment the number
of its factor."""
FIELDS = 16
(
    EXCHANGE,
    LATE,
    STEP,
    COMPLETE,
    STEP_2,
    STEP_3,
    EXCHANGE_2,
    EXCHANGE_3,
    TYPED,
    MOVE,
    ADJUST,
) = range(11)
"""KIND: what an operation is. The first three are what most runs consist of: doubles, in FMI 2.0,
at every point, into or from row k, or, late, from the row that a table names. _2 and _3 are
the same in general, by version of FMI."""
TYPES = ("f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
"""TYPE of the values of a typed exchange."""
MOVE_FIELDS = 7
"""Columns of a table of moves: table, after, weight, first, last (of the pairs of columns),
quantized, substituted."""
GET, SET = range(2)
"""WAY of a typed exchange."""
NOTHING, RANGE = -1, -2
"""Instead of the number of a refused operation: there is none; an output is out of range."""
_BLOCK = 1 << 13
"""Bytes of rows after which the range is checked: few enough to be still in the cache."""


@njit(cache=True)  # type: ignore[untyped-decorator]
def _field(operation: int, field: int) -> int:
    return int(load(operation + 8 * field))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _late(p: int, k: int, base: int, stride: int) -> int:
    """Return the address of the values in the row that a table names, or in the own row."""
    used = load(_field(p, TABLE) + 8 * k)
    if used >= 0:
        return int(base + used * stride + _field(p, OFFSET))
    return int(base + k * stride + _field(p, OWN))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _get_or_set_2(p: int, target: int) -> int:
    return int(
        exchange_2(
            _field(p, FUNCTION),
            _field(p, COMPONENT),
            _field(p, REFERENCES),
            _field(p, COUNT),
            target,
        )
    )


@njit(cache=True)  # type: ignore[untyped-decorator]
def _get_or_set_3(p: int, target: int) -> int:
    return int(
        exchange_3(
            _field(p, FUNCTION),
            _field(p, COMPONENT),
            _field(p, REFERENCES),
            _field(p, COUNT),
            target,
            _field(p, VALUES),
        )
    )


@njit(cache=True)  # type: ignore[untyped-decorator]
def _do_step_2(p: int, now: float, size: float) -> int:
    final = np.int32(_field(p, COUNT))
    return int(step_2(_field(p, FUNCTION), _field(p, COMPONENT), now, size, final))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _do_step_3(p: int, now: float, size: float) -> int:
    results, final = _field(p, RESULTS), np.int32(_field(p, COUNT))
    status = step_3(_field(p, FUNCTION), _field(p, COMPONENT), now, size, final, results)
    if status <= WARNING and byte(results + 1) != 0:
        return ENDED
    return int(status)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _into_scratch(kind: int, at: int, n: int, scratch: Any, row: Any, column: int) -> None:
    """Convert doubles of a row to values of a type; `scratch`: one view of a buffer per type."""
    f4, i1, u1, i2, u2, i4, u4, i8, u8 = scratch
    for j in range(n):
        value = row[column + j]
        if kind == 0:
            f4[2 * at + j] = np.float32(value)
        elif kind == 1:
            i1[8 * at + j] = np.int8(value)
        elif kind == 2:
            u1[8 * at + j] = np.uint8(value)
        elif kind == 3:
            i2[4 * at + j] = np.int16(value)
        elif kind == 4:
            u2[4 * at + j] = np.uint16(value)
        elif kind == 5:
            i4[2 * at + j] = np.int32(value)
        elif kind == 6:
            u4[2 * at + j] = np.uint32(value)
        elif kind == 7:
            i8[at + j] = np.int64(value)
        else:
            u8[at + j] = np.uint64(value)


@njit(cache=True)  # type: ignore[untyped-decorator]
def _from_scratch(kind: int, at: int, n: int, scratch: Any, row: Any, column: int) -> bool:
    """Convert values of a type to doubles of a row; false if one is not exact."""
    f4, i1, u1, i2, u2, i4, u4, i8, u8 = scratch
    exact = True
    for j in range(n):
        if kind == 0:
            value = np.float64(f4[2 * at + j])
        elif kind == 1:
            value = np.float64(i1[8 * at + j])
        elif kind == 2:
            value = np.float64(u1[8 * at + j])
        elif kind == 3:
            value = np.float64(i2[4 * at + j])
        elif kind == 4:
            value = np.float64(u2[4 * at + j])
        elif kind == 5:
            value = np.float64(i4[2 * at + j])
        elif kind == 6:
            value = np.float64(u4[2 * at + j])
        elif kind == 7:
            whole = i8[at + j]
            exact = exact and -(2**53) <= whole <= 2**53
            value = np.float64(whole)
        else:
            positive = u8[at + j]
            exact = exact and positive <= np.uint64(2**53)
            value = np.float64(positive)
        row[column + j] = value
    return exact


@njit(cache=True)  # type: ignore[untyped-decorator]
def _typed(p: int, k: int, rows: Any, scratch: Any) -> int:
    """Execute a get or set of values other than doubles."""
    at, column, n = _field(p, SCRATCH), _field(p, OFFSET) // 8, _field(p, VALUES)
    kind = _field(p, TYPE)
    values = scratch[8].ctypes.data + 8 * at
    if _field(p, WAY) == SET:
        _into_scratch(kind, at, n, scratch, rows[k], column)
    newer = _field(p, RESULTS) != 0
    status = _get_or_set_3(p, values) if newer else _get_or_set_2(p, values)
    exact = True
    if _field(p, WAY) == GET:
        exact = _from_scratch(kind, at, n, scratch, rows[k], column)
    return status if exact or status > WARNING else TOO_LARGE


@njit(cache=True)  # type: ignore[untyped-decorator]
def _move(
    move: Any, k: int, rows: Any, tables: Any, weights: Any, pairs: Any, numbers: Any
) -> None:
    """Copy the values of a route to the inputs, as `mover` in `generated_code` does."""
    used = tables[move[0], k]
    if used >= 0:
        share = weights[move[2], k] if move[2] >= 0 else 0.0
        after = tables[move[1], k] if move[1] >= 0 else used
        step = numbers[move[5]] if move[5] >= 0 else 0.0
        for j in range(move[3], move[4]):
            value = rows[used, pairs[j, 0]]
            if share > 0.0:
                value = (1.0 - share) * value + share * rows[after, pairs[j, 0]]
            if step != 0.0:
                value = np.rint(value / step) * step
            rows[k, pairs[j, 1]] = value
    elif used == -2 and move[6] >= 0:
        for j in range(move[3], move[4]):
            rows[k, pairs[j, 1]] = numbers[move[6]]


@njit(cache=True)  # type: ignore[untyped-decorator]
def _adjust(p: int, k: int, rows: Any, numbers: Any) -> None:
    factor, offset = numbers[_field(p, COUNT)], numbers[_field(p, COUNT) + 1]
    column = _field(p, OFFSET) // 8
    rows[k, column] = offset if factor == 0.0 else factor * rows[k, column] + offset


@njit(cache=True)  # type: ignore[untyped-decorator]
def _outside(first: int, last: int, rows: Any, outputs: int, bound: float) -> tuple[int, int]:
    """Return row and column of the first output out of range, (-1, -1) if there is none."""
    for k in range(first, last):
        outside = 0
        for j in range(outputs):
            outside += not abs(rows[k, j]) <= bound  # NaN is in no range
        if outside > 0:
            for j in range(outputs):
                if not abs(rows[k, j]) <= bound:
                    return k, j
    return -1, -1


@njit(cache=True)  # type: ignore[untyped-decorator]
def _seldom(
    p: int,
    k: int,
    base: int,
    stride: int,
    now: float,
    size: float,
    rows: Any,
    points: Any,
    next_points: Any,
    moves: Any,
    tables: Any,
    weights: Any,
    pairs: Any,
    numbers: Any,
    scratch: Any,
) -> int:
    """Execute an operation of any kind, for own points, any version and any type.

    Kept out of the loop, which it would make slower by a fifth even where it is not called.
    """
    kind, points_row, following = _field(p, KIND), _field(p, POINTS_ROW), k + 1
    if points_row >= 0:
        following = next_points[points_row, k]
        if following < 0:
            return 0
    at = following if _field(p, AHEAD) == 1 else k
    status = 0
    if kind in (STEP_2, STEP_3):
        own = size if points_row < 0 else (points[following] - points[k]) / 1e9
        status = _do_step_2(p, now, own) if kind == STEP_2 else _do_step_3(p, now, own)
    elif kind in (EXCHANGE_2, EXCHANGE_3):
        target = base + at * stride + _field(p, OFFSET)
        if _field(p, TABLE) != 0:
            target = _late(p, k, base, stride)
        status = _get_or_set_2(p, target) if kind == EXCHANGE_2 else _get_or_set_3(p, target)
    elif kind == TYPED:
        status = _typed(p, at, rows, scratch)
    elif kind == MOVE:
        _move(moves[_field(p, TABLE)], k, rows, tables, weights, pairs, numbers)
    else:
        _adjust(p, at, rows, numbers)
    return int(status)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def run(  # noqa: C901 - what happens at a point, in one place
    first: int,
    last: int,
    operations: int,
    count: int,
    place: Any,
    rows: Any,
    points: Any,
    seconds: Any,
    sizes: Any,
    next_points: Any,
    moves: Any,
    tables: Any,
    weights: Any,
    pairs: Any,
    numbers: Any,
    scratch: Any,
    outputs: int,
    bound: float,
) -> tuple[int, int, int, int]:
    """Execute a list of operations at the points first to last - 1.

    `operations` is the address of the table; `place` is kept at (point, whether its row is
    complete) for callbacks of the slaves.

    Returns
    -------
    point, complete rows, number of the operation that was refused (or RANGE, NOTHING), its
    status (with RANGE the column of the output).
    """
    base, stride = rows.ctypes.data, rows.strides[0]
    block = max(1, _BLOCK // stride) if stride > 0 else last
    begin = first
    while begin < last:
        stop = min(begin + block, last)
        refused, status, k = NOTHING, 0, begin
        while k < stop:
            place[0], place[1] = k, 0
            row, now, size = base + k * stride, seconds[k], sizes[k]
            for i in range(count):
                p = operations + 8 * FIELDS * i
                kind = _field(p, KIND)
                if kind <= LATE:
                    target = row + _field(p, OFFSET)
                    if kind == LATE:
                        target = _late(p, k, base, stride)
                    status = _get_or_set_2(p, target)
                elif kind == STEP:
                    status = _do_step_2(p, now, size)
                elif kind == COMPLETE:
                    place[1] = 1
                else:
                    status = _seldom(
                        p,
                        k,
                        base,
                        stride,
                        now,
                        size,
                        rows,
                        points,
                        next_points,
                        moves,
                        tables,
                        weights,
                        pairs,
                        numbers,
                        scratch,
                    )
                if status > WARNING:
                    refused = i
                    break
            if refused != NOTHING:
                break
            k += 1
        complete = k if refused == NOTHING else k + place[1]
        row_out, column_out = _outside(begin, complete, rows, outputs, bound)
        if row_out >= 0:
            return row_out, row_out + 1, RANGE, column_out
        if refused != NOTHING:
            return k, complete, refused, status
        begin = stop
    return last, last, NOTHING, 0
