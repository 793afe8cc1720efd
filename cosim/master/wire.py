"""Lay out the rows of a run: the columns of every component, and the routes between them."""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import Port
from cosim.master.communication_points import BLOCK, CommunicationPoints
from cosim.master.component_instance import Column, ComponentInstance, Group, Texts, columns_of
from cosim.master.order import receiving_order
from cosim.master.parts import Component, Connection, Endpoint, RouteKey, Signal
from cosim.master.reserved import Reserved
from cosim.master.routes import LOOKING_AHEAD, Route
from cosim.master.rows_in_use import RowsInUse, check_midpoint
from cosim.master.system import System
from cosim.master.wiring import RowMemory, Wiring

NOMINAL_RANGE = 1e6
"""An output that declares its nominal value is in range up to so many times this value."""
_LEAST_BLOCK, _BLOCK_VALUES = 1 << 10, 1 << 21
"""Steps of a run in a block, and values in its rows: 16 MB of these."""
_KINDS = ("clock", "float", "int", "bool", "string", "binary")


def _reserve(shape: tuple[int, int]) -> RowMemory:
    return Reserved(shape, np.float64, large_pages=True)


def wire(system: System, reserve: Callable[[tuple[int, int]], RowMemory] = _reserve) -> Wiring:
    """Lay out the rows and routes of a system; `reserve` gives the memory of the rows.

    Raises
    ------
    InputError : as `receiving_order`; a policy that a link does not allow.
    """
    receiving = receiving_order(system)
    if receiving.cut:
        cut = set(receiving.cut)
        connections = [c._replace(policy="previous") if c in cut else c for c in system.connections]
        system = replace(system, connections=connections)
    turns = {name: turn for turn, name in enumerate(receiving.order)}
    from_start = frozenset(receiving.initialised)
    arriving = {name: _Arriving({}, {}) for name in system.components}
    for end, signal in system.driven.items():
        arriving[end.component].driven[end.variable] = signal
    for connection in system.connections:
        arriving[connection.target.component].add(system, connection)
    described = {id(one.description): one for one in system.components.values()}
    of_each = {number: _outputs(component) for number, component in described.items()}
    outputs = {name: of_each[id(one.description)] for name, one in system.components.items()}
    output_columns = {number: columns_of(sent) for number, (sent, _) in of_each.items()}
    inputs = {name: _inputs(system, name, arriving[name]) for name in system.components}
    columns = _Columns()
    for name, (ports, _) in outputs.items():
        columns.add("out", name, ports)
    total = columns.width
    for name, (ports, _) in inputs.items():
        columns.add("in", name, ports)
    block = min(BLOCK, max(_LEAST_BLOCK, _BLOCK_VALUES // max(columns.width, 1)))
    comm_points = CommunicationPoints(system, block=block)
    shared = _SharedRows(system, comm_points)
    memory = reserve((comm_points.most + 1, columns.width))
    rows = memory.array
    texts = Texts()
    instances = {}
    for name, component in system.components.items():
        sent, prompt = outputs[name]
        received, route_keys = inputs[name]
        a = columns.first("out", name, sent)
        b = a + sum(port.size for port in sent[:prompt])
        c = columns.first("in", name, received)
        instances[name] = ComponentInstance(
            name=name,
            component=component,
            own_points=comm_points.own_points[name],
            output_columns=output_columns[id(component.description)],
            input_columns=columns_of(received),
            outputs=rows[:-1, a : a + sum(port.size for port in sent)],
            outputs_without_feedthrough=_groups(sent[:prompt], a),
            connected_inputs=_groups(received, c, route_keys),
            outputs_with_feedthrough=_groups(sent[prompt:], b),
            routes=tuple(
                _route(
                    system,
                    shared,
                    name,
                    route_key,
                    members,
                    columns,
                    stepped_before=system.algorithm == "gauss-seidel"
                    and turns[route_key.source] < turns[name],
                    feeds_through=prompt < len(sent),
                    initialised=not from_start.isdisjoint(members),
                )
                for route_key, members in arriving[name].routes.items()
            ),
            rows=rows[:-1],
            texts=texts,
            comm_points=comm_points,
            driven=arriving[name].driven,
        )
    ordered = tuple(instances[name] for name in receiving.order)
    sent_columns = [c for name in system.components for c in instances[name].output_columns]
    bounds = _bounds(sent_columns, system.divergence)
    whole_from = reserve((1, 1)).array
    whole_from[:] = np.inf
    wiring = Wiring(memory, total, bounds, ordered, texts, comm_points, receiving, whole_from)
    wiring.begin()
    return wiring


class _Arriving(NamedTuple):
    """What the inputs of a component receive: connections by route, and driven inputs."""

    routes: dict[RouteKey, list[Connection]]
    driven: dict[str, Signal | Endpoint]

    def add(self, system: System, connection: Connection) -> None:
        """Add a connection; one from the state of a link drives its input."""
        source = connection.source
        if system.is_state(source):
            self.driven[connection.target.variable] = source
        else:
            route_key = RouteKey(source.component, connection.link, connection.policy)
            self.routes.setdefault(route_key, []).append(connection)


class _Columns:
    """The columns of the rows, by direction and variable."""

    def __init__(self) -> None:
        self.width = 0
        self._first: dict[tuple[str, Endpoint], int] = {}

    def add(self, direction: str, component: str, ports: Iterable[Port]) -> None:
        """Give the variables the next columns."""
        for port in ports:
            self._first[direction, Endpoint(component, port.name)] = self.width
            self.width += port.size

    def first(self, direction: str, component: str, ports: Sequence[Port]) -> int:
        """Return the first column of neighbouring variables, 0 for none."""
        return self.of(direction, Endpoint(component, ports[0].name)) if ports else 0

    def of_source(self, system: System, end: Endpoint) -> int:
        """Return the first column of an output, or of an input Clock that the master lets tick."""
        return self.of("in" if system.port(end).ticks_by_time else "out", end)

    def of(self, direction: str, end: Endpoint) -> int:
        """Return the first column of a variable."""
        return self._first[direction, end]


def _bounds(columns: Iterable[Column], asked: float | None) -> NDArray[np.float64]:
    """Return the largest magnitude of each output that is in range, (outputs,).

    `asked` : for all outputs; None: a multiple of the nominal value where one is declared, else
    any finite value is in range.
    """
    nominals = [None if asked is not None else column.port.nominal for column in columns]
    otherwise = np.finfo(np.float64).max if asked is None else asked
    return np.array([otherwise if n is None else NOMINAL_RANGE * abs(n) for n in nominals])


def _outputs(component: Component) -> tuple[list[Port], int]:
    """Return the outputs, those without feedthrough first, by type; and how many those are."""
    ports = component.description.ports.values()
    recorded = [p for p in ports if p.causality == "output" and p.kind is not None]
    prompt = [p for p in recorded if not p.feedthrough]
    direct = [p for p in recorded if p.feedthrough]
    return [*_by_type(prompt), *_by_type(direct)], len(prompt)


def _inputs(system: System, name: str, arriving: _Arriving) -> tuple[list[Port], list[int | None]]:
    """Return the connected inputs by route and type, and the route of each."""
    ports: list[Port] = []
    route_keys: list[int | None] = []
    for number, members in enumerate(arriving.routes.values()):
        mine = _by_type([system.port(c.target) for c in members])
        ports += mine
        route_keys += [number] * len(mine)
    driven = [system.port(Endpoint(name, variable)) for variable in arriving.driven]
    driven += _ticked_by_master(system.components[name], {port.name for port in ports})
    return ports + driven, route_keys + [None] * len(driven)


def _ticked_by_master(component: Component, connected: Container[str]) -> list[Port]:
    """Return the input Clocks of a component that no connection lets tick."""
    return [
        port
        for port in component.description.ports.values()
        if port.kind == "clock"
        and port.name not in connected
        and (port.ticks_by_time or port.name in component.clocks)
    ]


def _check_in_turns(system: System, name: str, route_key: RouteKey) -> None:
    if system.algorithm == "gauss-seidel":
        raise InputError(
            "an input in the middle of a step and an output that depends on it at once do not go "
            "together under gauss-seidel",
            where=f"connection {route_key} to {name}",
            expected="the policy hold, or algorithm = jacobi",
            got=route_key.policy,
        )


def _by_type(ports: Sequence[Port]) -> list[Port]:
    return sorted(ports, key=lambda p: (_KINDS.index(p.kind or "float"), p.getter_type))


def _groups(
    ports: Sequence[Port], column: int, route_keys: Sequence[int | None] | None = None
) -> tuple[Group, ...]:
    """Group neighbouring variables of one type and route."""
    given = route_keys if route_keys is not None else [None] * len(ports)
    groups = []
    pairs = zip(ports, given, strict=True)
    for (getter_type, route_key, clocks), found in groupby(
        pairs, key=lambda pair: (pair[0].getter_type, pair[1], pair[0].clocks)
    ):
        members = [port for port, _ in found]
        size = sum(port.size for port in members)
        references = np.array([port.reference for port in members], dtype=np.uint32)
        given_type = (getter_type, members[0].c_type)
        groups.append(Group(*given_type, references, size, column, route_key, clocks))
        column += size
    return tuple(groups)


class _SharedRows:
    """The rows in use of routes: those that read the same rows at the same points share them."""

    def __init__(self, system: System, comm_points: CommunicationPoints) -> None:
        self._system, self._points = system, comm_points
        self._known: dict[tuple[Any, ...], RowsInUse] = {}

    def of(
        self, route_key: RouteKey, receiver: str, *, stepped_before: bool, initialised: bool
    ) -> RowsInUse:
        """Return the rows in use of a route; an `InputError` as `RowsInUse`."""
        own = self._points.own_points
        when = id(own[route_key.source]), id(own[receiver]), stepped_before, initialised
        key = (route_key.link, route_key.policy, *when)
        if key not in self._known:
            self._known[key] = RowsInUse(
                *(self._system, self._points, route_key, receiver),
                stepped_before=stepped_before,
                initialised=initialised,
            )
        return self._known[key]


def _route(
    system: System,
    shared: _SharedRows,
    name: str,
    route_key: RouteKey,
    members: Iterable[Connection],
    columns: _Columns,
    *,
    stepped_before: bool,
    feeds_through: bool,
    initialised: bool,
) -> Route:
    looks_ahead = route_key.policy in LOOKING_AHEAD
    also_at_point = feeds_through and looks_ahead
    if also_at_point:
        _check_in_turns(system, name, route_key)
    reads = partial(shared.of, receiver=name, stepped_before=stepped_before)
    in_step = reads(route_key, initialised=initialised and not also_at_point)
    at_point = None
    if also_at_point:
        at_point = reads(route_key._replace(policy="hold"), initialised=initialised)
    if route_key.policy == "midpoint":
        check_midpoint(system, route_key, name)
    pairs = [
        (columns.of_source(system, c.source) + i, columns.of("in", c.target) + i)
        for c in sorted(members, key=lambda c: columns.of("in", c.target))
        for i in range(system.port(c.target).size)
    ]
    sources, targets = np.array(pairs, dtype=np.intp).T
    return Route(
        route_key=route_key,
        columns=sources,
        targets=targets,
        in_step=in_step,
        at_point=at_point,
    )
