"""Every field of every link over a medium against a model in integers and fractions."""

from __future__ import annotations

import copy
import random
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

import link_model
import pytest
from medium_model import MediumModel
from shared import sampled, share_of
from test_link_exact import (
    check_delivery,
    check_statistics,
    draw_jitter,
    draw_loss,
    draw_points,
    draw_windows,
    step_of,
)

from cosim.network import (
    Delivery,
    Hop,
    Medium,
    MediumDelivery,
    Node,
    PacketLink,
    RangeLogit,
    RangeTable,
    begin_deliveries,
    draws,
)


class Case:
    """A medium, its links, a run, and where the nodes are at each instant."""

    def __init__(self, number: int) -> None:
        r = random.Random(number)  # noqa: S311 - cases, not secrets
        self.unit = r.choice([1, 1, 1, 10**6, 2_000_000_011])
        count, size = r.randint(2, 5), r.randint(1, 3)
        self.moves = r.random() < 0.4
        spread = r.choice([1, 10, 40])
        # metres so small that a unit is crossed in a unit of time
        self.start = [[Fraction(r.randint(0, spread)) for _ in range(size)] for _ in range(count)]
        self.speeds = [
            [Fraction(r.choice([0, 0, r.randint(-8, 8)]), 8 * self.unit) for _ in range(size)]
            for _ in range(count)
        ]
        if not self.moves:
            self.speeds = [[Fraction(0)] * size for _ in range(count)]
        nodes = tuple(
            Node(
                f"n{i}",
                tuple(None if v else float(a) for a, v in zip(at, speed, strict=True)),
            )
            for i, (at, speed) in enumerate(zip(self.start, self.speeds, strict=True))
        )
        self.moves = any(v for speed in self.speeds for v in speed)
        self.medium = draw_medium(r, nodes, self.unit, spread)
        self.end = r.randint(0, 250) * self.unit
        self.links = [draw_link(r, self, i) for i in range(r.randint(1, 5))]
        if r.random() < 0.4:
            self.links = share_packets(r, self.links)
        self.points = draw_points(r, self.end, self.unit)
        self.changes: dict[tuple[str, int], tuple[int | None, float | None]] = {}
        if r.random() < 0.3:
            self.links = [replace(link, adjustable=True) for link in self.links]
            self.changes = {
                (link.name, k): (
                    r.choice([None, r.randint(0, 9) * self.unit]),
                    r.choice([None, 0.0, 0.5, 1.0]),
                )
                for link in self.links
                for k in range(200)
                if r.random() < 0.7
            }

    def delays(self, link: PacketLink) -> list[int]:
        """The link's own delay of each message, as conditions change it."""
        changed = [self.changes.get((link.name, k), (None, None))[0] for k in range(200)]
        return [link.delay_ns if delay is None else delay for delay in changed]

    def draws(self, link: PacketLink, points: Sequence[int] | None) -> link_model.Raw:
        """The raw draws, with the losses as conditions change them."""
        raw = link_model.raw_draws(link, self.end, points)
        u = draws.uniform(link.seed, link.name, "loss", len(raw.lost))
        lost = [
            own
            if (loss := self.changes.get((link.name, k), (None, None))[1]) is None
            else u[k] < loss
            for k, own in enumerate(raw.lost)
        ]
        return raw._replace(lost=lost)

    def where(self, node: int, t: int) -> list[Fraction]:
        return [a + v * t for a, v in zip(self.start[node], self.speeds[node], strict=True)]

    def values(self, t: int) -> list[float]:
        """The coordinates that move, in the order of the nodes."""
        return [
            float(at)
            for node, speeds in enumerate(self.speeds)
            for at, v in zip(self.where(node, t), speeds, strict=True)
            if v
        ]


def draw_medium(r: random.Random, nodes: tuple[Node, ...], unit: int, spread: int) -> Medium:
    more: dict[str, Any] = {"access": r.choice(["aloha", "aloha", "csma", "csma", "tdma"])}
    if more["access"] == "tdma":
        slots = tuple(r.choice(nodes).name for _ in range(r.randint(0, 3)))
        more["slots"] = r.sample(slots + tuple(n.name for n in nodes), len(nodes) + len(slots))
        more["slots"] = tuple(more["slots"])
    elif r.random() < 0.5 or more["access"] == "csma":
        more["backoff_ns"] = r.randint(1, 30) * unit
    if more["access"] == "tdma" or r.random() < 0.2:
        more["slot_ns"] = r.randint(12, 30) * unit
    if r.random() < 0.4:
        more["max_range"] = r.choice([0.5, 1.0, spread / 2, float(spread)])
        if r.random() < 0.5:
            more["interference_range"] = more["max_range"] * r.choice([1.0, 1.5, 3.0])
    if r.random() < 0.5:
        ranges = tuple(sorted({r.uniform(0, 2 * spread) for _ in range(r.randint(1, 4))}))
        table = RangeTable(ranges, tuple(r.choice([0.0, 0.3, r.random()]) for _ in ranges))
        more["loss"] = r.choice([table, RangeLogit(r.uniform(-4, 2), r.uniform(-0.1, 0.3))])
    return Medium(
        "m",
        nodes,
        data_rate=r.choice([10**9, 3 * 10**8]),
        preamble_ns=r.choice([0, 0, r.randint(0, 3)]) * unit,
        speed=r.choice([10**9 / unit, 0.5 * 10**9 / unit, 7 * 10**8 / unit]),
        turnaround_ns=r.choice([0, 0, r.randint(0, 9)]) * unit,
        **more,
    )


def draw_link(r: random.Random, case: Case, number: int) -> PacketLink:
    unit, medium = case.unit, case.medium
    sender, receiver = r.sample([node.name for node in medium.nodes], 2)
    airtime = r.randint(1, 8) * unit
    size = airtime if medium.data_rate == 10**9 else max(1, 3 * airtime // 10)
    sample = r.randint(3, 40)
    link = PacketLink(
        f"l{number}",
        sample * unit,
        r.choice([0, 0, r.randint(0, 20)]) * unit,
        frame_size=size,
        hop=Hop(medium, sender, receiver),
        delay_ns=r.choice([0, 0, r.randint(0, 9)]) * unit,
        jitter=r.choice([draw_jitter(r, 1), draw_jitter(r, unit)]) if r.random() < 0.3 else JITTER,
        loss=draw_loss(r),
        order=r.choice(["newest-wins", "as-arrived", *([] if case.moves else ["fifo"])]),
        on_loss=r.choice(["hold", "zero", 2.5]),
        queue_limit=r.choice([None, 0, 1, 2]),
        windows=draw_windows(r, case.end),
        seed=r.randrange(2**63),
    )
    if r.random() < 0.25:
        late = link.least_transit_ns + r.randint(0, 40) * unit
        link = replace(link, playout_ns=late)
    return link


def share_packets(r: random.Random, links: list[PacketLink]) -> list[PacketLink]:
    """Let some links share their packets with the first one that is of the same sender then."""
    first = links[0]
    found = [replace(first, hop=replace(first.hop, packet="p"))]
    for link in links[1:]:
        assert first.hop is not None
        receiver = r.choice([n.name for n in first.hop.medium.nodes if n.name != first.hop.sender])
        mine = {key: getattr(first, key) for key in ("sample_time_ns", "offset_ns", "frame_size")}
        hop = replace(first.hop, receiver=receiver, packet="p")
        late = max(link.playout_ns, first.least_transit_ns + link.delay_ns)
        other = replace(
            link,
            **mine,
            queue_limit=first.queue_limit,
            hop=hop,
            playout_ns=late if link.playout_ns else 0,
        )
        found.append(r.choice([link, other]))
    return found


JITTER = PacketLink("none", 1).jitter


def down(points: Sequence[int] | None, t: int) -> int:
    return t if points is None else max(p for p in points if p <= t)


def up(points: Sequence[int] | None, t: int) -> int:
    return t if points is None else next((p for p in points if p >= t), t)


def model_of(case: Case, end: int, points: Sequence[int] | None) -> MediumModel:
    offers = [
        [up(points, t) for t in range(link.offset_ns, end + 1, link.sample_time_ns)]
        for link in case.links
    ]

    def where(node: int, t: int) -> list[Fraction]:
        return case.where(node, down(points, t))

    return MediumModel(case.medium, case.links, end, offers, where)


def grow(
    deliveries: dict[str, Delivery], case: Case, r: random.Random, points: list[int] | None
) -> None:
    """Make deliveries known in blocks cut at random, in an order of links that is random too."""
    known, one = -1, next(iter(deliveries.values()))
    assert isinstance(one, MediumDelivery)
    traffic = one.traffic
    while one.horizon_ns <= case.end:
        if traffic.is_live:
            at = traffic.horizon_ns
            assert points is None or at in points
            name = traffic.sending_link
            key = (name, deliveries[name].message) if name else ("", 0)
            delay, loss = case.changes.get(key, (None, None))
            traffic.resolve(traffic.message, case.values(at), delay_ns=delay, loss=loss)
        else:
            known += r.choice([0, 1, 1, r.randint(0, 1 + case.end // 20), 1 + case.end // 3])
            r.choice(list(deliveries.values())).advance(known)
        for each in deliveries.values():
            assert each.horizon_ns == traffic.horizon_ns


def check_case(number: int) -> None:
    """All links over a medium: at once, in blocks, as their nodes move, and on a grid."""
    case = Case(number)
    r = random.Random(-1 - number)  # noqa: S311 - cases, not secrets
    for points in (None, case.points):
        model = model_of(case, case.end, points)
        step = None if points is None else step_of(points)
        deliveries = begin_deliveries(case.links, case.end, step)
        grow(deliveries, case, r, points)
        stop = r.choice([0, case.end, r.randint(0, case.end)])
        stop = down(points, stop)
        shorter = model_of(case, stop, None if points is None else [p for p in points if p <= stop])
        for i, (link, d) in enumerate(zip(case.links, deliveries.values(), strict=True)):
            raw, delays = case.draws(link, points), case.delays(link)
            expected = model.outcome(i, raw, delays, points)
            instants = [*(r.randint(0, case.end) for _ in range(4)), 0, case.end]
            check_delivery(d, case.end, expected, instants)
            cut = None if points is None else [p for p in points if p <= stop]
            early = shorter.outcome(i, raw, delays, cut)
            check_statistics(link, d.statistics(stop), early)
            if number % 10 == 0:  # what a copy forgets is counted, and changes nothing
                twin, before = copy.deepcopy(d), repr(d.arrivals())
                twin.forget(r.randint(0, case.end))
                assert repr(twin.statistics(case.end)) == repr(d.statistics(case.end))
                assert repr(d.arrivals()) == before


@pytest.mark.parametrize("part", sampled(range(10), 1))
def test_medium_is_exact(part: int) -> None:
    """300 random media, nanosecond by nanosecond."""
    for number in range(30 * part, 30 * (part + 1)):
        check_case(number)


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(20)))
def test_medium_is_exact_on_ten_thousand(part: int) -> None:
    """10 000 random media, nanosecond by nanosecond."""
    for number in range(500 * (part + 1), 500 * (part + 2)):
        check_case(number)
