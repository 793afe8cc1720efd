"""Generate Python source for a program: a loop over points with one line per operation.

So the operations of a run are looked up once, not again at each point.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim.master.engine.program import (
    ENDED,
    Adjust,
    Call,
    Complete,
    Move,
    Operation,
    Program,
    Step,
)
from cosim.master.exchange import exchange_function, pointer, step_function
from cosim.master.routes import Route
from cosim.network import SUBSTITUTE

SegmentFunction = Callable[[int, int], tuple[int, int, int] | None]
"""Executes points first to last - 1; returns (point, operation, status) of a refused call."""


def segment_function(
    program: Program, operations: Sequence[Operation], place: list[int], *, name: str
) -> SegmentFunction:
    """Compile a function that executes a list of operations, point after point.

    It keeps `place` at [point, whether its row is complete].
    """
    writer = _Writer(program, place)
    for number, operation in enumerate(operations):
        writer.add(number, operation)
    source = writer.source(name)
    scope: dict[str, Any] = {}
    exec(compile(source, f"<{name} of a run>", "exec"), writer.names, scope)  # noqa: S102 - ours
    found: SegmentFunction = scope[name]
    return found


class _Writer:
    """Collects lines of source, and the objects that they name."""

    def __init__(self, program: Program, place: list[int]) -> None:
        rows = program.rows
        self._program = program
        self._base = int(rows.ctypes.data)
        self._stride = int(rows.strides[0])
        self.names: dict[str, Any] = {
            "place": place,
            "seconds": program.comm_points.seconds.data,
            "sizes": program.comm_points.sizes.data,
            "rows": rows,
        }
        self._lines: list[str] = []

    def source(self, name: str) -> str:
        given = ", ".join(f"{n}={n}" for n in self.names)
        body = self._lines or ["pass"]
        return "\n".join(
            [
                f"def {name}(first, last, {given}):",
                "    times = zip(range(first, last), seconds[first:last].tolist(),",
                "                sizes[first:last].tolist(), strict=True)",
                "    for k, now, size in times:",
                "        place[0] = k; place[1] = 0",
                f"        row = {self._base} + k * {self._stride}",
                *(f"        {line}" for line in body),
                "    return None",
            ]
        )

    def add(self, number: int, operation: Operation) -> None:
        lines = self._written(number, operation)
        next_points = (
            self._program.next_points[operation.instance] if operation.instance >= 0 else None
        )
        if next_points is None:
            self._lines += lines
        else:
            test = f"if {self._next_points(operation.instance)}[k] >= 0:"
            self._lines += [test, *(f"    {line}" for line in lines)]

    def _written(self, number: int, operation: Operation) -> list[str]:
        match operation:
            case Complete():
                return ["place[1] = 1"]
            case Move():
                self.names[f"move{number}"] = mover(self._program, operation.route)
                return [f"move{number}(k)"]
            case Adjust():
                row = self._next(operation.instance) if operation.ahead else "k"
                factor, offset = operation.by
                cell = f"rows[{row}, {operation.column}]"
                value = repr(offset) if factor == 0.0 else f"{factor!r} * {cell} + {offset!r}"
                return [f"{cell} = {value}"]
            case Step():
                return self._step(number, operation)
            case Call():
                return self._call(number, operation)

    def _call(self, number: int, call: Call) -> list[str]:
        if call.exchange is not None:
            self.names[f"{call.way}{number}"] = call.exchange
            row = self._next(call.instance) if call.ahead else "k"
            return _refusable(number, f"{call.way}{number}(rows[{row}])")
        function = f"{call.way}{number}"
        self.names[function] = exchange_function(call.version, call.function)
        component = self._pointer(f"c{call.instance}", call.component)
        references = self._pointer(f"r{number}", call.references.ctypes.data)
        more = "" if call.version == "2.0" else f", {call.values}"
        address = f"row + {8 * call.column}"
        before = []
        if call.ahead:
            address = (
                f"{self._base + 8 * call.column} + {self._next(call.instance)} * {self._stride}"
            )
        elif call.table is not None:
            self.names[f"t{number}"] = np.ascontiguousarray(call.table).data
            before = [f"used = t{number}[k]"]
            address = (
                f"{self._base + 8 * call.column} + used * {self._stride}"
                f" if used >= 0 else row + {8 * call.own}"
            )
        text = f"{function}({component}, {references}, {call.count}, {address}{more})"
        return [*before, *_refusable(number, text)]

    def _step(self, number: int, step: Step) -> list[str]:
        self.names[f"step{number}"] = step_function(step.version, step.function)
        component = self._pointer(f"c{step.instance}", step.component)
        size = "size"
        if self._program.next_points[step.instance] is not None:
            size = f"{self._sizes(step.instance)}[k]"
        if step.version == "2.0":
            return _refusable(number, f"step{number}({component}, now, {size}, {int(step.final)})")
        at = step.results
        results = ", ".join(str(at + place) for place in (0, 1, 2, 8))
        text = f"step{number}({component}, now, {size}, {int(step.final)}, {results})"
        self.names[f"results{number}"] = _flag(at + 1)
        asks = f"if results{number}[0]: return k, {number}, {ENDED}"
        return [*_refusable(number, text), asks]

    def _pointer(self, name: str, address: int) -> str:
        self.names[name] = pointer(address)
        return name

    def _next_points(self, instance: int) -> str:
        next_points = self._program.next_points[instance]
        assert next_points is not None  # noqa: S101 - asked for where there is one
        self.names[f"next_points{instance}"] = np.ascontiguousarray(next_points).data
        return f"next_points{instance}"

    def _next(self, instance: int) -> str:
        return (
            "(k + 1)"
            if self._program.next_points[instance] is None
            else f"{self._next_points(instance)}[k]"
        )

    def _sizes(self, instance: int) -> str:
        next_points, points = (
            self._program.next_points[instance],
            self._program.comm_points.points_ns,
        )
        self.names[f"size{instance}"] = ((points[next_points] - points) / 1e9).data
        return f"size{instance}"


def _refusable(number: int, call: str) -> list[str]:
    return [f"if (status := {call}) > 1: return k, {number}, status"]


def _flag(address: int) -> Any:
    """Return a view of the byte at an address, which a slave writes."""
    return (ctypes.c_ubyte * 1).from_address(address)


def mover(program: Program, route: Route) -> Callable[[int], None]:
    """Return a function that copies the values of a route at point k to the inputs in row k."""
    rows, link = program.rows, route.link

    def move(k: int) -> None:
        used = int(route.row[k])
        if used >= 0:
            values = rows[used, route.columns]
            if route.weight is not None and route.after is not None and route.weight[k] > 0.0:
                share = route.weight[k]
                values = (1.0 - share) * values + share * rows[route.after[k], route.columns]
            if link is not None and link.quantization:
                values = link.quantize(values)
            rows[k, route.targets] = values
        elif used == SUBSTITUTE and link is not None:
            rows[k, route.targets] = link.substitute

    return move
