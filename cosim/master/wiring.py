"""The rows of a run, and which of them each input reads at each communication point.

Row k of one array contains every value exchanged at point k: the outputs of all components, then
their connected inputs. A sender writes its columns; the columns of a receiver are copied from the
row that its route names. Routes are known before the run, except over links whose delay follows a
signal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import Port
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_instance import (
    Column,
    ComponentInstance,
    Group,
    Rows,
    Texts,
    columns_of,
    element_names,
)
from cosim.master.component_points import component_points
from cosim.master.order import ReceivingOrder, receiving_order
from cosim.master.parts import Component, Connection, Endpoint, Signal
from cosim.master.routes import (
    LOOKING_AHEAD,
    Route,
    RouteFiller,
    RouteKey,
    growing_rows_in_use,
    rows_in_use,
)
from cosim.master.system import System
from cosim.network import LinkState, PacketLink

Columns = NDArray[np.intp]
NOMINAL_RANGE = 1e6
"""An output that declares its nominal value is in range up to so many times this value."""
_KINDS = ("float", "int", "bool", "string")


@dataclass(eq=False)
class Wiring:
    """The rows of a run and the component instances that use them.

    Attributes
    ----------
    all_rows : (points + 1, values): those of the points, and the spare row.
    outputs : how many of the values are outputs; they come first.
    bounds : largest magnitude of each output in range, (outputs,).
    instances : in the order in which they receive, and under Gauss-Seidel step.
    comm_points : the communication points of the run.
    receiving : the order in which components receive, and what becomes of algebraic loops.
    settled : columns and values of inputs at the first point on which the initialisation settled.
    fills : set the rows of the routes that are not known from the start.
    whole_from : the first row that the loop leaves whole, (1, 1). In the rows before it
        `make_whole` copies the inputs that were set from the sender's row.
    whole_rows : number of rows in which it has done so.
    """

    all_rows: Rows
    outputs: int
    bounds: NDArray[np.float64]
    instances: tuple[ComponentInstance, ...]
    texts: Texts
    comm_points: CommunicationPoints
    fills: tuple[RouteFiller, ...]
    receiving: ReceivingOrder
    whole_from: Rows
    whole_rows: int = 0
    settled: list[tuple[Columns, Rows]] = field(default_factory=list)

    @property
    def rows(self) -> Rows:
        """The rows of the points, (points, values)."""
        return self.all_rows[:-1]

    @cached_property
    def by_name(self) -> Mapping[str, ComponentInstance]:
        """The instances by the names of their components."""
        return {instance.name: instance for instance in self.instances}

    def instance(self, name: str) -> ComponentInstance:
        """Return the instance of a component."""
        return self.by_name[name]

    @cached_property
    def direct_routes(self) -> frozenset[Route]:
        """The routes whose values an FMI call can set from the sender's row, without a copy."""
        found = set()
        # the values of an algebraic loop are in the row while it is iterated
        iterated = {name for loop in self.receiving.loops for name in loop}
        for instance in self.instances:
            for group in () if instance.name in iterated else instance.connected_inputs:
                route = None if group.route is None else instance.routes[group.route]
                if route is not None and route.at_point is None and route.verbatim:
                    whole = group.c_type == "f8" and group.size == route.targets.size
                    found |= {route} if whole else set()
        return frozenset(found)

    def make_whole(self, count: int) -> None:
        """Make the first `count` rows whole: copy the inputs that direct routes brought."""
        first, last = self.whole_rows, int(min(count, self.whole_from[0, 0]))
        for route in self.direct_routes if first < last else ():
            used = route.in_step.row[first:last]
            there = np.flatnonzero(used >= 0)
            if route.spans is not None:
                source, target = route.spans
                self.rows[first + there, target] = self.rows[used[there], source]
        self.whole_rows = max(self.whole_rows, count)

    def leave_whole_from(self, first: int) -> None:
        """From row `first` on the loop copies inputs itself, for example to adjust them."""
        self.make_whole(first)
        self.whole_from[0, 0] = min(self.whole_from[0, 0], first)

    def reset_rows(self, first: int) -> None:
        """Clear the rows from `first` on: inputs have their start values or driven signals."""
        self.whole_rows = min(self.whole_rows, first)
        self.rows[first:] = self._start
        self._settle(first)
        self.fill_rows(first, self.comm_points.horizon)

    def reset_inputs(self, k: int) -> None:
        """Give the inputs of row k their start values or driven signals again."""
        self.whole_rows = min(self.whole_rows, k)
        self.rows[k, self.outputs :] = self._start[self.outputs :]
        self._settle(k)
        self._drive(k, k + 1)

    def _settle(self, k: int) -> None:
        """At the first point, give inputs the values on which the initialisation settled."""
        for columns, values in self.settled if k == 0 else ():
            self.rows[0, columns] = values

    @cached_property
    def _start(self) -> Rows:
        """The row before anything is exchanged: start values of inputs, (values,)."""
        row = np.zeros(self.all_rows.shape[1])
        for instance in self.instances:
            first = instance.input_column
            for j, column in enumerate(instance.input_columns):
                port = column.port
                if column.name in (port.name, element_names(port)[0]):
                    start_value = instance.component.parameters.get(port.name, port.start)
                    place = first + j
                    row[place : place + port.size] = self.texts.doubles(start_value, port)
        return row

    def fill_rows(self, first: int, last: int) -> None:
        """Set routes and driven inputs at the points first to last - 1, known by now."""
        for fill in self.fills:
            fill(first, last)
        self._drive(first, last)

    def _drive(self, first: int, last: int) -> None:
        """Set the driven inputs at the points first to last - 1."""
        states: dict[str, LinkState] = {}
        for instance in self.instances:
            for j, column in enumerate(instance.input_columns if instance.driven else ()):
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
                for end in system.delays[name].signals
            )
            for name in self.comm_points.live
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


def wire(system: System, allocate: Callable[[tuple[int, int]], Rows] = np.zeros) -> Wiring:
    """Lay out the rows and routes of a system; `allocate` makes the array of the rows.

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
    outputs = {name: _outputs(component) for name, component in system.components.items()}
    inputs = {name: _inputs(system, name, arriving[name]) for name in system.components}
    columns = _Columns()
    for name, (ports, _) in outputs.items():
        columns.add("out", name, ports)
    total = columns.width
    for name, (ports, _) in inputs.items():
        columns.add("in", name, ports)
    comm_points = CommunicationPoints(system)
    rows = allocate((comm_points.points_ns.size + 1, columns.width))
    own_points = system.own_points
    if comm_points.grows:
        own_points = dict.fromkeys(system.components, component_points(None, comm_points.points_ns))
    texts = Texts()
    fills: list[RouteFiller] = []
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
            own_points=own_points[name],
            output_columns=columns_of(sent),
            input_columns=columns_of(received),
            outputs=rows[:-1, a : a + sum(port.size for port in sent)],
            outputs_without_feedthrough=_groups(sent[:prompt], a),
            connected_inputs=_groups(received, c, route_keys),
            outputs_with_feedthrough=_groups(sent[prompt:], b),
            routes=tuple(
                _route(
                    system,
                    comm_points,
                    name,
                    route_key,
                    members,
                    columns,
                    fills,
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
    whole_from = allocate((1, 1))
    whole_from[:] = np.inf
    wiring = Wiring(
        *(rows, total, bounds, ordered, texts, comm_points, tuple(fills), receiving, whole_from)
    )
    wiring.reset_rows(0)
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
    return ports + driven, route_keys + [None] * len(driven)


_STATE = {"age": "age_s"}


def _finite(values: Rows, component: str, variable: str) -> Rows:
    if not np.isfinite(values).all():
        raise InputError("the signal of an input must be finite", where=f"{component}.{variable}")
    return values


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
    columns: _Columns,
    fills: list[RouteFiller],
    *,
    stepped_before: bool,
    feeds_through: bool,
    initialised: bool,
) -> Route:
    at_point = None
    if comm_points.grows or route_key.link in comm_points.live:
        used, fill = growing_rows_in_use(
            system, comm_points, route_key, stepped_before=stepped_before, initialised=initialised
        )
        fills += [fill] if fill is not None else []
    else:
        sender, receiver = system.own_points[route_key.source], system.own_points[name]
        used = rows_in_use(system, route_key, sender, receiver, stepped_before=stepped_before)
        if feeds_through and route_key.policy in LOOKING_AHEAD:
            _check_in_turns(system, name, route_key)
            holding = route_key._replace(policy="hold")
            at_point = rows_in_use(system, holding, sender, receiver, stepped_before=stepped_before)
        if initialised and at_point is not None:
            at_point = at_point.from_initialisation()
        elif initialised:
            used = used.from_initialisation()
    pairs = [
        (columns.of("out", c.source) + i, columns.of("in", c.target) + i)
        for c in sorted(members, key=lambda c: columns.of("in", c.target))
        for i in range(system.port(c.target).size)
    ]
    sources, targets = np.array(pairs, dtype=np.intp).T
    channel = system.links[route_key.link] if route_key.link is not None else None
    return Route(
        route_key=route_key,
        columns=sources,
        targets=targets,
        in_step=used,
        link=channel if isinstance(channel, PacketLink) else None,
        at_point=at_point,
        initialised=(used if at_point is None else at_point).initialised,
    )
