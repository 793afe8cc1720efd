"""A medium, packet by packet, in integers and fractions: slow, obvious, and on its own.

It shares nothing with `cosim.network` but the declarations and the raw draws. Which packet begins
next is looked for anew each time, from all that has begun before; what became of them is looked for
afterwards, each against each other one. What a link does behind the medium is `link_model`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from decimal import Context, Decimal
from fractions import Fraction
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import link_model

from cosim.network import Medium, PacketLink, RangeLogit, RangeTable, draws

Where = Callable[[int, int], Sequence[Fraction]]
"""Place of a node at an instant [ns]."""

UNKNOWN = 2**62


class Packet(NamedTuple):
    """A packet that began to be sent: by whom, of which link and message, with which airtime."""

    begin: int
    airtime: int
    node: int
    link: int
    message: int


class Fate(NamedTuple):
    """What became of a packet, and when it was over; `travel` : from sender to receiver."""

    name: str
    over: int
    travel: int


@dataclass
class MediumModel:
    """A run of links over a medium; `offers` : instants of each link, on a grid its points."""

    medium: Medium
    links: Sequence[PacketLink]
    end: int
    offers: Sequence[Sequence[int]]
    where: Where

    def __post_init__(self) -> None:
        self.range, self.heard = cache(self.range), cache(self.heard)  # type: ignore[method-assign]
        self.fates = cache(self.fates)  # type: ignore[method-assign]
        self.names = [node.name for node in self.medium.nodes]
        self.sender = [self.names.index(link.hop.sender) for link in self.links]
        self.receiver = [self.names.index(link.hop.receiver) for link in self.links]
        shared = [(link.hop.sender, link.hop.packet or i) for i, link in enumerate(self.links)]
        self.leader = [shared.index(of) for of in shared]  # the link whose packets these are
        self.packets: list[Packet] = []
        self.refused: set[tuple[int, int]] = set()
        self._send_all()

    def airtime(self, link: int) -> int:
        bits = Fraction(self.links[link].frame_size * 10**9, self.medium.data_rate)
        return self.medium.preamble_ns + math.ceil(bits)

    def range(self, one: int, other: int, t: int) -> float:
        """The distance in double precision, as it is defined; what follows is exact."""
        total = 0.0
        for a, b in zip(self.where(one, t), self.where(other, t), strict=True):
            total += (float(a) - float(b)) * (float(a) - float(b))
        return math.sqrt(total)

    def travel(self, range_m: float) -> int:
        return round(Fraction(1.0 / self.medium.speed) * Fraction(range_m) * 10**9)

    def heard(self, packet: Packet, node: int) -> tuple[int, int] | None:
        """When a node hears a packet: from, until; None out of reach."""
        away = self.range(packet.node, node, packet.begin)
        limits = [r for r in (self.medium.max_range, self.medium.interference_range) if r]
        if limits and away > max(limits):
            return None
        first = packet.begin + self.travel(away)
        return first, first + packet.airtime

    def hears_at(self, node: int, t: int) -> bool:
        spans = (self.heard(p, node) for p in self.packets if p.node != node)
        return any(span is not None and span[0] < t < span[1] for span in spans)

    def looks(self, node: int, link: int, message: int, since: int) -> int:
        """When a node begins to send its first message, which it has at `since`."""
        medium, tries, t = self.medium, 0, since
        while True:
            if medium.backoff_ns and (medium.access == "aloha" or tries):
                own = self.links[link]
                u = draws.uniform(own.seed, own.name, "backoff", message + 1, tries)[message]
                t += math.floor(Fraction(float(u) * medium.backoff_ns))
            if medium.slot_ns:
                while t % medium.slot_ns or not self.owns(node, t // medium.slot_ns):
                    t += medium.slot_ns - t % medium.slot_ns
            if medium.access != "csma" or not self.hears_at(node, t):
                return t
            t, tries = t + 1, tries + 1

    def owns(self, node: int, slot: int) -> bool:
        slots = self.medium.slots
        return not slots or slots[slot % len(slots)] == self.names[node]

    def _send_all(self) -> None:
        waiting: list[list[tuple[int, int]]] = [[] for _ in self.names]
        since = [0] * len(self.names)
        free = [0] * len(self.names)
        left = sorted(
            (t, link, k)
            for link, all_ in enumerate(self.offers)
            for k, t in enumerate(all_)
            if self.leader[link] == link
        )
        while True:
            begins = [
                (self.looks(node, *line[0], since[node]), node)
                for node, line in enumerate(waiting)
                if line
            ]
            t, node = min(begins, default=(self.end + 1, 0))
            if left and left[0][0] < t:
                t, link, k = left.pop(0)
                node = self.sender[link]
                ready = max(t, free[node])
                at_once = not waiting[node] and self.looks(node, link, k, ready) == t
                limit = self.links[link].queue_limit
                others = sum(other == link for other, _ in waiting[node])
                if limit is not None and not at_once and others >= limit:
                    self.refused.add((link, k))
                else:
                    if not waiting[node]:
                        since[node] = ready
                    waiting[node].append((link, k))
            elif t <= self.end:
                link, k = waiting[node].pop(0)
                self.packets.append(Packet(t, self.airtime(link), node, link, k))
                since[node] = free[node] = t + self.airtime(link)
            else:
                return

    def fates(self) -> dict[tuple[int, int], Fate]:
        """What became of each packet: by link and message."""
        found = {}
        for p in self.packets:
            for link, leader in enumerate(self.leader):
                if leader == p.link:
                    found[link, p.message] = self.fate(p, link)
        return found

    def fate(self, p: Packet, link: int) -> Fate:
        """What became of a packet at the receiver of a link."""
        to = self.receiver[link]
        away = self.range(p.node, to, p.begin)
        travel = self.travel(away)
        first, last = p.begin + travel, p.begin + travel + p.airtime
        deaf = [
            (q.begin, q.begin + q.airtime + self.medium.turnaround_ns)
            for q in self.packets
            if q.node == to
        ]
        others = [self.heard(q, to) for q in self.packets if q is not p and q.node != to]
        name = "received"
        if self.medium.max_range is not None and away > self.medium.max_range:
            name = "out of range"
        elif any(a < last and first < b for a, b in deaf):
            name = "receiver sending"
        elif any(s is not None and s[0] < last and first < s[1] for s in others):
            name = "collided"
        elif self.is_lost(link, p.message, away):
            name = "lost"
        return Fate(name, last, travel)

    def is_lost(self, link: int, message: int, away: float) -> bool:
        """The draw against the probability: on a line of the table, or by the exponential."""
        law, own = self.medium.loss, self.links[link]
        if law is None:
            return False
        u = draws.uniform(own.seed, own.name, "range loss", message + 1)[message]
        if isinstance(law, RangeLogit):
            c = Context(prec=40)
            z = c.add(Decimal(law.intercept), c.multiply(Decimal(law.slope), Decimal(away)))
            return bool(Decimal(float(u)) < c.divide(1, c.add(1, c.exp(-z))))
        return Fraction(float(u)) < table_at(law, Fraction(away))

    def outcome(
        self,
        link: int,
        raw: link_model.Raw,
        delays: Sequence[int],
        points: Sequence[int] | None = None,
    ) -> link_model.Outcome:
        """What becomes of the messages of a link, with its own losses and behind the medium."""
        own, fates = self.links[link], self.fates()
        mine = {k: fate for (of, k), fate in fates.items() if of == link}
        refused = {k for of, k in self.refused if of == self.leader[link]}
        behind = replace(own, hop=None, frame_size=0, queue_limit=None)
        lost = [
            own_loss or (k in mine and mine[k].name != "received")
            for k, own_loss in enumerate(raw.lost)
        ]

        class Behind(link_model.LinkModel):
            def is_full(self, k: int) -> bool:
                return k in refused

        def crossing(k: int, sent: int) -> int:
            over = mine[k].over if k in mine and mine[k].over <= self.end else UNKNOWN
            return over - sent + delays[k]

        found = Behind(behind, self.end, points).run(
            list(self.offers[link]), raw._replace(lost=lost), crossing
        )
        found.of_medium = link_model.ON_MEDIUM
        for (k, _), entry in found.entries.items():
            fate = mine.get(k)
            late = own.playout_ns and (fate is None or fate.over > entry.sent + own.playout_ns)
            if entry.fate == "lost" and late:
                entry.fate = "late"
            elif entry.fate == "lost" and fate is not None and fate.name != "received":
                entry.fate = fate.name
            on_way = fate is not None and entry.fate != "in flight" and not late
            entry.transit = delays[k] + raw.jitter[k] + (fate.travel if on_way and fate else 0)
            entry.lost = raw.lost[k]
            if entry.fate == "in flight":
                entry.arrival = UNKNOWN
        found.received = [(label, found.entries[label].fate) for label, _ in found.received]
        return found


def table_at(law: RangeTable, away: Fraction) -> Fraction:
    known = [(Fraction(r), Fraction(p)) for r, p in zip(law.ranges, law.losses, strict=True)]
    if away <= known[0][0]:
        return known[0][1]
    for (r, p), (s, q) in pairwise(known):
        if away <= s:
            return (p * (s - away) + q * (away - r)) / (s - r)
    return known[-1][1]
