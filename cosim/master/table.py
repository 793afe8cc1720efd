"""The table of operations that a run carries out at every communication point.

Jacobi, at each point:                    Gauss-Seidel, at each point:
    every get that waits for nobody;          at the first: every get, into row 0;
    per component in order:                   the row is complete, but for inputs;
      its moves, its sets,                    per component in order:
      its other gets;                           its moves, its sets, its step,
    the row is complete;                        its gets, into the row of its next point.
    per component: its inputs for the
      middle of the step, its step.

`plain_loop` carries out the table in Python and reads like this; `kernel` does the same in C, bit
for bit. A get writes to the row, a move copies values from the rows that a route names to the
receiver's inputs in the row, a set reads them there: after its operations a row is whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master.adjustments import Adjustments
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_instance import ComponentInstance, Group, Rows
from cosim.master.exchange import TOO_LARGE
from cosim.master.routes import Route, merged_routes
from cosim.master.rows_in_use import RowsInUse
from cosim.master.system import System
from cosim.master.wiring import Wiring

Integers = NDArray[np.int64]

ENDED, UNSETTLED, OUT_OF_RANGE, GUARDED = range(TOO_LARGE + 1, TOO_LARGE + 5)
"""Not statuses of FMI: the slave asks for the end of the run, or returned early from a step; the
values of an algebraic loop do not settle; an output is out of range; a guard is not met."""
JUMPED, RETURNED, ANNOUNCED, RAISED = range(GUARDED + 1, GUARDED + 5)
"""Of the kernel alone: an input whose jump is an event jumps; a component with events returned
early from a step, or announced an event at its end; Python, called by it, has an exception."""
WORD_BITS = 20
"""The word in progress is point << WORD_BITS | number of the operation."""
WORDS = 261
"""Length of `Table.word`."""
ROW_SUM = WORDS - 1
"""Where in it the sum of the complete rows is (`cosim.master.row_sums`)."""
_CRASHED, _THREADS = 2, 3
_NONE = -1


class When(IntEnum):
    """At which points of a run an operation takes place."""

    ALWAYS, AT_FIRST, NOT_AT_LAST = range(3)


@dataclass(frozen=True, eq=False, kw_only=True)
class Operation:
    """An operation of the table.

    Attributes
    ----------
    instance : index of the component instance; -1 for the row as a whole.
    when : at which points.
    following : next point of the instance at its own points, -1 elsewhere, int64 (n,); None: it
        communicates at every point.
    ahead : it writes into the row of the instance's next point.
    spare : it uses the spare row, for inputs of the middle of a step.
    """

    instance: int = -1
    when: When = When.ALWAYS
    following: Integers | None = None
    ahead: bool = False
    spare: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Get(Operation):
    """Read a group of outputs into the row."""

    group: Group


@dataclass(frozen=True, eq=False, kw_only=True)
class Set(Operation):
    """Write a group of inputs from the row.

    `source` : the route that alone brings them, from whose sender's row they may be written.
    """

    group: Group
    source: Route | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Move(Operation):
    """Copy the values that a route brings, from the rows of the sample, to the inputs.

    `direct` : it may be left out, as the `source` of a set.
    """

    route: Route
    sample: RowsInUse
    direct: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Step(Operation):
    """Step to the next point of the instance."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Complete(Operation):
    """The row is complete: check that its outputs are in range."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Guess(Operation):
    """Begin the passes of an algebraic loop with the values of the row before."""

    loop: AlgebraicLoop


@dataclass(frozen=True, eq=False, kw_only=True)
class Settle(Operation):
    """Repeat the operations after the guess until they change no value of the loop.

    `begin` : number of the guess.
    """

    loop: AlgebraicLoop
    begin: int


@dataclass(eq=False)
class AlgebraicLoop:
    """The values of an algebraic loop, and when they are settled.

    Attributes
    ----------
    columns : of the values, outputs and inputs, int64 (m,).
    tolerance : largest change of a settled value, relative to the greater of its size and 1.
    limit : number of passes.
    kept : the values after the last pass, (m,).
    """

    columns: Integers
    tolerance: float
    limit: int

    def __post_init__(self) -> None:
        self.kept = np.zeros(self.columns.size)


class EarlyStop(NamedTuple):
    """Why a run cannot go on, or is to be looked at before it does.

    k : the point.
    complete : number of rows that are complete.
    what : the FMI call that was refused, "get", "set" or "step"; "range" when an output is out
        of range; "end" when a component asked for the end of the run or returned
        early from a step; "loop" when an algebraic
        loop does not settle; "guard" behind a row at which a guard is not met; "announced" behind
        steps of which one announced an event.
    instance : index of the instance in the wiring; for "range" and "loop" the column of the value.
    status : as the FMU returned it.
    """

    k: int
    complete: int
    what: Literal["get", "set", "step", "range", "end", "loop", "guard", "announced"]
    instance: int
    status: int


@dataclass(eq=False)
class Table:
    """The operations of a run, and what they share.

    Attributes
    ----------
    operations : in the order in which they take place at a point.
    sent : number of operations after which the values sent are in the row.
    complete : number of the operation after which a row is complete.
    instances : as in the wiring.
    rows : (points + 1, values); the last one is the spare row.
    outputs : how many of the values are outputs.
    comm_points : the points.
    bounds : largest magnitude of each output in range, (outputs,).
    adjustments : overrides and biases.
    copying : whether all moves must be made: something is adjusted; int64 (1,).
    word : int64 (WORDS,): the word in progress (see `WORD_BITS`), whether an engine is at work on
        it, with `threads` the word that crashed, and those of the threads, -1 for none; and the
        sum of the complete rows.
    is_watched : whether another process reads `word`; else nobody asks for the sum of the rows.
    threads : on so many the steps of a point are carried out side by side.
    no_way_back : whether no saved state of a slave may be restored; int64 (1,).
    """

    operations: tuple[Operation, ...]
    sent: int
    complete: int
    instances: tuple[ComponentInstance, ...]
    rows: Rows
    outputs: int
    comm_points: CommunicationPoints
    bounds: NDArray[np.float64]
    adjustments: Adjustments
    word: Integers
    is_watched: bool
    threads: int = 1
    no_way_back: Integers = field(default_factory=lambda: np.ones(1, np.int64))

    def __post_init__(self) -> None:
        self.spare = self.rows.shape[0] - 1
        self.copying = np.zeros(1, np.int64)
        self.begin_again()

    def begin_again(self) -> None:
        """Prepare for a run: the first one, or another one."""
        self.copying[0], self.no_way_back[0] = 0, 1
        self.word[_CRASHED:ROW_SUM] = _NONE
        self.word[ROW_SUM] = 0

    @cached_property
    def columns_sent(self) -> frozenset[int]:
        """The columns of what is sent: outputs without direct feedthrough."""
        groups = (o.group for o in self.operations[: self.sent] if isinstance(o, Get))
        return frozenset(c for g in groups for c in range(g.column, g.column + g.size))

    def place(self) -> tuple[int, int]:
        """Return the point and the number of the operation in progress."""
        word = int(self.word[0])
        return word >> WORD_BITS, word & ((1 << WORD_BITS) - 1)

    def place_in_team(self) -> int | None:
        """Return the number of the step in progress on the only thread that steps, or crashed."""
        crashed, words = int(self.word[_CRASHED]), self.word[_THREADS:ROW_SUM]
        found = [crashed] if crashed != _NONE else words[words != _NONE].tolist()
        return found[0] & ((1 << WORD_BITS) - 1) if len(found) == 1 else None

    def call(self, number: int) -> tuple[str, str]:
        """Return component and FMI function of an operation; "" for one without a call."""
        if number >= len(self.operations):  # on several threads
            return "", "DoStep of several components"
        operation = self.operations[number]
        if not isinstance(operation, Get | Set | Step):
            return "", ""
        instance = self.instances[operation.instance]
        verb = type(operation).__name__ if not isinstance(operation, Step) else "DoStep"
        kind = "" if isinstance(operation, Step) else operation.group.getter_type
        return instance.name, f"fmi{instance.component.description.version[0]}{verb}{kind}"

    def adjust(self, group: Group, at: int) -> None:
        """Adjust the values of a group in row `at`."""
        if self.adjustments.count[0]:
            self.adjustments.apply(self.rows[at], group.column, group.size)

    def early_stop(self, status: int, column: int) -> EarlyStop:
        """Return the early stop of the operation in progress, which had this status."""
        k, number = self.place()
        if status in (GUARDED, ANNOUNCED):
            what: Literal["guard", "announced"] = "guard" if status == GUARDED else "announced"
            return EarlyStop(column, column + 1, what, 0, status)
        operation = self.operations[number]
        complete = k + (number >= self.complete)
        if status == OUT_OF_RANGE:
            return EarlyStop(k, complete, "range", column, 0)
        if status == UNSETTLED:
            return EarlyStop(k, complete, "loop", column, 0)
        if status == ENDED:
            return EarlyStop(k, complete, "end", operation.instance, 0)
        return EarlyStop(k, complete, _REFUSED[type(operation)], operation.instance, status)


_REFUSED: Mapping[type[Operation], Literal["get", "set", "step"]] = MappingProxyType(
    {Get: "get", Set: "set", Step: "step"}
)


def make_table(
    system: System, wiring: Wiring, adjustments: Adjustments, word: Integers | None
) -> Table:
    """Make the table of a wiring whose instances have their slaves.

    word : as of `Table`, where another process watches it; None: nobody does.
    """
    direct = wiring.direct_sets
    parts = [_InstanceOperations(i, one, direct) for i, one in enumerate(wiring.instances)]
    sending: list[Operation] = []
    if system.algorithm == "gauss-seidel":
        receiving, steps = _gauss_seidel(parts)
    else:
        sending = [operation for part in parts for operation in part.gets(direct=False)]
        receiving, steps = _jacobi(system, wiring, parts, len(sending))
    return Table(
        operations=(*sending, *receiving, Complete(), *steps),
        sent=len(sending),
        complete=len(sending) + len(receiving),
        instances=wiring.instances,
        rows=wiring.all_rows,
        outputs=wiring.outputs,
        comm_points=wiring.comm_points,
        bounds=wiring.bounds,
        adjustments=adjustments,
        word=np.zeros(WORDS, np.int64) if word is None else word,
        is_watched=word is not None,
        threads=system.threads,
    )


_Parts = tuple[list[Operation], list[Operation]]
"""What comes before a row is complete, and after it."""


def _jacobi(
    system: System, wiring: Wiring, parts: Sequence[_InstanceOperations], sent: int
) -> _Parts:
    by_name = {part.instance.name: part for part in parts}
    loops = {loop[0]: [by_name[name] for name in loop] for loop in wiring.receiving.loops}
    iterated = {name for loop in wiring.receiving.loops for name in loop}
    receiving: list[Operation] = []
    for name, part in by_name.items():
        if name in loops:
            receiving += _iterate(system, loops[name], sent + len(receiving))
        elif name not in iterated:
            receiving += [*part.takes(), *part.gets(direct=True)]
    steps: list[Operation] = []
    for part in (by_name[name] for name in system.components):
        steps += [*part.takes_in_step(), part.step()]
    return receiving, steps


def _iterate(
    system: System, parts: Sequence[_InstanceOperations], number: int
) -> Iterator[Operation]:
    """Yield the operations of an algebraic loop; its guess gets this number."""
    columns = np.array([c for part in parts for c in part.columns_in_loop()], np.int64)
    loop = AlgebraicLoop(columns, system.solve_tolerance, system.solve_limit)
    yield Guess(loop=loop)
    for part in parts:
        yield from part.takes()
        yield from part.gets(direct=True)
    yield Settle(loop=loop, begin=number)


def _gauss_seidel(parts: Sequence[_InstanceOperations]) -> _Parts:
    opening: list[Operation] = []
    steps: list[Operation] = []
    for part in parts:
        steps += [*part.takes(), part.step()]
        for direct in (False, True):
            opening += part.gets(direct=direct, when=When.AT_FIRST)
            steps += part.gets(direct=direct, when=When.NOT_AT_LAST, ahead=True)
    return opening, steps


class _InstanceOperations:
    """Makes the operations of one component instance."""

    def __init__(
        self, number: int, instance: ComponentInstance, direct: Mapping[tuple[Group, ...], Route]
    ) -> None:
        self.instance = instance
        self._sources = [direct.get(groups) for groups in instance.input_sets]
        alone = {g.route for groups in instance.input_sets if groups in direct for g in groups}
        self._others = merged_routes(r for i, r in enumerate(instance.routes) if i not in alone)
        own = instance.own_points
        following = None if own.always else own.following
        self._own: dict[str, Any] = {"instance": number, "following": following}

    def takes(self) -> Iterator[Operation]:
        """Yield the moves and sets of its inputs at a point."""
        for source in self._sources:
            if source is not None:
                yield Move(route=source, sample=source.in_step, direct=True, **self._own)
        for route in self._others:
            yield Move(route=route, sample=route.at_point or route.in_step, **self._own)
        for groups, source in zip(self.instance.input_sets, self._sources, strict=True):
            yield Set(group=Group.of_all(groups), source=source, **self._own)

    def takes_in_step(self) -> Iterator[Operation]:
        """Yield the moves and sets of inputs that are others in the step than at its point."""
        given = {"when": When.NOT_AT_LAST, "spare": True, **self._own}
        later = [i for i, r in enumerate(self.instance.routes) if r.at_point is not None]
        for route in (self.instance.routes[i] for i in later):
            yield Move(route=route, sample=route.in_step, **given)
        for group in self.instance.connected_inputs:
            if group.route in later:
                yield Set(group=group, **given)

    def columns_in_loop(self) -> Iterator[int]:
        """Yield the columns of its inputs, and of its outputs with direct feedthrough."""
        instance = self.instance
        for group in (*instance.connected_inputs, *instance.outputs_with_feedthrough):
            if group.c_type != "S":
                yield from range(group.column, group.column + group.size)

    def gets(
        self, *, direct: bool, when: When = When.ALWAYS, ahead: bool = False
    ) -> Iterator[Operation]:
        """Yield the gets of its outputs, those with direct feedthrough or the others."""
        instance = self.instance
        groups = (
            instance.outputs_with_feedthrough if direct else instance.outputs_without_feedthrough
        )
        for group in groups:
            yield Get(group=group, when=when, ahead=ahead, **self._own)

    def step(self) -> Operation:
        """Return its step."""
        return Step(when=When.NOT_AT_LAST, **self._own)
