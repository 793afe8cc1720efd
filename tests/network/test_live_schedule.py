"""Live schedules: resolved message by message, as the loop does."""

from __future__ import annotations

import copy
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st
from test_link_exact import draw_case, same

from cosim.core.errors import InputError
from cosim.network import (
    IN_FLIGHT,
    DelaySignal,
    Jitter,
    LiveSchedule,
    PacketLink,
    align,
    schedule,
)

RANGING = PacketLink("ranging", 10, delay=DelaySignal(1e-9))


@given(st.integers(0, 10**9), st.integers(0, 40))
def test_constant_values_give_the_schedule_of_a_constant_delay(number: int, delay: int) -> None:
    """A signal that never changes makes the schedule of that delay, in every field."""
    case = draw_case(number)
    constant = replace(case.link, delay=None, delay_ns=delay)
    follows = replace(case.link, delay=DelaySignal(1e-9), delay_ns=0)
    exact = schedule(constant, case.end)
    for points, expected in (
        (None, exact),
        (case.points, align([exact], case.points, "grid").schedules[0]),
    ):
        live = LiveSchedule(follows, case.end, points)
        for k in range(live.sent_ns.size):
            live.resolve(k, float(delay))
        same(live.finish(), expected)
        instants = [0, case.end // 3, case.end]
        assert live.in_use(instants).tolist() == expected.in_use(instants).tolist()


def test_points_added_during_the_run_match_align() -> None:
    """The points found one by one are those that align() finds in the finished schedule."""
    ranges = {t: 40.0 - 0.3 * t for t in range(0, 101, 10)}
    live = LiveSchedule(RANGING, 100)
    given_points = np.union1d(np.arange(0, 101, 25), live.sent_ns).tolist()
    t, points, used = 0, [], []
    while True:
        points.append(t)
        while live.message < live.sent_ns.size and live.sent_ns[live.message] == t:
            live.resolve(live.message, ranges[t])
        used.append(live.until(t))
        if t == 100:
            break
        ahead = min(p for p in given_points if p > t)
        change = live.next_change_ns(t)
        t = ahead if change is None else min(ahead, change)
    finished = live.finish()
    aligned = align([finished], np.arange(0, 101, 25)).points_ns
    assert points == aligned.tolist()
    assert used == finished.in_use(aligned).tolist()


def test_state_after_the_next_sending_is_refused() -> None:
    """A state that depends on a value not given yet is refused, and the message named."""
    live = LiveSchedule(RANGING, 100)
    assert live.horizon_ns == 0
    for ask in (live.until, live.in_use, live.state):
        with pytest.raises(InputError, match=r"'ranging'.*not known yet"):
            ask(0)
    assert live.resolve(0, 3) == 3
    assert (live.until(9), live.until(2)) == (0, -1)
    assert live.in_use([0, 3, 9]).tolist() == [-1, 0, 0]
    assert live.next_change_ns(0) == 3
    assert live.next_change_ns(3) is None
    with pytest.raises(InputError, match="message 1 is sent"):
        live.until(10)
    with pytest.raises(InputError, match="message 1 is sent"):
        live.state([3, 10])


def test_delay_of_zero_is_in_use_at_once() -> None:
    """A message without delay is in use at the instant of sending; so are two at one point."""
    live = LiveSchedule(RANGING, 40, [0, 20, 40])
    assert live.sent_ns.tolist() == [0, 20, 20, 40, 40]
    live.resolve(0, 0)
    assert live.until(19) == 0
    live.resolve(1, 0)
    with pytest.raises(InputError, match="not known yet"):
        live.until(20)
    live.resolve(2, 0)
    assert live.until(20) == 2


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
    live = LiveSchedule(RANGING, 15)
    *before, last = messages
    for k in before:
        live.resolve(k, value)
    with pytest.raises(InputError, match=word):
        live.resolve(last, value)


def test_refused_value_changes_nothing() -> None:
    """After a value was refused, a valid one is accepted."""
    live = LiveSchedule(RANGING, 15)
    with pytest.raises(InputError):
        live.resolve(0, -5.0)
    assert live.message == 0
    assert live.resolve(0, 5.0) == 5


def test_a_link_without_signal_takes_no_value() -> None:
    """A delay that is known needs no value, and one is refused."""
    live = LiveSchedule(PacketLink("a", 10, delay_ns=3), 20)
    with pytest.raises(InputError, match="follows no signal"):
        live.resolve(0, 1.0)
    assert live.resolve(0) == 3


def test_finish_refuses() -> None:
    """A schedule is finished when all that was sent is resolved, at a point, within the run."""
    live = LiveSchedule(RANGING, 100, 25)
    for end, word in [(None, "never resolved"), (101, "0 to 100"), (-1, "0 to 100"), (30, "two")]:
        with pytest.raises(InputError, match=word):
            live.finish(end)
    live.resolve(0, 1)
    with pytest.raises(InputError, match="message 1"):
        live.finish(25)
    assert live.finish(25, broken_off=True).sequence.tolist() == [0]
    with pytest.raises(InputError, match="message 1"):
        live.finish(50, broken_off=True)
    live.resolve(1, 1)
    assert live.finish(25, broken_off=True).sequence.tolist() == [0, 1]
    live.resolve(2, 1)
    for broken_off in (False, True):
        assert live.finish(25, broken_off=broken_off).sequence.tolist() == [0, 1, 2]
    assert LiveSchedule(RANGING, 0).sent_ns.tolist() == [0]
    assert LiveSchedule(replace(RANGING, offset_ns=5), 4).finish().sequence.size == 0


def test_live_refuses_what_schedule_and_align_refuse() -> None:
    """Bad ends and points are refused before the run."""
    for arguments, word in [
        ((-1,), "range"),
        ((100, [0, 5, 5, 100]), "order"),
        ((100, [0, 50]), "do not end"),
        ((100, 0), "range"),
    ]:
        with pytest.raises(InputError, match=word):
            LiveSchedule(RANGING, *arguments)


def pickled(live: LiveSchedule) -> Any:
    return pickle.loads(pickle.dumps(live))  # noqa: S301 - our own


@pytest.mark.parametrize("snapshot", [copy.deepcopy, pickled])
def test_copies_are_independent(snapshot: Any) -> None:
    """A copy made in the middle, fed with other values, changes nothing in the original."""
    link = PacketLink(
        "a", 10, jitter=Jitter("uniform", width_ns=60), duplicate=0.5, delay=DelaySignal(1e-9)
    )
    alone, run = LiveSchedule(link, 300), LiveSchedule(link, 300)
    half = 12
    for k in range(alone.sent_ns.size):
        if k == half:
            taken, other = snapshot(run), snapshot(run)
        alone.resolve(k, float(k))
        run.resolve(k, float(k))
    for k in range(half, alone.sent_ns.size):
        taken.resolve(k, float(k))
        other.resolve(k, 100.0)
    instants = list(range(0, 301, 7))
    for one in (run, taken):
        same(one.finish(), alone.finish())
        assert one.in_use(instants).tolist() == alone.in_use(instants).tolist()
        assert [one.until(t) for t in instants] == [alone.until(t) for t in instants]
        for a, b in zip(one.state(instants), alone.state(instants), strict=True):
            assert (a == b).all()


def test_arrivals_are_returned_once() -> None:
    """Asked for new arrivals after each message, the link returns each once, in order."""
    link = replace(RANGING, jitter=Jitter("uniform", width_ns=60), duplicate=0.5, loss=0.2)
    live = LiveSchedule(link, 1000)
    arrivals: list[tuple[int, ...]] = []
    for k in range(live.sent_ns.size):
        live.resolve(k, 5.0)
        fresh = live.arrivals(len(arrivals))
        assert (fresh.arrival_ns < live.horizon_ns).all()
        arrivals += zip(*(a.tolist() for a in fresh), strict=True)
    finished = live.finish().arrivals()
    assert arrivals == list(zip(*(a.tolist() for a in finished), strict=True))
    assert [a.dtype for a in live.arrivals()] == [a.dtype for a in finished]


def test_cost_of_a_message_does_not_grow() -> None:
    """The queue contains the messages in flight only; each arrival is recorded once."""
    live = LiveSchedule(replace(RANGING, loss=0.2, order="as-arrived"), 50_000)
    most = 0
    for k in range(live.sent_ns.size):
        live.resolve(k, float(k % 7) * 10)
        most = max(most, len(live._due))
    assert most <= 8
    assert len(live._receiver.time_ns) == live.sent_ns.size - len(live._due) - np.count_nonzero(
        live.finish().status == IN_FLIGHT
    )
