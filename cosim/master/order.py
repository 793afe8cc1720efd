"""The order in which components receive, and under Gauss-Seidel step.

A component comes after every sender whose output has direct feedthrough and reaches it at the
same point. Connections that close a circle of such dependencies form an algebraic loop. A loop
is cut, solved or refused, in this order:

* A transport link with a delay passes a value on at once only at the start, where the signal has
  its initial value. In a loop its receiver begins with the value that the initialisation settled
  on, and the link cuts the loop.
* The policy "previous" cuts a loop: the connection reads the row before.
* Under `unknown_feedthrough = "previous"` connections from outputs that do not declare their
  dependencies get this policy where that cuts a loop: as few as possible, and of equal choices
  those into the component that is named first.
* Under `solve` the components of a loop are named together, to be iterated at every point.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cosim.core import InputError
from cosim.master.algebraic_loops import (
    cheapest_order,
    is_loop,
    shortest_loop,
    strongly_connected,
)
from cosim.master.parts import Connection, RouteKey
from cosim.master.rows_in_use import delivers_at_once, walk
from cosim.master.system import System
from cosim.network import PacketLink, TransportLink

Edges = dict[tuple[str, str], list[Connection]]
"""Connections with direct feedthrough that are read at the same point, by sender and receiver."""

_MOST_LISTED = 12


class ReceivingOrder(NamedTuple):
    """In which order components receive, and what becomes of algebraic loops.

    Attributes
    ----------
    order : every component once; the components of a loop follow each other.
    loops : the components of each algebraic loop that is to be solved, in `order`.
    cut : connections that get the policy "previous", since they close a loop through outputs
        whose dependencies are not declared; as in the system, with their own policy.
    initialised : connections over delayed transport links in a loop: at the first point the
        input has the value that the initialisation settled on.
    """

    order: tuple[str, ...]
    loops: tuple[tuple[str, ...], ...] = ()
    cut: tuple[Connection, ...] = ()
    initialised: tuple[Connection, ...] = ()


def receiving_order(system: System, like: System | None = None) -> ReceivingOrder:
    """Return the components, each after the senders with direct feedthrough to it.

    Under Gauss-Seidel, as far as possible also after all its other senders: in a loop the
    component that is named first begins.

    like : a system with the same components and connections, and the same keys beside them: where
        the same outputs reach inputs at once, its order is that of the system as well.

    Raises
    ------
    InputError : an algebraic loop that is neither cut nor to be solved, with its connections; or
        a given order that contradicts.
    """
    if system.receiving is None:
        edges = _edges(system)
        if like is None or like.receiving is None or like.receiving[0] != edges:
            found = edges, _order_from(system, *edges)
        else:
            found = like.receiving
        object.__setattr__(system, "receiving", found)
    order: ReceivingOrder = system.receiving[1]
    return order


def _order_from(
    system: System, given: Mapping[tuple[str, str], list[Connection]], at_start: list[Connection]
) -> ReceivingOrder:
    edges = {ends: [*connections] for ends, connections in given.items()}
    initialised = _inside(_loops(system, [*edges, *map(_pair, at_start)]), at_start)
    for c in at_start:
        if c not in initialised:
            edges.setdefault(_pair(c), []).append(c)
    cut: tuple[Connection, ...] = ()
    if system.unknown_feedthrough == "previous":
        cut = _cut(system, edges)
        edges = _without(edges, set(cut))
    loops = _loops(system, edges)
    if loops and not system.solve:
        raise _refusal(system, loops[0], edges)
    if loops and system.algorithm == "gauss-seidel":
        raise InputError(
            "an algebraic loop is solved where all its components are at the same point",
            where=" -> ".join([*loops[0], loops[0][0]]),
            expected="the algorithm jacobi",
            got="gauss-seidel",
        )
    waits: dict[str, set[str]] = {name: set() for name in system.components}
    for source, target in edges:
        waits[target].add(source)
    if system.order is not None:
        _check_given(system.order, waits)
        order = tuple(system.order)
    else:
        order = _sorted(system, waits, loops)
    place = {name: i for i, name in enumerate(order)}
    return ReceivingOrder(
        order,
        tuple(sorted((_by(place, loop) for loop in loops), key=lambda loop: place[loop[0]])),
        cut,
        tuple(c for c in at_start if c in initialised),
    )


def _edges(system: System) -> tuple[Edges, list[Connection]]:
    """Return connections with feedthrough read at the same point: at any, and only at the start."""
    edges: Edges = {}
    at_start: list[Connection] = []
    known: dict[object, bool] = {}
    for c in system.connections:
        if system.is_state(c.source) or c.policy == "previous":
            continue
        if not system.port(c.source).feedthrough:
            continue
        link = None if c.link is None else system.links[c.link]
        if isinstance(link, TransportLink):
            ends = (system.components[end.component].every_ns for end in (c.source, c.target))
            key = (c.link, *ends)
            if key not in known:
                known[key] = _delayed(system, c, link)
            if known[key]:
                at_start.append(c)
                continue
        elif c.link is not None and not _at_once(system, c.link):
            continue
        edges.setdefault(_pair(c), []).append(c)
    return edges, at_start


def _at_once(system: System, name: str) -> bool:
    """Whether a message of a packet link may be read at the point at which it is sent."""
    link = system.links[name]
    return not isinstance(link, PacketLink) or delivers_at_once(system, link)


def _delayed(system: System, c: Connection, link: TransportLink) -> bool:
    """Whether, after the first point, a transport link reads rows before the present one only.

    A policy that looks ahead counts as hold: at the point itself a receiver with direct
    feedthrough has the value of hold, and one without it is in no loop.
    """
    least = link.delay_ns if link.delay is None else int(link.delay.delays_ns.min())
    ends = (system.components[end.component] for end in (c.source, c.target))
    # points are a step apart at most
    far = least >= system.comm_schedule.step_ns
    if system.grows or (far and all(component.every_ns is None for component in ends)):
        return far
    route_key = RouteKey(c.source.component, c.link, "hold")
    for points, used, first, last in walk(system, route_key, c.target.component):
        latest = used.row[first:last]
        if used.after is not None and used.weight is not None:
            after = np.where(used.weight[first:last] > 0.0, used.after[first:last], 0)
            latest = np.maximum(latest, after)
        own = points.own_points[c.target.component].own_between(max(first, 1), last)
        if (latest[own - first] >= own).any():
            return False
    return True


def _pair(c: Connection) -> tuple[str, str]:
    return c.source.component, c.target.component


def _graph(names: Iterable[str], edges: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    graph: dict[str, list[str]] = {name: [] for name in names}
    for source, target in edges:
        if source in graph and target in graph:
            graph[source].append(target)
    return graph


def _loops(system: System, edges: Iterable[tuple[str, str]]) -> list[tuple[str, ...]]:
    graph = _graph(system.components, edges)
    return [group for group in strongly_connected(graph) if is_loop(group, graph)]


def _inside(loops: Iterable[tuple[str, ...]], connections: list[Connection]) -> set[Connection]:
    """Return the connections with both ends in one loop."""
    loop_of = {name: i for i, loop in enumerate(loops) for name in loop}
    return {
        c
        for c in connections
        if c.source.component in loop_of
        and loop_of[c.source.component] == loop_of.get(c.target.component)
    }


def _without(edges: Edges, cut: set[Connection]) -> Edges:
    left = {pair: [c for c in members if c not in cut] for pair, members in edges.items()}
    return {pair: members for pair, members in left.items() if members}


def _cut(system: System, edges: Edges) -> tuple[Connection, ...]:
    """Return the connections from outputs with undeclared dependencies that cut loops."""
    cut: set[Connection] = set()
    loops = _loops(system, edges)
    loop_of = {name: i for i, loop in enumerate(loops) for name in loop}
    inside: list[Edges] = [{} for _ in loops]
    for (source, target), members in edges.items():
        if source in loop_of and loop_of[source] == loop_of.get(target):
            inside[loop_of[source]][source, target] = members
    for loop, inner in zip(loops, inside, strict=True):
        open_to_cut = {
            pair: cs
            for pair, cs in inner.items()
            if not any(system.port(c.source).feedthrough_declared for c in cs)
        }
        # what is declared on all sides stays: it is one group here, solved or refused later
        groups = strongly_connected(_graph(loop, inner.keys() - open_to_cut.keys()))
        group_of = {name: i for i, group in enumerate(groups) for name in group}
        place = {
            g: i for i, g in enumerate(_order_of(system, groups, group_of, open_to_cut, inner))
        }
        for (source, target), members in open_to_cut.items():
            a, b = group_of[source], group_of[target]
            if source == target or place[a] > place[b]:
                cut.update(members)
    return tuple(c for c in system.connections if c in cut)


def _order_of(
    system: System,
    groups: Sequence[tuple[str, ...]],
    group_of: Mapping[str, int],
    open_to_cut: Edges,
    inner: Edges,
) -> Sequence[int]:
    """Return the order of groups under which the fewest connections lead backwards."""
    if system.order is not None:
        first = {name: i for i, name in enumerate(system.order)}
        return sorted(range(len(groups)), key=lambda g: min(first[name] for name in groups[g]))
    costs: dict[tuple[int, int], int] = {}
    fixed: set[tuple[int, int]] = set()
    for (source, target), members in inner.items():
        pair = group_of[source], group_of[target]
        if pair[0] == pair[1]:
            continue
        if (source, target) in open_to_cut:
            costs[pair] = costs.get(pair, 0) + len(members)
        else:
            fixed.add(pair)
    return cheapest_order(len(groups), costs, fixed)


def _refusal(system: System, loop: Sequence[str], edges: Edges) -> InputError:
    """Make the error for an algebraic loop: its connections, and what can be done about it."""
    way = shortest_loop(loop, _graph(loop, edges))
    hops = [edges[pair][0] for pair in pairwise(way)]
    undeclared = [c for c in hops if not system.port(c.source).feedthrough_declared]
    listed = [
        f"{c.source} -> {c.target}" + " (dependencies not declared)" * (c in undeclared)
        for c in hops[:_MOST_LISTED]
    ]
    if len(hops) > _MOST_LISTED:
        listed.append(f"{len(hops) - _MOST_LISTED} more")
    name = (undeclared or hops)[0].source.component
    cures = [
        f'components.{name}.feedthrough = "none", or the outputs that depend on inputs at once',
        'policy = "previous" for a connection of the loop, which delays it by one step',
        "run.solve = true, which iterates the loop at every point",
        "put a packet link with a delay into the loop, or a transport link with one of a step",
    ]
    if undeclared and system.unknown_feedthrough == "refuse":
        cures.insert(
            2, 'run.unknown_feedthrough = "previous", which does so where nothing is declared'
        )
    return InputError(
        "the connections form an algebraic loop",
        where=" -> ".join(way),
        expected="at least one component of the loop without direct feedthrough",
        got=", ".join(listed),
        hint="; or ".join(cures),
    )


def _by(place: Mapping[str, int], loop: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(loop, key=place.__getitem__))


def _sorted(
    system: System, waits: Mapping[str, set[str]], loops: Sequence[tuple[str, ...]]
) -> tuple[str, ...]:
    """Sort after the senders waited for, and after other senders where possible; else as given.

    The components of a loop stay together, as given.
    """
    loop_of = {name: loop for loop in loops for name in loop}
    groups = list(dict.fromkeys(loop_of.get(name, (name,)) for name in system.components))
    number = {name: i for i, group in enumerate(groups) for name in group}
    must = {(number[source], number[name]) for name in waits for source in waits[name]}
    should: set[tuple[int, int]] = set()
    if system.algorithm == "gauss-seidel":
        should = {
            (number[c.source.component], number[c.target.component])
            for c in system.connections
            if c.link is None and not system.is_state(c.source)
        }
    return tuple(name for i in _places(len(groups), must, should) for name in groups[i])


def _places(count: int, must: set[tuple[int, int]], should: set[tuple[int, int]]) -> list[int]:
    """Sort 0 ... count - 1 by pairs (before, after) that must hold, and that should."""
    left = [[0, 0] for _ in range(count)]
    after: list[list[tuple[int, int]]] = [[] for _ in range(count)]
    for kind, pairs in enumerate((must, should)):
        for a, b in pairs:
            if a != b:
                after[a].append((b, kind))
                left[b][kind] += 1
    ready = [i for i in range(count) if not left[i][0]]
    best = [i for i in ready if not left[i][1]]
    order: dict[int, None] = {}
    while len(order) < count:
        i = heapq.heappop(best or ready)
        if i in order:
            continue
        order[i] = None
        for other, kind in after[i]:
            left[other][kind] -= 1
            if other not in order and not left[other][0]:
                heapq.heappush(ready, other)
                if not left[other][1]:
                    heapq.heappush(best, other)
    return list(order)


def _check_given(order: Sequence[str], waits: Mapping[str, set[str]]) -> None:
    place = {name: i for i, name in enumerate(order)}
    for name in order:
        late = sorted(other for other in waits[name] if place[other] > place[name])
        if late:
            raise InputError(
                "the given order steps a component before one whose outputs it needs at once",
                where="order",
                expected=f"{', '.join(late)} before {name}",
                got=", ".join(order),
            )
