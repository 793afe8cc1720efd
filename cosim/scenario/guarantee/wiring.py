"""Compare the connections of a run with the loop of its design, input by input.

Every input of the loop is followed back to where its value comes from, through the gains and
offsets that the scenario puts before it, and compared with what the design says stands there.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import NamedTuple

from cosim.master import Connection, Endpoint, System
from cosim.network import PacketLink
from cosim.scenario.guarantee.departure import Departure
from cosim.scenario.guarantee.designed_loop import DesignedLoop, DesignedMeasurement, Form
from cosim.scenario.lowering import LinearMap

_CLOSE = 1e-12
_POLICIES = ("hold", "previous", "midpoint")
"""What holds a value that the sender had; "linear" goes on beyond the last one."""


class Sensed(NamedTuple):
    """A sensor in the loop: its component, and the measurement whose value number k is y[k]."""

    component: str
    values: Mapping[str, tuple[DesignedMeasurement, int]]


class Wiring:
    """The connections of a system, as a proof sees them.

    Parameters
    ----------
    maps : the components that compute gain * value + ... + offset before an input, by name.
    """

    def __init__(self, system: System, loop: DesignedLoop, maps: Mapping[str, LinearMap]) -> None:
        self._system, self._loop, self._maps = system, loop, maps
        self._by_target = {c.target: c for c in system.connections}
        self.sensors: dict[str, Sensed] = {}
        """Of an observer, by name of the measurement; known after `departures`."""

    @property
    def connected(self) -> Collection[Endpoint]:
        """The inputs that a connection leads to, or a given signal."""
        return self._by_target.keys() | self._system.driven.keys()

    def departures(self) -> list[Departure]:
        """Return where the connections are not those of the loop."""
        loop = self._loop
        found: list[Departure] = []
        for variable, wanted in loop.states.items():
            found += self._carries(Endpoint(loop.controller, variable), loop.plant, {wanted: 1.0})
        for measurement in loop.measurements:
            found += self._measures(measurement)
        for variable, wanted in loop.commands.items():
            found += self._carries(Endpoint(loop.plant, variable), loop.controller, {wanted: 1.0})
        return found + list(self._other_inputs())

    def feedback_connections(self) -> list[Connection]:
        """Return the connections of the loop that exist."""
        loop = self._loop
        ends = [Endpoint(loop.controller, name) for name in loop.states]
        ends += [Endpoint(loop.plant, name) for name in loop.commands]
        for one in loop.measurements:
            ends += [Endpoint(loop.controller, name) for name in (*one.inputs, one.stamp)]
        for sensed in self.sensors.values():
            ends += [Endpoint(sensed.component, name) for name in sensed.values]
        return [self._by_target[end] for end in ends if end in self._by_target]

    def components(self) -> set[str]:
        """Return the components of the loop: plant, controller, sensors, and maps before inputs."""
        found = {self._loop.plant, self._loop.controller}
        found |= {sensed.component for sensed in self.sensors.values()}
        return found | {c.source.component for c in self.feedback_connections()}

    def is_free(self, place: str) -> bool:
        """Whether a variable of the loop is a set-point or a disturbance, which may be anything."""
        loop = self._loop
        component, _, variable = place.partition(".")
        port = self._system.components[component].description.ports.get(variable)
        if port is None or port.causality != "input":
            return False
        if component == loop.plant:
            return variable in loop.disturbances | loop.bounded
        return component == loop.controller and variable not in self._measured_inputs()

    def _measured_inputs(self) -> set[str]:
        """Return the inputs of the controller that are measured."""
        loop = self._loop
        found = {*loop.states, *(x for one in loop.measurements for x in one.inputs)}
        return found | {one.stamp for one in loop.measurements}

    def _carries(
        self, end: Endpoint, source: str, wanted: Form, *, at_once: bool = False
    ) -> Iterator[Departure]:
        """Yield what is wrong with an input that is to read this combination of a component."""
        text = _form_text({Endpoint(source, name): x for name, x in wanted.items()})
        connection = self._connection(end)
        if isinstance(connection, str):
            yield Departure(str(end), text, connection)
            return
        terms, offset = self._terms(connection)
        same = terms.keys() == {Endpoint(source, name) for name in wanted}
        same = same and all(
            abs(x - wanted[place.variable]) <= _CLOSE * abs(wanted[place.variable])
            for place, x in terms.items()
        )
        if not same or offset != 0.0:
            yield Departure(str(end), text, _form_text(terms, offset))
        yield from self._on_the_way(connection, at_once=at_once)

    def _connection(self, end: Endpoint) -> Connection | str:
        """Return the connection to an input, or in words what it has in place of one."""
        component = self._system.components.get(end.component)
        if component is None or end.variable not in component.description.ports:
            return "there is no such input"
        if end in self._system.driven:
            return "a given series or path"
        return self._by_target.get(end) or "not connected"

    def _terms(self, connection: Connection) -> tuple[dict[Endpoint, float], float]:
        """Return what a connection brings: coefficients of signals, and an offset."""
        linear = self._maps.get(connection.source.component)
        if linear is None:
            return {connection.source: 1.0}, 0.0
        terms: dict[Endpoint, float] = {}
        for source, gain in linear.terms:
            if gain:
                terms[source] = terms.get(source, 0.0) + gain
        return terms, linear.offset

    def _on_the_way(self, connection: Connection, *, at_once: bool) -> Iterator[Departure]:
        """Yield what a link or a policy does to the values beside letting them age."""
        place = str(connection.target)
        if connection.policy not in _POLICIES:
            expected = "a value that was sent, held"
            yield Departure(place, expected, f"policy {connection.policy}, beyond the last value")
        if connection.link is None:
            return
        link = self._system.links[connection.link]
        if at_once:
            yield Departure(place, "at once, without a link", f"over {connection.link}")
        if isinstance(link, PacketLink) and link.quantization:
            step = f"rounded to steps of {link.quantization:g} by {connection.link}"
            yield Departure(place, "the value as it was sent", step)

    # ---- observers

    def _measures(self, one: DesignedMeasurement) -> Iterator[Departure]:
        """Yield what is wrong with a measurement: it comes from one sensor, with its stamp."""
        controller, stamp = self._loop.controller, Endpoint(self._loop.controller, one.stamp)
        stamped = self._connection(stamp)
        if isinstance(stamped, str):
            yield Departure(str(stamp), f"the stamp of the sensor of {one.name}", stamped)
            return
        sensor = stamped.source.component
        if stamped.source.variable != "stamp" or not self._is_sensor(sensor):
            yield Departure(str(stamp), f"the stamp of a sensor of {one.name}", str(stamped.source))
            return
        yield from self._on_the_way(stamped, at_once=False)
        values: dict[str, tuple[DesignedMeasurement, int]] = {}
        for k, (variable, form) in enumerate(zip(one.inputs, one.forms, strict=True)):
            end = Endpoint(controller, variable)
            found = self._connection(end)
            if isinstance(found, str):
                yield Departure(str(end), f"a value of {sensor}", found)
                continue
            terms, offset = self._terms(found)
            source, gain = next(iter(terms.items())) if len(terms) == 1 else (found.source, 0.0)
            known = source.component == sensor and source.variable.startswith("y[")
            if not known or gain != 1.0 or offset != 0.0:
                yield Departure(str(end), f"a value of {sensor}", _form_text(terms, offset))
                continue
            if (found.link, found.policy) != (stamped.link, stamped.policy):
                expected = f"over {stamped.link or 'a wire'} with its stamp"
                yield Departure(str(end), expected, f"over {found.link or 'a wire'}")
            yield from self._on_the_way(found, at_once=False)
            sensor_input = f"u{source.variable[1:]}"
            values[sensor_input] = (one, k)
            yield from self._carries(
                Endpoint(sensor, sensor_input), self._loop.plant, form, at_once=True
            )
        self.sensors[one.name] = Sensed(sensor, values)

    def _is_sensor(self, name: str) -> bool:
        """Whether a component has what a sensor of ours has: values, a stamp, noise and bias."""
        component = self._system.components.get(name)
        ports = {} if component is None else component.description.ports
        return all(x in ports for x in ("u[1]", "y[1]", "stamp", "noise[1]", "bias[1]"))

    # ---- what is no part of the loop

    def _other_inputs(self) -> Iterator[Departure]:
        """Yield inputs of plant and controller that bring something which no proof knows."""
        loop, moved = self._loop, self._moved_by_the_loop()
        free = {loop.plant: loop.disturbances | loop.bounded, loop.controller: None}
        own = {loop.plant: set(loop.commands), loop.controller: self._measured_inputs()}
        for name, known in own.items():
            component = self._system.components.get(name)
            for port in () if component is None else component.description.ports.values():
                if port.causality != "input" or port.name in known:
                    continue
                yield from self._other_input(Endpoint(name, port.name), free[name], moved)

    def _other_input(
        self, end: Endpoint, free: frozenset[str] | None, moved: set[str]
    ) -> Iterator[Departure]:
        component = self._system.components[end.component]
        connection = self._connection(end)
        if free is not None and end.variable not in free:
            expected = "zero: the design knows no such input"
            if not isinstance(connection, str):
                yield Departure(str(end), expected, str(connection.source))
            elif end in self._system.driven:
                yield Departure(str(end), expected, connection)
            elif (start := component.start_of(end.variable, 0.0)) not in (0, 0.0, None):
                yield Departure(str(end), expected, f"{start}")
            return
        if isinstance(connection, Connection) and connection.source.component in moved:
            expected = "a signal that does not depend on the loop"
            yield Departure(str(end), expected, str(connection.source))

    def _moved_by_the_loop(self) -> set[str]:
        """Return the components whose outputs may depend on the plant or the controller."""
        after: dict[str, set[str]] = {}
        for c in self._system.connections:
            after.setdefault(c.source.component, set()).add(c.target.component)
        reached: set[str] = set()
        ahead: Iterable[str] = (self._loop.plant, self._loop.controller, *self._system.modes)
        while fresh := set(ahead) - reached:
            reached |= fresh
            ahead = {name for one in fresh for name in after.get(one, ())}
        return reached


def _form_text(terms: Mapping[Endpoint, float], offset: float = 0.0) -> str:
    """Return a combination of signals in words: "plant.x[1]", "2 plant.x[1] + 0.5"."""
    if not terms and not offset:
        return "nothing"
    each = [f"{place}" if x == 1.0 else f"{x:g} {place}" for place, x in terms.items()]
    return " + ".join(each + ([f"{offset:g}"] if offset or not each else []))
