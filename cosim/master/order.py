"""The order in which components receive, and under Gauss-Seidel step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter

from cosim.core import InputError
from cosim.master.system import System
from cosim.network import TransportLink


def receiving_order(system: System) -> tuple[str, ...]:
    """Return the components, each after the senders with direct feedthrough to it.

    Under Gauss-Seidel, as far as possible also after all its other senders: in a loop the
    component that is named first begins.

    Raises
    ------
    InputError : an algebraic loop, named by its components, or a given order that contradicts.
    """
    waits: dict[str, set[str]] = {name: set() for name in system.components}
    for c in system.connections:
        if system.is_state(c.source):
            continue
        if system.port(c.source).feedthrough and _at_once(system, c.link):
            waits[c.target.component].add(c.source.component)
    _check_loops(waits)
    if system.order is not None:
        _check_given(system.order, waits)
        return tuple(system.order)
    likes: dict[str, set[str]] = {name: set() for name in system.components}
    if system.algorithm == "gauss-seidel":
        for c in system.connections:
            apart = c.source.component != c.target.component
            if c.link is None and apart and not system.is_state(c.source):
                likes[c.target.component].add(c.source.component)
    return _sorted(waits, likes)


def _check_loops(waits: Mapping[str, set[str]]) -> None:
    try:
        TopologicalSorter(waits).prepare()
    except CycleError as error:
        raise InputError(
            "the connections form an algebraic loop",
            where=" -> ".join(error.args[1]),
            expected="at least one component of the loop without direct feedthrough",
            # a transport link does not help: at the start it passes the initial value on at once
            hint="put a packet link with a delay into the loop",
        ) from error


def _sorted(waits: Mapping[str, set[str]], likes: Mapping[str, set[str]]) -> tuple[str, ...]:
    """Sort by `waits`, which must hold, and by `likes` where possible; otherwise as given."""
    order: list[str] = []
    left = list(waits)
    while left:
        ready = [name for name in left if waits[name] <= set(order)]
        chosen = next((name for name in ready if likes[name] <= set(order)), ready[0])
        left.remove(chosen)
        order.append(chosen)
    return tuple(order)


def _check_given(order: Sequence[str], waits: Mapping[str, set[str]]) -> None:
    for i, name in enumerate(order):
        late = sorted(waits[name] & set(order[i + 1 :]))
        if late:
            raise InputError(
                "the given order steps a component before one whose outputs it needs at once",
                where="order",
                expected=f"{', '.join(late)} before {name}",
                got=", ".join(order),
            )


def _at_once(system: System, link: str | None) -> bool:
    """Whether a value sent at some point may be read at that same point."""
    if link is None or link in system.comm_schedule.live:
        return True
    if isinstance(system.links[link], TransportLink):
        return True  # at the start, whatever the delay
    schedule = system.comm_schedule.schedules[link]
    return bool((schedule.delivered_ns == schedule.sent_ns).any())
