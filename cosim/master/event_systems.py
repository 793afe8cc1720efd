"""What systems with components in event mode must be like, and what is refused by name."""

from __future__ import annotations

from cosim.core import InputError
from cosim.fmu import SlaveOptions
from cosim.master.parts import Component, Parts


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
        "run.start": (schedule.start_ns != 0, "0", f"{schedule.at_s(0):g} s"),
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
            name,
            f"link {link!r}",
            "a delay that follows no signal or condition of the run",
            "one that does",
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


def slave_options(component: Component, *, alone: bool) -> SlaveOptions:
    """Return what the slave of a component is offered; `alone` : no other one has events.

    It may return early from a step if it can be taken back to before that step, for an event of
    another component that comes first, or if no other component may return early.
    """
    described = component.description
    early = component.has_events and (described.can_get_and_set_state or alone)
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
