"""The engine in Python, for any FMU: it executes the `generated_code` of a program.

The algorithm is described in `cosim.master.loop` and in `program`.
"""

from __future__ import annotations

import numpy as np

from cosim.master.engine.generated_code import SegmentFunction, segment_function
from cosim.master.engine.program import EarlyStop, Operation, Program, refusal

_List = tuple[tuple[Operation, ...], SegmentFunction]


class PythonEngine:
    """Executes a program in Python."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._place = [0, 0]
        point = (*program.sending, *program.leaving)
        closing = (*program.sending, *program.concluding)
        self._opening = self._written("opening", program.opening)
        self._point = self._written("point", point)
        self._closing = self._written("closing", closing)
        self._parts: tuple[_List, ...] = ()
        if program.comm_points.live:
            self._parts = (
                self._written("sending", program.sending),
                self._written("leaving", program.leaving),
                self._written("concluding", program.concluding),
            )

    def _written(self, name: str, operations: tuple[Operation, ...]) -> _List:
        return operations, segment_function(self._program, operations, self._place, name=name)

    def where(self) -> tuple[int, bool]:
        """Return the point that is being executed, and whether its row is complete."""
        return self._place[0], bool(self._place[1])

    def advance(self, first: int, last: int) -> EarlyStop | None:
        """Exchange at the points first to last - 1, and step from each but the run's last."""
        early_stop = self._advance(first, last)
        complete = last if early_stop is None else early_stop.complete
        # checked once per segment; what comes after a point out of range does not count
        return self._out_of_range(first, complete) or early_stop

    def _out_of_range(self, first: int, last: int) -> EarlyStop | None:
        bound = self._program.bound
        part = self._program.rows[first:last, : self._program.outputs]
        # min and max of a part with NaN are NaN, which is in no range
        if part.size == 0 or (part.min() >= -bound and part.max() <= bound):
            return None
        row, column = np.argwhere(~(np.abs(part) <= bound))[0].tolist()
        return EarlyStop(first + row, first + row + 1, "range", column, 0)

    def update_routes(self, first: int, last: int) -> None:
        """Do nothing: the generated code reads the rows of the routes themselves."""

    def send(self, k: int) -> EarlyStop | None:
        """Execute the first half of point k: after it, the values sent are in the row."""
        early_stop = self._execute(self._opening, 0, 1) if k == 0 else None
        return early_stop or self._execute(self._parts[0], k, k + 1)

    def receive_and_step(self, k: int) -> EarlyStop | None:
        """Execute the second half of point k."""
        final = self._program.comm_points.final
        early_stop = self._execute(self._parts[2 if k == final else 1], k, k + 1)
        complete = k + 1 if early_stop is None else early_stop.complete
        return self._out_of_range(k, complete) or early_stop

    def _advance(self, first: int, last: int) -> EarlyStop | None:
        final = self._program.comm_points.final
        early_stop = self._execute(self._opening, 0, 1) if first == 0 else None
        early_stop = early_stop or self._execute(self._point, first, min(last, final))
        if early_stop is None and last > final:
            early_stop = self._execute(self._closing, final, last)
        return early_stop

    def _execute(self, what: _List, first: int, last: int) -> EarlyStop | None:
        operations, execute = what
        refused = execute(first, last) if operations else None
        if refused is None:
            return None
        k, number, status = refused
        return refusal(operations[number], k, k + self._place[1], status)
