"""The points at which no component has an event, carried out by the kernel, many at once.

Between the instants at which Python must act, a component with events is stepped like any other:
clocked values are those of the row before, and no Clock ticks. The kernel stops

* before an input is set whose jump is an event: the point is carried out anew by Python;
* behind a step that returned early: Python ends the steps of the point where that one is;
* behind the steps of a point of which one announced an event: Python has the next point.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.fmu import FmuState
from cosim.master.event_instance import EventInstance
from cosim.master.kernel import KernelLoop
from cosim.master.table import Get, Operation, Set, Step, Table

_EVENTS, _MAY_RETURN_EARLY = 1, 2
_KEEP = 7
"""Numbers in the kernel: of the component that a step is of; of an operation that keeps values."""


class QuietKernel(KernelLoop):
    """The kernel for points without events.

    Parameters
    ----------
    events : the instances in event mode, by number.
    first : those of them that step first, since they may return early.

    Attributes
    ----------
    saved : states of those of `first` from before their last step, where there are several.
    """

    def __init__(
        self, table: Table, events: Mapping[int, EventInstance], first: Mapping[int, EventInstance]
    ) -> None:
        self._events, self._first = events, first
        self.saved: dict[int, FmuState] = {}
        if len(first) > 1:
            self.saved = {number: one.slave.snapshot() for number, one in first.items()}
        super().__init__(table)

    def _in_order(self, numbers: list[int]) -> list[int]:
        operations, complete = self._table.operations, self._table.complete

        def place(number: int) -> tuple[bool, bool]:
            operation = operations[number]
            is_first = isinstance(operation, Step) and operation.instance in self._first
            return number > complete, not is_first

        return sorted(numbers, key=place)

    def _sets_directly(self, operation: Operation) -> bool:
        return operation.instance not in self._events and super()._sets_directly(operation)

    def _encode(self, line: Any, operation: Operation) -> None:
        one = self._events.get(operation.instance)
        if one is None or not isinstance(operation, Get | Set | Step):
            super()._encode(line, operation)
        elif isinstance(operation, Step):
            super()._encode(line, operation)
            is_first = operation.instance in self._first
            line["events"] = _MAY_RETURN_EARLY if is_first else _EVENTS
            if operation.instance in self.saved:
                line["save"] = one.slave.address("get", "FMUState")
                state = self.saved[operation.instance].pointer
                line["state"] = ctypes.addressof(state)
        else:
            self._encode_values(line, operation, one)

    def _encode_values(self, line: Any, operation: Get | Set, one: EventInstance) -> None:
        """Encode a get or set of a component whose Clocks do not tick."""
        group, is_clock = operation.group, operation.group.getter_type == "Clock"
        if isinstance(operation, Get) and (is_clock or group.clocks):
            line["kind"], line["special"] = _KEEP, is_clock
            line["column"], line["values"] = group.column, group.size
            return
        if is_clock or group.clocks:
            line["kind"] = self.kind_of(operation)  # nothing is set
        else:
            super()._encode(line, operation)
            line["row"] = 0  # its inputs are in its own row, where they are compared
        if isinstance(operation, Set):
            columns = group.column + np.flatnonzero(one.jumps_of(group))
            line["pairs"], line["limit"] = self._address(_integers(columns)), columns.size
            line["back"] = is_clock


def _integers(values: Any) -> NDArray[np.int64]:
    return np.ascontiguousarray(values, np.int64)
