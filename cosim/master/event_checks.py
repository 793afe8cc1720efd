"""What systems with components in event mode must be like, and what is refused by name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING

from cosim.core import InputError
from cosim.fmu import FmuDescription, Port, SlaveOptions

if TYPE_CHECKING:
    from cosim.master.parts import Parts

Ticks = float | Fraction | Sequence[float]
"""The interval of a Clock [s], or the instants of its ticks [s]."""


def check_event_keys(
    description: FmuDescription,
    event_mode: bool | None,  # noqa: FBT001 - as the key of the component
    clocks: Mapping[str, Ticks],
    intermediate: Sequence[str],
) -> None:
    """Check what a component says of event mode, Clocks and outputs within steps.

    Raises
    ------
    InputError : see `Component`.
    """
    file = description.path.name
    if event_mode and not description.has_event_mode:
        raise InputError(
            "this FMU has no event mode",
            where=f"{file}: event_mode",
            expected="FMI 3.0, with hasEventMode in its model description",
        )
    events = description.has_event_mode if event_mode is None else event_mode
    for name, ticks in clocks.items():
        port, where = description.port(name, where=f"{file}: clocks"), f"{file}: clocks.{name}"
        if not events or port.clock is None or port.causality != "input":
            raise InputError(
                "only an input Clock of a component in event mode can be given its ticks",
                where=where,
                got=f"{port.causality} {port.getter_type}" + ", no event mode" * (not events),
            )
        _check_ticks(port, ticks, where)
    for name in intermediate:
        port = description.port(name, where=f"{file}: intermediate")
        offered = description.provides_intermediate_update and port.intermediate
        if not offered or port.causality != "output" or port.getter_type != "Float64" or port.shape:
            raise InputError(
                "this variable cannot be read within a step",
                where=f"{file}: intermediate",
                expected="a Float64 output with intermediateUpdate, of an FMU that "
                "providesIntermediateUpdate",
                got=f"{name}: {port.causality} {port.getter_type}"
                + " array" * bool(port.shape)
                + ", not offered" * (not offered),
            )


def _check_ticks(port: Port, ticks: Ticks, where: str) -> None:
    """Check that a Clock may have this interval, or these instants."""
    clock = port.clock
    instants = isinstance(ticks, Sequence)
    if instants and clock is not None and clock.variability != "triggered":
        raise InputError(
            "a time-based Clock ticks by its interval",
            where=where,
            expected="its interval, or nothing where the FMU gives it",
            got="instants",
        )
    if not instants and (clock is None or clock.variability not in ("fixed", "tunable")):
        raise InputError(
            "the interval of this Clock is not the importer's to give",
            where=where,
            expected="a fixed or tunable Clock",
            got="none" if clock is None else f"a {clock.variability} Clock",
        )
    given = list(ticks) if isinstance(ticks, Sequence) else [ticks]
    least = 0 if instants else 1e-9
    if any(not float(one) >= least for one in given) or given != sorted(set(given)):
        raise InputError(
            "these are no ticks of a Clock",
            where=where,
            expected="an interval of at least 1 ns, or instants that increase from 0 or later",
            got=str(ticks),
        )


def check_events(system: Parts) -> None:
    """Refuse what does not go together with components in event mode.

    Raises
    ------
    InputError : it is named.
    """
    name = next((n for n, c in system.components.items() if c.has_events), None)
    if name is None:
        return
    schedule = system.comm_schedule
    refused = {
        "algorithm": (system.algorithm != "jacobi", "the algorithm jacobi", system.algorithm),
        "run.threads": (system.threads > 1, "1", str(system.threads)),
        "run.events": (schedule.events != "align", 'events = "align"', schedule.events),
        "run": (schedule.given_ns is not None, "points by the rule of the run", "given points"),
    }
    for where, (wrong, expected, got) in refused.items():
        if wrong:
            raise _refusal(name, where, expected, got)
    for link in schedule.live:
        raise _refusal(
            name, f"link {link!r}", "a delay that follows no signal of the run", "one that does"
        )
    for other, component in system.components.items():
        if component.every_ns is not None:
            got = f"a step of its own, {component.every_ns / 1e9:g} s"
            raise _refusal(name, f"component {other!r}", "the communication step of the run", got)
        if not component.description.variable_step:
            got = "steps of one size only"
            raise _refusal(name, f"component {other!r}", "an FMU with steps of any size", got)
    for connection in system.connections:
        if connection.policy not in ("hold", "previous"):
            where = f"connection {connection.source} -> {connection.target}"
            raise _refusal(name, where, "the policy hold or previous", connection.policy)


def slave_options(system: Parts, name: str) -> SlaveOptions:
    """Return what the slave of a component is offered.

    It may return early from a step if it can be taken back to before that step, for an event of
    another component that comes first, or if no other component may return early.
    """
    component = system.components[name]
    described = component.description
    events = [one.description for one in system.components.values() if one.has_events]
    early = component.has_events and (described.can_get_and_set_state or len(events) == 1)
    return SlaveOptions(
        component.has_events,
        early,
        tuple(described.ports[output].reference for output in component.intermediate),
    )


def _refusal(name: str, where: str, expected: str, got: str) -> InputError:
    return InputError(
        f"this does not go together with the events of component {name!r}, which add points "
        "where they occur",
        where=where,
        expected=expected,
        got=got,
        hint=f"components.{name}.event_mode = false runs it by steps alone",
    )
