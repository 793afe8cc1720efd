"""Checks of a system: links, connections, types, units, steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.fmu import Port, SignalKind
from cosim.master.communication_points import blocks
from cosim.master.communication_schedule import Link
from cosim.master.component_points import own_instants
from cosim.master.event_systems import check_events
from cosim.master.parts import (
    MODE_NUMBER,
    Connection,
    DelaySource,
    Endpoint,
    Parts,
    Policy,
    UnknownFeedthrough,
)
from cosim.network import DelaySignal, PacketLink, TransportLink

LINK_STATE: Mapping[str, SignalKind] = MappingProxyType(
    {"age": "float", "sequence": "int", "dropped": "int", "delivered": "int"}
)
"""State of a packet link that a connection can read, `Endpoint(link, ...)`, and its kind."""

_NUMBERS = ("float", "int", "bool")
_OF_ROWS: tuple[Policy, ...] = ("hold", "previous")
"""Policies that read a row as it is."""


def check_links(system: Parts) -> None:
    """Check that links have their own names, a schedule, and the signals of their delays."""
    for name, link in system.links.items():
        packet = isinstance(link, PacketLink)
        if link.name != name or (packet and name not in system.comm_schedule.links):
            raise InputError(
                "the link does not match its entry in the system",
                where=f"link {name!r}",
                expected="the link's own name, and a communication schedule made for it",
                got=f"link {link.name!r}, schedules of {list(system.comm_schedule.links)}",
                hint="pass the same links to make_schedule and to System",
            )
    packets = [link for link in system.links.values() if isinstance(link, PacketLink)]
    following = [link.name for link in packets if isinstance(link.delay, DelaySignal)]
    moving = [x.resolved_with for x in packets if x.hop is not None and x.hop.medium.moves]
    following += dict.fromkeys(moving)
    for name in following:
        _check_delay(system, name)
    for name in system.delays:
        if name not in following:
            raise InputError(
                "this link's delay follows no signal",
                where=f"link {name!r}",
                expected="a link with a DelaySignal, or a medium whose nodes move: "
                + (", ".join(following) or "none"),
            )


def _check_delay(system: Parts, name: str) -> None:
    """Check that the signals of a delay exist, are numbers, and are known at each sending."""
    source = system.delays.get(name)
    where = f"link {name!r}: delay"
    if name not in system.links:
        where = f"{name}: nodes"
    if source is None or not source.signals:
        raise InputError("the delay of this link has no signal", where=where)
    if isinstance(source, DelaySource):
        _check_number(source, where)
    for end in source.read:
        try:
            port = system.port(end)
        except InputError as error:
            error.where = f"{where}, {end}"
            error.args = (error.text(),)
            raise
        if port.causality != "output" or port.kind != "float" or port.shape or port.feedthrough:
            raise InputError(
                "this signal cannot decide a delay",
                where=f"{where}, {end}",
                expected="a Real output without direct feedthrough",
                got=f"{port.causality}, {port.kind}"
                + (", direct feedthrough" if port.feedthrough else "")
                + (" (dependencies not declared)" if not port.feedthrough_declared else ""),
                hint=None
                if port.feedthrough_declared
                else f'components.{end.component}.feedthrough = "none" or the list of outputs '
                "that depend on inputs at once, where this one does not",
            )


def _check_number(source: DelaySource, where: str) -> None:
    number = 1 if source.origin is None else len(source.origin)
    if len(source.signals) != number:
        raise InputError(
            "the number of signals of this delay is wrong",
            where=where,
            expected="one signal, or one per coordinate of the origin",
            got=f"{len(source.signals)} signals, {number} coordinates",
        )


def check_parts(system: Parts) -> None:
    """Check connections, driven inputs, order and steps."""
    taken: dict[Endpoint, str] = {}
    _check_connections(system, taken)
    _check_driven(system, taken)
    _check_order(system)
    _check_threads(system)
    _check_loop_keys(system)
    check_events(system)
    for name, component in system.components.items():
        if system.grows and component.every_ns is not None:
            raise InputError(
                "a component cannot have its own step where points are added during the run",
                where=f"component {name!r}",
                got=f"link {next(iter(system.comm_schedule.live))!r}, whose delay follows a signal "
                "or a condition",
                hint='events = "grid"',
            )
        _check_own_step(system, component.every_ns)
        if not component.description.variable_step and not _has_equal_steps(system, name):
            raise InputError(
                "this FMU takes steps of one size only",
                where=f"component {name!r} ({component.description.path.name})",
                hint='set events = "grid" and an end that is a multiple of the step, or give '
                "the component its own step of which the end is a multiple",
            )


def _check_own_step(system: Parts, every_ns: int | None) -> None:
    """Check that every multiple of a component's step is a communication point."""
    schedule = system.comm_schedule
    if every_ns is None:
        return
    by_rule = every_ns in schedule.every_ns or every_ns % schedule.step_ns == 0
    if by_rule and schedule.given_ns is None:
        return
    for points, first, last in blocks(system):
        times = points.points_ns[first:last]
        after = int(points.points_ns[first - 1]) if first else -1
        wanted = own_instants(every_ns, after, int(times[-1]), schedule.end_ns)
        missing = np.setdiff1d(wanted, times, assume_unique=True)
        if missing.size:
            raise InputError(
                "a component's step does not fall on communication points",
                where="run",
                expected="a communication point at every multiple of the component's step",
                got=f"none at {int(missing[0]) / 1e9:g} s",
                hint="a multiple of the communication step, or events = align",
            )


def _has_equal_steps(system: Parts, name: str) -> bool:
    """Whether all steps of a component are of one size."""
    if system.grows:
        return False
    size = latest = None
    for points, first, last in blocks(system):
        times = points.points_ns[points.own_points[name].own_between(first, last)]
        times = times if latest is None else np.append(latest, times)
        steps = np.diff(times)
        size = steps[0] if size is None and steps.size else size
        if (steps != size).any():
            return False
        latest = times[-1:]
    return True


def _check_order(system: Parts) -> None:
    if system.order is None:
        return
    if system.algorithm != "gauss-seidel" or sorted(system.order) != sorted(system.components):
        raise InputError(
            "the order does not match the system",
            where="order",
            expected=f"under gauss-seidel, each of {', '.join(system.components)} once",
            got=f"{system.algorithm}: {', '.join(system.order)}",
        )


def _check_threads(system: Parts) -> None:
    if system.threads < 1 or (system.threads > 1 and system.algorithm != "jacobi"):
        raise InputError(
            "the components cannot step on so many threads",
            where="run.threads",
            expected="1 or more; under gauss-seidel, where they step one after the other, 1",
            got=f"{system.threads}, {system.algorithm}",
        )


def _check_loop_keys(system: Parts) -> None:
    """Check what is to be done about algebraic loops."""
    if system.unknown_feedthrough not in get_args(UnknownFeedthrough):
        raise InputError.unknown(
            "way to treat unknown feedthrough",
            str(system.unknown_feedthrough),
            get_args(UnknownFeedthrough),
            where="unknown_feedthrough",
        )
    if not 0.0 < system.solve_tolerance < float("inf") or system.solve_limit < 1:
        raise InputError(
            "an algebraic loop cannot be solved like this",
            where="solve",
            expected="solve_tolerance > 0 and solve_limit >= 1",
            got=f"{system.solve_tolerance!r} and {system.solve_limit!r}",
        )


def _check_connections(system: Parts, taken: dict[Endpoint, str]) -> None:
    for connection in system.connections:
        where = f"connection {connection.source} -> {connection.target}"
        if system.is_state(connection.source):
            _check_state(system, connection, where)
        else:
            _check_connection(system, connection, where)
        _take(taken, connection.target, f"connection from {connection.source}")


def _check_connection(system: Parts, connection: Connection, where: str) -> None:
    source, target = system.port(connection.source), system.port(connection.target)
    link, policy = connection.link, connection.policy
    if policy not in get_args(Policy):
        raise InputError.unknown("policy", str(policy), get_args(Policy), where=where)
    if system.grows and policy not in _OF_ROWS:
        raise InputError(
            "the next point is not known where points are added during the run",
            where=where,
            expected="the policy hold or previous",
            got=policy,
            hint='events = "grid"',
        )
    check_ends(source, target, where)
    if link is not None and link not in system.links:
        raise InputError.unknown("link", link, system.links, where=where)
    if source.kind != "float" and policy not in _OF_ROWS:
        raise InputError(
            "only real numbers can be interpolated",
            where=where,
            expected="the policy hold or previous",
            got=policy,
        )
    if link is not None and source.kind == "clock":
        raise InputError(
            "the tick of a Clock has no duration: a link cannot transmit it",
            where=where,
            expected="a connection without a link; values that a link brings are held",
        )
    if link is not None and source.kind != "float":
        _check_link_kind(system.links[link], source, where)


def check_ends(source: Port, target: Port, where: str) -> None:
    """Check that a connection may lead from one variable to another.

    Raises
    ------
    InputError : no output and input, types or shapes that differ, or units of two names.
    """
    if not source.is_source or target.causality != "input":
        got = f"{source.causality} -> {target.causality}"
        raise InputError("a connection leads from an output to an input", where=where, got=got)
    _check_types(source, target, where)
    if source.unit and target.unit and source.unit != target.unit:
        got = f"{source.unit} -> {target.unit}"
        raise InputError("the units of the two ends differ", where=where, got=got)


_NAMES = {
    "float": "Real",
    "int": "Integer",
    "bool": "Boolean",
    "string": "String",
    "binary": "Binary",
    "clock": "Clock",
}


def _check_types(source: Port, target: Port, where: str) -> None:
    """Check that both ends have the same kind and shape, and that every value fits."""
    if source.kind is None or source.kind != target.kind:
        raise InputError(
            "the types of the two ends differ",
            where=where,
            expected="both Real, both Integer (or Enumeration), both Boolean, both String, both "
            "Binary or, in event mode, both Clock",
            got=" -> ".join(_NAMES.get(p.kind or "", "Clock") for p in (source, target)),
        )
    if target.clock is not None and target.clock.time_based:
        raise InputError(
            "a time-based Clock ticks by the time, not by a connection",
            where=where,
            expected="a triggered Clock",
            got=f"a {target.clock.variability} one",
        )
    if source.shape != target.shape and not source.size == target.size == 1:
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


def _check_state(system: Parts, connection: Connection, where: str) -> None:
    """Check a connection from the state of a packet link, or of a mode machine, to an input."""
    name, what = connection.source
    if name in system.modes:
        _check_mode(system, connection, where)
        return
    if not isinstance(system.links[name], PacketLink):
        raise InputError("only a packet link has a state", where=where, got=f"link {name!r}")
    if what not in LINK_STATE:
        raise InputError.unknown("state of a link", what, LINK_STATE, where=where)
    allowed = ("float",) if LINK_STATE[what] == "float" else ("float", "int")
    target = _check_direct(system, connection, ("the state of a link",) * 2, allowed, where)
    if what == "age" and target.unit not in (None, "s"):
        raise InputError("an age is in seconds", where=where, got=str(target.unit))


def _check_mode(system: Parts, connection: Connection, where: str) -> None:
    """Check a connection from a mode machine to an input."""
    name, what = connection.source
    known = (*system.modes[name].states, MODE_NUMBER)
    if what not in known:
        raise InputError.unknown(f"state of {name}", what, known, where=where)
    allowed = ("float", "int") if what == MODE_NUMBER else ("float", "int", "bool")
    _check_direct(system, connection, ("the mode of a machine", "a mode"), allowed, where)


def _check_direct(
    system: Parts,
    connection: Connection,
    what: tuple[str, str],
    allowed: Sequence[str],
    where: str,
) -> Port:
    """Check a connection from what the master knows itself, and return its target.

    what : its name where the target does not fit, and where a link is in between.
    """
    target = system.port(connection.target)
    if target.causality != "input" or target.kind not in allowed or target.shape:
        raise InputError(
            f"{what[0]} does not fit this target",
            where=where,
            expected="an input, " + " or ".join(_NAMES[kind] for kind in allowed),
            got=f"{target.causality}, {_NAMES.get(target.kind or '', 'none')}",
        )
    if connection.link is not None or connection.policy != "hold":
        raise InputError(f"{what[1]} is known at once: it cannot pass over a link", where=where)
    return target


def _check_link_kind(link: Link, port: Port, where: str) -> None:
    """Refuse a link that would interpolate, quantize or substitute what is not a real number."""
    text_replaced = port.kind in ("string", "binary") and not (
        isinstance(link, PacketLink) and link.substitute is None
    )
    if isinstance(link, TransportLink) or link.quantization or text_replaced:
        raise InputError(
            f"link {link.name!r} transmits real numbers only",
            where=where,
            expected="a packet link without quantization"
            + ", on_loss hold, greatest_age 0" * text_replaced,
            got=f"{port.name} of kind {port.kind}",
        )


def _check_driven(system: Parts, taken: dict[Endpoint, str]) -> None:
    for end, values in system.driven.items():
        port = system.port(end)
        if port.causality != "input" or port.kind not in _NUMBERS or port.shape:
            raise InputError(
                "only an input that is a number or a Boolean can follow a signal",
                where=str(end),
                got=f"{port.causality}, {port.kind or 'String'}{' array' if port.shape else ''}",
            )
        if not callable(values):
            _check_values(system, end, values)
        _take(taken, end, "driven signal")


def _check_values(system: Parts, end: Endpoint, values: NDArray[np.float64]) -> None:
    if system.grows:
        raise InputError(
            "values at points cannot be given where points are added during the run",
            where=str(end),
            expected="a function of the points",
            hint='events = "grid"',
        )
    if values.shape != system.comm_schedule.points_ns.shape or not np.isfinite(values).all():
        raise InputError("the signal of an input must be finite", where=str(end))


def _take(taken: dict[Endpoint, str], target: Endpoint, by: str) -> None:
    if target in taken:
        raise InputError(
            "an input has two sources",
            where=str(target),
            got=f"{taken[target]}, and {by}",
            hint="leave one out; add = true in both connections adds their values",
        )
    taken[target] = by
