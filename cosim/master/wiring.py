"""The rows of a run, and which of them each input reads at each communication point.

Row k of one array contains every value exchanged at point k: the outputs of all components, then
their connected inputs. A sender writes its columns; the columns of a receiver are copied from the
row that its route names. Routes are known before the run, except over links whose delay follows a
signal.

A row has one index for the whole run; the array is reserved for all of them, filled as the points
become known, and its memory is given back where no row is read any more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_instance import (
    ComponentInstance,
    Group,
    Rows,
    Texts,
    element_names,
)
from cosim.master.order import ReceivingOrder
from cosim.master.parts import MODE_NUMBER, Endpoint
from cosim.master.routes import Route, merged_routes
from cosim.master.rows_in_use import RowsInUse
from cosim.master.system import System
from cosim.network import LinkState

Columns = NDArray[np.intp]
HISTORY = 4096
"""So many rows are left when memory is given back, for those who look back from the last one."""


class RowMemory(Protocol):
    """Memory of rows, such as `Reserved`; `array` : (points + 1, values)."""

    array: Rows

    def give_back(self, before: int) -> None:
        """Give back the memory of the rows before this one: they are not read again."""


@dataclass(eq=False)
class Wiring:
    """The rows of a run and the component instances that use them.

    Attributes
    ----------
    memory : of the rows.
    all_rows : (points + 1, values): those of the points, and the spare row.
    outputs : how many of the values are outputs; they come first.
    bounds : largest magnitude of each output in range, (outputs,).
    instances : in the order in which they receive, and under Gauss-Seidel step.
    comm_points : the communication points of the run.
    receiving : the order in which components receive, and what becomes of algebraic loops.
    settled : columns and values of inputs at the first point on which the initialisation settled.
    whole_from : the first row that the loop leaves whole, (1, 1). In the rows before it
        `make_whole` copies the inputs that were set without a copy.
    whole_rows : number of rows in which it has done so.
    gives_back_rows : whether `give_back` includes the rows; a process that shares them leaves that
        to the other one.
    """

    memory: RowMemory
    outputs: int
    bounds: NDArray[np.float64]
    instances: tuple[ComponentInstance, ...]
    texts: Texts
    comm_points: CommunicationPoints
    receiving: ReceivingOrder
    whole_from: Rows
    whole_rows: int = 0
    gives_back_rows: bool = True
    settled: list[tuple[Columns, Rows]] = field(default_factory=list)

    @property
    def all_rows(self) -> Rows:
        """The rows of the points, and the spare row, (points + 1, values)."""
        return self.memory.array

    @property
    def rows(self) -> Rows:
        """The rows of the points, (points, values)."""
        return self.all_rows[:-1]

    def use_rows(self, memory: RowMemory) -> None:
        """Read the rows in other memory from now on."""
        self.memory = memory
        for instance in self.instances:
            first, width = instance.output_column, instance.outputs.shape[1]
            instance.rows = self.rows
            instance.outputs = self.rows[:, first : first + width]

    @cached_property
    def by_name(self) -> Mapping[str, ComponentInstance]:
        """The instances by the names of their components."""
        return {instance.name: instance for instance in self.instances}

    def instance(self, name: str) -> ComponentInstance:
        """Return the instance of a component."""
        return self.by_name[name]

    @cached_property
    def direct_sets(self) -> Mapping[tuple[Group, ...], Route]:
        """By groups that one FMI call sets, the route whose values it can take without a copy.

        They are read in the sender's row, or where several routes read the same rows, gathered.
        """
        found = {}
        # the values of an algebraic loop are in the row while it is iterated
        iterated = {name for loop in self.receiving.loops for name in loop}
        for instance in self.instances:
            for groups in () if instance.name in iterated else instance.input_sets:
                numbers = dict.fromkeys(group.route for group in groups)
                routes = [instance.routes[number] for number in numbers if number is not None]
                exact = all(route.at_point is None and route.unaltered for route in routes)
                merged = merged_routes(routes) if exact and len(routes) == len(numbers) else []
                size = sum(group.size for group in groups if group.c_type == "f8")
                if len(merged) == 1 and merged[0].targets.size == size:
                    found[groups] = merged[0]
        return found

    def make_whole(self, count: int) -> None:
        """Make the first `count` rows whole: copy the inputs that were set without a copy."""
        first, last = self.whole_rows, int(min(count, self.whole_from[0, 0]))
        for sample, spans in self._direct.items() if first < last else ():
            used = sample.row[first:last]
            there = np.flatnonzero(used >= 0)
            into, of = first + there, used[there]
            for source, target in spans:
                if isinstance(source, slice):
                    self.rows[into, target] = self.rows[of, source]
                else:
                    self.rows[into[:, None], target] = self.rows[of[:, None], source]
        self.whole_rows = max(self.whole_rows, count)

    @cached_property
    def _direct(self) -> Mapping[RowsInUse, Sequence[tuple[Any, Any]]]:
        """The columns of direct sets, read and written, by the rows that are read.

        Where they can be, as slices, of which NumPy copies a row at once.
        """
        by_sample: dict[RowsInUse, list[tuple[Any, Any]]] = {}
        for route in self.direct_sets.values():
            spans = (route.columns, route.targets) if route.spans is None else route.spans
            by_sample.setdefault(route.in_step, []).append(spans)
        return by_sample

    def leave_whole_from(self, first: int) -> None:
        """From row `first` on the loop copies inputs itself, for example to adjust them."""
        self.make_whole(first)
        self.whole_from[0, 0] = min(self.whole_from[0, 0], first)

    def begin(self) -> None:
        """Prepare the rows that are ready at the beginning of the run."""
        self.whole_rows = 0
        self.fill_routes(0, self.comm_points.ready)
        self.begin_rows(0, max(self.comm_points.ready, 1))

    def begin_again(self, system: System) -> None:
        """Begin another run, of a system of the same structure, into the same memory."""
        # an algebraic loop begins with what stands in the first row; other rows are written first
        self.all_rows[[0, -1]] = 0.0
        self.comm_points.begin_again(system.comm_schedule)
        for instance in self.instances:
            if instance.component is not system.components[instance.name]:
                instance.component = system.components[instance.name]
                self._write_start(instance, self._start)
            instance.driven = {
                name: system.driven.get(Endpoint(instance.name, name), source)
                for name, source in instance.driven.items()
            }
        for sample in self.samples:
            sample.begin(system)
        self.settled.clear()
        self.whole_from[:] = np.inf
        self.begin()

    def extend(self) -> None:
        """Prepare the rows of the next points."""
        first = self.comm_points.ready
        self.comm_points.extend()
        self.fill_routes(first, self.comm_points.ready)
        self.begin_rows(first, self.comm_points.ready)

    def fill_routes(self, first: int, last: int) -> None:
        """Fill in which rows are read at the points first to last - 1, which are ready."""
        for sample in self.samples if first < last else ():
            sample.fill(first, last)

    def begin_rows(self, first: int, last: int) -> None:
        """Give inputs in rows first to last - 1 their start values or driven signals.

        Where a route brings a value, the loop writes it.
        """
        if first >= last:
            return
        rows = self.rows[first:last]
        for targets, sample in self._received:
            bare = sample.bare(first, last)
            if bare.size:
                rows[bare[:, None], targets] = self._start[targets]
        rows[:, self._not_received] = self._start[self._not_received]
        self._settle(first)
        self._drive(first, last)

    def first_read(self, complete: int) -> int:
        """Return the first row that is still read when `complete` rows are complete."""
        read = (sample.oldest(complete) for sample in self.samples)
        return max(0, min([complete - HISTORY, *read]))

    def give_back(self, complete: int) -> None:
        """Give back the memory of what is not read any more when `complete` rows are complete."""
        if complete - HISTORY < self.comm_points.oldest + HISTORY:  # not worth it yet
            return
        before = self.first_read(complete)
        if before <= self.comm_points.oldest:
            return
        self.whole_rows = max(self.whole_rows, before)
        if self.gives_back_rows:
            self.memory.give_back(before)
        for sample in self.samples:
            sample.give_back(before)
        self.comm_points.give_back(before)

    @cached_property
    def samples(self) -> tuple[RowsInUse, ...]:
        """The rows in use of all routes."""
        routes = (route for instance in self.instances for route in instance.routes)
        return tuple(dict.fromkeys(sample for route in routes for sample in route.samples))

    def reset_inputs(self, k: int) -> None:
        """Give the inputs of row k their start values or driven signals again."""
        self.whole_rows = min(self.whole_rows, k)
        self.begin_rows(k, k + 1)

    def _settle(self, k: int) -> None:
        """At the first point, give inputs the values on which the initialisation settled."""
        for columns, values in self.settled if k == 0 else ():
            self.rows[0, columns] = values

    @cached_property
    def _received(self) -> tuple[tuple[Columns, RowsInUse], ...]:
        """The columns of inputs that a route writes, and the rows that they are read from."""
        by_sample: dict[RowsInUse, list[Columns]] = {}
        for route in (route for instance in self.instances for route in instance.routes):
            by_sample.setdefault(route.at_point or route.in_step, []).append(route.targets)
        return tuple((np.concatenate(targets), sample) for sample, targets in by_sample.items())

    @cached_property
    def _not_received(self) -> Columns:
        """The columns of the other inputs."""
        inputs = np.arange(self.outputs, self.all_rows.shape[1])
        received = np.concatenate([[], *(to for to, _ in self._received)])
        return np.setdiff1d(inputs, received, assume_unique=True)

    @cached_property
    def _start(self) -> Rows:
        """The row before anything is exchanged: start values of inputs, (values,)."""
        row = np.zeros(self.all_rows.shape[1])
        for instance in self.instances:
            self._write_start(instance, row)
        return row

    def _write_start(self, instance: ComponentInstance, row: Rows) -> None:
        """Write the start values of a component's inputs into a row."""
        for place, column in enumerate(instance.input_columns, instance.input_column):
            port = column.port
            if column.name in (port.name, element_names(port)[0]):
                start_value = instance.component.start_of(port.name)
                row[place : place + port.size] = self.texts.doubles(start_value, port)

    def _drive(self, first: int, last: int) -> None:
        """Set the driven inputs at the points first to last - 1."""
        states: dict[str, LinkState] = {}
        for instance in self.instances:
            for j, column in enumerate(instance.input_columns if instance.driven else ()):
                cells = self.rows[first:last, instance.input_column + j]
                source = instance.driven.get(column.name)
                if source is None or first >= last:
                    continue
                if isinstance(source, Endpoint) and source.component in self.comm_points.modes:
                    cells[:] = self._mode(source, first, last)
                elif isinstance(source, Endpoint):
                    name, what = source
                    if name not in states:
                        states[name] = self.comm_points.state(name, first, last)
                    cells[:] = getattr(states[name], _STATE.get(what, what))
                elif callable(source):
                    cells[:] = _finite(
                        source(self.comm_points.seconds[first:last]), instance.name, column.name
                    )
                else:
                    cells[:] = source[first:last]

    def _mode(self, source: Endpoint, first: int, last: int) -> Columns:
        """Return what a mode machine sends at the points first to last - 1."""
        machine, what = source
        number = self.comm_points.mode(machine, first, last)
        if what == MODE_NUMBER:
            return number
        wanted = self.comm_points.modes[machine].states.index(what)
        return np.asarray(number == wanted, np.int64)

    def change_mode(self, machine: str, first: int) -> None:
        """Give the inputs that follow a machine its present state, from row `first` on."""
        last = max(self.comm_points.ready, first)
        for instance in self.instances:
            for j, column in enumerate(instance.input_columns if instance.driven else ()):
                source = instance.driven.get(column.name)
                if isinstance(source, Endpoint) and source.component == machine:
                    cells = self.rows[first:last, instance.input_column + j]
                    cells[:] = self._mode(source, first, last)

    def resolve_delays(self, system: System, k: int) -> None:
        """Resolve the delays of what is sent at point k, unless an output is out of range there.

        Raises
        ------
        InputError : see `CommunicationPoints.resolve`.
        """
        row = self.rows[k]
        if (np.abs(row[: self.outputs]) <= self.bounds).all():
            self.comm_points.resolve(k, row, self.columns_of_delays(system))

    def columns_of_delays(self, system: System) -> dict[str, tuple[int, ...]]:
        """Return by live link the columns of its delay signals."""
        return {
            name: tuple(
                self.instance(end.component).place(end.variable)[0]
                for end in system.delays[name].read
            )
            for name in self.comm_points.live
            if name in system.delays
        }

    def signal(self, column: int) -> Endpoint:
        """Return the output or input in a column."""
        for instance in self.instances:
            for first, columns in (
                (instance.output_column, instance.output_columns),
                (instance.input_column, instance.input_columns),
            ):
                if 0 <= column - first < len(columns):
                    return Endpoint(instance.name, columns[column - first].name)
        raise ValueError(f"expected a column of the rows, got {column}")


_STATE = {"age": "age_s"}


def _finite(values: Rows, component: str, variable: str) -> Rows:
    if not np.isfinite(values).all():
        raise InputError("the signal of an input must be finite", where=f"{component}.{variable}")
    return values
