"""The compiled engine: the program as tables of numbers, and the kernel that runs them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.master.engine import kernel
from cosim.master.engine.program import Call, Halt, Program
from cosim.master.wiring import Route

_WHAT: tuple[Literal["get", "set", "step", "range"], ...] = ("get", "set", "step", "range")
"""The words of a `Halt`, by the kernel's number."""
_Integers = NDArray[np.int64]


class CompiledEngine:
    """Carries a program out in machine code; the same results, bit for bit."""

    def __init__(self, program: Program) -> None:
        self._program = program  # the addresses below point into its arrays
        self._place = np.zeros(2, np.int64)
        self._tables: list[_Integers] = list(program.tables)
        self._weights: list[NDArray[np.float64]] = []
        self._pairs: list[_Integers] = []
        self._numbers: list[float] = []
        self._moves: list[list[int]] = []
        self._scratch = 0
        sends = _in_order(program.sends)
        sets: list[Call] = []
        gets: list[Call] = []
        parts = []
        for part in program.parts:
            bounds = [len(self._moves), len(sets), len(gets)]
            for route in part.moves:
                self._add_move(route)
            sets += _in_order(part.sets)
            gets += _in_order(part.gets)
            ends = [len(self._moves), len(sets), len(gets)]
            parts.append([x for pair in zip(bounds, ends, strict=True) for x in pair])
        calls = [self._calls(group) for group in (sends, sets, gets)]
        n = program.points_ns.size
        self._arguments: tuple[Any, ...] = (
            self._place,
            program.rows,
            program.points_ns,
            program.seconds,
            calls[0],
            np.array(parts, np.int64).reshape(-1, 6),
            np.array(self._moves, np.int64).reshape(-1, kernel.MOVE_FIELDS),
            calls[1],
            calls[2],
            np.array(program.steps, np.int64).reshape(-1, 3),
            np.array(self._tables, np.int64).reshape(-1, n),
            np.array(self._weights, np.float64).reshape(-1, n),
            np.array([p for pairs in self._pairs for p in pairs], np.int64).reshape(-1, 2),
            np.array(self._numbers, np.float64),
            np.zeros(max(self._scratch, 1), np.int32),
            program.outputs,
            program.bound,
        )

    def where(self) -> tuple[int, bool]:
        """The point that is being worked on, and whether its row is complete."""
        return int(self._place[0]), bool(self._place[1])

    def advance(self, first: int, last: int) -> Halt | None:
        """Exchange at the points first to last - 1, and step from each but the run's last."""
        k, complete, why, station, status = kernel.advance(first, last, *self._arguments)
        return None if why == kernel.NOTHING else Halt(k, complete, _WHAT[why], station, status)

    def _calls(self, calls: Sequence[Call]) -> _Integers:
        table = np.zeros((len(calls), kernel.CALL_FIELDS), np.int64)
        for i, call in enumerate(calls):
            scratch = -1
            if not call.reals:
                scratch, self._scratch = self._scratch, self._scratch + call.references.size
            table[i] = (
                call.function,
                call.component,
                call.references.ctypes.data,
                call.references.size,
                call.column,
                scratch,
                call.table,
                call.own,
                call.station,
            )
        return table

    def _add_move(self, route: Route) -> None:
        self._tables.append(route.row)
        weight = -1
        if route.weight is not None:
            weight = len(self._weights)
            self._weights.append(route.weight)
        begin = sum(len(pairs) for pairs in self._pairs)
        self._pairs.append(np.column_stack([route.columns, route.targets]).astype(np.int64))
        quantized, substituted = -1, -1
        if route.link is not None and route.link.quantization:
            quantized = self._number(route.link.quantization)
        if route.link is not None and route.link.substitute is not None:
            substituted = self._number(route.link.substitute)
        end = begin + route.columns.size
        table = len(self._tables) - 1
        self._moves.append([table, weight, begin, end, quantized, substituted])

    def _number(self, value: float) -> int:
        self._numbers.append(value)
        return len(self._numbers) - 1


def _in_order(calls: Sequence[Call]) -> list[Call]:
    """As the Python engine makes them: Reals of row k, Reals of other rows, the rest."""
    return sorted(calls, key=lambda call: (not call.reals, call.table >= 0))
