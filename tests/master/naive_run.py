"""A scenario of scalars executed once more, from its definition: slow, obvious, and on its own.

It shares nothing with `cosim.master` but the declaration of the system. There are no rows, routes,
tables or blocks: what a signal is at an instant is asked for, and follows from what it was before.
What links deliver says the model of their tests (`link_model`), which shares nothing with
`cosim.network`. Time is counted in whole nanoseconds, and steps and shares are fractions.

    x(c, t)    the state of a component at one of its own points
    u(c, t)    its input there, held until its next point
    y(c, t)    its output with direct feedthrough there
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from typing import Any

from network import link_model

from cosim.master import Connection, System
from cosim.network import PacketLink, TransportLink


class NaiveRun:
    """The signals of a system of scalars (`scalar.c`) whose delays are known before the run.

    Under Gauss-Seidel the system says in which order its components step.
    """

    def __init__(self, system: System) -> None:
        self.system, self.schedule = system, system.comm_schedule
        self.end = self.schedule.end_ns
        self.names = [*(system.order or system.components)]
        self.sources: dict[str, Connection] = {c.target.component: c for c in system.connections}
        grid = None
        if self.schedule.events == "grid":
            grid = self.points = multiples(self.schedule.step_ns, self.end)
        packets = [link for link in system.links.values() if isinstance(link, PacketLink)]
        self.deliveries = {link.name: self.delivery(link, grid) for link in packets}
        if grid is None:
            self.points = self.instants()
        self.own = {name: self.own_points(name) for name in self.names}
        for ask in ("x", "u", "y"):  # each is worked out once
            setattr(self, ask, cache(getattr(self, ask)))

    def delivery(self, link: PacketLink, grid: Sequence[int] | None) -> link_model.Outcome:
        """What becomes of the messages of a link with a constant delay."""
        raw = link_model.raw_draws(link, self.end, grid)
        return link_model.run(link, self.end, raw, lambda _k, _t: link.delay_ns, grid)

    def instants(self) -> list[int]:
        """The points: of the step, of own steps, and whenever a link sends or changes a value."""
        steps = [self.schedule.step_ns, *self.schedule.every_ns]
        instants = {t for every in steps for t in multiples(every, self.end)}
        for outcome in self.deliveries.values():
            instants |= {entry.sent for entry in outcome.entries.values()} | {*outcome.changes()}
        return sorted(instants)

    def own_points(self, name: str) -> list[int]:
        """The points at which a component communicates: the last one is one of all."""
        every = self.system.components[name].every_ns
        return [t for t in self.points if every is None or t % every == 0 or t == self.end]

    def parameter(self, name: str, what: str) -> float:
        """Of a component, by default as scalar.c begins."""
        default = {"a": -1.0, "b": 1.0, "c": 1.0}.get(what, 0.0)
        given: Any = self.system.components[name].parameters.get(what, default)
        return float(given)

    def x(self, name: str, t: int) -> float:
        """The state: that at the point before, advanced exactly for the input held since then."""
        if t == 0:
            return self.parameter(name, "x0")
        before = self.own[name][bisect_left(self.own[name], t) - 1]
        a, pull = self.parameter(name, "a"), self.parameter(name, "b") * self.u(name, before)
        h = float(Fraction(t - before, 10**9))
        x = self.x(name, before)
        return x + h * pull if a == 0 else math.exp(a * h) * x + math.expm1(a * h) / a * pull

    def y(self, name: str, t: int) -> float:
        """The output with direct feedthrough."""
        c, e = self.parameter(name, "c"), self.parameter(name, "e")
        return c * self.x(name, t) + e * self.u(name, t)

    def sent(self, connection: Connection, t: int) -> float:
        """What the sender of a connection gives at an instant: its output at its last point."""
        name, variable = connection.source
        return float(getattr(self, variable)(name, last(self.own[name], t)))

    def u(self, name: str, t: int) -> float:
        """The input: what its connection brings; without one, or before a message, 0."""
        connection = self.sources.get(name)
        if connection is None:
            return 0.0
        link = None if connection.link is None else self.system.links[connection.link]
        if isinstance(link, TransportLink):
            return self.delayed(connection, link, t)
        if link is None or self.is_wire(link):
            return self.over_a_wire(connection, name, t)
        used = self.deliveries[link.name].at(t).used
        if used == "none":
            return 0.0
        if used == "substitute":
            assert link.substitute is not None
            return link.substitute
        return quantized(self.sent(connection, self.deliveries[link.name].sent(used)), link)

    def over_a_wire(self, connection: Connection, name: str, t: int) -> float:
        """What is there at once; who stepped before, under Gauss-Seidel, is a point ahead."""
        before = self.names.index(connection.source.component) < self.names.index(name)
        if self.system.algorithm == "gauss-seidel" and before:
            t = self.points[min(self.points.index(t) + 1, len(self.points) - 1)]
        link = None if connection.link is None else self.system.links[connection.link]
        value = self.sent(connection, t)
        return quantized(value, link) if isinstance(link, PacketLink) else value

    def is_wire(self, link: PacketLink) -> bool:
        """Whether a message is sent, and arrives, at every point."""
        outcome = self.deliveries[link.name]
        return all(outcome.sent(outcome.at(t).used) == t for t in self.points)

    def delayed(self, connection: Connection, link: TransportLink, t: int) -> float:
        """A continuous signal as it was: on the line between two points of its sender."""
        own = self.own[connection.source.component]
        wanted, known = max(t - link.delay_ns, 0), last(own, t)
        before = last(own, wanted)
        if before == wanted or own.index(before) + 1 == len(own):
            return self.sent(connection, before)
        after = own[own.index(before) + 1]
        if after > known:
            return self.sent(connection, before)
        share = float(Fraction(wanted - before, after - before))
        return (1.0 - share) * self.sent(connection, before) + share * self.sent(connection, after)


def multiples(every_ns: int, end_ns: int) -> list[int]:
    """The multiples of a step up to the end, and the end."""
    return sorted({*range(0, end_ns, every_ns), end_ns})


def last(points: Sequence[int], t: int) -> int:
    """The last of them up to an instant."""
    return points[bisect_right(points, t) - 1]


def quantized(value: float, link: PacketLink) -> float:
    """The nearest multiple of the step of a link."""
    return round(value / link.quantization) * link.quantization if link.quantization else value
