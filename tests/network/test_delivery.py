"""Deliveries against a receiver that is simulated nanosecond by nanosecond."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from typing import TYPE_CHECKING

import numpy as np
import pytest
from fates import arrivals, delivered, entries, fates
from hypothesis import given, settings, strategies as st

from cosim.core import InputError
from cosim.network import (
    NONE_YET,
    SUBSTITUTE,
    Delivery,
    GilbertElliott,
    Jitter,
    PacketLink,
    deliver,
    draws,
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
        self.sent = sent
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


def instants(link: PacketLink, end: int) -> list[int]:
    """When messages are to be sent."""
    return list(range(link.offset_ns, end + 1, link.sample_time_ns))


def drawn(link: PacketLink, count: int) -> tuple[list[int], list[bool]]:
    """Delay with jitter of each message, and which are lost."""
    jitter = draws.jitter_ns(link.jitter, link.seed, link.name, count)
    lost = draws.lost(link.loss, link.seed, link.name, count)
    return (link.delay_ns + jitter).tolist(), lost.tolist()


def in_use(model: Receiver, times: list[int]) -> list[int]:
    """When the message in use was sent, as `Delivery.sent_in_use`."""
    return [model.used[t] if model.used[t] < 0 else model.sent[model.used[t]] for t in times]


@settings(max_examples=400)
@given(links, ends)
def test_delivery_is_what_the_receiver_sees(link: PacketLink, end: int) -> None:
    """Status, delivery, message in use and statistics are those of the slow model."""
    d, sent = deliver(link, end), instants(link, end)
    model = Receiver(link, end, sent, *drawn(link, len(sent)))
    assert d.sendings(-1, end).tolist() == sent
    assert fates(d) == model.fate
    assert arrivals(d) == model.when
    assert d.sent_in_use(np.arange(end + 1)).tolist() == in_use(model, [*range(end + 1)])

    figures = d.statistics(end)
    json.dumps(figures, allow_nan=False)
    assert figures["sent"] == len(model.fate)
    assert figures["sent"] == figures["delivered"] + figures["dropped"] + figures["in_flight"]
    for fate in ("delivered", "lost", "overtaken"):
        assert figures[fate] == model.fate.count(fate)
    assert figures["dropped"] == figures["lost"] + figures["overtaken"]
    assert figures["substitutions"] == model.substitutions
    delays = [entry.arrival - entry.sent for entry in delivered(d)]
    if not delays:
        assert figures["mean_delay_s"] is figures["max_delay_s"] is figures["max_age_s"] is None
        return
    mean = Fraction(sum(delays), len(delays) * 10**9)
    assert figures["mean_delay_s"] == pytest.approx(float(mean), rel=1e-15)
    assert figures["max_delay_s"] == max(delays) / 1e9
    assert figures["max_age_s"] == (None if model.max_age is None else model.max_age / 1e9)


@given(links, ends)
def test_never_early_and_in_order(link: PacketLink, end: int) -> None:
    """No delivery before sent + delay; under fifo none before its predecessor's."""
    d = deliver(link, end)
    assert all(entry.arrival >= entry.sent + link.delay_ns for entry in delivered(d))
    if link.order == "fifo":
        accepted = [entry.message for entry in delivered(d)]
        assert accepted == sorted(accepted)
        assert "overtaken" not in fates(d)


@given(links, ends, st.integers(1, 40))
def test_longer_run_begins_with_the_shorter(link: PacketLink, end: int, more: int) -> None:
    """What becomes of a message does not depend on the length of the run."""
    short, long = deliver(link, end), deliver(link, end + more)
    assert [entry for entry in entries(long) if entry.arrival <= end] == entries(short)


def test_seed_and_name_decide_the_draws() -> None:
    """Same seed and name, same delivery; another of either, another one."""
    jitter = Jitter("uniform", width_ns=10**6)
    one = PacketLink("a", 10**6, jitter=jitter, seed=1)
    again = PacketLink("a", 10**6, jitter=jitter, seed=1)
    first = np.array(arrivals(deliver(one, 10**8)))
    assert first.tolist() == arrivals(deliver(again, 10**8))
    for other in (
        PacketLink("a", 10**6, jitter=jitter, seed=2),
        PacketLink("b", 10**6, jitter=jitter, seed=1),
    ):
        assert (np.array(arrivals(deliver(other, 10**8))) != first).mean() > 0.9


def test_loss_does_not_change_delays() -> None:
    """Changing the loss changes which messages are lost and no delay."""
    jitter = Jitter("normal", sigma_ns=10**6)
    few, many = (
        deliver(PacketLink("a", 10**7, jitter=jitter, loss=p, seed=1), 10**10) for p in (0.1, 0.6)
    )
    assert arrivals(few)[:-9] == arrivals(many)[:-9]
    lost = [{entry.message for entry in entries(d) if entry.fate == "lost"} for d in (few, many)]
    assert lost[0] < lost[1]  # the same numbers against a higher threshold


@pytest.mark.parametrize("order", ["newest-wins", "fifo", "as-arrived"])
@pytest.mark.parametrize("step", [None, 10])
def test_link_without_delay_passes_values_on(order: str, step: int | None) -> None:
    """Without delay, jitter and loss, sampled at each point, a link is a wire."""
    d, points = deliver(PacketLink("wire", 10, order=order), 1000, step), np.arange(0, 1001, 10)
    assert (d.sent_in_use(points) == points).all()
    assert (d.state(points).age_s == 0).all()
    assert d.statistics(1000)["max_age_s"] == 10 / 1e9


def test_constant_delay_by_hand() -> None:
    """Period 10, delay 25: message k is in use from 10 k + 25 on, its age 25 to 35."""
    d = deliver(PacketLink("a", 10, delay_ns=25), 100)
    assert d.sendings(-1, 100).tolist() == [*range(0, 101, 10)]
    times, sent = d.changes(-1, 100)
    assert times.tolist() == [*range(25, 101, 10)]
    assert sent.tolist() == [*range(0, 80, 10)]
    assert d.sent_in_use([0, 10, 20, 25, 30, 35, 40]).tolist() == [-1, -1, -1, 0, 0, 10, 10]
    assert d.statistics(100)["max_age_s"] == 35 / 1e9
    assert d.statistics(100)["in_flight"] == 3  # sent at 80, 90, 100
    state = d.state([24, 25, 34, 35])  # before the first delivery the value is as old as the run
    assert np.rint(state.age_s * 1e9).tolist() == [24, 25, 34, 25]
    assert state.sequence.tolist() == [-1, 0, 0, 1]


def test_messages_that_arrive_together() -> None:
    """Of messages that arrive at one instant none is overtaken, and the last sent is in use."""
    d = deliver(PacketLink("a", 5), 30, 10)
    assert [entry.sent for entry in delivered(d)] == [0, 10, 10, 20, 20, 30, 30]
    assert arrivals(d) == [0, 10, 10, 20, 20, 30, 30]
    assert d.statistics(30)["overtaken"] == 0
    assert d.state([0, 10, 20, 30]).sequence.tolist() == [0, 2, 4, 6]


@given(links, ends, st.integers(1, 20))
def test_grid_rounds_up(link: PacketLink, end: int, step: int) -> None:
    """On a grid sends and arrivals are rounded up to the points, in exact integers."""
    d, grid = deliver(link, end, step), [*range(0, end, step), end]

    def up(t: int) -> int:
        return min((p for p in grid if p >= t), default=t)

    sent = [up(t) for t in instants(link, end)]
    assert d.sendings(-1, end).tolist() == sorted({*sent})
    model = Receiver(link, end, sent, *drawn(link, len(sent)), rounded=up)
    assert d.sent_in_use(grid).tolist() == in_use(model, grid)
    assert {entry.arrival for entry in delivered(d)} <= {*grid}
    assert all(entry.arrival >= entry.sent + link.delay_ns for entry in delivered(d))


def test_bad_ends_and_steps_are_refused() -> None:
    """Before the run, and by name."""
    for arguments in ((-1,), (100, 0), (100, -5)):
        with pytest.raises(InputError, match=r"'a'(.|\n)*expected: [01] to 2"):
            deliver(PacketLink("a", 7), *arguments)


def test_too_many_messages() -> None:
    """A period of 1 ns over an hour is taken for seconds mistaken for nanoseconds."""
    with pytest.raises(InputError, match=r"at most 1000000000(.|\n)*nanoseconds"):
        Delivery(PacketLink("a", 1), 3600 * 10**9)


def test_a_day_of_messages_begins_at_once() -> None:
    """None is drawn before it is needed."""
    link, day = PacketLink("a", 10**6, delay_ns=5), 86_400 * 10**9
    d = Delivery(link, day)
    d.advance(10**6)
    assert d.sent_in_use([4, 5, 10**6]).tolist() == [-1, 0, 0]
    assert d.sendings(day - 10**6, day).tolist() == [day]


def test_messages_that_take_too_long_to_send() -> None:
    """512 frames of 2**53 ns would end beyond the instants that an integer holds."""
    link = PacketLink("a", 1, data_rate=1_000_000_000, frame_size=2**53)
    assert deliver(link, 510).statistics(510)["in_flight"] == 511
    with pytest.raises(InputError, match="longer to send than can be counted") as caught:
        deliver(link, 511)
    assert caught.value.got == f"512 messages of {2**53} ns"


def test_the_mean_of_long_delays_is_exact() -> None:
    """Four thousand delays of 52 days add up to more than 64 bits hold."""
    link = PacketLink("a", 2**40, delay_ns=2**52)
    figures = deliver(link, 2**53).statistics(2**53)
    assert figures["delivered"] == 2**12 + 1
    assert figures["mean_delay_s"] == 2**52 / 1e9
