"""The engine in Python, for any FMU: it runs the program as `listing` writes it out.

The algorithm reads best in `cosim.master.loop` and in `program`, not here: the operations of a
point are Python source that is made and compiled once per run.
"""

from __future__ import annotations

import numpy as np

from cosim.master.engine.listing import Stretch, stretch
from cosim.master.engine.program import Halt, Operation, Program, refusal

_List = tuple[tuple[Operation, ...], Stretch]


class PythonEngine:
    """Carries a program out in Python."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._place = [0, 0]
        point = (*program.sending, *program.leaving)
        closing = (*program.sending, *program.concluding)
        self._opening = self._written("opening", program.opening)
        self._point = self._written("point", point)
        self._closing = self._written("closing", closing)
        self._parts: tuple[_List, ...] = ()
        if program.course.live:
            self._parts = (
                self._written("sending", program.sending),
                self._written("leaving", program.leaving),
                self._written("concluding", program.concluding),
            )

    def _written(self, name: str, operations: tuple[Operation, ...]) -> _List:
        return operations, stretch(self._program, operations, self._place, name=name)

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

    def known(self, first: int, last: int) -> None:
        """The rows to be read at the points first to last - 1 are known now."""

    def send(self, k: int) -> Halt | None:
        """The first half of what happens at point k: after it, what is sent is in the row."""
        halt = self._carry_out(self._opening, 0, 1) if k == 0 else None
        return halt or self._carry_out(self._parts[0], k, k + 1)

    def leave(self, k: int) -> Halt | None:
        """The other half."""
        final = self._program.course.final
        halt = self._carry_out(self._parts[2 if k == final else 1], k, k + 1)
        complete = k + 1 if halt is None else halt.complete
        return self._out_of_range(k, complete) or halt

    def _advance(self, first: int, last: int) -> Halt | None:
        final = self._program.course.final
        halt = self._carry_out(self._opening, 0, 1) if first == 0 else None
        halt = halt or self._carry_out(self._point, first, min(last, final))
        if halt is None and last > final:
            halt = self._carry_out(self._closing, final, last)
        return halt

    def _carry_out(self, what: _List, first: int, last: int) -> Halt | None:
        operations, carry_out = what
        refused = carry_out(first, last) if operations else None
        if refused is None:
            return None
        k, number, status = refused
        return refusal(operations[number], k, k + self._place[1], status)
