"""A link that replays a recording does to every message what was done to the recorded one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from fates import arrivals, fates

from cosim.core import InputError
from cosim.network import (
    IN_FLIGHT_NS,
    DelayProfile,
    Delivery,
    Jitter,
    LossWindow,
    PacketLink,
    Recording,
    deliver,
)

SENT = np.arange(6) * 10
LOST = np.array([0, 1, 0, 0, 1, 0], bool)
DELAY = np.array([3, 4, 15, 2, 1, 7])


def recorded(**changes: Any) -> Recording:
    """Six messages, each 10 ns; two are lost."""
    return replace(Recording(SENT, LOST, DELAY), **changes)


def test_each_message_has_its_own_row() -> None:
    """Instants by hand: of those that came, and of those that did not when they were due."""
    link = PacketLink("up", 10, offset_ns=5, recording=recorded(), order="as-arrived")
    d = deliver(link, 60)
    assert arrivals(d) == [8, 19, 40, 37, 46, -1]
    assert fates(d) == ["delivered", "lost", "delivered", "delivered", "lost", "in flight"]
    assert LOST.tolist() == [False, True, False, False, True, False]


def delays(link: PacketLink, end: int) -> np.ndarray:
    """From sending to arrival, by message, of those that came or were due in the run."""
    when, sent, sequence, _ = deliver(replace(link, order="as-arrived"), end).arrivals()
    found = np.zeros(int(sequence.max()) + 1, np.int64)
    found[sequence] = when - sent
    return found


def test_blocks_are_whole_and_drawn_by_the_seed() -> None:
    """Inside a block rows follow each other; blocks begin anywhere; another seed, other blocks."""
    n, block = 50, 7
    recording = Recording(np.arange(n) * 10, np.zeros(n, bool), np.arange(n), "blocks", block)
    link = PacketLink("up", 10, recording=recording)
    rows = delays(link, 9_999)[: 140 * block].reshape(-1, block)
    assert (np.diff(rows, axis=1) == 1).all()
    starts = set(rows[:, 0].tolist())
    assert min(starts) == 0
    assert max(starts) == n - block
    assert len(starts) > 35
    other = delays(replace(link, seed=1), 9_999)
    assert other.tolist() != delays(link, 9_999).tolist()


def test_in_flight_at_the_end_of_the_recording_is_in_flight_at_the_end_of_the_run() -> None:
    """Replayed once it never comes; a loop, and blocks, end before it."""
    flight = recorded(delay_ns=np.array([3, 4, 15, 2, 1, IN_FLIGHT_NS]))
    once = deliver(PacketLink("up", 10, recording=flight), 59)
    assert once.statistics(59)["in_flight"] == 1
    loop = PacketLink("up", 10, recording=flight.played("loop"))
    assert delays(loop, 99).tolist() == [3, 4, 15, 2, 1] * 2


def test_an_outage_is_laid_over_a_recording() -> None:
    """A window of loss 1 loses what the recording would deliver; one of 0 delivers all."""
    windows = (LossWindow(0, 21, 1.0), LossWindow(40, 50, 0.0))
    link = PacketLink("up", 10, recording=recorded(), windows=windows, order="as-arrived")
    assert fates(deliver(link, 59)) == ["lost"] * 3 + ["delivered"] * 3


def test_by_time_a_message_takes_the_last_row_before_it() -> None:
    """Recorded each 10 ns, sent each 4 ns: rows come twice or thrice, in their own time."""
    link = PacketLink("up", 4, recording=recorded(rows="time"))
    assert delays(link, 50)[:13].tolist() == [3, 3, 3, 4, 4, 15, 15, 15, 2, 2, 1, 1, 1]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"sent_ns": SENT[::-1]}, ["out of order", "message 0"]),
        ({"sent_ns": SENT + 1}, ["out of order", "message 0", "sent 1 ns"]),
        ({"delay_ns": DELAY - 3}, ["message 4", "delay -2"]),
        ({"delay_ns": DELAY[1:]}, ["a row for each message", "(5,)", "(6,)"]),
        ({"replay": "again"}, ["replay", "once, loop, blocks"]),
        ({"replay": "blocks"}, ["recording.block", "blocks"]),
        ({"block": 3}, ["recording.block", "once"]),
        ({"rows": "number"}, ["rows", "message, time"]),
    ],
)
def test_what_is_no_recording_is_refused(changes: dict[str, Any], words: list[str]) -> None:
    """The message names the key or the first bad row."""
    with pytest.raises(InputError) as refused:
        recorded(**changes)
    for word in words:
        assert word in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "end", "words"),
    [
        ({}, 60, ["'up'", "ends before the run", "7", "got: 6", "loop"]),
        ({"sample_time_ns": 12}, 50, ["rhythm", "message 3 about", "rows"]),
        ({"recording": recorded(replay="blocks", block=7)}, 60, ["shorter than one block", "6"]),
        ({"delay_ns": 3}, 50, ["delay", "recording says"]),
        ({"delay": DelayProfile([0], [1])}, 50, ["delay", "recording says"]),
        ({"jitter": Jitter("uniform", width_ns=3)}, 50, ["jitter", "recording says"]),
        ({"loss": 0.1}, 50, ["loss", "recording says"]),
        ({"recording": "log.csv"}, 50, ["recording of the wrong type", "'log.csv'"]),
        ({"playout_ns": 1}, 50, ["every message would be late", "at least 2 ns"]),
    ],
)
def test_a_recording_that_does_not_fit_its_link_is_refused(
    changes: dict[str, Any], end: int, words: list[str]
) -> None:
    """It must last as long as the run, have its rhythm, and stand alone."""
    given = {"sample_time_ns": 10, "recording": recorded()} | changes
    with pytest.raises(InputError) as refused:
        Delivery(PacketLink("up", **given), end)
    for word in words:
        assert word in str(refused.value)


def test_losses_alone_leave_delay_and_jitter_to_the_link() -> None:
    """Of a log without times of arrival."""
    jitter = Jitter("uniform", width_ns=5)
    link = PacketLink("up", 10, delay_ns=9, jitter=jitter, recording=recorded(delay_ns=None))
    link = replace(link, order="as-arrived")
    found, plain = deliver(link, 59), deliver(replace(link, recording=None), 59)
    assert arrivals(found)[:5] == arrivals(plain)[:5]
    assert [fate == "lost" for fate in fates(found)[:5]] == LOST.tolist()[:5]


def test_recordings_are_what_their_rows_say() -> None:
    """Equal rows, equal links: `repr` decides whether sessions share a snapshot."""
    assert recorded() == recorded()
    assert PacketLink("up", 10, recording=recorded()) == PacketLink("up", 10, recording=recorded())
    others = [recorded(lost=~LOST), recorded(delay_ns=DELAY + 1), recorded(delay_ns=None)]
    others += [recorded(replay="loop"), recorded(sent_ns=SENT * 2)]
    assert len({recorded(), *others}) == len({repr(each) for each in [recorded(), *others]}) == 6
