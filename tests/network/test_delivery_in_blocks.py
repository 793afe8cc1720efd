"""Deliveries in blocks, of which the oldest is forgotten, against the model."""

from __future__ import annotations

import copy
import gc
import pickle
import random
import tracemalloc
from dataclasses import replace
from typing import Any

import link_model
import numpy as np
import pytest
from hypothesis import given, strategies as st
from shared import sampled, share_of
from test_link_exact import (
    Case,
    begin,
    check_answers,
    check_statistics,
    draw_case,
    grow,
    step_of,
)

from cosim.core import InputError
from cosim.master import compiled_delivery
from cosim.network import (
    REASONS,
    DelayProfile,
    DelaySignal,
    Delivery,
    GilbertElliott,
    Jitter,
    PacketLink,
    deliver,
    sendings,
)

RANGING = PacketLink("ranging", 10, delay=DelaySignal(1e-9))


def check_blocks(number: int) -> None:
    """A random link in blocks cut at random, each forgotten sooner or later."""
    case = draw_case(number)
    r = random.Random(-1 - number)  # noqa: S311 - cases, not secrets
    for points in (None, case.points):
        raw = link_model.raw_draws(case.link, case.end, points)
        model = link_model.run(case.link, case.end, raw, case.delay, points)
        growing = begin(case, None if points is None else step_of(points), number)
        sent = sorted({e.sent for e in model.entries.values()})
        after, until = sorted(r.randint(-1, case.end) for _ in range(2))
        assert growing.sendings(-1, case.end).tolist() == sent
        assert growing.sendings(after, until).tolist() == [t for t in sent if after < t <= until]
        arrivals: list[tuple[int, ...]] = []
        other = growing
        for known in grow(growing, case, model, r):
            fresh = growing.arrivals(len(arrivals))
            arrivals += zip(*(column.tolist() for column in fresh), strict=True)
            oldest = growing.oldest_ns
            if known >= oldest:
                check_answers(growing, model, [known, *(r.randint(oldest, known) for _ in "12")])
                check_changes(growing, model, r.randint(oldest - 1, known), known)
            for end in (known, r.randint(0, known)) if known >= 0 else ():
                if end >= oldest and (points is None or end in points):
                    check_end(growing, case, points, raw, end)
            growing.forget(r.choice([0, 0, known, known + 1, r.randint(0, known + 1)]))
            if r.random() < 0.1:  # what a copy does changes nothing
                other = r.choice([copy.deepcopy(growing), pickle.loads(pickle.dumps(growing))])  # noqa: S301
                finish_otherwise(other)
        expected = [
            (model.entries[label].arrival, model.entries[label].sent, label[0], REASONS.index(fate))
            for label, fate in model.received
        ]
        assert arrivals == expected
        growing.forget(case.end)
        check_statistics(case.link, growing.statistics(case.end), model)


def finish_otherwise(s: Delivery) -> None:
    while s.is_live and s.horizon_ns <= s.end_ns:
        s.resolve(s.message, 39.0 if s.message % 2 else 1.0)
    s.advance(s.end_ns)
    s.forget(s.end_ns)


def check_changes(growing: Delivery, model: link_model.Outcome, after: int, until: int) -> None:
    times, sent = growing.changes(after, until)
    assert times.tolist() == [t for t in sorted(model.changes()) if after < t <= until]
    assert sent.tolist() == [model.sent(model.at(t).used) for t in times.tolist()]


def check_end(
    growing: Delivery, case: Case, points: list[int] | None, raw: link_model.Raw, end: int
) -> None:
    """The statistics of a run that ends there, by the model and, to the last bit, at once."""
    link, got = case.link, growing.statistics(end)
    until = None if points is None else [p for p in points if p <= end]
    check_statistics(link, got, link_model.run(link, end, raw, case.delay, until))
    if not growing.is_live:
        step = None if points is None else step_of(points)
        assert repr(got) == repr(deliver(link, case.end, step).statistics(end))


@pytest.mark.parametrize("part", sampled(range(6), 1))
def test_blocks_of_any_size_make_the_same_delivery(
    part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """300 random links, cut at random and forgotten, drawn in blocks of one to many messages."""
    monkeypatch.setattr(sendings, "DRAWN_AT_ONCE", (1, 2, 3, 5, 9, 4096)[part])
    for number in range(50 * part, 50 * (part + 1)):
        check_blocks(number)


@pytest.mark.slow
@pytest.mark.parametrize("part", share_of(range(10)))
def test_blocks_of_any_size_on_three_thousand(part: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """3000 random links, cut at random and forgotten."""
    monkeypatch.setattr(sendings, "DRAWN_AT_ONCE", part + 1)
    for number in range(1000 + 300 * part, 1000 + 300 * (part + 1)):
        check_blocks(number)


@given(st.integers(0, 10**9), st.integers(0, 40))
def test_constant_values_are_a_constant_delay(number: int, delay: int) -> None:
    """A signal that never changes makes the delivery of that delay, in every answer."""
    case = draw_case(number)
    link = replace(case.link, recording=None)
    link = replace(link, playout_ns=link.playout_ns and link.playout_ns + delay)
    constant = replace(link, delay=None, delay_ns=delay, windows=())
    follows = replace(link, delay=DelaySignal(1e-9), delay_ns=0, windows=())
    for step in (None, step_of(case.points)):
        live = Delivery(follows, case.end, step)
        while live.horizon_ns <= case.end:
            live.resolve(live.message, float(delay))
        same(live, deliver(constant, case.end, step))


def same(one: Delivery, other: Delivery) -> None:
    """They answer alike about the whole run."""
    end = one.end_ns
    assert repr(one.statistics(end)) == repr(other.statistics(end))
    instants = np.linspace(0, end, 40).astype(np.int64)
    for a, b in (
        *zip(one.arrivals(), other.arrivals(), strict=True),
        *zip(one.state(instants), other.state(instants), strict=True),
        *zip(one.changes(-1, end), other.changes(-1, end), strict=True),
        (one.in_flight(instants), other.in_flight(instants)),
    ):
        assert a.dtype == b.dtype
        assert a.tolist() == b.tolist()


def test_state_after_the_next_sending_is_refused() -> None:
    """A state that depends on a value not given yet is refused, and the message named."""
    live = Delivery(RANGING, 100)
    assert live.horizon_ns == 0
    for ask in (live.sent_in_use, live.state, live.advance, lambda t: live.changes(-1, t)):
        with pytest.raises(InputError, match=r"'ranging'.*not known yet"):
            ask(0)
    assert live.resolve(0, 3) == 3
    assert live.sent_in_use([0, 3, 9]).tolist() == [-1, 0, 0]
    assert [c.tolist() for c in live.changes(0, 9)] == [[3], [0]]
    assert [c.tolist() for c in live.changes(3, 9)] == [[], []]
    with pytest.raises(InputError, match="message 1 is sent"):
        live.sent_in_use(10)
    with pytest.raises(InputError, match="message 1 is sent"):
        live.state([3, 10])


def test_known_delays_are_asked_for_after_advance() -> None:
    """Of a known delay nothing is told that was not computed, and the message says what to do."""
    known = Delivery(PacketLink("a", 10, delay_ns=3), 100)
    known.advance(12)
    known.advance(5)
    assert (known.horizon_ns, known.message) == (13, 2)
    assert known.sent_in_use([0, 3, 12]).tolist() == [-1, 0, 0]
    for ask in (known.sent_in_use, known.statistics):
        with pytest.raises(InputError, match=r"before 13 ns(.|\n)*advance"):
            ask(13)
    known.advance(1000)
    assert known.horizon_ns == 2**63 - 1
    assert known.sent_in_use(100) == 90


def test_delay_of_zero_is_in_use_at_once() -> None:
    """A message without delay is in use at the instant of sending; so are two at one point."""
    live = Delivery(RANGING, 40, 20)
    assert live.sendings(-1, 40).tolist() == [0, 20, 40]
    live.resolve(0, 0)
    assert (live.horizon_ns, live.state(19).sequence) == (20, 0)
    live.resolve(1, 0)
    with pytest.raises(InputError, match="not known yet"):
        live.state(20)
    live.resolve(2, 0)
    assert (live.horizon_ns, live.state(20).sequence) == (40, 2)


@pytest.mark.parametrize(
    ("messages", "value", "word"),
    [
        ([1], 1.0, "in order of sending"),
        ([0, 0], 1.0, "expected: message 1"),
        ([0, 1, 2], 1.0, "no more messages"),
        ([0], None, "not a finite number"),
        ([0], float("nan"), "'ranging', message 0"),
        ([0], -1.0, "out of range"),
        ([0], 1e16, "out of range"),
    ],
)
def test_resolve_refuses(messages: list[int], value: Any, word: str) -> None:
    """Messages out of order and values that give no delay are refused by name."""
    live = Delivery(RANGING, 15)
    *before, last = messages
    for k in before:
        live.resolve(k, value)
    with pytest.raises(InputError, match=word):
        live.resolve(last, value)


def test_refused_value_changes_nothing() -> None:
    """After a value was refused, a valid one is accepted."""
    live = Delivery(RANGING, 15)
    with pytest.raises(InputError):
        live.resolve(0, -5.0)
    assert live.message == 0
    assert live.resolve(0, 5.0) == 5


def test_a_link_without_signal_takes_no_value() -> None:
    """A delay that is known needs no value, and one is refused."""
    known = Delivery(PacketLink("a", 10, delay_ns=3), 20)
    with pytest.raises(InputError, match=r"follows no signal(.|\n)*advance"):
        known.resolve(0, 1.0)


def test_ends_of_a_run_that_are_refused() -> None:
    """A run has statistics when all that was sent is resolved, at a point, within the run."""
    live = Delivery(RANGING, 100, 25)

    def sent(end: int, *, broken_off: bool = False) -> float | None:
        return live.statistics(end, broken_off=broken_off)["sent"]

    for end, word in [(100, "never resolved"), (101, "0 to 100"), (-1, "0 to 100"), (30, "two")]:
        with pytest.raises(InputError, match=word):
            sent(end)
    live.resolve(0, 1)
    with pytest.raises(InputError, match="message 1"):
        sent(25)
    assert sent(25, broken_off=True) == 1
    with pytest.raises(InputError, match="message 1"):
        sent(50, broken_off=True)
    live.resolve(1, 1)
    assert sent(25, broken_off=True) == 2
    live.resolve(2, 1)
    assert sent(25) == sent(25, broken_off=True) == 3
    assert Delivery(RANGING, 0).sendings(-1, 0).tolist() == [0]
    assert Delivery(replace(RANGING, offset_ns=5), 4).statistics(4)["sent"] == 0


@pytest.mark.parametrize("step", [None, 10, 25, 30])
def test_a_run_broken_off_counts_what_was_resolved(step: int | None) -> None:
    """Ended at an instant of sending, a run counts what arrives there, and no more is sent."""
    link = replace(RANGING, jitter=Jitter("uniform", width_ns=30), duplicate=0.5, loss=0.2)
    link = replace(link, on_loss="zero")
    live = Delivery(link, 600, step)
    while live.horizon_ns < 600:
        live.resolve(live.message, 15.0)
        if live.horizon_ns < 600:
            end = live.horizon_ns
            figures = live.statistics(end, broken_off=True)
            forgetful = copy.deepcopy(live)
            forgetful.forget(end)
            assert repr(forgetful.statistics(end, broken_off=True)) == repr(figures)
            assert figures["sent"] == live.message
            # a run of that length, of which no more is sent at its end
            shorter = Delivery(link, end, step)
            while shorter.message < live.message:
                shorter.resolve(shorter.message, 15.0)
            assert repr(shorter.statistics(end, broken_off=True)) == repr(figures)


def test_in_flight_is_what_was_sent_and_is_in_no_entry_yet() -> None:
    """Copies, losses and a queue that refuses; also when what lies behind is forgotten."""
    link = PacketLink(
        *("busy", 10), delay_ns=35, jitter=Jitter("uniform", width_ns=30), loss=0.3, duplicate=0.4,
        order="as-arrived", data_rate=10**9, frame_size=14, queue_limit=3, seed=4,
    )  # fmt: skip
    growing = Delivery(link, 4000)
    growing.advance(4000)
    entries = growing.arrivals()
    points = np.arange(0, 3000, 7)
    sent, come = (np.sort(c) for c in (entries.sent_ns, entries.arrival_ns))
    expected = [int((sent <= t).sum() - (come <= t).sum()) for t in points]
    assert growing.in_flight(points).tolist() == expected
    assert max(expected) > min(expected[20:]) >= 0
    growing.forget(1500)
    assert growing.in_flight(points[300:]).tolist() == expected[300:]


def test_in_flight_where_a_run_breaks_off() -> None:
    """At the horizon of a live link the delay of what is sent there is not known yet."""
    growing = Delivery(RANGING, 100)
    growing.resolve(0, 15.0)
    assert growing.horizon_ns == 10
    assert growing.in_flight([0, 10]).tolist() == [1, 2]


def test_what_was_forgotten_is_refused() -> None:
    """Instants and arrivals are refused once they were forgotten."""
    known = Delivery(PacketLink("a", 10, delay_ns=3), 100)
    known.advance(60)
    known.forget(0)
    assert known.arrivals().sequence.size == 6
    known.forget(40)
    known.forget(30)
    assert known.oldest_ns == 40
    assert known.arrivals(4).sequence.tolist() == [4, 5]
    assert known.sent_in_use(40) == 30
    for ask, argument in [
        (known.sent_in_use, [50, 39]),
        (known.state, 39),
        (known.statistics, 38),
        (lambda t: known.changes(t - 1, 50), 39),
        (known.arrivals, 3),
    ]:
        with pytest.raises(InputError, match=r"'a'.*forgotten"):
            ask(argument)
    known.forget(1000)
    assert known.oldest_ns == known.horizon_ns == 61


def pickled(live: Delivery) -> Any:
    return pickle.loads(pickle.dumps(live))  # noqa: S301 - our own


@pytest.mark.parametrize("snapshot", [copy.deepcopy, pickled])
def test_copies_are_independent(snapshot: Any) -> None:
    """A copy made in the middle, fed with other values, changes nothing in the original."""
    link = PacketLink(
        "a", 10, jitter=Jitter("uniform", width_ns=60), duplicate=0.5, delay=DelaySignal(1e-9)
    )
    alone, run = Delivery(link, 300), Delivery(link, 300)
    half, count = 12, 31
    for k in range(count):
        if k == half:
            taken, other = snapshot(run), snapshot(run)
        alone.resolve(k, float(k))
        run.resolve(k, float(k))
    for k in range(half, count):
        taken.resolve(k, float(k))
        other.resolve(k, 100.0)
    for one in (run, taken):
        same(one, alone)


def test_a_copy_of_a_compiled_delivery_goes_on_alike() -> None:
    """A pickled one goes on in Python: another process has its own library."""
    link = PacketLink("a", 10, delay_ns=95, jitter=Jitter("uniform", width_ns=60), duplicate=0.5)
    run = Delivery(link, 3000, None, compiled_delivery())
    run.advance(1000)
    twins = [copy.deepcopy(run), pickled(run)]
    for one in (run, *twins):
        one.advance(3000)
        same(one, deliver(link, 3000))


LONG = [
    PacketLink("a", 10, delay_ns=500, jitter=Jitter("uniform", width_ns=100), loss=0.1),
    PacketLink(
        "b",
        10,
        delay=DelayProfile(np.array([0, 10**6]), np.array([300, 900]), "linear"),
        jitter=Jitter("normal", mean_ns=20, sigma_ns=9),
        loss=GilbertElliott(0.05, 0.3),
        duplicate=1.0,
        order="fifo",
        on_loss="zero",
        data_rate=10**9,
        frame_size=9,
        queue_limit=2,
    ),
    replace(RANGING, loss=0.2, order="as-arrived", duplicate=1.0),
]


@pytest.mark.parametrize("link", sampled(LONG, 1), ids=lambda link: link.name)
@pytest.mark.parametrize("step", [None, 25])
def test_memory_does_not_grow_with_the_run(
    link: PacketLink, step: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eight times as many messages, forgotten after each block, take the same memory."""
    monkeypatch.setattr(sendings, "DRAWN_AT_ONCE", 500)
    peaks, left = [], []
    for count in (2_000, 16_000):
        end = 10 * count
        gc.collect()
        tracemalloc.start()
        growing = Delivery(link, end, step, compiled_delivery())
        for until in range(1000, end + 1, 1000):
            while growing.is_live and growing.horizon_ns <= until:
                growing.resolve(growing.message, float(growing.message % 7) * 10)
            growing.advance(until)
            growing.sent_in_use(np.arange(until - 999, until + 1, 100))
            growing.forget(until)
        assert growing.statistics(end)["sent"] == count + 1
        peaks.append(tracemalloc.get_traced_memory()[1])
        gc.collect()  # what the interpreter itself keeps for reuse
        left.append(tracemalloc.get_traced_memory()[0])
        tracemalloc.stop()
    assert left[1] < left[0] + 50_000
    assert peaks[1] < peaks[0] + 500_000
