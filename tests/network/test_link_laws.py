"""Properties of every link, and small runs computed by hand."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from dataclasses import replace
from typing import Any

import link_model
import numpy as np
import pytest
from fates import arrivals, delivered, entries, fates
from hypothesis import given, strategies as st
from test_link_exact import Case, draw_case

from cosim.network import (
    REASONS,
    DelayProfile,
    DelaySignal,
    Delivery,
    GilbertElliott,
    Jitter,
    LossChain,
    PacketLink,
    TransportLink,
    deliver,
    draws,
)

numbers = st.integers(0, 10**9)


def delivery_of(case: Case) -> Delivery:
    """The delivery of a random link, with a known or a live delay."""
    d = Delivery(case.link, case.end)
    while d.is_live and d.horizon_ns <= case.end:
        d.resolve(d.message, case.value(d.message))
    d.advance(case.end)
    return d


@given(numbers)
def test_no_message_arrives_early(number: int) -> None:
    """Nothing arrives before the instant of sending, the frame and the declared delay."""
    case = draw_case(number)
    # with a play-out buffer anything else is missed before it would have come
    not_there = {"queue full"} if not case.link.playout_ns else {*REASONS} - {"delivered"}
    for arrival, sent, k, fate in entries(delivery_of(case)):
        if fate not in not_there:
            assert arrival >= sent + case.link.frame_ns + case.delay(k, sent)


@given(numbers)
def test_never_reordered_under_fifo(number: int) -> None:
    """Under fifo deliveries come in the order of the sequence numbers, and none is discarded."""
    d = delivery_of(draw_case(number))
    if d.link.order != "fifo":
        return
    accepted = [entry.message for entry in delivered(d)]
    assert accepted == sorted(accepted)
    assert not {"overtaken", "duplicate"} & {entry.fate for entry in entries(d)}


@given(numbers)
def test_newest_wins_never_goes_back(number: int) -> None:
    """Under newest-wins the message in use is never replaced by an older one, or by itself."""
    d = delivery_of(draw_case(number))
    if d.link.order != "newest-wins":
        return
    accepted = [entry.message for entry in delivered(d)]
    assert accepted == sorted({*accepted})


@given(numbers, st.integers(1, 50))
def test_longer_run_begins_with_the_same_messages(number: int, more: int) -> None:
    """A longer run begins with the same messages, copies, arrivals, and answers."""
    case = draw_case(number)
    if case.link.is_live:
        return
    short, long = deliver(case.link, case.end), deliver(case.link, case.end + more)
    assert [entry for entry in entries(long) if entry.arrival <= case.end] == entries(short)
    points = np.linspace(0, case.end, 7).astype(np.int64)
    assert (long.sent_in_use(points) == short.sent_in_use(points)).all()
    for a, b in zip(long.state(points), short.state(points), strict=True):
        assert (a == b).all()


def test_the_random_links_are_of_every_kind() -> None:
    """The links that the exact model is run on meet every fate, order, delay and policy."""
    met, seen = set(), set()
    for number in range(200):
        case = draw_case(number)
        d = delivery_of(case)
        met |= {entry.fate for entry in entries(d)}
        met |= {"in flight"} if d.statistics(case.end)["in_flight"] else set()
        delay = case.link.delay
        seen |= {case.link.order, case.link.on_loss, type(case.link.loss), type(delay)}
        seen |= {getattr(delay, "interpolation", None), case.link.jitter.kind}
        seen |= {getattr(case.link.recording, "replay", None)}
        seen |= {"substituted"} if d.statistics(case.end)["substitutions"] else set()
    assert met == set(REASONS) - set(link_model.ON_MEDIUM)
    assert seen >= {"newest-wins", "fifo", "as-arrived", "hold", "zero", 2.5, "substituted"}
    assert seen >= {float, GilbertElliott, LossChain, type(None), "once", "loop", "blocks"}
    assert seen >= {DelayProfile, DelaySignal}
    assert seen >= {"previous", "linear", "none", "uniform", "exponential", "normal"}


@pytest.mark.parametrize(
    ("jitter", "digest"),
    [
        (Jitter("uniform", width_ns=10**7), "9a94ee5b70c2e315"),
        (Jitter("exponential", mean_ns=10**6, max_ns=4 * 10**6), "2a8a9016c4b9d816"),
        (Jitter("normal", mean_ns=10**5, sigma_ns=10**6), "8eee0880af679f06"),
    ],
)
def test_draws_of_jitter_are_the_same_everywhere(jitter: Jitter, digest: str) -> None:
    """The first thousand draws, of messages and of copies, have the digest written here."""
    drawn = [
        draws.jitter_ns(jitter, 2024, "uplink", 1000, purpose)
        for purpose in ("jitter", "copy jitter")
    ]
    assert (drawn[0] != drawn[1]).mean() > 0.9
    assert sha(*drawn) == digest


def test_draws_of_losses_and_copies_are_the_same_everywhere() -> None:
    """The first thousand losses, bursts and copies have the digest written here."""
    drawn = (
        draws.lost(0.2, 2024, "uplink", 1000),
        draws.lost(GilbertElliott(0.05, 0.3, 0.01, 0.9), 2024, "uplink", 1000),
        draws.duplicated(0.1, 2024, "uplink", 1000),
    )
    assert sha(*(d.astype(np.int64) for d in drawn)) == "dfd894ab404730bb"


def test_a_delivery_is_the_same_everywhere() -> None:
    """A link with everything has the digest written here."""
    link = PacketLink(
        "uplink",
        10**8,
        delay=DelayProfile(np.array([0, 10**10]), np.array([10**8, 7 * 10**8]), "linear"),
        jitter=Jitter("normal", sigma_ns=10**8),
        loss=GilbertElliott(0.05, 0.3),
        duplicate=0.2,
        data_rate=9600,
        frame_size=1024,
        queue_limit=3,
        seed=2024,
    )
    d = deliver(link, 20 * 10**9)
    assert {entry.fate for entry in entries(d)} == (
        set(REASONS) - {"late", "in flight", *link_model.ON_MEDIUM}
    )
    assert sha(*d.arrivals()) == "6828ef523ad1e8e2"


def sha(*arrays: Any) -> str:
    return hashlib.sha256(b"".join(a.astype("<i8").tobytes() for a in arrays)).hexdigest()[:16]


def test_a_copy_is_discarded_or_used_again() -> None:
    """All messages copied, no jitter: each arrives twice at one instant."""
    links = {
        order: PacketLink("a", 10, delay_ns=25, order=order, duplicate=1.0)
        for order in ("newest-wins", "fifo", "as-arrived")
    }
    for order, link in links.items():
        s = deliver(link, 44)
        figures = s.statistics(44)
        twice = order != "newest-wins"
        fate = "delivered" if twice else "duplicate"
        assert entries(s) == [
            (25, 0, 0, "delivered"),
            (25, 0, 0, fate),
            (35, 10, 1, "delivered"),
            (35, 10, 1, fate),
        ]
        assert (figures["sent"], figures["duplicated"], figures["in_flight"]) == (5, 5, 6)
        assert (figures["delivered"], figures["discarded_copies"]) == ((4, 0) if twice else (2, 2))
        assert s.state([34, 35, 44]).sequence.tolist() == [0, 1, 1]


def test_played_out_messages_by_hand() -> None:
    """Delays 5, 30, 12, 31 behind a buffer of 30: three at exactly 30, the last one too late."""
    delays = DelayProfile(np.array([0, 10, 20, 30, 40]), np.array([5, 30, 12, 31, 0]))
    for order in ("newest-wins", "fifo", "as-arrived"):
        link = PacketLink("a", 10, delay=delays, playout_ns=30, order=order, on_loss="zero")
        s = deliver(link, 65)
        assert arrivals(s) == [30, 40, 50, 60, -1, -1, -1]
        assert fates(s) == ["delivered"] * 3 + ["late"] + ["in flight"] * 3
        # the late message is missed at its play-out, as a lost one would be
        assert s.state([29, 30, 49, 50, 59, 60]).sequence.tolist() == [-1, 0, 1, 2, 2, -2]
        figures = s.statistics(65)
        assert (figures["late"], figures["lost"], figures["dropped"]) == (1, 0, 1)
        assert (figures["substitutions"], figures["max_delay_s"]) == (1, 30e-9)
        assert figures["mean_delay_s"] == 30e-9


def test_a_message_kept_waiting_under_fifo_may_be_late() -> None:
    """Message 1 waits for message 0, which is late itself; the buffer comes after the channel."""
    delays = DelayProfile(np.array([0, 10, 20]), np.array([60, 0, 0]))
    met = {
        order: fates(deliver(PacketLink("a", 10, delay=delays, playout_ns=45, order=order), 80))
        for order in ("fifo", "newest-wins")
    }
    assert met["fifo"][:3] == ["late", "late", "delivered"]
    assert met["newest-wins"][:3] == ["late", "delivered", "delivered"]


def test_a_copy_may_be_in_time_where_its_message_is_late() -> None:
    """Each of the two has its own jitter, and what is in time comes out."""
    wide = Jitter("uniform", width_ns=100)
    d = deliver(PacketLink("a", 10, jitter=wide, duplicate=1.0, playout_ns=50), 10_000)
    pairs: dict[int, list[str]] = {}
    for entry in entries(d):
        pairs.setdefault(entry.message, []).append(entry.fate)
    both = {tuple(pair) for pair in pairs.values()}
    assert both >= {("late", "delivered"), ("delivered", "late"), ("delivered", "duplicate")}
    assert all(entry.arrival - entry.sent == 50 for entry in delivered(d))


def test_on_a_grid_the_play_out_itself_decides() -> None:
    """Arrival at 12 after a play-out of 11 is late, though the grid releases at 20 only."""
    for delay, fate in ((11, "delivered"), (12, "late")):
        changing = DelayProfile(np.array([0, 1]), np.array([delay, 0]))
        link = PacketLink("a", 100, delay=changing, playout_ns=11)
        d = deliver(link, 40, 20)
        assert (fates(d), arrivals(d)) == ([fate], [20])


def test_copies_do_not_change_losses_and_delays() -> None:
    """With copies the messages themselves keep their losses and delays."""
    links = [
        PacketLink(
            *("a", 10),
            jitter=Jitter("uniform", width_ns=90),
            loss=0.3,
            duplicate=p,
            seed=4,
            order="as-arrived",
        )
        for p in (0.0, 0.4)
    ]
    without, with_copies = (deliver(link, 10_000) for link in links)
    more = Counter(entries(with_copies))
    more.subtract(entries(without))
    copies = [entry for entry, count in more.items() for _ in range(count)]
    assert min(more.values()) == 0
    assert {entry.fate for entry in copies} == {"delivered"}
    assert len(copies) / len(delivered(without)) == pytest.approx(0.4, abs=0.1)


def test_a_copy_takes_no_sending_time() -> None:
    """A copy is made after the queue: both leave when the one frame is sent."""
    link = PacketLink("a", 10, duplicate=1.0, order="fifo", data_rate=10**9, frame_size=8)
    assert [e.arrival for e in entries(deliver(link, 29))] == [8, 8, 18, 18, 28, 28]


def test_frame_longer_than_the_sample_time() -> None:
    """Frames of 25 every 10: the queue grows by 15 with each message, without bound."""
    link = PacketLink("a", 10, data_rate=10**9, frame_size=25)
    assert arrivals(deliver(link, 150))[:6] == [25, 50, 75, 100, 125, 150]


def test_queue_limit_by_hand() -> None:
    """Frames of 25 every 10, one may wait: what finds another waiting is refused.

    0 is sent until 25, 1 waits from 10 and is sent until 50; 2 (at 20) finds it waiting; 3 (at
    30) waits until 50 and is sent until 75; 4 (at 40) finds it waiting; 5 comes at 50, as 3
    begins, and waits until 75.
    """
    link = PacketLink("a", 10, data_rate=10**9, frame_size=25, queue_limit=1, on_loss="zero")
    s = deliver(link, 50)
    assert arrivals(s) == [25, 50, 20, -1, 40, -1]
    assert arrivals(deliver(link, 100))[:6] == [25, 50, 20, 75, 40, 100]
    ends = ["in flight"]
    assert fates(s) == ["delivered", "delivered", "queue full", *ends, "queue full", *ends]
    state = s.state([19, 20, 40, 50])
    assert state.dropped.tolist() == [0, 1, 2, 2]
    assert state.sequence.tolist() == [-1, -1, 0, 1]  # what was never sent is not missed
    none_waits = PacketLink("a", 10, data_rate=10**9, frame_size=25, queue_limit=0)
    s = deliver(none_waits, 100)
    full = [k for k, word in enumerate(fates(s)) if word == "queue full"]
    assert full == [1, 2, 4, 5, 7, 8, 10]
    assert s.statistics(100)["queue_full"] == s.statistics(100)["dropped"] == 7


@pytest.mark.parametrize(
    ("p_enter", "p_exit", "lost"),
    [
        (1, 0, [0, *[1] * 49]),
        (0, 1, [0] * 50),
        (0, 0, [0] * 50),
        (1, 1, [0, 1] * 25),
    ],
)
def test_gilbert_elliott_with_probabilities_0_and_1(
    p_enter: int, p_exit: int, lost: list[int]
) -> None:
    """Probabilities 0 and 1 are deterministic; the first message is sent in the good state."""
    for count in (0, 1, 2, 50):
        got = draws.lost(GilbertElliott(p_enter, p_exit), 1, "a", count)
        assert got.tolist() == lost[:count]


@given(st.tuples(*[st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0])] * 4), numbers, st.integers(0, 80))
def test_gilbert_elliott_is_the_chain(p: Any, seed: int, count: int) -> None:
    """The states found at once are those of the chain, walked message by message."""
    u = draws.uniform(seed, "a", "loss", count)
    change = draws.uniform(seed, "a", "loss state", count)
    bad, expected = False, []
    for k in range(count):
        if k > 0:
            bad = change[k] >= p[1] if bad else change[k] < p[0]
        expected.append(u[k] < (p[3] if bad else p[2]))
    assert draws.lost(GilbertElliott(*p), seed, "a", count).tolist() == expected


def test_state_by_hand() -> None:
    """Before the first delivery the age is the time since 0; then it is that of the message."""
    s = deliver(PacketLink("a", 10, delay_ns=25), 60)
    state = s.state([0, 24, 25, 34, 35, 60])
    assert state.age_s.tolist() == [0.0, 24e-9, 25e-9, 34e-9, 25e-9, 30e-9]
    assert state.sequence.tolist() == [-1, -1, 0, 0, 1, 3]
    assert state.delivered.tolist() == [0, 0, 1, 1, 2, 4]
    assert not state.dropped.any()
    assert all(a.size == 0 for a in s.state([]))
    assert s.state(60).age_s == 30e-9


def test_state_while_a_substitute_is_in_use() -> None:
    """All but the first lost: -2 from the loss on, and the age is that of the first."""
    link = PacketLink("a", 10, delay_ns=5, loss=GilbertElliott(1, 0), on_loss="zero")
    state = deliver(link, 40).state([4, 5, 14, 15, 40])
    assert state.sequence.tolist() == [-1, 0, 0, -2, -2]
    assert state.age_s.tolist() == [4e-9, 5e-9, 14e-9, 15e-9, 40e-9]
    assert state.dropped.tolist() == [0, 0, 0, 1, 3]
    nothing = PacketLink("a", 10, delay_ns=5, loss=1.0, on_loss="zero")
    state = deliver(nothing, 40).state([4, 5, 40])
    assert (state.sequence.tolist(), state.age_s.tolist()) == ([-1, -2, -2], [4e-9, 5e-9, 40e-9])


def test_link_without_delay_has_age_zero() -> None:
    """Without delay, sampled at each point, a link is a wire of age 0, in both kinds."""
    link = PacketLink("wire", 10)
    points = np.arange(0, 101, 10)
    for step in (None, 10):
        d = deliver(link, 100, step)
        assert d.sent_in_use(points).tolist() == points.tolist()
        assert not d.state(points).age_s.any()
    assert not TransportLink("wire").state(points).age_s.any()


def test_state_of_a_transport_link() -> None:
    """Its age is the delay, once the run is as old; there are no messages."""
    state = TransportLink("t", 25).state([0, 10, 25, 60])
    assert state.age_s.tolist() == [0.0, 10e-9, 25e-9, 25e-9]
    assert state.sequence.tolist() == [-1] * 4
    assert not state.dropped.any()
    assert not state.delivered.any()


def test_statistics_have_the_same_keys_for_every_link() -> None:
    """Figures that do not apply to a link are None, and all are JSON."""
    plain = deliver(PacketLink("a", 10), 100).statistics(100)
    full = PacketLink("a", 10, duplicate=0.5, data_rate=10**9, frame_size=8, queue_limit=1)
    figures = deliver(replace(full, playout_ns=9), 100).statistics(100)
    assert list(plain) == list(figures)
    assert plain["duplicated"] is plain["discarded_copies"] is plain["queue_full"] is None
    assert plain["late"] is None
    assert None not in figures.values()
    json.dumps([plain, figures], allow_nan=False)


def test_a_recorded_delay_is_taken_at_the_instant_of_sending() -> None:
    """Delays 100 until 20, then 5: the message of 20 overtakes those before it."""
    profile = DelayProfile(np.array([0, 20]), np.array([100, 5]))
    d = deliver(PacketLink("a", 10, delay=profile), 200)
    assert arrivals(d)[:4] == [100, 110, 25, 35]
    assert fates(d)[:4] == ["overtaken", "overtaken", "delivered", "delivered"]
    moved = deliver(PacketLink("a", 15, delay=profile, order="as-arrived"), 120, 20)
    assert moved.sendings(-1, 60).tolist() == [0, 20, 40, 60]
    # the message of 15 is sent at 20 and takes 5; at 15 it would have taken 100
    assert arrivals(moved)[:5] == [100, 40, 60, 80, 80]


def test_model_of_the_tests_by_hand() -> None:
    """The model itself, on a run that can be followed: a loss, a copy, an overtaking."""
    link = PacketLink("a", 10, order="newest-wins", on_loss="zero")
    raw = link_model.Raw([0, 30, 0, 0], [False, False, False, True], [True, *[False] * 3], [7] * 4)
    out = link_model.run(link, 40 - 1, raw, lambda _k, _t: 3)
    fates = {label: (e.arrival, e.fate) for label, e in out.entries.items()}
    assert fates == {
        (0, 0): (3, "delivered"),
        (0, 1): (10, "duplicate"),
        (1, 0): (43, "in flight"),
        (2, 0): (23, "delivered"),
        (3, 0): (33, "lost"),
    }
    assert out.at(22).used == (0, 0)
    assert out.at(33).used == "substitute"
    assert (out.at(39).delivered, out.at(39).dropped) == (2, 2)
