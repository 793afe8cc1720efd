"""Resolve names in conditions: signals of a run, constants, and the state of links."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from cosim.core import NUMBER_ONLY, TIME, InputError
from cosim.fmu import Port
from cosim.master import LINK_STATE, MODE_NUMBER, ComponentInstance, Endpoint, System, element_names
from cosim.network import PacketLink
from cosim.scenario.binding import Meaning, check_name
from cosim.scenario.link_rows import link_state
from cosim.scenario.matching import endpoint
from cosim.scenario.modes import TIME_IN_STATE
from cosim.scenario.signal_reader import Block, SignalReader
from cosim.scenario.units import unit_of

_STATE = {"age": "age_s"}


def meaning_of_state(what: str) -> Meaning:
    """Return the meaning of a state of a packet link.

    Raises
    ------
    InputError : there is no such state.
    """
    if what not in LINK_STATE:
        raise InputError.unknown("state of a link", what, LINK_STATE)
    return Meaning("number", TIME if what == "age" else NUMBER_ONLY)


class RunScope:
    """Resolves the names of one system.

    Outputs and connected inputs are signals; parameters and unconnected inputs are constants,
    unless an event sets them (`changed`); `LINK.age`, `.sequence`, `.dropped`, `.delivered` are
    the state of a packet link; `MACHINE.STATE` is whether a mode machine is in a state, and
    `MACHINE.time` since when it is in its present one.
    """

    def __init__(self, system: System, changed: Sequence[Endpoint] = ()) -> None:
        self._system, self._changed = system, changed

    @cached_property
    def _signals(self) -> dict[str, dict[str, Port]]:
        return self._ports[0]

    @cached_property
    def _others(self) -> dict[str, dict[str, Port]]:
        return self._ports[1]

    @cached_property
    def _ports(self) -> tuple[dict[str, dict[str, Port]], dict[str, dict[str, Port]]]:
        """By component and element: outputs and connected inputs, and all other variables."""
        system = self._system
        connected = {c.target for c in system.connections} | set(system.driven)
        signals: dict[str, dict[str, Port]] = {}
        others: dict[str, dict[str, Port]] = {}
        for name, component in system.components.items():
            mine, rest = signals.setdefault(name, {}), others.setdefault(name, {})
            for port in component.description.ports.values():
                moves = port.causality == "output" or Endpoint(name, port.name) in connected
                into = mine if moves and port.kind is not None else rest
                into.update(dict.fromkeys(element_names(port), port))
        return signals, others

    def signals(self, component: str) -> Mapping[str, Port]:
        """Return outputs and connected inputs of a component, by the names of their elements."""
        if component not in self._signals:
            raise InputError.unknown("component", component, self._signals)
        return self._signals[component]

    def meaning(self, reference: str) -> Meaning:
        """Return the meaning of `component.variable`; an `InputError` with the nearest names."""
        name, _, variable = reference.partition(".")
        if self.is_link(name):
            return self._state(name, variable)
        if self.is_machine(name):
            return self._mode(name, variable)
        if not variable:
            check_name(reference)
        if name not in self._signals:
            raise InputError.unknown("component", name, [*self._signals, *self._system.modes])
        port = self.signals(name).get(variable)
        if port is None:
            port = self._constant(name, variable)
        if port.kind == "string":
            raise InputError(f"{reference} is a text", expected="a number or a truth value")
        if port.kind == "bool":
            return Meaning("truth", None)
        unit = unit_of(self._system.components[name].description, port)
        if unit is None:
            return Meaning("number", None)
        return Meaning("number", unit.dimension, unit.to_si)

    def is_link(self, name: str) -> bool:
        """Whether a name is that of a link, and not of a component as well."""
        return name in self._system.links and name not in self._system.components

    def is_machine(self, name: str) -> bool:
        """Whether a name is that of a mode machine."""
        return name in self._system.modes

    def state_number(self, machine: str, state: str) -> int:
        """Return the number of a state of a mode machine."""
        return self._system.modes[machine].states.index(state)

    def _mode(self, machine: str, what: str) -> Meaning:
        if what == TIME_IN_STATE:
            return Meaning("number", TIME)
        if what == MODE_NUMBER:
            return Meaning("number", NUMBER_ONLY)
        states = self._system.modes[machine].states
        if what not in states:
            known = (*states, TIME_IN_STATE, MODE_NUMBER)
            raise InputError.unknown(
                f"state of {machine}", what, known, hint=f"{machine}.{states[0]}"
            )
        return Meaning("truth", None)

    def _constant(self, name: str, variable: str) -> Port:
        port = self._others[name].get(variable)
        known = port is not None and port.causality in ("parameter", "input") and not port.shape
        if port is None or not known:
            raise InputError.unknown(
                "variable", f"{name}.{variable}", [f"{name}.{v}" for v in self._signals[name]]
            )
        if Endpoint(name, variable) in self._changed:
            raise InputError(f"{name}.{variable} is set by an event", expected="a signal")
        return port

    def _state(self, link: str, what: str) -> Meaning:
        if not isinstance(self._system.links[link], PacketLink):
            raise InputError("only a packet link has a state", got=f"link {link!r}")
        return meaning_of_state(what)

    def constant(self, reference: str) -> float | None:
        """Return the value of a constant; None for a signal."""
        end = endpoint(reference)
        port = self._others.get(end.component, {}).get(end.variable)
        if port is None:
            return None
        return float(self._system.components[end.component].start_of(port.name, 0.0))


class ValueReader:
    """Reads the values of names at the points of a run, block by block.

    Attributes
    ----------
    reads_inputs : whether any of them is an input.
    """

    def __init__(
        self, instances: Sequence[ComponentInstance], scope: RunScope, names: Sequence[str]
    ) -> None:
        self._instance = instances[0]
        by_name = {instance.name: instance for instance in instances}
        self._read: list[Callable[[int, int], NDArray[np.float64]]] = []
        self.reads_inputs = False
        for name in names:
            first, _, rest = name.partition(".")
            of_run = name == "t" or scope.is_link(first) or scope.is_machine(first)
            constant = None if of_run else scope.constant(name)
            if name == "t":
                self._read.append(self._seconds)
            elif scope.is_machine(first) and rest == TIME_IN_STATE:
                self._read.append(partial(self._time_in_state, first))
            elif scope.is_machine(first) and rest == MODE_NUMBER:
                self._read.append(partial(self._number, first))
            elif scope.is_machine(first):
                number = scope.state_number(first, rest)
                self._read.append(partial(self._is_in_state, first, number))
            elif scope.is_link(first):
                self._read.append(partial(self._state, first, _STATE.get(rest, rest)))
            elif constant is not None:
                self._read.append(partial(_constant, constant))
            else:
                reader = SignalReader(by_name[first], [rest], recorded=True)
                self.reads_inputs |= reader.reads_inputs
                self._read.append(partial(_signal, reader))

    def read(self, first: int, last: int) -> list[NDArray[np.float64]]:
        """Return the values at the points first to last - 1, (n,) each; blocks come in order."""
        return [read(first, last) for read in self._read]

    def _seconds(self, first: int, last: int) -> NDArray[np.float64]:
        points = self._instance.comm_points
        return (points.points_ns[first:last] + points.start_ns) / 1e9

    def _is_in_state(self, machine: str, number: int, first: int, last: int) -> NDArray[np.float64]:
        return np.asarray(self._number(machine, first, last) == number, dtype=np.float64)

    def _number(self, machine: str, first: int, last: int) -> NDArray[np.float64]:
        return self._instance.comm_points.mode(machine, first, last).astype(np.float64)

    def _time_in_state(self, machine: str, first: int, last: int) -> NDArray[np.float64]:
        points = self._instance.comm_points
        instants = points.points_ns[first:last]
        spent: NDArray[np.float64] = (instants - points.event_values.since(machine, instants)) / 1e9
        return spent

    def _state(self, link: str, what: str, first: int, last: int) -> NDArray[np.float64]:
        state = link_state(self._instance, link, first, last)
        return np.asarray(getattr(state, what), dtype=np.float64)


def _constant(value: float, first: int, last: int) -> NDArray[np.float64]:
    return np.full(last - first, value)


def _signal(reader: SignalReader, first: int, last: int) -> NDArray[np.float64]:
    return reader.read(Block(first, first, last))[:, 0]
