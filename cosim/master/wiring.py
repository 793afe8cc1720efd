"""From connections to rows: what each input reads at each communication point.

Row k of one array holds every value exchanged at point k: the outputs of all components,
then their connected inputs. A sender writes its part once; a receiver reads the row that its
route names. The routes are complete before the run starts: the trace is the delay line.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from cosim.fmu import Port
from cosim.master.columns import columns_of, element_names
from cosim.master.order import receiving_order
from cosim.master.routes import Route, Way, rows_in_use
from cosim.master.stations import Group, Rows, Station, Texts
from cosim.master.system import Component, Connection, Endpoint, System
from cosim.network import PacketLink

_KINDS = ("float", "int", "bool", "string")


@dataclass(frozen=True)
class Wiring:
    """The rows of a run and who uses them.

    Attributes
    ----------
    rows : (points, values).
    outputs : how many of the values are outputs; they come first.
    stations : in the order in which they receive, and under Gauss-Seidel step.
    """

    rows: Rows
    outputs: int
    stations: tuple[Station, ...]
    texts: Texts

    def station(self, name: str) -> Station:
        """The station of a component."""
        return next(s for s in self.stations if s.name == name)

    def first_output(self, station: Station) -> int:
        """The first column of a station's outputs."""
        return min((group.column for group in (*station.sends, *station.answers)), default=0)

    def begin_again(self, system: System, row: int) -> None:
        """Lay out rows from `row` on: inputs at their start values, or at what drives them."""
        self.rows[row:] = 0.0
        for station in self.stations:
            first = station.input_column
            for j, column in enumerate(station.input_columns):
                port = column.port
                if column.name in (port.name, element_names(port)[0]):
                    held = station.component.parameters.get(port.name, port.start)
                    self.rows[row:, first + j : first + j + port.size] = self.texts.doubles(
                        held, port
                    )
                end = Endpoint(station.name, port.name)
                if end in system.driven:
                    self.rows[row:, first + j] = system.driven[end][row:]

    def output(self, column: int) -> Endpoint:
        """The output that stands in a column."""
        for station in self.stations:
            first = self.first_output(station)
            if 0 <= column - first < len(station.output_columns):
                return Endpoint(station.name, station.output_columns[column - first].name)
        raise ValueError(f"expected the column of an output, got {column}")


def wire(system: System) -> Wiring:
    """The rows and routes of a system.

    Raises
    ------
    InputError : an algebraic loop, named by its components; a policy that a link forbids.
    """
    order = receiving_order(system)
    sorted_outputs = {name: _outputs(c) for name, c in system.components.items()}
    sorted_inputs = {name: _inputs(system, name) for name in system.components}
    column: dict[tuple[str, Endpoint], int] = {}
    width = 0
    for direction, ports in (("out", sorted_outputs), ("in", sorted_inputs)):
        for name, (members, _) in ports.items():
            for port in members:
                column[direction, Endpoint(name, port.name)] = width
                width += port.size
    total = sum(port.size for members, _ in sorted_outputs.values() for port in members)
    rows: Rows = np.zeros((system.timetable.points_ns.size, width))
    texts = Texts()
    stations = {}
    for name, component in system.components.items():
        outputs, prompt = sorted_outputs[name]
        inputs, ways = sorted_inputs[name]
        a = column["out", Endpoint(name, outputs[0].name)] if outputs else 0
        b = a + sum(port.size for port in outputs[:prompt])
        c = column["in", Endpoint(name, inputs[0].name)] if inputs else 0
        station = Station(
            name=name,
            component=component,
            beat=system.beats[name],
            output_columns=columns_of(outputs),
            input_columns=columns_of(inputs),
            outputs=rows[:, a : a + sum(port.size for port in outputs)],
            sends=_groups(outputs[:prompt], a),
            takes=_groups(inputs, c, ways),
            answers=_groups(outputs[prompt:], b),
            routes=tuple(
                _route(system, name, way, members, column, order)
                for way, members in _ways(system, name)
            ),
            rows=rows,
            texts=texts,
        )
        stations[name] = station
    wiring = Wiring(rows, total, tuple(stations[name] for name in order), texts)
    wiring.begin_again(system, 0)
    return wiring


def _outputs(component: Component) -> tuple[list[Port], int]:
    """Outputs, those first that do not wait for inputs, types together; how many those are."""
    ports = component.description.ports.values()
    recorded = [p for p in ports if p.causality == "output" and p.kind is not None]
    prompt = [p for p in recorded if not p.feedthrough]
    direct = [p for p in recorded if p.feedthrough]
    return [*_by_type(prompt), *_by_type(direct)], len(prompt)


def _inputs(system: System, name: str) -> tuple[list[Port], list[int | None]]:
    """Connected inputs, those of one route and type together; and the route of each."""
    ports: list[Port] = []
    ways: list[int | None] = []
    for number, (_, members) in enumerate(_ways(system, name)):
        mine = _by_type([system.port(c.target) for c in members])
        ports += mine
        ways += [number] * len(mine)
    driven = [system.port(end) for end in system.driven if end.component == name]
    return ports + driven, ways + [None] * len(driven)


def _ways(system: System, name: str) -> list[tuple[Way, list[Connection]]]:
    """Connections into a component, by sender, link and policy."""
    ways: dict[Way, list[Connection]] = {}
    for c in system.connections:
        if c.target.component == name:
            ways.setdefault(Way(c.source.component, c.link, c.policy), []).append(c)
    return list(ways.items())


def _by_type(ports: Sequence[Port]) -> list[Port]:
    return sorted(ports, key=lambda p: (_KINDS.index(p.kind or "float"), p.getter_type))


def _groups(
    ports: Sequence[Port], column: int, ways: Sequence[int | None] | None = None
) -> tuple[Group, ...]:
    """Neighbours of one type and route, a group each."""
    given = ways if ways is not None else [None] * len(ports)
    groups = []
    pairs = zip(ports, given, strict=True)
    for (getter_type, way), found in groupby(
        pairs, key=lambda pair: (pair[0].getter_type, pair[1])
    ):
        members = [port for port, _ in found]
        size = sum(port.size for port in members)
        references = np.array([port.reference for port in members], dtype=np.uint32)
        groups.append(Group(getter_type, members[0].c_type, references, size, column, way))
        column += size
    return tuple(groups)


def _route(
    system: System,
    name: str,
    way: Way,
    members: Iterable[Connection],
    column: Mapping[tuple[str, Endpoint], int],
    order: Sequence[str],
) -> Route:
    in_order = sorted(members, key=lambda c: column["in", c.target])
    before = order.index(way.source) < order.index(name)
    used = rows_in_use(
        system,
        way,
        system.beats[way.source],
        system.beats[name],
        stepped_before=system.algorithm == "gauss-seidel" and before,
    )
    sizes = [range(system.port(c.target).size) for c in in_order]
    pairs = [
        (column["out", c.source] + i, column["in", Endpoint(name, c.target.variable)] + i)
        for c, size in zip(in_order, sizes, strict=True)
        for i in size
    ]
    columns, targets = np.array(pairs, dtype=np.intp).T
    channel = system.links[way.link] if way.link is not None else None
    return Route(
        way=way,
        columns=columns,
        targets=targets,
        row=used.row,
        after=used.after,
        weight=used.weight,
        link=channel if isinstance(channel, PacketLink) else None,
    )
