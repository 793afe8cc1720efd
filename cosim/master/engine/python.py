"""The engine that reads like the algorithm: any FMU, one call after the other.

Calls go through cffi with plain addresses, which costs a third less than ctypes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from cffi import FFI

from cosim.master.engine.program import WARNING, Call, Halt, Part, Program
from cosim.master.wiring import Route
from cosim.network import SUBSTITUTE

_FFI: Final = FFI()
_EXCHANGE: Final = "int(*)(uintptr_t, uintptr_t, size_t, uintptr_t)"
_STEP: Final = "int(*)(uintptr_t, double, double, int)"
_Exchange = Callable[[int, int, int, int], int]


class _Ready(NamedTuple):
    """A call as it is made; `offset` is where its values stand in a row, in bytes."""

    function: _Exchange
    component: int
    references: int
    number: int
    offset: int
    call: Call


class _Turn(NamedTuple):
    """What a station does once all have sent."""

    moves: tuple[Route, ...]
    sets: list[_Ready]
    late: list[_Ready]
    sets_integers: list[_Ready]
    gets: list[_Ready]
    gets_integers: list[_Ready]


class PythonEngine:
    """Carries a program out in Python."""

    def __init__(self, program: Program) -> None:
        self._program = program
        self._rows = program.rows
        self._base = int(program.rows.ctypes.data)
        self._stride = int(program.rows.strides[0])
        self._tables = [table.data for table in program.tables]
        self._sends, _, self._sends_integers = _sorted(program.sends)
        self._parts = [_part(part) for part in program.parts]
        self._steps = [(_FFI.cast(_STEP, f), c, station) for station, f, c in program.steps]
        self._k, self._complete = 0, False

    def where(self) -> tuple[int, bool]:
        """The point that is being worked on, and whether its row is complete."""
        return self._k, self._complete

    def advance(self, first: int, last: int) -> Halt | None:
        """Exchange at the points first to last - 1, and step from each but the run's last."""
        halt = self._advance(first, last)
        complete = last if halt is None else halt.complete
        # looked at a stretch at a time; what came after a point out of range does not count
        return self._out_of_range(first, complete) or halt

    def _out_of_range(self, first: int, last: int) -> Halt | None:
        bound = self._program.bound
        part = self._rows[first:last, : self._program.outputs]
        # NaN is in no range, and comes out of both
        if part.size == 0 or (part.min() >= -bound and part.max() <= bound):
            return None
        row, column = np.argwhere(~(np.abs(part) <= bound))[0].tolist()
        return Halt(first + row, first + row + 1, "range", column, 0)

    def _advance(self, first: int, last: int) -> Halt | None:
        points = self._program.points_ns
        nows = self._program.seconds[first:last].tolist()
        sizes = (np.diff(points[first : last + 1]) / 1e9).tolist()
        for k, now, size in zip(range(first, last), nows, [*sizes, None], strict=False):
            self._k, self._complete = k, False
            halt = self._exchange(k)
            if halt is not None:
                return halt
            if size is None:
                break
            self._complete = True
            for step, component, station in self._steps:
                status = step(component, now, size, 1)
                if status > WARNING:
                    return Halt(k, k + 1, "step", station, status)
        return None

    def _exchange(  # noqa: C901, PLR0911, PLR0912 - what happens at a point, in one place
        self, k: int
    ) -> Halt | None:
        row = self._base + k * self._stride
        for function, component, references, count, offset, call in self._sends:
            status = function(component, references, count, row + offset)
            if status > WARNING:
                return Halt(k, k, "get", call.station, status)
        if self._sends_integers:
            halt = self._get_integers(self._sends_integers, k)
            if halt is not None:
                return halt
        for moves, sets, late, sets_integers, gets, gets_integers in self._parts:
            for route in moves:
                self._move(route, k)
            for function, component, references, count, offset, call in sets:
                status = function(component, references, count, row + offset)
                if status > WARNING:
                    return Halt(k, k, "set", call.station, status)
            for function, component, references, count, offset, call in late:
                used = self._tables[call.table][k]
                address = (
                    self._base + used * self._stride + offset if used >= 0 else row + 8 * call.own
                )
                status = function(component, references, count, address)
                if status > WARNING:
                    return Halt(k, k, "set", call.station, status)
            if sets_integers:
                halt = self._set_integers(sets_integers, k)
                if halt is not None:
                    return halt
            for function, component, references, count, offset, call in gets:
                status = function(component, references, count, row + offset)
                if status > WARNING:
                    return Halt(k, k, "get", call.station, status)
            if gets_integers:
                halt = self._get_integers(gets_integers, k)
                if halt is not None:
                    return halt
        return None

    def _get_integers(self, calls: Sequence[_Ready], k: int) -> Halt | None:
        for function, component, references, count, _, call in calls:
            status = function(component, references, count, call.scratch.ctypes.data)
            if status > WARNING:
                return Halt(k, k, "get", call.station, status)
            self._rows[k, call.column : call.column + count] = call.scratch
        return None

    def _set_integers(self, calls: Sequence[_Ready], k: int) -> Halt | None:
        for function, component, references, count, _, call in calls:
            call.scratch[:] = self._rows[k, call.column : call.column + count]
            status = function(component, references, count, call.scratch.ctypes.data)
            if status > WARNING:
                return Halt(k, k, "set", call.station, status)
        return None

    def _move(self, route: Route, k: int) -> None:
        """Put what is in use at point k into the receiver's part of row k."""
        used = int(route.row[k])
        rows = self._rows
        if used >= 0:
            values = rows[used, route.columns]
            if route.weight is not None and route.weight[k] > 0.0:
                share = route.weight[k]
                values = (1.0 - share) * values + share * rows[used + 1, route.columns]
            if route.link is not None and route.link.quantization:
                values = route.link.quantize(values)
            rows[k, route.targets] = values
        elif used == SUBSTITUTE and route.link is not None:
            rows[k, route.targets] = route.link.substitute


def _sorted(calls: Sequence[Call]) -> tuple[list[_Ready], list[_Ready], list[_Ready]]:
    """Calls on Reals of row k, on Reals of earlier rows, on Integers and Booleans."""
    ready = [_ready(call) for call in calls]
    reals = [r for r in ready if r.call.reals]
    return (
        [r for r in reals if r.call.table < 0],
        [r for r in reals if r.call.table >= 0],
        [r for r in ready if not r.call.reals],
    )


def _ready(call: Call) -> _Ready:
    function: Any = _FFI.cast(_EXCHANGE, call.function)
    return _Ready(
        function,
        call.component,
        call.references.ctypes.data,
        call.references.size,
        8 * call.column,
        call,
    )


def _part(part: Part) -> _Turn:
    sets, late, sets_integers = _sorted(part.sets)
    gets, _, gets_integers = _sorted(part.gets)
    return _Turn(part.moves, sets, late, sets_integers, gets, gets_integers)
