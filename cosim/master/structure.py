"""What two systems must have in common so that one session can run both, one after the other.

Then a second run needs no new slaves, wiring or table: start values, driven signals and what links
do to their messages are all that differs.
"""

from __future__ import annotations

from typing import Any

from cosim.master.communication_schedule import Link
from cosim.master.order import receiving_order
from cosim.master.system import System
from cosim.network import DelaySignal, PacketLink

_OWN_TOOL = "auv-cosim"
"""The generation tool of FMUs whose reset is tested to be a new instance, bit for bit."""


def same_structure(one: System, other: System) -> bool:
    """Whether a session of `one` can run `other` (`Session.begin_again`)."""
    return (
        all(
            one.components[name].description is component.description
            for name, component in other.components.items()
            if name in one.components
        )
        and _structure(one) == _structure(other)
        and one.comm_schedule.most == other.comm_schedule.most
        and receiving_order(one) == receiving_order(other)
    )


def can_be_reset(system: System) -> bool:
    """Whether every slave of a system can be reset to what a new one is."""
    return system.threads == 1 and all(
        component.description.model.generationTool == _OWN_TOOL
        and not component.isolate
        and not component.has_events
        and not component.description.departures  # a new instance logs them
        for component in system.components.values()
    )


def _structure(system: System) -> tuple[Any, ...]:
    schedule = system.comm_schedule
    return (
        [
            (name, c.every_ns, c.log_level, c.log_categories)
            for name, c in system.components.items()
        ],
        list(system.connections),
        {name: _form(link) for name, link in system.links.items()},
        list(system.driven),
        (schedule.step_ns, schedule.end_ns, schedule.events, schedule.every_ns),
        schedule.instants_ns.tolist(),
        None if schedule.given_ns is None else schedule.given_ns.tolist(),
        (system.divergence, system.algorithm, system.order, system.delays, system.threads),
        (system.unknown_feedthrough, system.solve, system.solve_tolerance, system.solve_limit),
    )


def _form(link: Link) -> tuple[Any, ...]:
    """Return what the table of a run contains of a link."""
    if isinstance(link, PacketLink):
        live = isinstance(link.delay, DelaySignal)
        return True, live, link.quantization, link.on_loss
    return False, link.delay is None
