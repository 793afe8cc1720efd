"""The rows of a run, and which of them each input reads at each communication point.

Row k of one array contains every value exchanged at point k: the outputs of all components, then
their connected inputs. A sender writes its columns; a receiver reads the row that its route names.
Routes are known before the run, except over links whose delay follows a signal.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from cosim.core import InputError
from cosim.fmu import Port
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_instance import (
    ComponentInstance,
    Group,
    Rows,
    Texts,
    columns_of,
    element_names,
)
from cosim.master.component_points import component_points
from cosim.master.order import receiving_order
from cosim.master.parts import Component, Connection, Endpoint, Signal
from cosim.master.routes import Route, RouteFiller, RouteKey, growing_rows_in_use, rows_in_use
from cosim.master.system import System
from cosim.network import LinkState, PacketLink

_KINDS = ("float", "int", "bool", "string")


@dataclass(frozen=True)
class Wiring:
    """The rows of a run and the component instances that use them.

    Attributes
    ----------
    rows : (points, values).
    outputs : how many of the values are outputs; they come first.
    instances : in the order in which they receive, and under Gauss-Seidel step.
    comm_points : the communication points of the run.
    fills : set the rows of the routes that are not known from the start.
    """

    rows: Rows
    outputs: int
    instances: tuple[ComponentInstance, ...]
    texts: Texts
    comm_points: CommunicationPoints
    fills: tuple[RouteFiller, ...]

    def instance(self, name: str) -> ComponentInstance:
        """Return the instance of a component."""
        return next(s for s in self.instances if s.name == name)

    def reset_rows(self, row: int) -> None:
        """Clear the rows from `row` on: inputs have their start values or driven signals."""
        self.rows[row:] = 0.0
        for instance in self.instances:
            first = instance.input_column
            for j, column in enumerate(instance.input_columns):
                port = column.port
                if column.name in (port.name, element_names(port)[0]):
                    start_value = instance.component.parameters.get(port.name, port.start)
                    self.rows[row:, first + j : first + j + port.size] = self.texts.doubles(
                        start_value, port
                    )
        self.fill_rows(row, self.comm_points.horizon)

    def fill_rows(self, first: int, last: int) -> None:
        """Set routes and driven inputs at the points first to last - 1, known by now."""
        for fill in self.fills:
            fill(first, last)
        states: dict[str, LinkState] = {}
        for instance in self.instances:
            for j, column in enumerate(instance.input_columns):
                cells = self.rows[first:last, instance.input_column + j]
                source = instance.driven.get(column.name)
                if source is None or first >= last:
                    continue
                if isinstance(source, Endpoint):
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

    def columns_of_delays(self, system: System) -> dict[str, tuple[int, ...]]:
        """Return by live link the columns of its delay signals."""
        return {
            name: tuple(
                self.instance(end.component).place(end.variable)[0]
                for end in system.delays[name].signals
            )
            for name in self.comm_points.live
        }

    def output(self, column: int) -> Endpoint:
        """Return the output in a column."""
        for instance in self.instances:
            first = instance.output_column
            if 0 <= column - first < len(instance.output_columns):
                return Endpoint(instance.name, instance.output_columns[column - first].name)
        raise ValueError(f"expected the column of an output, got {column}")


def wire(system: System) -> Wiring:
    """Lay out the rows and routes of a system.

    Raises
    ------
    InputError : an algebraic loop, named by its components; a policy that a link does not allow.
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
    comm_points = CommunicationPoints(system)
    most = comm_points.points_ns.size
    rows: Rows = np.zeros((most, width))
    own_points = system.own_points
    if comm_points.grows:
        own_points = dict.fromkeys(system.components, component_points(None, comm_points.points_ns))
    texts = Texts()
    fills: list[RouteFiller] = []
    instances = {}
    for name, component in system.components.items():
        outputs, prompt = sorted_outputs[name]
        inputs, route_keys = sorted_inputs[name]
        a = column["out", Endpoint(name, outputs[0].name)] if outputs else 0
        b = a + sum(port.size for port in outputs[:prompt])
        c = column["in", Endpoint(name, inputs[0].name)] if inputs else 0
        instances[name] = ComponentInstance(
            name=name,
            component=component,
            own_points=own_points[name],
            output_columns=columns_of(outputs),
            input_columns=columns_of(inputs),
            outputs=rows[:, a : a + sum(port.size for port in outputs)],
            outputs_without_feedthrough=_groups(outputs[:prompt], a),
            connected_inputs=_groups(inputs, c, route_keys),
            outputs_with_feedthrough=_groups(outputs[prompt:], b),
            routes=tuple(
                _route(system, comm_points, name, route_key, members, column, order, fills)
                for route_key, members in _connections_by_route(system, name)
            ),
            rows=rows,
            texts=texts,
            comm_points=comm_points,
            driven=_driven(system, name),
        )
    ordered = tuple(instances[name] for name in order)
    wiring = Wiring(rows, total, ordered, texts, comm_points, tuple(fills))
    wiring.reset_rows(0)
    return wiring


def _outputs(component: Component) -> tuple[list[Port], int]:
    """Return the outputs, those without feedthrough first, by type; and how many those are."""
    ports = component.description.ports.values()
    recorded = [p for p in ports if p.causality == "output" and p.kind is not None]
    prompt = [p for p in recorded if not p.feedthrough]
    direct = [p for p in recorded if p.feedthrough]
    return [*_by_type(prompt), *_by_type(direct)], len(prompt)


def _inputs(system: System, name: str) -> tuple[list[Port], list[int | None]]:
    """Return the connected inputs by route and type, and the route of each."""
    ports: list[Port] = []
    route_keys: list[int | None] = []
    for number, (_, members) in enumerate(_connections_by_route(system, name)):
        mine = _by_type([system.port(c.target) for c in members])
        ports += mine
        route_keys += [number] * len(mine)
    driven = [system.port(Endpoint(name, variable)) for variable in _driven(system, name)]
    return ports + driven, route_keys + [None] * len(driven)


def _driven(system: System, name: str) -> dict[str, Signal | Endpoint]:
    """Return the inputs of a component that follow a signal, or the state of a link."""
    found: dict[str, Signal | Endpoint] = {
        end.variable: signal for end, signal in system.driven.items() if end.component == name
    }
    for c in system.connections:
        if c.target.component == name and system.is_state(c.source):
            found[c.target.variable] = c.source
    return found


_STATE = {"age": "age_s"}


def _finite(values: Rows, component: str, variable: str) -> Rows:
    if not np.isfinite(values).all():
        raise InputError("the signal of an input must be finite", where=f"{component}.{variable}")
    return values


def _connections_by_route(system: System, name: str) -> list[tuple[RouteKey, list[Connection]]]:
    """Return the connections into a component, by sender, link and policy."""
    route_keys: dict[RouteKey, list[Connection]] = {}
    for c in system.connections:
        if c.target.component == name and not system.is_state(c.source):
            route_keys.setdefault(RouteKey(c.source.component, c.link, c.policy), []).append(c)
    return list(route_keys.items())


def _by_type(ports: Sequence[Port]) -> list[Port]:
    return sorted(ports, key=lambda p: (_KINDS.index(p.kind or "float"), p.getter_type))


def _groups(
    ports: Sequence[Port], column: int, route_keys: Sequence[int | None] | None = None
) -> tuple[Group, ...]:
    """Group neighbouring variables of one type and route."""
    given = route_keys if route_keys is not None else [None] * len(ports)
    groups = []
    pairs = zip(ports, given, strict=True)
    for (getter_type, route_key), found in groupby(
        pairs, key=lambda pair: (pair[0].getter_type, pair[1])
    ):
        members = [port for port, _ in found]
        size = sum(port.size for port in members)
        references = np.array([port.reference for port in members], dtype=np.uint32)
        groups.append(Group(getter_type, members[0].c_type, references, size, column, route_key))
        column += size
    return tuple(groups)


def _route(
    system: System,
    comm_points: CommunicationPoints,
    name: str,
    route_key: RouteKey,
    members: Iterable[Connection],
    column: Mapping[tuple[str, Endpoint], int],
    order: Sequence[str],
    fills: list[RouteFiller],
) -> Route:
    in_order = sorted(members, key=lambda c: column["in", c.target])
    before = order.index(route_key.source) < order.index(name)
    stepped = system.algorithm == "gauss-seidel" and before
    if comm_points.grows or route_key.link in comm_points.live:
        used, fill = growing_rows_in_use(system, comm_points, route_key, stepped_before=stepped)
        fills += [fill] if fill is not None else []
    else:
        sender, receiver = system.own_points[route_key.source], system.own_points[name]
        used = rows_in_use(system, route_key, sender, receiver, stepped_before=stepped)
    sizes = [range(system.port(c.target).size) for c in in_order]
    pairs = [
        (column["out", c.source] + i, column["in", Endpoint(name, c.target.variable)] + i)
        for c, size in zip(in_order, sizes, strict=True)
        for i in size
    ]
    columns, targets = np.array(pairs, dtype=np.intp).T
    channel = system.links[route_key.link] if route_key.link is not None else None
    return Route(
        route_key=route_key,
        columns=columns,
        targets=targets,
        row=used.row,
        after=used.after,
        weight=used.weight,
        link=channel if isinstance(channel, PacketLink) else None,
    )
