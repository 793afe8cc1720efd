"""From connections to rows: what each input reads at each communication point.

Every value that a component sends is written once, into row k of its output array; a
receiver reads the row that its route names. The routes are complete before the run starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.fmu import Bundle, FmuSlave, Port
from cosim.master.system import Component, Connection, Endpoint, System
from cosim.network import SUBSTITUTE, PacketLink, TransportLink

Rows = NDArray[np.float64]


@dataclass(frozen=True)
class Route:
    """Inputs of one component that read outputs of one other over the same way.

    Attributes
    ----------
    source : name and rows of the sender.
    columns, targets : columns read, and the input columns they go to.
    row : sender's row in use at each point; -1 none yet, -2 the link's substitute.
    weight : share of the following row (transport links), or None.
    link : the packet link, or None.
    """

    source: str
    rows: Rows
    columns: NDArray[np.intp]
    targets: NDArray[np.intp]
    row: NDArray[np.int64]
    weight: Rows | None
    link: PacketLink | None

    def deliver(self, k: int, inputs: Rows) -> None:
        """Put what is in use at point k into `inputs`; what nothing has reached stays."""
        row = self.row[k]
        if row >= 0:
            values = self.rows[row, self.columns]
            if self.weight is not None and self.weight[k] > 0.0:
                share = self.weight[k]
                values = (1.0 - share) * values + share * self.rows[row + 1, self.columns]
            if self.link is not None and self.link.quantization:
                values = self.link.quantize(values)
            inputs[self.targets] = values
        elif row == SUBSTITUTE and self.link is not None:
            inputs[self.targets] = self.link.substitute


class Station:
    """A component of a run: its slave, its rows, its routes.

    `outputs` (points, outputs) and `inputs` (points, connected inputs) are the record of the
    run; rows beyond the last point reached are undefined.
    """

    def __init__(self, name: str, component: Component, inputs: Sequence[Port], n: int) -> None:
        ports = component.description.ports.values()
        prompt = [p for p in ports if _recorded(p) and not p.feedthrough]
        direct = [p for p in ports if _recorded(p) and p.feedthrough]
        self.name = name
        self.component = component
        self.output_ports = (*prompt, *direct)
        self.input_ports = tuple(inputs)
        self.outputs: Rows = np.zeros((n, len(self.output_ports)))
        self.inputs: Rows = np.zeros((n, len(inputs)))
        for j, port in enumerate(inputs):
            self.inputs[:, j] = component.parameters.get(port.name, port.start or 0.0)
        self.routes: list[Route] = []
        self._prompt, self._direct = prompt, direct

    def attach(self, slave: FmuSlave) -> None:
        """Take the slave that plays this component."""
        self.slave = slave
        self._read_prompt = Bundle(slave, self._prompt)
        self._read_direct = Bundle(slave, self._direct)
        self._write = Bundle(slave, self.input_ports)

    def send(self, k: int) -> None:
        """Read the outputs that do not wait for this point's inputs."""
        self._read_prompt.read(self.outputs[k, : len(self._prompt)])

    def receive(self, k: int) -> None:
        """Set the inputs of this point, then read the outputs that follow them at once."""
        row = self.inputs[k]
        for route in self.routes:
            route.deliver(k, row)
        self._write.write(row)
        if self._direct:
            self._read_direct.read(self.outputs[k, len(self._prompt) :])


def wire(system: System) -> list[Station]:
    """Stations with their routes, in the order in which they receive.

    Raises
    ------
    InputError : an algebraic loop, named by its components.
    """
    points = system.timetable.points_ns
    targets = [c.target for c in system.connections] + list(system.driven)
    stations = {}
    for name, component in system.components.items():
        mine = [system.port(end) for end in targets if end.component == name]
        stations[name] = Station(name, component, mine, points.size)
    for end, values in system.driven.items():
        station = stations[end.component]
        station.inputs[:, _column(station.input_ports, end.variable)] = values
    groups: dict[tuple[str, str, str | None], list[Connection]] = {}
    for c in system.connections:
        groups.setdefault((c.source.component, c.target.component, c.link), []).append(c)
    for (source, target, link), members in groups.items():
        sender, receiver = stations[source], stations[target]
        row, weight = _rows_in_use(system, link)
        packet = system.links[link] if link is not None else None
        receiver.routes.append(
            Route(
                source=source,
                rows=sender.outputs,
                columns=_columns(sender.output_ports, [m.source for m in members]),
                targets=_columns(receiver.input_ports, [m.target for m in members]),
                row=row,
                weight=weight,
                link=packet if isinstance(packet, PacketLink) else None,
            )
        )
    return _in_order(stations, system)


def _recorded(port: Port) -> bool:
    return port.causality == "output" and port.kind is not None


def _column(ports: Sequence[Port], name: str) -> int:
    return next(i for i, port in enumerate(ports) if port.name == name)


def _columns(ports: Sequence[Port], ends: Sequence[Endpoint]) -> NDArray[np.intp]:
    return np.array([_column(ports, end.variable) for end in ends], dtype=np.intp)


def _rows_in_use(system: System, link: str | None) -> tuple[NDArray[np.int64], Rows | None]:
    points = system.timetable.points_ns
    if link is None:
        return np.arange(points.size), None
    channel = system.links[link]
    if isinstance(channel, TransportLink):
        return channel.rows(points)
    return system.timetable.schedules[link].rows(points), None


def _in_order(stations: dict[str, Station], system: System) -> list[Station]:
    """Receivers after the senders whose outputs they need of the same point."""
    waits: dict[str, set[str]] = {name: set() for name in stations}
    for c in system.connections:
        if not system.port(c.source).feedthrough:
            continue
        row, _ = _rows_in_use(system, c.link)
        if (row == np.arange(row.size)).any():
            waits[c.target.component].add(c.source.component)
    try:
        order = list(TopologicalSorter(waits).static_order())
    except CycleError as error:
        raise InputError(
            "the connections form an algebraic loop",
            where=" -> ".join(error.args[1]),
            expected="at least one component of the loop without direct feedthrough",
            # a transport link passes the initial value on at the start, which is a loop still
            hint="put a packet link with a delay into the loop",
        ) from error
    return [stations[name] for name in order]
