"""Packet schedules against a receiver that is simulated nanosecond by nanosecond."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from cosim.core import InputError
from cosim.network import (
    DELIVERED,
    IN_FLIGHT,
    LOST,
    NONE_YET,
    OVERTAKEN,
    SUBSTITUTE,
    GilbertElliott,
    GrowingSchedule,
    Jitter,
    PacketLink,
    align,
    schedule,
)

if TYPE_CHECKING:
    from collections.abc import Callable

jitters = st.one_of(
    st.just(Jitter()),
    st.builds(Jitter, st.just("uniform"), width_ns=st.integers(1, 40)),
    st.builds(Jitter, st.just("exponential"), mean_ns=st.integers(1, 20)),
    st.builds(Jitter, st.just("normal"), mean_ns=st.integers(0, 9), sigma_ns=st.integers(1, 20)),
)
losses = st.one_of(
    st.sampled_from([0.0, 0.3, 0.8, 1.0]), st.just(GilbertElliott(0.3, 0.4, 0.1, 0.9))
)
rates = st.sampled_from(
    [{}, {"data_rate": 10**9, "frame_size": 4}, {"data_rate": 3 * 10**8, "frame_size": 4}]
)
links = st.builds(
    lambda name, rate, **rest: PacketLink(name, **rate, **rest),
    st.sampled_from(["sensor", "actuator"]),
    rates,
    sample_time_ns=st.integers(1, 15),
    offset_ns=st.integers(0, 5),
    delay_ns=st.integers(0, 30),
    jitter=jitters,
    loss=losses,
    order=st.sampled_from(["newest-wins", "fifo", "as-arrived"]),
    on_loss=st.sampled_from(["hold", "zero", 1.5]),
    seed=st.integers(0, 2**63 - 1),
)
ends = st.integers(0, 120)


class Receiver:
    """A slow model: messages in flight, examined nanosecond by nanosecond."""

    def __init__(
        self,
        link: PacketLink,
        end: int,
        sent: list[int],
        transit: list[int],
        lost: list[bool],
        *,
        rounded: Callable[[int], int] = int,
    ) -> None:
        self.due = []
        free = 0  # when the sender has put the message before on the link
        for s, d in zip(sent, transit, strict=True):
            free = max(s, free) + math.ceil(Fraction(link.frame_size * 10**9, link.data_rate or 1))
            self.due.append(rounded(free + d))
        self.fate = ["in flight"] * len(sent)
        self.when = [-1] * len(sent)
        self.used = []
        self.substitutions = 0
        ages = []
        newest = in_use = NONE_YET
        open_ = list(range(len(sent)))
        for t in range(end + 1):
            before = in_use
            for k in list(open_):
                behind = any(j < k and not lost[j] for j in open_)
                if self.due[k] > t or (link.order == "fifo" and behind):
                    continue
                open_.remove(k)
                self.when[k] = t
                if lost[k]:
                    self.fate[k] = "lost"
                    if link.on_loss != "hold" and newest < k:
                        in_use = SUBSTITUTE
                elif link.order == "newest-wins" and newest > k:
                    self.fate[k] = "overtaken"
                else:
                    self.fate[k] = "delivered"
                    newest, in_use = max(newest, k), k
            changed = in_use != before or (in_use == SUBSTITUTE and self.noticed(t, newest))
            self.substitutions += changed and in_use == SUBSTITUTE
            if changed and before >= 0:
                ages.append(t - sent[before])
            self.used.append(in_use)
        if in_use >= 0:
            ages.append(end - sent[in_use])
        self.max_age = max(ages, default=None)

    def noticed(self, t: int, newest: int) -> bool:
        return any(
            fate == "lost" and w == t and k > newest
            for k, (fate, w) in enumerate(zip(self.fate, self.when, strict=True))
        )


@settings(max_examples=400)
@given(links, ends)
def test_schedule_is_what_the_receiver_sees(link: PacketLink, end: int) -> None:
    """Status, delivery, message in use and statistics are those of the slow model."""
    s = schedule(link, end)
    assert s.sent_ns.tolist() == list(range(link.offset_ns, end + 1, link.sample_time_ns))
    model = Receiver(link, end, s.sent_ns.tolist(), s.transit_ns.tolist(), s.lost.tolist())
    words = {DELIVERED: "delivered", LOST: "lost", OVERTAKEN: "overtaken", IN_FLIGHT: "in flight"}
    assert [words[k] for k in s.status.tolist()] == model.fate
    expected = [w if f == "delivered" else -1 for w, f in zip(model.when, model.fate, strict=True)]
    assert s.delivered_ns.tolist() == expected
    assert s.in_use(np.arange(end + 1)).tolist() == model.used

    figures = s.statistics()
    json.dumps(figures, allow_nan=False)
    assert figures["sent"] == len(model.fate)
    assert figures["sent"] == figures["delivered"] + figures["dropped"] + figures["in_flight"]
    for fate in ("delivered", "lost", "overtaken"):
        assert figures[fate] == model.fate.count(fate)
    assert figures["dropped"] == figures["lost"] + figures["overtaken"]
    assert figures["substitutions"] == model.substitutions
    delays = [w - s.sent_ns[k] for k, w in enumerate(expected) if w >= 0]
    if not delays:
        assert figures["mean_delay_s"] is figures["max_delay_s"] is figures["max_age_s"] is None
        return
    mean = Fraction(int(sum(delays)), len(delays) * 10**9)
    assert figures["mean_delay_s"] == pytest.approx(float(mean), rel=1e-15)
    assert figures["max_delay_s"] == max(delays) / 1e9
    assert figures["max_age_s"] == (None if model.max_age is None else model.max_age / 1e9)


@given(links, ends)
def test_never_early_and_in_order(link: PacketLink, end: int) -> None:
    """No delivery before sent + delay; under fifo none before its predecessor's."""
    s = schedule(link, end)
    arrived = s.delivered_ns >= 0
    assert (s.delivered_ns[arrived] >= s.sent_ns[arrived] + link.delay_ns).all()
    if link.order == "fifo":
        assert (np.diff(s.delivered_ns[arrived]) >= 0).all()
        assert not (s.status == OVERTAKEN).any()


@given(links, ends, st.integers(1, 40))
def test_longer_run_begins_with_the_shorter(link: PacketLink, end: int, more: int) -> None:
    """What is drawn for a message does not depend on the length of the run."""
    short, long = schedule(link, end), schedule(link, end + more)
    n = short.sent_ns.size
    for key in ("sent_ns", "transit_ns", "lost"):
        assert (getattr(long, key)[:n] == getattr(short, key)).all()


def test_seed_and_name_decide_the_draws() -> None:
    """Same seed and name, same schedule; another of either, another schedule."""
    jitter = Jitter("uniform", width_ns=10**6)
    one = PacketLink("a", 10, jitter=jitter, seed=1)
    again = PacketLink("a", 10, jitter=jitter, seed=1)
    same = schedule(one, 1000).transit_ns == schedule(again, 1000).transit_ns
    assert same.all()
    for other in (
        PacketLink("a", 10, jitter=jitter, seed=2),
        PacketLink("b", 10, jitter=jitter, seed=1),
    ):
        assert (schedule(other, 1000).transit_ns != schedule(one, 1000).transit_ns).mean() > 0.9


def test_loss_does_not_change_delays() -> None:
    """Changing the loss changes which messages are lost and no delay."""
    jitter = Jitter("normal", sigma_ns=10**6)
    few, many = (
        schedule(PacketLink("a", 10, jitter=jitter, loss=p, seed=1), 10_000) for p in (0.1, 0.6)
    )
    assert (few.transit_ns == many.transit_ns).all()
    assert (many.lost | ~few.lost).all()  # the same numbers against a higher threshold
    assert few.lost.sum() < many.lost.sum()


@pytest.mark.parametrize("order", ["newest-wins", "fifo", "as-arrived"])
@pytest.mark.parametrize("policy", ["align", "grid"])
def test_link_without_delay_passes_values_on(order: str, policy: str) -> None:
    """Without delay, jitter and loss, sampled at each point, a link is a wire."""
    s = schedule(PacketLink("wire", 10, order=order), 1000)
    points, (aligned,) = align([s], 10, policy)
    assert points.tolist() == list(range(0, 1001, 10))
    values = np.random.default_rng(0).normal(size=points.size)
    assert (values[aligned.rows(points)] == values).all()
    assert (aligned.state(points).age_s == 0).all()
    assert aligned.statistics()["max_age_s"] == 10 / 1e9


def test_constant_delay_by_hand() -> None:
    """Period 10, delay 25: message k is in use from 10 k + 25 on, its age 25 to 35."""
    s = schedule(PacketLink("a", 10, delay_ns=25), 100)
    points, (s,) = align([s], 10)
    assert points.tolist() == sorted({*range(0, 101, 10), *range(25, 101, 10)})
    # points 0, 10, 20, 25, 30, 35, 40: the message sent at 0 (row 0), then that of 10 (row 1)
    assert s.rows(points)[:7].tolist() == [-1, -1, -1, 0, 0, 1, 1]
    assert s.statistics()["max_age_s"] == 35 / 1e9
    assert s.statistics()["in_flight"] == 3  # sent at 80, 90, 100
    state = s.state([24, 25, 34, 35])  # before the first delivery the value is as old as the run
    assert np.rint(state.age_s * 1e9).tolist() == [24, 25, 34, 25]
    assert state.sequence.tolist() == [-1, 0, 0, 1]


def test_messages_that_arrive_together() -> None:
    """Of messages that arrive at one instant none is overtaken, and the last sent is in use."""
    s = schedule(PacketLink("a", 5), 30)
    points, (s,) = align([s], 10, "grid")
    assert s.sent_ns.tolist() == s.delivered_ns.tolist() == [0, 10, 10, 20, 20, 30, 30]
    assert s.statistics()["overtaken"] == 0
    assert s.in_use(points).tolist() == [0, 2, 4, 6]


@given(st.lists(links, min_size=1, max_size=2), ends, st.integers(1, 20))
def test_align_makes_points_of_events(some: list[PacketLink], end: int, step: int) -> None:
    """Under "align" every sending and delivery is a point, and rows name what was sent."""
    schedules = [schedule(link, end) for link in some]
    points, aligned = align(schedules, step)
    assert (np.diff(points) > 0).all()
    assert points[0] == 0
    assert points[-1] == end
    assert set(range(0, end, step)) <= set(points.tolist())
    for s in aligned:
        assert set(s.sent_ns.tolist()) <= set(points.tolist())
        assert set(s.delivered_ns[s.delivered_ns >= 0].tolist()) <= set(points.tolist())
        used, rows = s.in_use(points), s.rows(points)
        real = used >= 0
        assert (points[rows[real]] == s.sent_ns[used[real]]).all()
        assert (rows[~real] == used[~real]).all()


@given(links, ends, st.integers(1, 20))
def test_grid_rounds_up(link: PacketLink, end: int, step: int) -> None:
    """Under "grid" sends and arrivals are rounded up to the points, in exact integers."""
    exact = schedule(link, end)
    points, (s,) = align([exact], step, "grid")
    grid = points.tolist()
    assert grid == [*range(0, end, step), end]

    def up(t: int) -> int:
        return min((p for p in grid if p >= t), default=t)

    assert s.sent_ns.tolist() == [up(t) for t in exact.sent_ns.tolist()]
    model = Receiver(
        link, end, s.sent_ns.tolist(), exact.transit_ns.tolist(), exact.lost.tolist(), rounded=up
    )
    assert s.in_use(points).tolist() == [model.used[t] for t in grid]
    arrived = s.delivered_ns >= 0
    assert set(s.delivered_ns[arrived].tolist()) <= set(grid)
    assert (s.delivered_ns[arrived] >= s.sent_ns[arrived] + link.delay_ns).all()
    s.rows(points)  # every send lies on a point


def test_rows_refuse_sends_between_points() -> None:
    """A schedule that was not aligned is refused, and the message names the instant."""
    s = schedule(PacketLink("a", 7), 20)
    with pytest.raises(InputError, match="7 ns"):
        s.rows([0, 10, 20])


def test_align_refuses() -> None:
    """Unknown policies, runs of different length and disordered points are refused."""
    a, b = schedule(PacketLink("a", 7), 20), schedule(PacketLink("b", 7), 30)
    for arguments, word in [
        (([a], 5, "round"), "policy"),
        (([a, b], 5), "different length"),
        (([], 5), "end of the run is unknown"),
        (([a], [0, 5, 5, 20]), "order"),
        (([a], [0.0, 20.0]), "order"),
        (([a], [0, 10]), "do not end"),
        (([a], 0), "range"),
    ]:
        with pytest.raises(InputError, match=word):
            align(*arguments)


def test_too_many_messages() -> None:
    """A period of 1 ns over an hour is taken for seconds mistaken for nanoseconds."""
    with pytest.raises(InputError, match="nanoseconds"):
        schedule(PacketLink("a", 1), 3600 * 10**9)
    with pytest.raises(InputError, match="at most 1000000000"):
        GrowingSchedule(PacketLink("a", 1), 3600 * 10**9)


def test_more_messages_in_blocks_than_fit_in_arrays() -> None:
    """A day of messages at 1 ms begins at once, since none is drawn before it is needed."""
    link, day = PacketLink("a", 10**6, delay_ns=5), 86_400 * 10**9
    with pytest.raises(InputError, match="at most 50000000"):
        schedule(link, day)
    growing = GrowingSchedule(link, day)
    growing.advance(10**6)
    assert growing.sent_in_use([4, 5, 10**6]).tolist() == [-1, 0, 0]
    assert growing.sendings(day - 10**6, day).tolist() == [day]


def test_messages_that_take_too_long_to_send() -> None:
    """512 frames of 2**53 ns would end beyond the instants that an integer holds."""
    link = PacketLink("a", 1, data_rate=1_000_000_000, frame_size=2**53)
    assert schedule(link, 510).arrival_ns[-1] == 511 * 2**53
    with pytest.raises(InputError, match="longer to send than can be counted") as caught:
        schedule(link, 511)
    assert caught.value.got == f"512 messages of {2**53} ns"
