"""The loop in plain Python: what the kernel does in C, bit for bit, and for values of any type."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Literal

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


class PlainLoop:
    """Carries out a table of operations."""

    def __init__(
        self, table: Table, events: Mapping[int, EventInstance] = MappingProxyType({})
    ) -> None:
        self._table, self._rows, self._events = table, table.rows, events
        self._calls = [self._call(operation) for operation in table.operations]
        self._column = self._passes = 0
        self._bits = table.rows.view(np.uint64)[:, : table.outputs]
        self._weights = column_weights(table.outputs)
        self._restore_float_mode = float_mode_restorer()

    def run(  # noqa: C901, PLR0912 - the algorithm, in one place
        self, begin: int, end: int, first: int, last: int, guards: Guards | None = None
    ) -> EarlyStop | None:
        """Carry out operations begin to end - 1 at points first to last - 1.

        guards : looked at behind each point; an early stop is at the first that is not met.
        """
        table, final, word = self._table, self._table.comm_points.final, self._table.word.data
        operations, adjusted, always = table.operations, table.adjustments.count.data, When.ALWAYS
        for k in range(first, last):
            number = begin - 1
            while (number := number + 1) < end:
                operation, call = operations[number], self._calls[number]
                following = k + 1 if operation.following is None else int(operation.following[k])
                if operation.when is not always and _is_left_out(operation.when, k, final):
                    continue
                if following < 0:
                    continue
                at = following if operation.ahead else table.spare if operation.spare else k
                word[0] = k << WORD_BITS | number
                status = OK
                match operation:
                    case Get(group=group):
                        status = call(at)
                        if adjusted[0]:
                            table.adjust(group, at)
                    case Set(group=group):
                        if adjusted[0]:
                            table.adjust(group, at)
                        status = call(at)
                    case Move():
                        move(table, operation, k, at)
                    case Step():
                        status = call(k, following)
                    case Complete():
                        if table.is_watched:
                            self._add_to_sum(k)
                        status = self._range_status(k)
                    case Guess(loop=loop):
                        self._guess(loop, k)
                    case Settle(loop=loop) if not self._is_settled(loop, k):
                        if self._passes < loop.limit:
                            number = operation.begin
                        else:
                            status = UNSETTLED
                if ONE / TEN != TENTH or ONE / THREE != THIRD or TINY * TEN == 0.0:
                    self._restore_float_mode()
                if status not in ACCEPTED_STATUSES:
                    return table.early_stop(status, self._column)
            if guards is not None and not guards.are_met(k):
                return table.early_stop(GUARDED, k)
        return None

    def close(self) -> None:
        """Do nothing: it has no threads."""

    def _call(self, operation: Operation) -> Callable[..., int]:
        """Return the FMI call of an operation."""
        match operation:
            case Get(group=group):
                return self._exchange(operation, group, "get")
            case Set(group=group):
                return self._exchange(operation, group, "set")
            case Step():
                return self._step(self._table.instances[operation.instance].slave)
        return int  # makes no call

    def _exchange(
        self, operation: Operation, group: Group, way: Literal["get", "set"]
    ) -> Callable[[int], int]:
        """Return what gets or sets a group of values in a row."""
        rows, instance = self._rows, self._table.instances[operation.instance]
        if operation.instance in self._events:
            in_event_mode = self._events[operation.instance].exchange(group, way)
            return lambda at: in_event_mode(rows, at)
        if group.c_type != "f8":
            exchange = exchange_of(instance, group, way)
            return lambda at: exchange(rows[at])
        slave = instance.slave
        version = slave.description.version
        function = exchange_function(version, slave.address(way, group.getter_type))
        component, references = pointer(slave.component), pointer(group.references.ctypes.data)
        count, more = group.references.size, () if version == "2.0" else (group.size,)
        begin, stride = int(rows.ctypes.data) + 8 * group.column, int(rows.strides[0])
        return lambda at: function(component, references, count, begin + at * stride, *more)

    def _step(self, slave: FmuSlave) -> Callable[[int, int], int]:
        """Return what steps an instance from a point to another."""
        points, call = self._table.comm_points, step_call(slave, self._table.no_way_back.data)
        times, seconds, sizes = points.points_ns.data, points.seconds.data, points.sizes.data

        def step(k: int, following: int) -> int:
            size = sizes[k] if following == k + 1 else (times[following] - times[k]) / 1e9
            return call(seconds[k], size)

        if slave.description.version == "2.0":
            return step
        results = (ctypes.c_ubyte * 16).from_address(slave.step_results)

        def step_3(k: int, following: int) -> int:
            status = step(k, following)
            if status not in ACCEPTED_STATUSES:
                return status
            return ENDED if results[1] or results[2] else status

        return step_3

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

    def _guess(self, loop: AlgebraicLoop, k: int) -> None:
        """Begin the passes of an algebraic loop with the values of the row before."""
        if k > 0:
            self._rows[k, loop.columns] = self._rows[k - 1, loop.columns]
        self._passes, loop.kept[:] = 0, self._rows[k, loop.columns]

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
    if version == "2.0":
        return lambda time, size: function(component, time, size, no_way_back[0])
    results = (ctypes.c_ubyte * 16).from_address(slave.step_results)
    places = [slave.step_results + place for place in (0, 1, 2, 8)]

    def step(time: float, size: float) -> int:
        results[0] = results[1] = results[2] = 0
        return function(component, time, size, no_way_back[0], *places)

    return step


def move(table: Table, operation: Move, k: int, at: int) -> None:
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


def _is_left_out(when: When, k: int, final: int) -> bool:
    return (when is When.AT_FIRST and k > 0) or (when is When.NOT_AT_LAST and k == final)
