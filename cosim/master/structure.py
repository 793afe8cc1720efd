"""What two systems have in common that differ in the numbers of a run alone.

Start values, driven signals and what links do to their messages may differ. The second one needs
no new checks, and if it receives in the same order no new slaves, wiring or table.
"""

from __future__ import annotations

from typing import Any

from cosim.master.communication_schedule import Link
from cosim.master.parts import Parts
from cosim.network import PacketLink

_OWN_TOOL = "auv-cosim"
"""The generation tool of FMUs whose reset is tested to be a new instance, bit for bit."""


def same_structure(one: Parts, other: Parts) -> bool:
    """Whether two systems differ in start values, driven signals and numbers of links alone."""
    return (
        all(
            one.components[name].description is component.description
            for name, component in other.components.items()
            if name in one.components
        )
        and _structure(one) == _structure(other)
        and one.comm_schedule.most == other.comm_schedule.most
    )


def can_be_reset(system: Parts) -> bool:
    """Whether every slave of a system can be reset to what a new one is."""
    return system.threads == 1 and all(
        component.description.tool == _OWN_TOOL
        and not component.isolate
        and not component.has_events
        and not component.description.departures  # a new instance logs them
        for component in system.components.values()
    )


def _structure(system: Parts) -> tuple[Any, ...]:
    schedule = system.comm_schedule
    return (
        [
            (name, c.every_ns, c.log_level, c.log_categories)
            for name, c in system.components.items()
        ],
        list(system.connections),
        {name: _form(link) for name, link in system.links.items()},
        list(system.driven),
        (schedule.step_ns, schedule.end_ns, schedule.events, schedule.every_ns, schedule.start_ns),
        schedule.instants_ns.tolist(),
        None if schedule.given_ns is None else schedule.given_ns.tolist(),
        (system.divergence, system.algorithm, system.order, system.delays, system.threads),
        (system.unknown_feedthrough, system.solve, system.solve_tolerance, system.solve_limit),
        system.modes,
    )


def _form(link: Link) -> tuple[Any, ...]:
    """Return what the table of a run contains of a link."""
    if isinstance(link, PacketLink):
        return True, link.is_live, link.quantization, link.on_loss, link.substitute
    return False, link.delay is None
