"""In which order components receive, and step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from graphlib import CycleError, TopologicalSorter

from cosim.core import InputError
from cosim.master.system import System
from cosim.network import TransportLink


def receiving_order(system: System) -> tuple[str, ...]:
    """Receivers after the senders whose outputs follow their inputs at the same point.

    Under Gauss-Seidel, also after all others that they are wired to, where that goes without a
    contradiction: in a loop somebody begins, the one that is named first.

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
            # a transport link passes the initial value on at the start, which is a loop still
            hint="put a packet link with a delay into the loop",
        ) from error


def _sorted(waits: Mapping[str, set[str]], likes: Mapping[str, set[str]]) -> tuple[str, ...]:
    """Those first that wait for nobody, and like to wait for nobody; otherwise as given."""
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
    """Whether a value sent at some point is read at that same point."""
    if link is None:
        return True
    if isinstance(system.links[link], TransportLink):
        return True  # at the start, whatever the delay
    if link in system.comm_schedule.live:
        return True  # nobody can know
    schedule = system.comm_schedule.schedules[link]
    return bool((schedule.delivered_ns == schedule.sent_ns).any())
