"""The inner loop in machine code: numba over the addresses of the FMUs' functions.

An address is called through an intrinsic that turns an integer into a function pointer, so
that no address becomes part of the compiled code: it is compiled once, and kept on disk.
Operations lie side by side in one table of integers and are read by address: a view of an
array per call would cost more than the call.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

(
    KIND,
    FUNCTION,
    COMPONENT,
    REFERENCES,
    COUNT,
    OFFSET,
    BEAT,
    TABLE,
    OWN,
    AHEAD,
    VALUES,
    TYPE,
    SCRATCH,
    STATION,
    WAY,
    RESULTS,
) = range(16)
"""Columns of the table of operations. OFFSET and OWN in bytes; SCRATCH in elements of 8 bytes; of a
move TABLE is its number, of an adjustment COUNT the number of its factor, of a step COUNT is
whether it is final."""
FIELDS = 16
(
    EXCHANGE_2,
    EXCHANGE_3,
    LATE_2,
    LATE_3,
    STEP_2,
    STEP_3,
    COMPLETE,
    TYPED,
    MOVE,
    ADJUST,
) = range(10)
"""KIND: what an operation is; _2 and _3 are the versions of FMI."""
TYPES = ("f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
"""TYPE: what a typed exchange moves."""
MOVE_FIELDS = 7
"""Columns of a table of moves: table, after, weight, first, last (of the pairs of columns),
quantized, substituted."""
GET, SET, STEP, RANGE, END, NOTHING = range(6)
"""What may end a stretch."""
TOO_LARGE = 100
_BLOCK = 64
"""Rows after which the range is looked at: few enough to be in the cache still."""

_INT8, _INT32, _INT64, _DOUBLE = ir.IntType(8), ir.IntType(32), ir.IntType(64), ir.DoubleType()


@intrinsic  # type: ignore[untyped-decorator]
def _exchange_2(
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
def _exchange_3(
    _typing: Any, function: Any, component: Any, references: Any, count: Any, values: Any, size: Any
) -> Any:
    """fmi3Get... or fmi3Set... at an address."""
    del function, component, references, count, values, size
    signature = types.int32(*[types.int64] * 6)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT32, [_INT64] * 5)
        return builder.call(builder.inttoptr(arguments[0], kind.as_pointer()), arguments[1:])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def _step_2(_typing: Any, function: Any, component: Any, now: Any, size: Any, final: Any) -> Any:
    """fmi2DoStep at an address; `final`: noSetFMUStatePriorToCurrentPoint."""
    del function, component, now, size, final
    signature = types.int32(types.int64, types.int64, types.float64, types.float64, types.int32)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        kind = ir.FunctionType(_INT32, [_INT64, _DOUBLE, _DOUBLE, _INT32])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        return builder.call(function, arguments[1:])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def _step_3(
    _typing: Any, function: Any, component: Any, now: Any, size: Any, final: Any, said: Any
) -> Any:
    """fmi3DoStep at an address; what it says lies at `said`: three C bools, a double at 8."""
    del function, component, now, size, final, said
    signature = types.int32(
        types.int64, types.int64, types.float64, types.float64, types.int32, types.int64
    )

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        # a C bool is passed as an int whose other bits are zero
        kind = ir.FunctionType(_INT32, [_INT64, _DOUBLE, _DOUBLE, _INT32, *[_INT64] * 4])
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        places = [builder.add(arguments[5], ir.Constant(_INT64, i)) for i in (0, 1, 2, 8)]
        return builder.call(function, [*arguments[1:5], *places])

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def _load(_typing: Any, address: Any) -> Any:
    """The integer at an address."""
    del address
    signature = types.int64(types.int64)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.load(builder.inttoptr(arguments[0], _INT64.as_pointer()))

    return signature, generate


@intrinsic  # type: ignore[untyped-decorator]
def _byte(_typing: Any, address: Any) -> Any:
    """The byte at an address."""
    del address
    signature = types.int64(types.int64)

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        found = builder.load(builder.inttoptr(arguments[0], _INT8.as_pointer()))
        return builder.zext(found, _INT64)

    return signature, generate


@njit(cache=True)  # type: ignore[untyped-decorator]
def _field(operation: int, field: int) -> int:
    return int(_load(operation + 8 * field))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _into_scratch(kind: int, at: int, n: int, scratch: Any, row: Any, column: int) -> None:
    """Doubles of a row -> values of a type; `scratch` is a view of one buffer per type."""
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
    """Values of a type -> doubles of a row; false if one is not held exactly."""
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
    """A get or set of values that are no doubles."""
    at, column, n = _field(p, SCRATCH), _field(p, OFFSET) // 8, _field(p, VALUES)
    kind = _field(p, TYPE)
    values = scratch[8].ctypes.data + 8 * at
    if _field(p, WAY) == SET:
        _into_scratch(kind, at, n, scratch, rows[k], column)
    if _field(p, RESULTS) == 0:
        status = _exchange_2(
            _field(p, FUNCTION),
            _field(p, COMPONENT),
            _field(p, REFERENCES),
            _field(p, COUNT),
            values,
        )
    else:
        status = _exchange_3(
            _field(p, FUNCTION),
            _field(p, COMPONENT),
            _field(p, REFERENCES),
            _field(p, COUNT),
            values,
            n,
        )
    exact = True
    if _field(p, WAY) == GET:
        exact = _from_scratch(kind, at, n, scratch, rows[k], column)
    return int(status) if exact or status > 1 else TOO_LARGE


@njit(cache=True)  # type: ignore[untyped-decorator]
def _move(
    move: Any, k: int, rows: Any, tables: Any, weights: Any, pairs: Any, numbers: Any
) -> None:
    """As in the listing, operation by operation."""
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
    """The first output that is out of range, (-1, -1) if none is."""
    for k in range(first, last):
        outside = 0
        for j in range(outputs):
            outside += not abs(rows[k, j]) <= bound  # NaN is in no range
        if outside > 0:
            for j in range(outputs):
                if not abs(rows[k, j]) <= bound:
                    return k, j
    return -1, -1


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def run(  # noqa: C901, PLR0912, PLR0915 - what happens at a point, in one place
    first: int,
    last: int,
    operations: int,
    count: int,
    place: Any,
    rows: Any,
    points: Any,
    seconds: Any,
    beats: Any,
    moves: Any,
    tables: Any,
    weights: Any,
    pairs: Any,
    numbers: Any,
    scratch: Any,
    outputs: int,
    bound: float,
) -> tuple[int, int, int, int, int]:
    """Carry out a list of operations at the points first to last - 1.

    `operations` is the address of the table; `place` is kept at (point, whether its row is
    complete) for whoever is called back.

    Returns
    -------
    point, complete rows, what ended it (GET, SET, STEP: a call that was refused; RANGE: an output
    out of it; END: asked for by a component; NOTHING), station (or column of the output), status.
    """
    base, stride = rows.ctypes.data, rows.strides[0]
    end = points.size - 1
    begin = first
    while begin < last:
        stop = min(begin + _BLOCK, last)
        why, station, status, k = NOTHING, 0, 0, begin
        while k < stop:
            place[0], place[1] = k, 0
            row = base + k * stride
            now = seconds[k]
            size = (points[k + 1] - points[k]) / 1e9 if k < end else 0.0
            for i in range(count):
                p = operations + 8 * FIELDS * i
                kind, beat, following = _field(p, KIND), _field(p, BEAT), k + 1
                if beat >= 0:
                    following = beats[beat, k]
                    if following < 0:
                        continue
                if kind == STEP_2:
                    h = size if beat < 0 else (points[following] - points[k]) / 1e9
                    final = np.int32(_field(p, COUNT))
                    status = _step_2(_field(p, FUNCTION), _field(p, COMPONENT), now, h, final)
                    way = STEP
                elif kind <= LATE_3:
                    target = row + _field(p, OFFSET)
                    if kind >= LATE_2:
                        used = tables[_field(p, TABLE), k]
                        if used >= 0:
                            target = base + used * stride + _field(p, OFFSET)
                        else:
                            target = row + _field(p, OWN)
                    elif _field(p, AHEAD) == 1:
                        target = base + following * stride + _field(p, OFFSET)
                    if kind in (EXCHANGE_2, LATE_2):
                        status = _exchange_2(
                            _field(p, FUNCTION),
                            _field(p, COMPONENT),
                            _field(p, REFERENCES),
                            _field(p, COUNT),
                            target,
                        )
                    else:
                        status = _exchange_3(
                            _field(p, FUNCTION),
                            _field(p, COMPONENT),
                            _field(p, REFERENCES),
                            _field(p, COUNT),
                            target,
                            _field(p, VALUES),
                        )
                    way = _field(p, WAY)
                elif kind == COMPLETE:
                    place[1] = 1
                    continue
                elif kind == STEP_3:
                    h = size if beat < 0 else (points[following] - points[k]) / 1e9
                    said, final = _field(p, RESULTS), np.int32(_field(p, COUNT))
                    status = _step_3(_field(p, FUNCTION), _field(p, COMPONENT), now, h, final, said)
                    way = STEP
                    if status <= 1 and _byte(said + 1) != 0:
                        way, status = END, 2
                elif kind == TYPED:
                    at = following if _field(p, AHEAD) == 1 else k
                    status = _typed(p, at, rows, scratch)
                    way = _field(p, WAY)
                elif kind == MOVE:
                    _move(moves[_field(p, TABLE)], k, rows, tables, weights, pairs, numbers)
                    continue
                else:
                    _adjust(p, following if _field(p, AHEAD) == 1 else k, rows, numbers)
                    continue
                if status > 1:
                    why, station = way, _field(p, STATION)
                    break
            if why != NOTHING:
                break
            k += 1
        complete = k if why == NOTHING else k + place[1]
        row_out, column_out = _outside(begin, complete, rows, outputs, bound)
        if row_out >= 0:
            return row_out, row_out + 1, RANGE, column_out, 0
        if why != NOTHING:
            return k, complete, why, station, status if why != END else 0
        begin = stop
    return last, last, NOTHING, 0, 0
