"""The loop in plain Python: what the kernel does in C, bit for bit, and for values of any type."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import Final, Literal

import numpy as np

from cosim.fmu import ACCEPTED_STATUSES, FmuSlave
from cosim.master.component_instance import Group
from cosim.master.event_instance import EventInstance
from cosim.master.exchange import (
    OK,
    exchange_function,
    exchange_of,
    float_mode_restorer,
    pointer,
    step_function,
)
from cosim.master.guards import Guards
from cosim.master.row_sums import column_weights, signed
from cosim.master.table import (
    ENDED,
    GUARDED,
    OUT_OF_RANGE,
    ROW_SUM,
    UNSETTLED,
    WORD_BITS,
    AlgebraicLoop,
    Complete,
    EarlyStop,
    Get,
    Guess,
    Move,
    Operation,
    Set,
    Settle,
    Step,
    Table,
    When,
)
from cosim.network import SUBSTITUTE

ONE, THREE, TEN, TINY = 1.0, 3.0, 10.0, 5e-324
THIRD, TENTH = 1 / 3, 1 / 10
"""Quotients that are rounded down and up to the nearest double. A call may have changed rounding,
or made tiny numbers count as zero."""


Call = Callable[[int], int]
"""Carries out an operation at point k, and returns its status."""


_FEW: Final = 40
"""Up to so many values a loop in Python is sooner through than NumPy has begun."""


class PlainLoop:
    """Carries out a table of operations; each is prepared once, as a function of the point."""

    def __init__(
        self, table: Table, events: Mapping[int, EventInstance] = MappingProxyType({})
    ) -> None:
        self._table, self._rows, self._events = table, table.rows, events
        self._values = table.rows.reshape(-1).data
        self._column = self._passes = 0
        self._bits = table.rows.view(np.uint64)[:, : table.outputs]
        self._weights = column_weights(table.outputs)
        self._limits = table.bounds.tolist()
        self._restore_float_mode = float_mode_restorer()
        self._calls = [*enumerate(map(self._prepared, table.operations))]

    def run(
        self, begin: int, end: int, first: int, last: int, guards: Guards | None = None
    ) -> EarlyStop | None:
        """Carry out operations begin to end - 1 at points first to last - 1.

        guards : looked at behind each point; an early stop is at the first that is not met.
        """
        word, calls = self._table.word.data, self._calls[begin:end]
        for k in range(first, last):
            place = k << WORD_BITS
            for number, call in calls:
                word[0] = place | number
                status = call(k)
                if status and status not in ACCEPTED_STATUSES:
                    return self._table.early_stop(status, self._column)
            if guards is not None and not guards.are_met(k):
                return self._table.early_stop(GUARDED, k)
        return None

    def close(self) -> None:
        """Let go of the rows: operations and loop know each other, which only a collector ends."""
        self._calls.clear()

    def _prepared(self, operation: Operation) -> Call:
        """Return what carries out an operation at a point, if it takes place there."""
        call, when, points = self._call(operation), operation.when, self._table.comm_points
        at_some = call
        if when is When.AT_FIRST:
            at_some = lambda k: OK if k else call(k)  # noqa: E731 - one of three
        elif when is When.NOT_AT_LAST:
            at_some = lambda k: OK if k == points.final else call(k)  # noqa: E731
        if operation.following is None:
            return at_some
        following = operation.following.data
        return lambda k: OK if following[k] < 0 else at_some(k)

    def _call(self, operation: Operation) -> Call:
        """Return what carries out an operation."""
        match operation:
            case Get(group=group) | Set(group=group):
                way: Literal["get", "set"] = "get" if isinstance(operation, Get) else "set"
                return self._exchange(operation, group, way)
            case Move():
                return self._move(operation)
            case Step():
                return self._step(operation)
            case Complete():
                return self._complete
            case Guess(loop=loop):
                return lambda k: self._guess(loop, k)
            case Settle(loop=loop):
                return lambda k: self._settle(loop, operation.begin, k)
        raise TypeError(f"no operation of a table: {operation}")

    def _row_of(self, operation: Operation) -> Callable[[int], int] | None:
        """Return what gives the row that an operation uses at a point; None: that of the point."""
        if operation.ahead:
            following = operation.following
            return (lambda k: k + 1) if following is None else following.data.__getitem__
        spare = self._table.spare
        return (lambda _: spare) if operation.spare else None

    def _exchange(self, operation: Operation, group: Group, way: Literal["get", "set"]) -> Call:
        """Return what gets or sets a group of values in a row."""
        table, row_of, restore = self._table, self._row_of(operation), self._restore_float_mode
        exchange, begin, stride = self._plain_exchange(operation, group, way)
        adjusted = table.adjustments.count.data

        def call(k: int) -> int:
            at = k if row_of is None else row_of(k)
            if adjusted[0] and way == "set":
                table.adjust(group, at)
            status = exchange(begin + at * stride)
            if adjusted[0] and way == "get":
                table.adjust(group, at)
            if ONE / TEN != TENTH or ONE / THREE != THIRD or TINY * TEN == 0.0:
                restore()
            return status

        return call

    def _plain_exchange(
        self, operation: Operation, group: Group, way: Literal["get", "set"]
    ) -> tuple[Callable[[int], int], int, int]:
        """Return what makes the FMI call of a get or set, and begin and stride of what it is given.

        That is begin + row * stride: the address of the values there, or the number of the row.
        """
        rows, instance = self._rows, self._table.instances[operation.instance]
        if operation.instance in self._events:
            in_event_mode = self._events[operation.instance].exchange(group, way)
            return lambda at: in_event_mode(rows, at), 0, 1
        if group.c_type != "f8":
            exchange = exchange_of(instance, group, way)
            return lambda at: exchange(rows[at]), 0, 1
        slave, size = instance.slave, group.size
        version = slave.description.version
        function = exchange_function(version, slave.address(way, group.getter_type))
        component, references = pointer(slave.component), pointer(group.references.ctypes.data)
        call = partial(function, component, references, group.references.size)
        begin, stride = int(rows.ctypes.data) + 8 * group.column, int(rows.strides[0])
        return (call if version != "3.0" else lambda values: call(values, size)), begin, stride

    def _step(self, operation: Operation) -> Call:
        """Return what steps an instance from a point to its next one."""
        slave, points = self._table.instances[operation.instance].slave, self._table.comm_points
        call, restore = step_call(slave, self._table.no_way_back.data), self._restore_float_mode
        times, seconds, sizes = points.points_ns.data, points.seconds.data, points.sizes.data
        following = None if operation.following is None else operation.following.data
        results = None
        if slave.description.version == "3.0":
            results = (ctypes.c_ubyte * 16).from_address(slave.step_results)

        def step(k: int) -> int:
            size = sizes[k] if following is None else (times[following[k]] - times[k]) / 1e9
            status = call(seconds[k], size)
            if ONE / TEN != TENTH or ONE / THREE != THIRD or TINY * TEN == 0.0:
                restore()
            if results is not None and (results[1] or results[2]) and status in ACCEPTED_STATUSES:
                return ENDED
            return status

        return step

    def _move(self, operation: Move) -> Call:
        """Return what copies the values that a route brings to the inputs in a row."""
        table, row_of, route, sample = (
            self._table, self._row_of(operation), operation.route, operation.sample
        )  # fmt: skip
        used, values, width = sample.row.data, self._values, self._rows.shape[1]
        if not route.verbatim or sample.weight is not None or route.spans is None:
            return lambda k: move(table, operation, k, k if row_of is None else row_of(k))
        columns, targets = route.spans
        source, target, count = columns.start, targets.start, columns.stop - columns.start
        substitute = None if route.link is None else route.link.substitute

        def copy(k: int) -> int:
            row = used[k]
            if row >= 0:
                begin, into = row * width + source, (k if row_of is None else row_of(k)) * width
                into += target
                values[into : into + count] = values[begin : begin + count]
            elif row == SUBSTITUTE and substitute is not None:
                return move(table, operation, k, k if row_of is None else row_of(k))
            return OK

        return copy

    def _complete(self, k: int) -> int:
        """Check that the outputs of a complete row are in range."""
        if self._table.is_watched:
            self._add_to_sum(k)
        if len(self._limits) > _FEW:
            return self._range_status(k)
        begin = k * self._rows.shape[1]
        for value, limit in zip(
            self._values[begin : begin + len(self._limits)], self._limits, strict=True
        ):
            if not -limit <= value <= limit:  # NaN is in no range
                return self._range_status(k)
        return OK

    def _add_to_sum(self, k: int) -> None:
        """Add the row that is complete to the sum of the rows."""
        word = self._table.word.data
        word[ROW_SUM] = signed(word[ROW_SUM] + int(self._bits[k] @ self._weights) * (2 * k + 1))

    def _range_status(self, k: int) -> int:
        inside = np.abs(self._rows[k, : self._table.outputs]) <= self._table.bounds
        if inside.all():  # NaN is in no range
            return OK
        self._column = int(np.argmin(inside))
        return OUT_OF_RANGE

    def _guess(self, loop: AlgebraicLoop, k: int) -> int:
        """Begin the passes of an algebraic loop with the values of the row before."""
        if k > 0:
            self._rows[k, loop.columns] = self._rows[k - 1, loop.columns]
        self._passes, loop.kept[:] = 0, self._rows[k, loop.columns]
        return OK

    def _settle(self, loop: AlgebraicLoop, begin: int, k: int) -> int:
        """Repeat the operations from the guess on until they change no value."""
        word = self._table.word.data
        place, end = word[0] - (word[0] & ((1 << WORD_BITS) - 1)), word[0] & ((1 << WORD_BITS) - 1)
        while not self._is_settled(loop, k):
            if self._passes >= loop.limit:
                return UNSETTLED
            for number, call in self._calls[begin + 1 : end]:
                word[0] = place | number
                status = call(k)
                if status and status not in ACCEPTED_STATUSES:
                    return status
            word[0] = place | end
        return OK

    def _is_settled(self, loop: AlgebraicLoop, k: int) -> bool:
        """Whether a pass of an algebraic loop changed no value."""
        values = self._rows[k, loop.columns]
        allowed = loop.tolerance * np.maximum(1.0, np.abs(values))
        changed = np.flatnonzero(~(np.abs(values - loop.kept) <= allowed))
        self._passes, loop.kept[:] = self._passes + 1, values
        if changed.size:
            self._column = int(loop.columns[changed[-1]])
        return not changed.size


def step_call(slave: FmuSlave, no_way_back: Sequence[int]) -> Callable[[float, float], int]:
    """Return what steps a slave from an instant by a size [s], and returns the status."""
    if slave.description.scheduled:

        def advance(time: float, size: float) -> int:
            slave.advance(time + size)
            return OK

        return advance
    version = slave.description.version
    function, component = step_function(version, slave.address("step")), pointer(slave.component)
    if version == "1.0":  # asked whether the step is a new one: no state was restored
        return lambda time, size: function(component, time, size, 1)
    if version == "2.0":
        return lambda time, size: function(component, time, size, no_way_back[0])
    results = (ctypes.c_ubyte * 16).from_address(slave.step_results)
    places = [slave.step_results + place for place in (0, 1, 2, 8)]

    def step(time: float, size: float) -> int:
        results[0] = results[1] = results[2] = 0
        return function(component, time, size, no_way_back[0], *places)

    return step


def move(table: Table, operation: Move, k: int, at: int) -> int:
    """Copy the values that a route brings at point k to the inputs in row `at`."""
    rows, route, sample = table.rows, operation.route, operation.sample
    used = int(sample.row[k])
    if used >= 0 and route.verbatim and sample.weight is None and route.spans is not None:
        columns, targets = route.spans
        rows[at, targets] = rows[used, columns]
    elif used >= 0:
        values = rows[used, route.columns]
        if sample.weight is not None and sample.after is not None and sample.weight[k] > 0.0:
            share = sample.weight[k]
            values = (1.0 - share) * values + share * rows[sample.after[k], route.columns]
        if route.link is not None and route.link.quantization:
            values = route.link.quantize(values)
        rows[at, route.targets] = values
    elif used == SUBSTITUTE and route.link is not None:
        rows[at, route.targets] = route.link.substitute
    return OK
