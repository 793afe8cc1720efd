"""The kernel: `kernel.c`, prebuilt or compiled at first use, carries out the table of a run.

It takes the addresses of the FMUs' functions and instances, and exchanges numbers; Strings and
Binary it lets Python exchange.
"""

from __future__ import annotations

import ctypes
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import FmuSlave
from cosim.master.compiled import load_kernel
from cosim.master.component_instance import Group
from cosim.master.exchange import exchange_of
from cosim.master.guards import Guards
from cosim.master.routes import Route
from cosim.master.rows_in_use import RowsInUse
from cosim.master.table import (
    RAISED,
    ROW_SUM,
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
)

_OF_TEAM = 2
"""Where the words of a team begin, see `Table.word`."""
_KINDS = (Get, Set, Move, Step, Complete, Guess, Settle)
_USUAL = (None, Get, Set, Step, Complete)
"""Kinds that have a shorter way in the kernel, by the number there."""
_GATHER, _GATHER_AND_SET = 5, 6
"""The numbers of a move, and of a set, of values from anywhere in a row."""
_SCATTERED, _ALTERED = 1, 2
"""What is special in a move."""
_C_TYPES = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
_IN_PYTHON = len(_C_TYPES)
"""The number of a type that Python exchanges: a text."""
_EXCHANGE = ctypes.CFUNCTYPE(ctypes.c_int64, ctypes.c_int64)
"""Exchanges a group of texts in a row, and returns the status."""
_OPERATION = np.dtype(
    [
        *((name, "i8") for name in ("usual", "number", "function", "component", "references")),
        *((name, "i8") for name in ("count", "column", "row", "source", "values", "pairs")),
        *((name, "i8") for name in ("kind", "special", "type", "fmi3", "when", "ahead", "spare")),
        *((name, "i8") for name in ("following", "scratch", "after", "weight")),
        *((name, "f8") for name in ("quantization", "substitute")),
        *((name, "i8") for name in ("substituted", "results", "back", "limit")),
        ("tolerance", "f8"),
        *((name, "i8") for name in ("events", "save", "state")),
    ]
)
"""`Operation` of kernel.c, its pointers as integers."""
_RUN = np.dtype(
    [
        (name, "i8")
        for name in (
            *("rows", "width", "outputs", "spare", "final", "no_way_back"),
            *("points", "seconds", "sizes", "bounds", "factor", "offset", "active"),
            *(
                "adjustments",
                "copying",
                "word",
                "status",
                "column",
                "passes",
                "guards",
                "announced",
            ),
        )
    ]
)
"""`Run` of kernel.c."""
_GUARDS = np.dtype(
    [
        (name, "i8")
        for name in ("sources", "nodes", "slots", "count", "results", "expected", "conditions")
    ]
)
"""`Guards` of kernel.c."""


class KernelLoop:
    """Carries out a table of operations in machine code."""

    def __init__(self, table: Table) -> None:
        self._table = table
        self._library = load_kernel()
        self._kept: list[Any] = []  # the addresses below point into these
        self._raised: BaseException | None = None
        # a set reads the sender's row: the move is left out, as long as nothing is adjusted
        kept = [not (self._sets_directly(o) and isinstance(o, Move)) for o in table.operations]
        self._places = np.cumsum([0, *kept])
        self._operations = np.zeros(sum(kept), _OPERATION)
        numbers = self._in_order(np.flatnonzero(kept).tolist())
        for line, number in zip(self._operations, numbers, strict=True):
            line["number"] = number
            self._encode(line, table.operations[number])
        points, adjustments = table.comm_points, table.adjustments
        self._run, self._guards = np.zeros(1, _RUN), np.zeros(1, _GUARDS)
        self._run["rows"] = self._address(table.rows)
        self._run["width"] = table.rows.shape[1]
        self._run["outputs"], self._run["spare"] = table.outputs, table.spare
        self._run["points"] = self._address(points.points_ns)
        self._run["seconds"] = self._address(points.seconds)
        self._run["sizes"] = self._address(points.sizes)
        self._run["bounds"] = self._address(table.bounds)
        self._run["factor"] = self._address(adjustments.factor)
        self._run["offset"] = self._address(adjustments.offset)
        self._run["active"] = self._address(adjustments.active)
        self._run["adjustments"] = self._address(adjustments.count)
        self._run["copying"] = self._address(table.copying)
        self._run["word"] = self._address(table.word)
        self._team = self._make_team(table) if table.threads > 1 else None

    def close(self) -> None:
        """End its threads."""
        if self._team is not None:
            self._library.end_team(self._team)
        self._team = None

    def _make_team(self, table: Table) -> int:
        """Start the threads that step instances side by side.

        Raises
        ------
        InputError : the system gives no threads.
        """
        ends = [i + 1 for i, o in enumerate(table.operations) if isinstance(o, Step)]
        begins = [table.complete + 1, *ends[:-1]]
        groups = np.column_stack([self._places[begins], self._places[ends]])
        threads = min(table.threads, len(ends), ROW_SUM - _OF_TEAM - 1)
        team: int | None = self._library.make_team(
            *(threads, self._address(groups.astype(np.int64)), len(groups)),
            self._address(table.word[_OF_TEAM:]),
        )
        if team is None:
            raise InputError(
                "the components cannot step side by side",
                where="run.threads",
                expected="a system with POSIX threads that has so many left",
                got=str(table.threads),
                hint="run.threads = 1",
            )
        return team

    def run(
        self, begin: int, end: int, first: int, last: int, guards: Guards | None = None
    ) -> EarlyStop | None:
        """Carry out operations begin to end - 1 at points first to last - 1.

        guards : looked at behind each point; an early stop is at the first that is not met.
        """
        run = self._run
        run["guards"] = 0 if guards is None else self._encoded(guards)
        run["final"] = self._table.comm_points.final
        run["no_way_back"] = self._table.no_way_back[0]
        places = (int(self._places[number]) for number in (begin, end))
        if not self._library.run(
            *(run.ctypes.data, self._operations.ctypes.data, *places, first, last),
            self._team,
            int(self._places[self._table.complete + 1]),
        ):
            return None
        raised, self._raised = self._raised, None
        if raised is not None:
            raise raised
        return self._table.early_stop(int(run["status"][0]), int(run["column"][0]))

    def _encoded(self, guards: Guards) -> int:
        """Return the address of guards as they are now."""
        line = self._guards
        line["sources"] = guards.sources.ctypes.data
        line["nodes"], line["slots"] = guards.nodes.ctypes.data, guards.slots.ctypes.data
        line["count"], line["results"] = len(guards.nodes), guards.results.ctypes.data
        line["expected"] = guards.expected.ctypes.data
        line["conditions"] = len(guards.results)
        return int(line.ctypes.data)

    def _address(self, array: NDArray[Any]) -> int:
        if not array.flags.c_contiguous:
            raise ValueError("expected an array without gaps")
        self._kept.append(array)
        return int(array.ctypes.data)

    def _in_order(self, numbers: list[int]) -> list[int]:
        """Return the operations in the order in which they are carried out."""
        return numbers

    def _sets_directly(self, operation: Operation) -> bool:
        """Whether a set reads the sender's row, or a move is left out for that."""
        if isinstance(operation, Move):
            return operation.direct
        return isinstance(operation, Set) and operation.source is not None

    @staticmethod
    def kind_of(operation: Operation) -> int:
        """Return the number of the kind of an operation."""
        return _KINDS.index(type(operation))

    def _encode(self, line: Any, operation: Operation) -> None:
        line["kind"], line["when"] = self.kind_of(operation), operation.when
        line["ahead"], line["spare"] = operation.ahead, operation.spare
        if operation.following is not None:
            line["following"] = self._address(operation.following)
        match operation:
            case Get(group=group):
                self._encode_exchange(line, operation, group, "get")
            case Set(group=group):
                self._encode_exchange(line, operation, group, "set")
                self._encode_source(line, operation)
            case Move(route=route, sample=sample):
                self._encode_move(line, route, sample)
            case Step():
                slave = self._encode_slave(line, operation)
                line["function"], line["results"] = slave.address("step"), slave.step_results
                line["special"] = slave.description.version == "1.0"
            case Guess(loop=loop) | Settle(loop=loop):
                line["limit"], line["tolerance"] = loop.limit, loop.tolerance
                line["values"], line["pairs"] = loop.columns.size, self._address(loop.columns)
                line["scratch"] = self._address(loop.kept)
        if isinstance(operation, Settle):
            line["back"] = self._places[operation.begin]
        line["usual"] = self._usual(line, operation)

    @staticmethod
    def _usual(line: Any, operation: Operation) -> int:
        """Return the number of a usual kind: doubles in FMI 2.0, at every point, in row k."""
        if line["fmi3"] or operation.following is not None:
            return 0
        kind: type[Operation] = type(operation)
        if kind is not Step and (operation.when or operation.ahead or operation.spare):
            return 0
        if kind is Move:
            return _GATHER if line["special"] == _SCATTERED else 0
        if kind is Set and not line["row"]:
            kind = Get  # the same but for the function
        if kind is Set and line["pairs"]:
            return _GATHER_AND_SET
        return _USUAL.index(kind) if kind in _USUAL and not line["special"] else 0

    def _encode_slave(self, line: Any, operation: Operation) -> FmuSlave:
        slave = self._table.instances[operation.instance].slave
        line["component"] = slave.component
        line["fmi3"] = slave.description.version == "3.0"
        return slave

    def _encode_exchange(
        self, line: Any, operation: Operation, group: Group, way: Literal["get", "set"]
    ) -> None:
        slave = self._encode_slave(line, operation)
        line["column"], line["values"] = group.column, group.size
        if group.c_type not in _C_TYPES:
            line["special"], line["type"] = True, _IN_PYTHON
            line["function"] = self._exchange(operation, group, way)
            return
        line["function"] = slave.address(way, group.getter_type)
        line["references"] = self._address(group.references)
        line["count"], line["type"] = group.references.size, _C_TYPES.index(group.c_type)
        if group.c_type != "f8":
            line["special"] = True
            line["scratch"] = self._address(np.zeros(group.size, np.uint64))

    def _exchange(self, operation: Operation, group: Group, way: Literal["get", "set"]) -> int:
        """Return the address of what exchanges a group of texts in a row."""
        rows = self._table.rows
        plain = exchange_of(self._table.instances[operation.instance], group, way)

        def exchange(at: int) -> int:
            try:
                return plain(rows[at])
            except BaseException as error:  # noqa: BLE001 - it is raised again behind the kernel
                self._raised = error
                return RAISED

        self._kept.append(_EXCHANGE(exchange))
        return ctypes.cast(self._kept[-1], ctypes.c_void_p).value or 0

    def _encode_source(self, line: Any, operation: Set) -> None:
        """Encode from where a set reads what the route brings that is its source."""
        route = operation.source
        if route is None or not self._sets_directly(operation):
            return
        line["row"] = self._address(route.in_step.row)
        line["source"] = route.columns[0]
        if route.spans is None:
            line["pairs"] = self._address(_pairs(route))
            line["scratch"] = self._address(np.zeros(len(route.columns)))

    def _encode_move(self, line: Any, route: Route, sample: RowsInUse) -> None:
        pairs = _pairs(route)
        line["pairs"], line["values"] = self._address(pairs), len(pairs)
        altered = sample.weight is not None or route.link_alters
        line["special"] = _ALTERED if altered else _SCATTERED if route.spans is None else 0
        line["source"], line["column"] = pairs[0]
        line["row"] = self._address(sample.row)
        if sample.weight is not None and sample.after is not None:
            line["weight"] = self._address(sample.weight)
            line["after"] = self._address(sample.after)
        if route.link is not None:
            line["quantization"] = route.link.quantization
        if route.link is not None and route.link.substitute is not None:
            line["substituted"], line["substitute"] = True, route.link.substitute


def _pairs(route: Route) -> NDArray[np.int64]:
    """Return the columns read and written, (n, 2)."""
    return np.column_stack([route.columns, route.targets]).astype(np.int64)
