"""From connections to rows: what each input reads at each communication point.

Row k of one array holds every value exchanged at point k: the outputs of all components,
then their connected inputs. A sender writes its part once; a receiver reads the row that its
route names. The routes are complete before the run starts: the trace is the delay line.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.fmu import FmuSlave, Port, SignalKind
from cosim.master.system import Component, Connection, Endpoint, System
from cosim.network import PacketLink, TransportLink

Rows = NDArray[np.float64]
_KINDS: tuple[SignalKind, ...] = ("float", "int", "bool")


@dataclass(frozen=True)
class Group:
    """Variables of one type, side by side in the rows: one FMI call moves them.

    Attributes
    ----------
    kind : their type; Integers and Booleans are carried as doubles, which hold them exactly.
    references : value references, uint32 (m,).
    column : their first column in the rows.
    route : number of the station's route that brings them; None for outputs, and for inputs
        that follow a given signal.
    """

    kind: SignalKind
    references: NDArray[np.uint32]
    column: int
    route: int | None = None


@dataclass(frozen=True)
class Route:
    """Inputs of one component that read outputs of one other over the same way.

    Attributes
    ----------
    source : name of the sender.
    columns, targets : columns of the rows that are read, and that they go to.
    row : row in use at each point; -1 none yet, -2 the link's substitute.
    weight : share of the following row (transport links), or None.
    link : the packet link, or None.
    """

    source: str
    columns: NDArray[np.intp]
    targets: NDArray[np.intp]
    row: NDArray[np.int64]
    weight: Rows | None
    link: PacketLink | None

    @property
    def verbatim(self) -> bool:
        """Whether what arrives is what stands side by side in some row, bit for bit.

        Such inputs can be set straight from the sender's row.
        """
        altered = self.weight is not None or (
            self.link is not None and (self.link.quantization or self.link.on_loss != "hold")
        )
        return not altered and bool((np.diff(self.columns) == 1).all())


@dataclass(eq=False)
class Station:
    """A component of a run: its slave, its part of the rows, its routes.

    Attributes
    ----------
    outputs : (points, outputs), a view of the rows; undefined beyond the last point reached.
    sends : outputs that do not wait for the inputs of the same point.
    takes : connected inputs.
    answers : outputs that follow the inputs of the same point.
    straight : numbers of the routes whose values are set straight from the sender's row.
    """

    name: str
    component: Component
    output_ports: tuple[Port, ...]
    input_ports: tuple[Port, ...]
    outputs: Rows
    sends: tuple[Group, ...]
    takes: tuple[Group, ...]
    answers: tuple[Group, ...]
    routes: tuple[Route, ...]
    rows: Rows = field(repr=False)
    slave: FmuSlave = field(init=False)
    straight: frozenset[int] = field(init=False)

    def __post_init__(self) -> None:
        self._settled = 0
        whole = {g.route: g for g in self.takes if g.kind == "float"}
        self.straight = frozenset(
            i
            for i, route in enumerate(self.routes)
            if route.verbatim and i in whole and whole[i].references.size == route.targets.size
        )

    def inputs(self, reached: int) -> Rows:
        """Connected inputs at the first points, (reached, inputs); all of them were reached.

        What is set straight from a sender's row is written down here, when it is asked for.
        """
        for i in self.straight:
            self._write_down(self.routes[i], self._settled, reached)
        self._settled = max(self._settled, reached)
        first = self.takes[0].column if self.takes else 0
        return self.rows[:reached, first : first + len(self.input_ports)]

    def _write_down(self, route: Route, first: int, last: int) -> None:
        source = slice(int(route.columns[0]), int(route.columns[-1]) + 1)
        target = slice(int(route.targets[0]), int(route.targets[-1]) + 1)
        used = route.row[first:last]
        there = np.flatnonzero(used >= 0)
        self.rows[first + there, target] = self.rows[used[there], source]


@dataclass(frozen=True)
class Wiring:
    """The rows of a run and who uses them.

    Attributes
    ----------
    rows : (points, values).
    outputs : how many of the values are outputs; they come first.
    stations : in the order in which they receive.
    """

    rows: Rows
    outputs: int
    stations: tuple[Station, ...]

    def output(self, column: int) -> Endpoint:
        """The output that stands in a column."""
        for station in self.stations:
            for group in (*station.sends, *station.answers):
                j = column - group.column
                if 0 <= j < group.references.size:
                    names = {
                        p.reference: p.name for p in station.output_ports if p.kind == group.kind
                    }
                    return Endpoint(station.name, names[int(group.references[j])])
        raise ValueError(f"expected the column of an output, got {column}")


def wire(system: System) -> Wiring:
    """The rows and routes of a system.

    Raises
    ------
    InputError : an algebraic loop, named by its components.
    """
    sorted_outputs = {name: _outputs(c) for name, c in system.components.items()}
    sorted_inputs = {name: _inputs(system, name) for name in system.components}
    column: dict[tuple[str, Endpoint], int] = {}
    for direction, ports in (("out", sorted_outputs), ("in", sorted_inputs)):
        for name, (members, _) in ports.items():
            for port in members:
                column[direction, Endpoint(name, port.name)] = len(column)
    points = system.timetable.points_ns
    rows: Rows = np.zeros((points.size, len(column)))
    stations = {}
    for name, component in system.components.items():
        outputs, prompt = sorted_outputs[name]
        inputs, ways = sorted_inputs[name]
        a = column["out", Endpoint(name, outputs[0].name)] if outputs else 0
        c = column["in", Endpoint(name, inputs[0].name)] if inputs else 0
        routes = tuple(
            _route(system, name, source, link, members, column)
            for source, link, members in _ways(system, name)
        )
        for j, port in enumerate(inputs):
            rows[:, c + j] = component.parameters.get(port.name, port.start or 0.0)
        for end, values in system.driven.items():
            if end.component == name:
                rows[:, column["in", end]] = values
        stations[name] = Station(
            name=name,
            component=component,
            output_ports=tuple(outputs),
            input_ports=tuple(inputs),
            outputs=rows[:, a : a + len(outputs)],
            sends=_groups(outputs[:prompt], a),
            takes=_groups(inputs, c, ways),
            answers=_groups(outputs[prompt:], a + prompt),
            routes=routes,
            rows=rows,
        )
    total = sum(len(members) for members, _ in sorted_outputs.values())
    return Wiring(rows, total, _in_order(stations, system))


def _outputs(component: Component) -> tuple[list[Port], int]:
    """Outputs, those first that do not wait for inputs, types together; how many those are."""
    ports = component.description.ports.values()
    recorded = [p for p in ports if p.causality == "output" and p.kind in _KINDS]
    prompt = [p for p in recorded if not p.feedthrough]
    direct = [p for p in recorded if p.feedthrough]
    return [*_by_kind(prompt), *_by_kind(direct)], len(prompt)


def _inputs(system: System, name: str) -> tuple[list[Port], list[int | None]]:
    """Connected inputs, those of one route and type together; and the route of each."""
    ports: list[Port] = []
    ways: list[int | None] = []
    for number, (_, _, members) in enumerate(_ways(system, name)):
        mine = _by_kind([system.port(c.target) for c in members])
        ports += mine
        ways += [number] * len(mine)
    driven = [system.port(end) for end in system.driven if end.component == name]
    return ports + driven, ways + [None] * len(driven)


def _ways(system: System, name: str) -> list[tuple[str, str | None, list[Connection]]]:
    """Connections into a component, by sender and link."""
    ways: dict[tuple[str, str | None], list[Connection]] = {}
    for c in system.connections:
        if c.target.component == name:
            ways.setdefault((c.source.component, c.link), []).append(c)
    return [(source, link, members) for (source, link), members in ways.items()]


def _by_kind(ports: Sequence[Port]) -> list[Port]:
    return sorted(ports, key=lambda p: _KINDS.index(p.kind or "float"))


def _groups(
    ports: Sequence[Port], column: int, ways: Sequence[int | None] | None = None
) -> tuple[Group, ...]:
    """Neighbours of one type and route, a group each."""
    given = ways if ways is not None else [None] * len(ports)
    numbered = list(enumerate(zip(ports, given, strict=True)))
    groups = []
    for (kind, way), members in groupby(numbered, key=lambda item: (item[1][0].kind, item[1][1])):
        found = list(members)
        references = np.array([port.reference for _, (port, _) in found], dtype=np.uint32)
        groups.append(Group(kind or "float", references, column + found[0][0], way))
    return tuple(groups)


def _route(
    system: System,
    name: str,
    source: str,
    link: str | None,
    members: Iterable[Connection],
    column: Mapping[tuple[str, Endpoint], int],
) -> Route:
    in_order = sorted(members, key=lambda c: column["in", c.target])
    row, weight = _rows_in_use(system, link)
    channel = system.links[link] if link is not None else None
    return Route(
        source=source,
        columns=np.array([column["out", c.source] for c in in_order], dtype=np.intp),
        targets=np.array([column["in", Endpoint(name, c.target.variable)] for c in in_order]),
        row=row,
        weight=weight,
        link=channel if isinstance(channel, PacketLink) else None,
    )


def _rows_in_use(system: System, link: str | None) -> tuple[NDArray[np.int64], Rows | None]:
    points = system.timetable.points_ns
    if link is None:
        return np.arange(points.size), None
    channel = system.links[link]
    if isinstance(channel, TransportLink):
        return channel.rows(points)
    return system.timetable.schedules[link].rows(points), None


def _in_order(stations: dict[str, Station], system: System) -> tuple[Station, ...]:
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
    return tuple(stations[name] for name in order)
