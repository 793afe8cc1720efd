"""Laws of a medium, and its packets against a simulation of processes in SimPy."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Generator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
import simpy
from fates import arrivals, delivered, entries, fates
from shared import sampled
from test_medium_exact import Case

from cosim.core import InputError
from cosim.network import (
    DelaySignal,
    Delivery,
    Hop,
    Jitter,
    Medium,
    MediumDelivery,
    Node,
    PacketLink,
    RangeTable,
    begin_deliveries,
    deliver,
    draws,
)

S = 10**9
SHIP = Node("ship", (0.0, 0.0))
AUVS = tuple(Node(f"auv{i}", (1500.0 * i, 0.0)) for i in (1, 2, 3))


def run(links: list[PacketLink], end: int, case: Case | None = None) -> dict[str, Delivery]:
    """The deliveries of links over one medium at the end of a run."""
    found = begin_deliveries(links, end)
    one = next(iter(found.values()))
    assert isinstance(one, MediumDelivery)
    while one.is_live and one.horizon_ns <= end:
        assert case is not None
        one.traffic.resolve(one.traffic.message, case.values(one.horizon_ns))
    one.advance(end)
    return found


def medium(**keys: Any) -> Medium:
    return Medium("acoustic", (SHIP, *AUVS), **{"data_rate": 1000, **keys})


def link(name: str, sender: str, to: str, over: Medium, **keys: Any) -> PacketLink:
    return PacketLink(
        name, **{"sample_time_ns": 10 * S, "frame_size": 1000, "hop": Hop(over, sender, to), **keys}
    )


def test_a_packet_takes_its_airtime_and_its_way() -> None:
    """Sent at 0: a preamble of 0.2 s, 1000 bit at 1000 bit/s, 1500 m at 1500 m/s, 0.1 s more."""
    over = medium(preamble_ns=S // 5)
    found = run([link("up", "auv1", "ship", over, delay_ns=S // 10)], 20 * S)["up"]
    assert arrivals(found) == [23 * S // 10, 123 * S // 10, -1]
    assert fates(found) == ["delivered", "delivered", "in flight"]


def test_two_packets_that_meet_at_a_receiver_are_lost_and_end_to_end_they_are_not() -> None:
    """auv1 and auv2 are 1 s and 2 s away: sent 1 s apart they meet, sent at once they touch."""
    for offset, fate in ((S, "collided"), (0, "delivered"), (2 * S, "delivered"), (1, "collided")):
        over = medium()
        far = link("far", "auv2", "ship", over)
        near = link("near", "auv1", "ship", over, offset_ns=offset)
        found = run([near, far], 9 * S)
        assert fates(found["near"])[0] == fates(found["far"])[0] == fate


def test_a_node_that_sends_hears_nothing_and_a_while_longer() -> None:
    """The ship sends from 1.5 s to 2.5 s, while a packet of auv1 is at it from 1 s to 2 s."""
    for turnaround, offset, fate in (
        (0, 3 * S // 2, "receiver sending"),
        (0, 2 * S, "delivered"),
        (0, 0, "delivered"),
        (1, 0, "receiver sending"),
    ):
        over = medium(turnaround_ns=turnaround)
        up = link("up", "auv1", "ship", over)
        down = link("down", "ship", "auv3", over, offset_ns=offset)
        found = run([up, down], 9 * S)
        assert fates(found["up"])[0] == fate
        assert fates(found["down"])[0] == "delivered"


def test_out_of_range_and_interference_from_out_of_range() -> None:
    """auv2, 3 km away, is out of range but disturbs auv1; beyond 2 km nothing is heard."""
    for heard, fate in ((4000.0, "collided"), (None, "delivered")):
        over = medium(max_range=2000.0, interference_range=heard)
        near = link("near", "auv1", "ship", over, offset_ns=S // 2)
        found = run([near, link("far", "auv2", "ship", over)], 9 * S)
        assert fates(found["far"])[0] == "out of range"
        assert fates(found["near"])[0] == fate


def test_tdma_begins_at_the_beginning_of_slots_to_the_nanosecond() -> None:
    """Slots of 2.5 s: auv1 has the first and the third, the ship the second one of a frame."""
    over = medium(access="tdma", slot_ns=5 * S // 2, slots=("auv1", "ship", "auv1"))
    up = link("up", "auv1", "ship", over, sample_time_ns=3 * S, queue_limit=2)
    down = link("down", "ship", "auv1", over, sample_time_ns=8 * S)
    found = run([up, down], 100 * S)
    begins = {name: [entry.arrival - 2 * S for entry in delivered(s)] for name, s in found.items()}
    assert begins["up"][:4] == [0, 5 * S, 15 * S // 2, 25 * S // 2]
    assert {t % (15 * S // 2) for t in begins["up"]} == {0, 5 * S}
    assert {t % (15 * S // 2) for t in begins["down"]} == {5 * S // 2}
    assert "collided" not in fates(found["up"]) + fates(found["down"])


def test_who_listens_waits_and_who_does_not_collides() -> None:
    """Four nodes in a bay: ALOHA loses by collisions what carrier sensing still brings."""
    nodes = tuple(Node(f"n{i}", (30.0 * i,)) for i in range(4))
    counted = {}
    for access in ("aloha", "csma"):
        over = Medium("bay", nodes, 1000, access=access, backoff_ns=3 * S)
        links = [
            link(f"l{i}", f"n{i}", "n0", over, sample_time_ns=9 * S, offset_ns=i * S // 10)
            for i in (1, 2, 3)
        ]
        found = run(links, 1000 * S)
        counted[access] = Counter(word for s in found.values() for word in fates(s))
    assert counted["csma"]["delivered"] > 1.5 * counted["aloha"]["delivered"]
    assert counted["aloha"]["collided"] > 100


def test_one_link_on_a_medium_is_a_link_with_a_data_rate() -> None:
    """Without others a medium is a queue, a data rate and a delay: every field is the same."""
    own = PacketLink(
        "up", 3 * S, 7, S, data_rate=1000, frame_size=4000, queue_limit=3, loss=0.3, seed=5
    )
    over = Medium("m", (Node("a", (0.0,)), Node("b", (1500.0,))), 1000)
    shared = link(
        "up", "a", "b", over, sample_time_ns=3 * S, offset_ns=7, frame_size=4000, queue_limit=3,
        loss=0.3, seed=5,
    )  # fmt: skip
    one, other = deliver(own, 100 * S), run([shared], 100 * S)["up"]
    assert {*entries(one)} == {*entries(other)}
    figures = one.statistics(100 * S)
    assert figures == {key: other.statistics(100 * S)[key] for key in figures}


def test_under_fifo_jitter_behind_a_medium_overtakes_nothing() -> None:
    """A message waits for those before it, however soon it has come."""
    wide = Jitter("uniform", width_ns=60 * S)
    up = link("up", "auv1", "ship", medium(), order="fifo", jitter=wide, seed=2)
    d = run([up], 1000 * S)["up"]
    accepted = [entry.message for entry in delivered(d)]
    assert accepted == sorted(accepted)
    assert "overtaken" not in fates(d)
    waited = [e.arrival for e in delivered(d)]
    assert len(waited) > len({*waited})  # some came with the one they waited for


def test_links_that_share_their_packets_send_once() -> None:
    """The ship calls three at once; each receives or misses it by itself, with its own draws."""
    over = medium(max_range=4000.0, loss=RangeTable((0.0,), (0.3,)))
    calls = [
        link(f"to_{n.name}", "ship", n.name, over, hop=Hop(over, "ship", n.name, "call"), seed=1)
        for n in AUVS
    ]
    found = run(calls, 1000 * S)
    met = [fates(found[call.name])[:-1] for call in calls]
    assert all(15 < each.count("lost") < 45 for each in met[:2])
    assert met[0] != met[1]
    assert set(met[2]) == {"out of range"}
    assert arrivals(found["to_auv1"])[0] == 2 * S
    assert arrivals(found["to_auv2"])[0] == 3 * S
    other = link("to_auv2", "ship", "auv2", over, hop=Hop(over, "ship", "auv2", "call"))
    with pytest.raises(InputError, match="frame_size"):
        run([calls[0], replace(other, name="late", frame_size=7)], S)


def test_the_share_of_a_table_is_lost() -> None:
    """Half way between no loss at 1 km and certain loss at 2 km half the packets are lost."""
    over = medium(loss=RangeTable((1000.0, 2000.0), (0.0, 1.0)))
    up = link("up", "auv1", "ship", over, seed=1)
    lost = fates(run([up], 10_000 * S)["up"]).count("lost")
    assert abs(lost - 500) < 5 * 250**0.5


def test_what_is_sent_is_delivered_once_or_not_and_never_while_sending() -> None:
    """Conservation over random media, from the deliveries alone."""
    for number in range(40):
        case = Case(number)
        found = run(case.links, case.end, case)
        sending: dict[str, set[tuple[int, int, str, int]]] = {}
        taken: dict[str, set[tuple[int, int, str, int]]] = {}
        for one in case.links:
            s, hop = found[one.name], one.hop
            assert hop is not None
            numbers = [entry.message for entry in entries(s)]
            assert len(numbers) == len({*numbers})
            assert all(e.arrival >= e.sent + one.frame_ns + one.delay_ns for e in delivered(s))
            counts = s.statistics(case.end)
            assert counts["sent"] == sum(
                counts[key] or 0 for key in ("delivered", "dropped", "in_flight")
            )
            if one.playout_ns or one.jitter.kind != "none" or one.order == "fifo":
                continue  # the arrival is not the end of the packet
            for arrival, _, k, how in entries(s):
                packet = hop.packet or one.name, k  # several links may share it
                over = arrival - one.delay_ns
                if how != "queue full" and not case.medium.moves:
                    begin = over - one.frame_ns - travel_ns(case, hop)
                    sending.setdefault(hop.sender, set()).add(
                        (begin, begin + one.frame_ns, *packet)
                    )
                if how in ("delivered", "overtaken"):
                    taken.setdefault(hop.receiver, set()).add((over - one.frame_ns, over, *packet))
        for spans in (*sending.values(), *taken.values()):
            assert all(a[1] <= b[0] for a, b in pairwise(sorted(spans)))
        for node, spans in taken.items():
            for a, b, _, _ in spans:
                deaf = case.medium.turnaround_ns
                assert all(d + deaf <= a or b <= c for c, d, _, _ in sending.get(node, ()))


def travel_ns(case: Case, hop: Hop) -> int:
    """How long a packet travels between nodes that do not move."""
    names = [node.name for node in case.medium.nodes]
    ends = (case.where(names.index(name), 0) for name in (hop.sender, hop.receiver))
    away = math.dist(*([float(x) for x in place] for place in ends))
    return DelaySignal(1.0 / case.medium.speed).delay_ns(away)


class Bay:
    """The medium as processes: modems that wait, listen and send; packets that pass by."""

    def __init__(self, case: Case) -> None:
        self.case, self.env = case, simpy.Environment()
        self.queue = [simpy.Store(self.env) for _ in case.medium.nodes]
        self.line: list[list[int]] = [[] for _ in case.medium.nodes]
        self.present: list[list[dict[str, Any]]] = [[] for _ in case.medium.nodes]
        self.deaf: list[int] = [0 for _ in case.medium.nodes]
        self.fates: dict[tuple[int, int], tuple[str, int]] = {}
        self.names = [node.name for node in case.medium.nodes]
        for i in range(len(self.names)):
            self.env.process(self.modem(i))
        for number, one in enumerate(case.links):
            self.env.process(self.source(number, one))

    def source(self, number: int, one: PacketLink) -> Generator[Any, Any, None]:
        assert one.hop is not None
        node = self.names.index(one.hop.sender)
        yield self.env.timeout(one.offset_ns)
        k = 0
        while True:
            self.queue[node].put((number, k))
            k += 1
            yield self.env.timeout(one.sample_time_ns)

    def modem(self, node: int) -> Generator[Any, Any, None]:
        m = self.case.medium
        while True:
            number, k = yield self.queue[node].get()
            one, tries = self.case.links[number], 0
            while True:
                if m.backoff_ns and (m.access == "aloha" or tries):
                    u = draws.uniform(one.seed, one.name, "backoff", k + 1, tries)[k]
                    yield self.env.timeout(int(float(u) * m.backoff_ns))
                while m.slot_ns and (
                    self.env.now % m.slot_ns
                    or (
                        m.slots
                        and m.slots[self.env.now // m.slot_ns % len(m.slots)] != self.names[node]
                    )
                ):
                    yield self.env.timeout(m.slot_ns - self.env.now % m.slot_ns)
                now = self.env.now
                if m.access != "csma" or not any(
                    p["since"] < now < p["until"] for p in self.present[node]
                ):
                    break
                tries += 1
                yield self.env.timeout(1)
            yield from self.send(node, number, k, one)

    def send(self, node: int, number: int, k: int, one: PacketLink) -> Generator[Any, Any, None]:
        env, m = self.env, self.case.medium
        assert one.hop is not None
        for other, name in enumerate(self.names):
            if other != node:
                pair = (self.case.where(i, env.now) for i in (node, other))
                away = math.dist(*([float(x) for x in place] for place in pair))
                env.process(
                    self.passing(
                        other, away, one, (number, k) if name == one.hop.receiver else None
                    )
                )
        self.deaf[node] = env.now + one.frame_ns + m.turnaround_ns
        for packet in self.present[node]:
            if packet["until"] > env.now:
                packet["deaf"] = True
        yield env.timeout(one.frame_ns)

    def passing(
        self, node: int, away: float, one: PacketLink, to: tuple[int, int] | None
    ) -> Generator[Any, Any, None]:
        m, env = self.case.medium, self.env
        heard_within = m.interference_range or m.max_range
        far = DelaySignal(1.0 / m.speed).delay_ns(away)
        packet = {
            "since": env.now + far,
            "until": env.now + far + one.frame_ns,
            "deaf": False,
            "met": False,
        }
        yield env.timeout(far)
        if heard_within is None or away <= heard_within:
            packet["deaf"] = packet["since"] < self.deaf[node]
            for other in self.present[node]:
                if other["until"] > env.now:
                    other["met"] = packet["met"] = True
            self.present[node].append(packet)
        yield env.timeout(one.frame_ns)
        if to is None:
            return
        how = "received"
        if m.max_range is not None and away > m.max_range:
            how = "out of range"
        elif packet["deaf"]:
            how = "receiver sending"
        elif packet["met"]:
            how = "collided"
        self.fates[to] = how, env.now


def spread(case: Case) -> None:
    """Let no two links offer at one instant, where SimPy has an order of its own; lose nothing."""
    over = replace(case.medium, loss=None)
    case.medium, case.end = over, 64 * case.end
    case.links = [
        PacketLink(
            one.name,
            64 * one.sample_time_ns,
            64 * one.offset_ns + i,
            frame_size=one.frame_size,
            seed=one.seed,
            hop=replace(one.hop, medium=over, packet=""),
        )
        for i, one in enumerate(case.links)
        if one.hop is not None
    ]


@pytest.mark.parametrize("part", sampled(range(10), 1))
def test_packets_against_processes_in_simpy(part: int) -> None:
    """500 random media: fate and end of each packet are those that processes in SimPy find."""
    for number in range(50 * part, 50 * (part + 1)):
        case = Case(number)
        spread(case)
        bay = Bay(case)
        bay.env.run(until=case.end + 1)
        found = {}
        for i, s in enumerate(run(case.links, case.end, case).values()):
            for at, _, k, how in entries(s):
                taken = how in ("delivered", "overtaken")
                found[i, k] = "received" if taken else how, at
        assert found == bay.fates


def test_a_message_that_waits_is_awaited() -> None:
    """The oldest message that may still come is that which waits for its slot."""
    over = medium(access="tdma", slot_ns=20 * S, slots=("ship", "auv1"))
    found = begin_deliveries([link("up", "auv1", "ship", over, offset_ns=S)], 100 * S)["up"]
    found.advance(30 * S)  # what was sent at 1 s came at 22 s, that at 11 s and 21 s waits
    assert found.sent_in_use([30 * S]).tolist() == [S]
    found.advance(63 * S)
    assert found.sent_in_use([62 * S]).tolist() == [11 * S]
    assert found.oldest_awaited_ns(21 * S) == S
    assert found.oldest_awaited_ns(62 * S) == 11 * S
    late = begin_deliveries([link("up", "auv1", "ship", over, offset_ns=21 * S)], 100 * S)["up"]
    late.advance(59 * S)
    assert late.oldest_awaited_ns(59 * S) == 21 * S  # nothing came, though one waits since then


def test_what_a_medium_refuses() -> None:
    """Each mistake is named, with its place."""
    over = medium()
    for make, words_ in (
        (lambda: medium(access="tdma"), "slot does not go with the access"),
        (lambda: medium(access="csma"), "backoff does not go"),
        (lambda: medium(slots=("ship",)), "slots does not go"),
        (lambda: medium(access="tdma", slot_ns=1, slots=("shp",)), "node"),
        (lambda: medium(max_range=2.0, interference_range=1.0), "is heard"),
        (lambda: medium(speed=-1.0), "speed out of range"),
        (lambda: medium(data_rate=0), "data_rate out of range"),
        (lambda: Medium("m", (SHIP,), 1), "needs nodes"),
        (lambda: Medium("m", (SHIP, Node("a", (0.0,))), 1), "do not go together"),
        (lambda: Hop(over, "ship", "ship"), "from one node to another"),
        (lambda: Hop(over, "ship", "auv"), "node"),
        (lambda: link("l", "ship", "auv1", over, frame_size=0), "has a size"),
        (lambda: link("l", "ship", "auv1", over, data_rate=9), "no data_rate"),
        (lambda: link("l", "ship", "auv1", over, duplicate=0.5), "no duplicate"),
        (lambda: link("l", "ship", "auv1", over, delay=DelaySignal(1.0)), "no delay"),
        (
            lambda: link("l", "auv1", "ship", medium(access="tdma", slot_ns=1, slots=("auv1",))),
            "exceeds its slot",
        ),
        (
            lambda: link("l", "ship", "auv1", medium(access="tdma", slot_ns=S, slots=("auv1",))),
            "has no slot",
        ),
        (lambda: deliver(link("l", "ship", "auv1", over), S), "other links"),
        (lambda: Delivery(link("l", "ship", "auv1", over), S), "other links"),
        (
            lambda: run(
                [link("l", "ship", "auv1", over), link("k", "ship", "auv1", medium(data_rate=2))], S
            ),
            "two media have one name",
        ),
    ):
        with pytest.raises(InputError, match=words_):
            make()
