"""The engine that reads like the algorithm: any FMU, one call after the other."""

from __future__ import annotations

import numpy as np

from cosim.master.engine.listing import ENDED, stretch
from cosim.master.engine.program import Call, Halt, Operation, Program, Step


class PythonEngine:
    """Carries a program out in Python."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._place = [0, 0]
        self._opening = stretch(program, program.opening, self._place, name="opening")
        self._points = stretch(program, program.point, self._place, name="point")
        self._closing = stretch(program, program.closing, self._place, name="closing")

    def where(self) -> tuple[int, bool]:
        """The point that is being worked on, and whether its row is complete."""
        return self._place[0], bool(self._place[1])

    def advance(self, first: int, last: int) -> Halt | None:
        """Exchange at the points first to last - 1, and step from each but the run's last."""
        halt = self._advance(first, last)
        complete = last if halt is None else halt.complete
        # looked at a stretch at a time; what came after a point out of range does not count
        return self._out_of_range(first, complete) or halt

    def _out_of_range(self, first: int, last: int) -> Halt | None:
        bound = self._program.bound
        part = self._program.rows[first:last, : self._program.outputs]
        # NaN is in no range, and comes out of both
        if part.size == 0 or (part.min() >= -bound and part.max() <= bound):
            return None
        row, column = np.argwhere(~(np.abs(part) <= bound))[0].tolist()
        return Halt(first + row, first + row + 1, "range", column, 0)

    def _advance(self, first: int, last: int) -> Halt | None:
        program = self._program
        end = program.points_ns.size - 1
        refused, operations = None, program.opening
        if first == 0 and program.opening:
            refused = self._opening(0, 1)
        if refused is None:
            operations = program.point
            refused = self._points(first, min(last, end))
        if refused is None and last > end:
            operations = program.closing
            refused = self._closing(end, last)
        return None if refused is None else self._halt(operations, *refused)

    def _halt(self, operations: tuple[Operation, ...], k: int, number: int, status: int) -> Halt:
        operation = operations[number]
        complete = k + self._place[1]
        if status == ENDED:
            return Halt(k, complete, "end", operation.station, 0)
        what = "step" if isinstance(operation, Step) else "get"
        if isinstance(operation, Call):
            what = operation.way
        return Halt(k, complete, what, operation.station, status)  # type: ignore[arg-type]
