"""Programs: a run as lists of operations, which both engines execute at every point.

Jacobi, at each point:        Gauss-Seidel, at the first point: every get, into row 0;
    every get that waits      then at each point:
      for nobody;                 per component in order: its moves, its sets, its step,
    per component in order:         its gets, into the row of its next point.
      its moves, its sets,
      its other gets;
    every step.

At the last point of a run there are no steps, and no gets that would follow one. The engines
check the outputs of each row against the range of the run. Values are exchanged in place: a get
of doubles writes to an address in the row, a set reads from one, in row k or in the sender's row
that the route names. Only values that are interpolated, quantized, substituted, adjusted or not
neighbours are copied first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_instance import ComponentInstance, Group, Rows
from cosim.master.exchange import Exchange
from cosim.master.routes import Route
from cosim.master.system import System
from cosim.master.wiring import Wiring

Integers = NDArray[np.int64]

ENDED = 101
"""Not a status of FMI: the slave asks for the end of the run."""


class Adjustment(NamedTuple):
    """factor * value + offset in place of a value; factor 0: offset, whatever the value."""

    factor: float
    offset: float

    def apply(self, rows: Rows, k: int, column: int) -> None:
        """Adjust one value."""
        value = rows[k, column]
        rows[k, column] = self.offset if self.factor == 0.0 else self.factor * value + self.offset


@dataclass(frozen=True, eq=False)
class Call:
    """An FMI call that exchanges a group.

    instance : index of the component instance.
    way : "get" or "set".
    function, component, references, count, values, column : of the call; `column` is the first
        column of the values in the row written to or read from.
    version : of FMI.
    table : row that is read at each point, int64 (n,); None: row k itself.
    own : the first column of the values in the instance's own part of row k.
    ahead : a get into the row of the instance's next point.
    exchange : executes the call if the values are not doubles; None for doubles.
    c_type : numpy's name of the type of one value.
    """

    instance: int
    way: Literal["get", "set"]
    function: int
    component: int
    references: NDArray[np.uint32]
    count: int
    values: int
    column: int
    version: str
    table: Integers | None
    own: int
    ahead: bool
    exchange: Exchange | None
    c_type: str


@dataclass(frozen=True, eq=False)
class Move:
    """Copy the values of a route at point k to the receiver's inputs in row k."""

    instance: int
    route: Route


@dataclass(frozen=True, eq=False)
class Adjust:
    """Adjust one column, of row k or, `ahead`, of the row of the instance's next point."""

    instance: int
    column: int
    by: Adjustment
    ahead: bool


@dataclass(frozen=True, eq=False)
class Step:
    """A step of a component instance.

    `results` : address that an FMI 3.0 slave writes the results of the call to; `final`:
    promises the slave that no state from before the step will be restored.
    """

    instance: int
    function: int
    component: int
    version: str
    results: int
    final: bool


@dataclass(frozen=True, eq=False)
class Complete:
    """Marks row k as complete; under Gauss-Seidel, except inputs of components that follow."""

    instance: int = -1


Operation = Call | Move | Adjust | Step | Complete


class EarlyStop(NamedTuple):
    """Why a run cannot go on.

    k : the point.
    complete : number of rows that are complete.
    what : the FMI call that was refused, "get", "set" or "step"; "range" when an output is out
        of range; "end" when a component asked for the end of the run.
    instance : index of the instance in the wiring; for "range" the column of the output.
    status : as the FMU returned it.
    """

    k: int
    complete: int
    what: Literal["get", "set", "step", "range", "end"]
    instance: int
    status: int


def refusal(operation: Operation, k: int, complete: int, status: int) -> EarlyStop:
    """Return the early stop at an operation that a slave refused, or ended the run with."""
    if status == ENDED:
        return EarlyStop(k, complete, "end", operation.instance, 0)
    what = operation.way if isinstance(operation, Call) else "step"
    return EarlyStop(k, complete, what, operation.instance, status)


@dataclass(frozen=True, eq=False)
class Program:
    """The operations of a run, with addresses in place of names.

    Attributes
    ----------
    rows, outputs : as in the wiring.
    comm_points : the points.
    opening : at the first point, before all others.
    sending : at every point; after it, the values sent are in the row.
    leaving : after that, at every point but the last; concluding : at the last.
    next_points : per instance, its next point at its own points, -1 elsewhere; None: every point.
    bound : an output beyond +-bound, or NaN, ends the run.
    """

    rows: Rows
    outputs: int
    comm_points: CommunicationPoints
    opening: tuple[Operation, ...]
    sending: tuple[Operation, ...]
    leaving: tuple[Operation, ...]
    concluding: tuple[Operation, ...]
    next_points: tuple[Integers | None, ...]
    bound: float


def make_program(
    system: System,
    wiring: Wiring,
    adjustments: Mapping[int, Adjustment] | None = None,
    *,
    may_go_back: bool = False,
) -> Program:
    """Make the program of a wiring whose instances have their slaves.

    `adjustments` : by column of the rows; no direct route may bring such a column
    (`ComponentInstance.copy_from`). `may_go_back` : saved states may be restored.
    """
    builder = _ProgramBuilder(wiring.instances, adjustments or {}, final=not may_go_back)
    opening, sending, leaving, concluding = (
        builder.gauss_seidel() if system.algorithm == "gauss-seidel" else builder.jacobi(system)
    )
    return Program(
        rows=wiring.rows,
        outputs=wiring.outputs,
        comm_points=wiring.comm_points,
        opening=tuple(opening),
        sending=tuple(sending),
        leaving=tuple(leaving),
        concluding=tuple(concluding),
        next_points=tuple(
            None if s.own_points.always else s.own_points.following for s in wiring.instances
        ),
        bound=system.divergence,
    )


_Lists = tuple[list[Operation], list[Operation], list[Operation], list[Operation]]


class _ProgramBuilder:
    """Makes the operations of component instances."""

    def __init__(
        self,
        instances: tuple[ComponentInstance, ...],
        adjustments: Mapping[int, Adjustment],
        *,
        final: bool,
    ) -> None:
        self._instances = instances
        self._adjustments = adjustments
        self._final = final

    def jacobi(self, system: System) -> _Lists:
        sending: list[Operation] = []
        receiving: list[Operation] = []
        for i, instance in enumerate(self._instances):
            sending += self._gets(i, instance.outputs_without_feedthrough)
            receiving += [*self._takes(i), *self._gets(i, instance.outputs_with_feedthrough)]
        places = {instance.name: i for i, instance in enumerate(self._instances)}
        steps = [self._step(places[name]) for name in system.components]
        return [], sending, [*receiving, Complete(), *steps], receiving

    def gauss_seidel(self) -> _Lists:
        opening: list[Operation] = []
        point: list[Operation] = []
        closing: list[Operation] = []
        for i, instance in enumerate(self._instances):
            outputs = (*instance.outputs_without_feedthrough, *instance.outputs_with_feedthrough)
            opening += self._gets(i, outputs)
            closing += self._takes(i)
            point += [*self._takes(i), self._step(i), *self._gets(i, outputs, ahead=True)]
        return opening, [], [Complete(), *point], [Complete(), *closing]

    def _takes(self, number: int) -> list[Operation]:
        instance = self._instances[number]
        moves: list[Operation] = [
            Move(number, route)
            for i, route in enumerate(instance.routes)
            if i not in instance.direct_routes
        ]
        adjusts: list[Operation] = []
        sets: list[Operation] = []
        for group in instance.connected_inputs:
            adjusts += self._adjusted(number, group, ahead=False)
            if group.route in instance.direct_routes:
                route = instance.routes[group.route]
                wire = bool((route.row == np.arange(route.row.size)).all())
                table = None if wire else route.row
                sets.append(self._call(number, group, "set", int(route.columns[0]), table))
            else:
                sets.append(self._call(number, group, "set", group.column, None))
        return [*moves, *adjusts, *sets]

    def _gets(
        self, number: int, groups: tuple[Group, ...], *, ahead: bool = False
    ) -> list[Operation]:
        found: list[Operation] = []
        for group in groups:
            found.append(self._call(number, group, "get", group.column, None, ahead=ahead))
            found += self._adjusted(number, group, ahead=ahead)
        return found

    def _adjusted(self, number: int, group: Group, *, ahead: bool) -> list[Operation]:
        columns = range(group.column, group.column + group.size)
        return [
            Adjust(number, column, self._adjustments[column], ahead)
            for column in columns
            if column in self._adjustments
        ]

    def _call(
        self,
        number: int,
        group: Group,
        way: Literal["get", "set"],
        column: int,
        table: Integers | None,
        *,
        ahead: bool = False,
    ) -> Call:
        instance = self._instances[number]
        slave = instance.slave
        return Call(
            instance=number,
            way=way,
            function=slave.address(way, group.getter_type),
            component=slave.component,
            references=group.references,
            count=group.references.size,
            values=group.size,
            column=column,
            version=slave.description.version,
            table=table,
            own=group.column,
            ahead=ahead,
            exchange=None if group.c_type == "f8" else Exchange(instance, group, way),
            c_type=group.c_type,
        )

    def _step(self, number: int) -> Step:
        slave = self._instances[number].slave
        version = slave.description.version
        results = slave.step_results if version == "3.0" else 0
        return Step(number, slave.address("step"), slave.component, version, results, self._final)
