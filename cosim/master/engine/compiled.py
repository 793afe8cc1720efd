"""The compiled engine: encodes a program as tables of numbers, which the kernel executes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.master.engine import kernel
from cosim.master.engine.program import (
    Adjust,
    Call,
    Complete,
    EarlyStop,
    Move,
    Operation,
    Program,
    Step,
    refusal,
)
from cosim.master.routes import Route

_Integers = NDArray[np.int64]
_Coded = tuple[tuple[Operation, ...], _Integers]


class CompiledEngine:
    """Executes a program in machine code, with the same results bit for bit."""

    def __init__(self, program: Program) -> None:
        self._program = program  # the addresses below point into its arrays
        self._place = np.zeros(2, np.int64)
        self._kept: list[_Integers] = []
        self._tables: list[_Integers] = []
        self._weights: list[NDArray[np.float64]] = []
        self._pairs: list[_Integers] = []
        self._numbers: list[float] = []
        self._moves: list[list[int]] = []
        self._scratch = 0
        self._opening = self._coded(program.opening)
        sending, leaving = self._coded(program.sending), self._coded(program.leaving)
        concluding = self._coded(program.concluding)
        self._parts = (sending, leaving, concluding)
        self._point = _joined(sending, leaving)
        self._closing = _joined(sending, concluding)
        comm_points = program.comm_points
        n = comm_points.points_ns.size
        self._stacked = np.array(self._tables, np.int64).reshape(-1, n)
        self._shares = np.array(self._weights, np.float64).reshape(-1, n)
        scratch = np.zeros(max(self._scratch, 1), np.uint64)
        next_points = [np.full(n, -1) if entry is None else entry for entry in program.next_points]
        self._arguments: tuple[Any, ...] = (
            self._place,
            program.rows,
            comm_points.points_ns,
            comm_points.seconds,
            comm_points.sizes,
            np.array(next_points, np.int64).reshape(-1, n)
            if any(entry is not None for entry in program.next_points)
            else np.zeros((1, 1), np.int64),
            np.array(self._moves, np.int64).reshape(-1, kernel.MOVE_FIELDS),
            self._stacked,
            self._shares,
            np.array([p for pairs in self._pairs for p in pairs], np.int64).reshape(-1, 2),
            np.array(self._numbers, np.float64),
            tuple(scratch.view(code) for code in kernel.TYPES),
            program.outputs,
            program.bound,
        )

    def where(self) -> tuple[int, bool]:
        """Return the point that is being executed, and whether its row is complete."""
        return int(self._place[0]), bool(self._place[1])

    def advance(self, first: int, last: int) -> EarlyStop | None:
        """Exchange at the points first to last - 1, and step from each but the run's last."""
        final = self._program.comm_points.final
        early_stop = self._run(0, 1, self._opening, checked=False) if first == 0 else None
        if early_stop is None and first < min(last, final):
            early_stop = self._run(first, min(last, final), self._point)
        if early_stop is None and last > final:
            early_stop = self._run(final, last, self._closing)
        return early_stop

    def update_routes(self, first: int, last: int) -> None:
        """Take over the rows to be read at the points first to last - 1, which are known now."""
        for own, table in zip(self._stacked, self._tables, strict=True):
            own[first:last] = table[first:last]
        for shares, weight in zip(self._shares, self._weights, strict=True):
            shares[first:last] = weight[first:last]

    def send(self, k: int) -> EarlyStop | None:
        """Execute the first half of point k: after it, the values sent are in the row."""
        early_stop = self._run(0, 1, self._opening, checked=False) if k == 0 else None
        return early_stop or self._run(k, k + 1, self._parts[0], checked=False)

    def receive_and_step(self, k: int) -> EarlyStop | None:
        """Execute the second half of point k."""
        return self._run(k, k + 1, self._parts[2 if k == self._program.comm_points.final else 1])

    def _run(
        self, first: int, last: int, what: _Coded, *, checked: bool = True
    ) -> EarlyStop | None:
        operations, table = what
        *arguments, outputs, bound = self._arguments
        k, complete, refused, status = kernel.run(
            first,
            last,
            table.ctypes.data,
            len(table),
            *arguments,
            outputs if checked else 0,
            bound,
        )
        if refused == kernel.NOTHING:
            return None
        if refused == kernel.RANGE:
            return EarlyStop(k, complete, "range", status, 0)
        return refusal(operations[refused], k, complete, status)

    def _coded(self, operations: Sequence[Operation]) -> _Coded:
        table = np.zeros((len(operations), kernel.FIELDS), np.int64)
        for line, operation in zip(table, operations, strict=True):
            self._code(line, operation)
            always = isinstance(operation, Complete) or (
                self._program.next_points[operation.instance] is None
            )
            line[kernel.POINTS_ROW] = -1 if always else operation.instance
            if line[kernel.POINTS_ROW] < 0 and not line[kernel.AHEAD]:
                line[kernel.KIND] = self._short(line)
        return tuple(operations), table

    @staticmethod
    def _short(line: _Integers) -> int:
        """Return the faster kind, if there is one, of an operation at every point."""
        match int(line[kernel.KIND]):
            case kernel.STEP_2:
                return kernel.STEP
            case kernel.EXCHANGE_2:
                return kernel.LATE if line[kernel.TABLE] else kernel.EXCHANGE
            case kind:
                return kind

    def _code(self, line: _Integers, operation: Operation) -> None:
        match operation:
            case Complete():
                line[kernel.KIND] = kernel.COMPLETE
            case Move():
                line[kernel.KIND] = kernel.MOVE
                line[kernel.TABLE] = self._add_move(operation.route)
            case Adjust():
                line[kernel.KIND] = kernel.ADJUST
                line[kernel.OFFSET] = 8 * operation.column
                line[kernel.AHEAD] = operation.ahead
                line[kernel.COUNT] = self._number(operation.by.factor)
                self._number(operation.by.offset)
            case Step():
                line[kernel.KIND] = kernel.STEP_2 if operation.version == "2.0" else kernel.STEP_3
                line[kernel.FUNCTION] = operation.function
                line[kernel.COMPONENT] = operation.component
                line[kernel.RESULTS] = operation.results
                line[kernel.COUNT] = operation.final
            case Call():
                self._code_call(line, operation)

    def _code_call(self, line: _Integers, call: Call) -> None:
        newer = call.version != "2.0"
        line[kernel.WAY] = kernel.GET if call.way == "get" else kernel.SET
        line[kernel.FUNCTION] = call.function
        line[kernel.COMPONENT] = call.component
        line[kernel.REFERENCES] = call.references.ctypes.data
        line[kernel.COUNT] = call.count
        line[kernel.VALUES] = call.values
        line[kernel.OFFSET] = 8 * call.column
        line[kernel.OWN] = 8 * call.own
        line[kernel.AHEAD] = call.ahead
        if call.exchange is not None:
            line[kernel.KIND] = kernel.TYPED
            line[kernel.TYPE] = kernel.TYPES.index(call.c_type)
            line[kernel.SCRATCH] = self._scratch
            line[kernel.RESULTS] = newer
            self._scratch += call.values
            return
        line[kernel.KIND] = kernel.EXCHANGE_3 if newer else kernel.EXCHANGE_2
        if call.table is not None:
            table = np.ascontiguousarray(call.table, np.int64)
            self._kept.append(table)
            line[kernel.TABLE] = table.ctypes.data

    def _table(self, table: _Integers) -> int:
        self._tables.append(table)
        return len(self._tables) - 1

    def _add_move(self, route: Route) -> int:
        weight, after = -1, -1
        if route.weight is not None and route.after is not None:
            weight, after = len(self._weights), self._table(route.after)
            self._weights.append(route.weight)
        begin = sum(len(pairs) for pairs in self._pairs)
        self._pairs.append(np.column_stack([route.columns, route.targets]).astype(np.int64))
        quantized, substituted = -1, -1
        if route.link is not None and route.link.quantization:
            quantized = self._number(route.link.quantization)
        if route.link is not None and route.link.substitute is not None:
            substituted = self._number(route.link.substitute)
        end = begin + route.columns.size
        table = self._table(route.row)
        self._moves.append([table, after, weight, begin, end, quantized, substituted])
        return len(self._moves) - 1

    def _number(self, value: float) -> int:
        self._numbers.append(value)
        return len(self._numbers) - 1


def _joined(one: _Coded, other: _Coded) -> _Coded:
    return one[0] + other[0], np.vstack([one[1], other[1]])
