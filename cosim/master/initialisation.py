"""Initialisation of all slaves together: values are exchanged until none changes.

In initialization mode each output may depend on inputs, and each input on the outputs of others.
A pass sets all inputs that have a value at the first point, and reads all outputs; passes are
repeated until one changes nothing. Inputs that are delayed by a point keep the value on which this
settles at the first point.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction

import numpy as np

from cosim.core import ComponentError
from cosim.fmu import ACCEPTED_STATUSES, calling
from cosim.master.component_instance import ComponentInstance, Group, Rows
from cosim.master.event_instance import EventInstance
from cosim.master.exchange import exchange_of
from cosim.master.parts import Endpoint
from cosim.master.system import System
from cosim.master.wiring import Wiring

MOST_PASSES = 100
_TOLERANCE = 1e-12
"""Largest change of a settled value, relative to the greater of its magnitude and 1."""


class Initialisation:
    """Initialises all slaves of a wiring, for one run after the other."""

    def __init__(self, wiring: Wiring) -> None:
        self._wiring = wiring
        self._ends: list[_InitialisedComponent] = []

    def run(self, system: System, events: Iterable[EventInstance] = ()) -> int:
        """Initialise all slaves, which are there and new or reset; return the number of passes.

        `events` : the instances in event mode, whose Clocks are prepared.

        Raises
        ------
        InputError : a parameter that does not exist or cannot be set.
        ComponentError : a slave that fails, or values that do not settle, named.
        """
        wiring, schedule = self._wiring, system.comm_schedule
        start, end = schedule.at_s(0), schedule.at_s(schedule.end_ns)
        for name in system.components:
            instance = wiring.instance(name)
            instance.slave.set_start(instance.component.parameters)
            instance.slave.enter_initialisation(start, end)
        if not self._ends or any(one.is_stale() for one in self._ends):
            self._ends = [_InitialisedComponent(instance) for instance in wiring.instances]
        most = max(MOST_PASSES, system.solve_limit) if system.solve else MOST_PASSES
        passes = _settle(self._ends, wiring, most)
        for one in events:
            one.prepare(Fraction(0))
        for name in system.components:
            wiring.instance(name).slave.exit_initialisation()
        return passes


def _settle(ends: Sequence[_InitialisedComponent], wiring: Wiring, most: int) -> int:
    if not any(component.connected_inputs for component in ends):
        return 0
    row = wiring.rows[0].copy()
    for component in ends:
        component.ask(row)
    changes: dict[Endpoint, float] = {}
    for turn in range(1, most + 1):
        changes, sent = {}, row[: wiring.outputs].copy()
        for component in ends:
            found = component.moved(row)
            if found or turn == 1:
                component.give(row)
                component.ask(row)
            changes |= found
        # where no output has moved either, the next pass would change nothing
        ahead = bool(changes) and turn < most and np.array_equal(sent, row[: wiring.outputs])
        if not changes or ahead:
            for component in ends:
                component.keep_settled(row, wiring)
            return turn + ahead
    worst = sorted(changes, key=lambda end: -changes[end])[:5]
    raise ComponentError(
        "the initial values do not settle",
        where=", ".join(str(end) for end in worst),
        expected=f"inputs that stay within {_TOLERANCE:g} of themselves "
        f"before pass {most} of the initialisation",
        got=f"changes of up to {changes[worst[0]]:.3g} in that pass",
        hint="an algebraic loop with a gain of 1 or more: break it by a packet link, or give "
        "it consistent start values",
    )


def _is_exchanged(group: Group) -> bool:
    """Whether variables are exchanged here: clocked ones are while their Clock ticks, later."""
    return group.getter_type != "Clock" and not group.clocks


class _InitialisedComponent:
    """A component during initialisation: its inputs that have a value, and its outputs."""

    def __init__(self, instance: ComponentInstance) -> None:
        self._instance, self._slave = instance, instance.slave
        self._routes = [route for route in instance.routes if route.at_start]
        numbers = {instance.routes.index(route) for route in self._routes}
        given: list[Group] = []
        for groups in instance.input_sets:
            has_value = [group.route is None or group.route in numbers for group in groups]
            some = [group for group, has in zip(groups, has_value, strict=True) if has]
            given += [Group.of_all(groups)] if all(has_value) else some
        sent = (*instance.outputs_without_feedthrough, *instance.outputs_with_feedthrough)
        self.connected_inputs = [
            exchange_of(instance, group, "set") for group in given if _is_exchanged(group)
        ]
        self._gets = [exchange_of(instance, group, "get") for group in sent if _is_exchanged(group)]

    def is_stale(self) -> bool:
        """Whether other inputs have a value in this run, or its slave is another one."""
        routes = [route for route in self._instance.routes if route.at_start]
        return routes != self._routes or self._slave is not self._instance.slave

    def moved(self, row: Rows) -> dict[Endpoint, float]:
        """Copy the senders' values to the inputs; return how much each input changed."""
        first = self._instance.input_column
        columns = self._instance.input_columns
        mine = slice(first, first + len(columns))
        before = row[mine].copy()
        for route in self._routes:
            values = row[route.columns]
            row[route.targets] = values if route.link is None else route.link.quantize(values)
        if (row[mine] == before).all():
            return {}
        step = np.abs(row[mine] - before)
        changed = ~(step <= _TOLERANCE * np.maximum(1.0, np.abs(row[mine])))
        return {
            Endpoint(self._instance.name, columns[j].name): float(step[j])
            for j in np.flatnonzero(changed).tolist()
        }

    def give(self, row: Rows) -> None:
        """Set the inputs."""
        self._do(self.connected_inputs, row, "set")

    def ask(self, row: Rows) -> None:
        """Read the outputs."""
        self._do(self._gets, row, "get")

    def keep_settled(self, row: Rows, wiring: Wiring) -> None:
        """Put settled inputs that no row of a sender brings at the first point into row 0."""
        for route in self._routes:
            if route.initialised:
                wiring.settled.append((route.targets, row[route.targets]))
                wiring.rows[0, route.targets] = row[route.targets]

    def _do(self, exchanges: list[Callable[[Rows], int]], row: Rows, what: str) -> None:
        for exchange in exchanges:
            with calling(self._instance.name, f"{what} in initialisation"):
                status = exchange(row)
            if status not in ACCEPTED_STATUSES:
                raise self._instance.slave.refused(f"{what} in initialisation", status)
