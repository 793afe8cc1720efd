"""What the master runs: components, what connects them, and when they meet."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.errors import InputError
from cosim.fmu import FmuDescription, Port
from cosim.master.beats import Beat, beat_of, own_instants
from cosim.network import PacketLink, PacketSchedule, TransportLink, align, schedule

Link = PacketLink | TransportLink
Events = Literal["align", "grid"]
Algorithm = Literal["jacobi", "gauss-seidel"]
Policy = Literal["hold", "midpoint", "linear"]
"""What an input is held at over a step: see `cosim.master.routes`."""

_MOST_POINTS = 20_000_000


class Endpoint(NamedTuple):
    """A variable of a component."""

    component: str
    variable: str

    def __str__(self) -> str:
        return f"{self.component}.{self.variable}"


class Connection(NamedTuple):
    """An output wired to an input, directly or over a link."""

    source: Endpoint
    target: Endpoint
    link: str | None = None
    policy: Policy = "hold"


@dataclass(frozen=True)
class Component:
    """An FMU with the parameters it starts from.

    `every_ns` : its own communication step [ns]; None: it communicates at every point.
    """

    description: FmuDescription
    parameters: Mapping[str, Any] = field(default_factory=dict)
    every_ns: int | None = None


@dataclass(frozen=True)
class System:
    """A closed description of one run.

    Attributes
    ----------
    components : by name, in the order in which they are stepped.
    connections : one per input at most.
    links : by name.
    driven : inputs that follow a given signal, as a function of the points [s].
    step_ns, end_ns : communication step and end [ns].
    events : "align": sends and arrivals become communication points; "grid": they are moved
        to the next point of the grid.
    divergence : a magnitude of any output from which on the run counts as diverged.
    algorithm : "jacobi": all step from the same point on what was exchanged there;
        "gauss-seidel": one after the other, each on what those before it have reached.
    order : in which components step under Gauss-Seidel, all of them; None: senders before
        those whose outputs follow them at once, else as in `components`.
    """

    components: Mapping[str, Component]
    connections: Sequence[Connection]
    links: Mapping[str, Link]
    driven: Mapping[Endpoint, NDArray[np.float64]]
    timetable: Timetable
    divergence: float
    algorithm: Algorithm = "jacobi"
    order: Sequence[str] | None = None

    def __post_init__(self) -> None:
        _check_links(self)
        _check(self)

    @cached_property
    def beats(self) -> Mapping[str, Beat]:
        """When each component communicates."""
        points = self.timetable.points_ns
        steps = {component.every_ns for component in self.components.values()}
        made = {every: beat_of(every, points) for every in steps}
        return {name: made[component.every_ns] for name, component in self.components.items()}

    def port(self, end: Endpoint) -> Port:
        """The variable behind an endpoint."""
        where = f"component {end.component!r}"
        component = self.components.get(end.component)
        if component is None:
            raise InputError.unknown("component", end.component, self.components)
        return component.description.port(end.variable, where=where)


@dataclass(frozen=True)
class Timetable:
    """Every communication point of a run, and the schedule of every packet link.

    Attributes
    ----------
    points_ns : strictly increasing from 0 to the end [ns], int64 (n,).
    schedules : by name of the link; all their instants are points, or were moved to one.
    step_ns : the communication step asked for [ns].
    """

    points_ns: NDArray[np.int64]
    schedules: Mapping[str, PacketSchedule]
    step_ns: int


def make_timetable(
    links: Mapping[str, Link],
    step_ns: int,
    end_ns: int,
    events: Events,
    every_ns: Iterable[int] = (),
) -> Timetable:
    """Lay out the whole run in time before it starts.

    `every_ns` : steps of components that have their own [ns]; under "align" their multiples
    become points, on the grid they are to be multiples of the step.

    Raises
    ------
    InputError : a step that is not positive or exceeds the end, or far too many points.
    """
    if step_ns < 1 or end_ns < step_ns:
        raise InputError(
            "the communication step does not fit the run",
            where="run",
            expected="0 < step <= end",
            got=f"step {step_ns / 1e9:g} s, end {end_ns / 1e9:g} s",
        )
    if end_ns // step_ns > _MOST_POINTS:
        raise InputError(
            "too many communication points",
            where="run",
            expected=f"at most {_MOST_POINTS}",
            got=f"{end_ns // step_ns}: one each {step_ns / 1e9:g} s up to {end_ns / 1e9:g} s",
        )
    grid = np.append(np.arange(0, end_ns, step_ns, dtype=np.int64), np.int64(end_ns))
    for every in every_ns:
        if not 1 <= every <= end_ns or (events == "grid" and every % step_ns):
            raise InputError(
                "a component's own step does not fit the run",
                where="run",
                expected="0 < step <= end"
                + (", a multiple of the communication step" if events == "grid" else ""),
                got=f"{every / 1e9:g} s, step {step_ns / 1e9:g} s, end {end_ns / 1e9:g} s",
            )
        if events == "align":
            grid = np.union1d(grid, own_instants(every, end_ns))
    packet = [link for link in links.values() if isinstance(link, PacketLink)]
    if not packet:
        return Timetable(grid, {}, step_ns)
    aligned = align([schedule(link, end_ns) for link in packet], grid, events)
    return Timetable(aligned.points_ns, {s.link.name: s for s in aligned.schedules}, step_ns)


def _check_links(system: System) -> None:
    for name, link in system.links.items():
        packet = isinstance(link, PacketLink)
        if link.name != name or (packet and name not in system.timetable.schedules):
            raise InputError(
                "the link and its place in the system do not fit",
                where=f"link {name!r}",
                expected="the link's own name, and a timetable made for it",
                got=f"link {link.name!r}, schedules of {list(system.timetable.schedules)}",
                hint="pass the same links to make_timetable and to System",
            )


def _check(system: System) -> None:
    taken: dict[Endpoint, str] = {}
    _check_connections(system, taken)
    _check_driven(system, taken)
    _check_order(system)
    for name, component in system.components.items():
        own = system.timetable.points_ns[system.beats[name].own]
        if np.unique(np.diff(own)).size > 1 and not component.description.variable_step:
            raise InputError(
                "this FMU takes steps of one size only",
                where=f"component {name!r} ({component.description.path.name})",
                hint='set events = "grid" and an end that is a multiple of the step, or give '
                "the component a step of its own of which the end is a multiple",
            )


def _check_order(system: System) -> None:
    if system.order is None:
        return
    if system.algorithm != "gauss-seidel" or sorted(system.order) != sorted(system.components):
        raise InputError(
            "the order does not fit the system",
            where="order",
            expected=f"under gauss-seidel, each of {', '.join(system.components)} once",
            got=f"{system.algorithm}: {', '.join(system.order)}",
        )


def _check_connections(system: System, taken: dict[Endpoint, str]) -> None:
    for connection in system.connections:
        source, target = system.port(connection.source), system.port(connection.target)
        where = f"connection {connection.source} -> {connection.target}"
        if source.causality != "output" or target.causality != "input":
            raise InputError(
                "a connection leads from an output to an input",
                where=where,
                got=f"{source.causality} -> {target.causality}",
            )
        _check_types(source, target, where)
        if source.unit and target.unit and source.unit != target.unit:
            raise InputError(
                "the units of the two ends differ",
                where=where,
                got=f"{source.unit} -> {target.unit}",
            )
        if connection.link is not None and connection.link not in system.links:
            raise InputError.unknown("link", connection.link, system.links, where=where)
        if source.kind != "float" and connection.policy != "hold":
            raise InputError(
                "only real numbers have a value in between",
                where=where,
                expected="the policy hold",
                got=connection.policy,
            )
        if connection.link is not None and source.kind != "float":
            _check_carries(system.links[connection.link], source, where)
        _take(taken, connection.target, f"connection from {connection.source}")


_NAMES = {"float": "Real", "int": "Integer", "bool": "Boolean", "string": "String"}


def _check_types(source: Port, target: Port, where: str) -> None:
    """Same kind, same shape, and room for every value."""
    if source.kind is None or source.kind != target.kind:
        raise InputError(
            "the types of the two ends do not fit",
            where=where,
            expected="both Real, both Integer (or Enumeration), both Boolean or both String",
            got=" -> ".join(_NAMES.get(p.kind or "", "Binary or Clock") for p in (source, target)),
        )
    if source.shape != target.shape:
        raise InputError(
            "the arrays at the two ends differ in shape",
            where=where,
            got=f"{source.shape or 'a scalar'} -> {target.shape or 'a scalar'}",
        )
    if source.kind == "int" and not _has_room(source, target):
        raise InputError(
            "the target's integers are too small for the source's",
            where=where,
            got=f"{source.getter_type} -> {target.getter_type}",
            hint="a source that declares min and max within the target's range",
        )


def _has_room(source: Port, target: Port) -> bool:
    limits = np.iinfo(target.c_type)
    declared = np.iinfo(source.c_type)
    low = declared.min if source.minimum is None else source.minimum
    high = declared.max if source.maximum is None else source.maximum
    return bool(limits.min <= low and high <= limits.max)


def _check_carries(link: Link, port: Port, where: str) -> None:
    """Refuse a link that would make a number in between out of an Integer or Boolean."""
    text_replaced = port.kind == "string" and not (
        isinstance(link, PacketLink) and link.on_loss == "hold"
    )
    if isinstance(link, TransportLink) or link.quantization or text_replaced:
        raise InputError(
            f"link {link.name!r} carries real numbers only",
            where=where,
            expected="a packet link without quantization" + ", on_loss hold" * text_replaced,
            got=f"{port.name} of kind {port.kind}",
        )


def _check_driven(system: System, taken: dict[Endpoint, str]) -> None:
    for end, values in system.driven.items():
        port = system.port(end)
        if port.causality != "input" or port.kind != "float" or port.shape:
            raise InputError(
                "only a Real input can follow a signal",
                where=str(end),
                got=f"{port.causality}, {port.kind or 'String'}{' array' if port.shape else ''}",
            )
        if values.shape != system.timetable.points_ns.shape or not np.isfinite(values).all():
            raise InputError("the signal of an input must be finite", where=str(end))
        _take(taken, end, "driven signal")


def _take(taken: dict[Endpoint, str], target: Endpoint, by: str) -> None:
    if target in taken:
        raise InputError(
            "an input has two sources", where=str(target), got=f"{taken[target]}, and {by}"
        )
    taken[target] = by
