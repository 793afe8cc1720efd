"""Events of a run are the same whatever its blocks, and the log has no more than it can bear."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from hypothesis import given, strategies as st

from cosim.scenario.loss_bursts import FEWEST, Bursts
from cosim.scenario.run_events import MOST_LINES, Episodes, EventCollector
from cosim.trace import EventCount, RunEvent

TRUTHS = st.lists(st.booleans(), max_size=30)
CUTS = st.lists(st.integers(0, 30), max_size=3)
AT_LIMIT = RunEvent(0, "warning", "saturation", "c.force", "at its limit")
END_NS = 1000


def in_blocks(size: int, cuts: Sequence[int]) -> list[slice]:
    """Slices that cut so many items at these places."""
    places = sorted({0, size, *(min(cut, size) for cut in cuts)})
    return [slice(a, b) for a, b in pairwise(places)]


@given(TRUTHS, CUTS)
def test_episodes_are_where_it_is_true(there: list[bool], cuts: list[int]) -> None:
    """Begin, end and duration of each, found by hand; one that lasts ends with the run."""
    times = np.arange(len(there), dtype=np.int64) * 10
    collector = EventCollector()
    episodes = Episodes(collector, AT_LIMIT, "below again")
    for part in in_blocks(len(there), cuts):
        episodes.add(times[part], np.array(there, bool)[part])
    episodes.close(END_NS)
    wanted, total, since = [], 0, None
    for k, now in enumerate(there):
        if now and since is None:
            since = 10 * k
            wanted.append((since, "warning", "at its limit"))
        elif not now and since is not None:
            total += 10 * k - since
            since = None
            wanted.append((10 * k, "info", "below again"))
    total += 0 if since is None else END_NS - since
    assert [(e.time_ns, e.level, e.message) for e in collector.take(END_NS)] == wanted
    begun = [time for time, level, _ in wanted if level == "warning"]
    if not begun:
        assert collector.counts() == ()
        return
    (found,) = collector.counts()
    assert (found.count, found.first_s, found.total_s) == (len(begun), begun[0] / 1e9, total / 1e9)


@given(TRUTHS, CUTS)
def test_bursts_are_three_messages_missed_in_a_row(missed: list[bool], cuts: list[int]) -> None:
    """Begin at the third, end with the next that arrives: counted one message after the other."""
    times = np.arange(len(missed), dtype=np.int64) * 7
    collector = EventCollector()
    bursts = Bursts("up", collector)
    for part in in_blocks(len(missed), cuts):
        bursts.add(times[part], np.array(missed, bool)[part])
    bursts.close(END_NS)
    wanted, gone = [], 0
    for k, is_missed in enumerate(missed):
        if is_missed:
            gone += 1
            if gone == FEWEST:
                wanted.append((7 * k, "3 messages in a row did not arrive"))
        else:
            if gone >= FEWEST:
                wanted.append((7 * k, f"messages arrive again, after {gone} that did not"))
            gone = 0
    assert [(e.time_ns, e.message) for e in collector.take(END_NS)] == wanted


def test_log_has_a_bounded_number_of_lines_of_a_kind() -> None:
    """The last one says so; all are counted, and another subject has its own lines."""
    collector = EventCollector()
    episodes = Episodes(collector, AT_LIMIT, "below again")
    count = MOST_LINES + 50
    times = np.arange(2 * count, dtype=np.int64)
    episodes.add(times, times % 2 == 0)
    collector.begun(RunEvent(3, "warning", "saturation", "c.moment", "at its limit"))
    lines = collector.take(10**9)
    mine = [line for line in lines if line.subject == "c.force"]
    assert len(mine) == 2 * MOST_LINES
    assert sum("counted only" in line.message for line in mine) == 1
    assert [line.time_ns for line in lines] == sorted(line.time_ns for line in lines)
    first, other = collector.counts()
    assert (first.count, first.total_s) == (count, count / 1e9)
    assert first.words == "c.force: at its limit (450 times, 4.5e-07 s in all)"
    assert (other.count, other.words) == (1, "c.moment: at its limit")


def test_events_are_returned_once_and_not_before_their_time() -> None:
    """Only those up to an instant; the rest the next time."""
    collector = EventCollector()
    for time_ns in (5, 1, 9):
        collector.begun(RunEvent(time_ns, "info", "loss", "up", "x"))
    assert [e.time_ns for e in collector.take(5)] == [1, 5]
    assert [e.time_ns for e in collector.take(100)] == [9]
    assert collector.take(100) == []


def test_count_of_any_json_is_read() -> None:
    """What is no event is None; what is one reads as itself."""
    found = EventCount("loss", "up", "warning", "x", 2, 0.5, 1.5)
    assert EventCount.from_json(found.to_json()) == found
    for other in (None, [], {}, {"kind": "loss"}, {**found.to_json(), "first_s": "x"}):
        assert EventCount.from_json(other) is None
