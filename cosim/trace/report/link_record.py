"""Collect what a report shows of a link, and of the loop over two links, part by part."""

from __future__ import annotations

from collections import Counter

import numpy as np
from numpy.typing import NDArray

from cosim.trace import Table
from cosim.trace.outcome import BURST
from cosim.trace.report.decimation import decimated
from cosim.trace.tables.traffic import loop_age

_ARRIVED = ("overtaken", "duplicate")
"""Reasons of messages that arrived and were not used."""

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]


class Points:
    """Points over time [ns], collected part by part, and thinned in each part if that is asked."""

    def __init__(self) -> None:
        self._parts: list[tuple[Integers, Reals]] = []

    def add(self, t_ns: Integers, values: Reals, segments: int | None) -> None:
        """Add points, of times that do not decrease; segments : see `decimated`; None keeps all."""
        if segments is not None:
            kept = decimated((t_ns - t_ns[:1]) / 1e9, values, segments)
            t_ns, values = t_ns[kept], values[kept]
        self._parts.append((t_ns, values))

    def points(self) -> tuple[Integers, Reals]:
        """Return times [ns] and values."""
        empty = np.zeros(0, np.int64), np.zeros(0)
        t, values = zip(*(self._parts or [empty]), strict=True)
        return np.concatenate(t), np.concatenate(values)


class LinkRecord:
    """The messages of one link, in order of delivery.

    Attributes
    ----------
    delivered : number of messages.
    reasons : number of dropped messages by reason.
    delay_ns, largest_delay_ns : sum and largest of the times from sending to delivery.
    largest_age_ns, silence_ns : of the message in use; longest time between two deliveries.
    dropped : times of due and sending, and number of each dropped message; and its reason.
    bursts_ns : from the first to after the last of at least `BURST` messages that did not arrive;
        None where none arrived afterwards.
    """

    def __init__(self) -> None:
        self.delivered = 0
        self.reasons: Counter[str] = Counter()
        self.delay_ns = self.largest_delay_ns = self.largest_age_ns = self.silence_ns = 0
        self.dropped: list[tuple[Integers, list[str]]] = []
        self.bursts_ns: list[tuple[int, int | None]] = []
        self._age, self._deliveries = Points(), Points()
        self._last: tuple[int, int] | None = None
        self._missed, self._missed_since_ns = 0, 0

    def add(self, delivered: Table | None, dropped: Table | None, segments: int | None) -> None:
        """Take the next messages; segments : see `Points.add`."""
        self._add_bursts(delivered, dropped)
        if dropped is not None and len(dropped):
            self._add_dropped(dropped, segments)
        if delivered is None or not len(delivered):
            return
        delays = delivered.log_time_ns - delivered.publish_time_ns
        self.delivered += len(delivered)
        self.delay_ns += int(delays.sum())
        self.largest_delay_ns = max(self.largest_delay_ns, int(delays.max()))
        order = np.argsort(delivered.log_time_ns, kind="stable")
        arrived, age = delivered.log_time_ns[order], delays[order]
        self._deliveries.add(arrived, np.zeros(arrived.size), segments)
        if self._last is not None:
            arrived = np.append(self._last[0], arrived)
            age = np.append(self._last[1], age)
        self._sawtooth(arrived[:-1], age[:-1], arrived[1:], segments)
        self._last = int(arrived[-1]), int(age[-1])

    def finish(self, end_ns: int) -> None:
        """Let the last message be in use up to the end [ns]."""
        self._end_burst(None)
        if self._last is None:
            return
        arrived, age = (np.array([each], np.int64) for each in self._last)
        self._sawtooth(arrived, age, np.maximum(arrived, end_ns), None)
        self._last = None

    def ages(self) -> tuple[Integers, Reals]:
        """Return times [ns] and age [s] of the message in use, the corners of a sawtooth."""
        return self._age.points()

    def deliveries_ns(self) -> Integers:
        """Return the times of the deliveries [ns]."""
        return self._deliveries.points()[0]

    def _sawtooth(
        self, arrived: Integers, age: Integers, until: Integers, segments: int | None
    ) -> None:
        if not arrived.size:
            return
        t = np.column_stack([arrived, until]).ravel()
        ages = np.column_stack([age, age + until - arrived]).ravel()
        self.silence_ns = max(self.silence_ns, int((until - arrived).max()))
        self.largest_age_ns = max(self.largest_age_ns, int(ages.max()))
        self._age.add(t, ages / 1e9, segments)

    def _add_bursts(self, delivered: Table | None, dropped: Table | None) -> None:
        """Follow how many messages in a row did not arrive."""
        arrived = np.zeros(0, np.int64) if delivered is None else delivered.log_time_ns
        missed = np.zeros(0, np.int64) if dropped is None else _missed_ns(dropped)
        times = np.concatenate([missed, arrived])
        is_missed = np.arange(times.size) < missed.size
        order = np.argsort(times, kind="stable")
        is_missed, times = is_missed[order], times[order]
        starts = np.flatnonzero(np.diff(is_missed, prepend=~is_missed[:1]))
        for start, end in zip(starts, [*starts[1:], times.size], strict=True):
            if not is_missed[start]:
                self._end_burst(int(times[start]))
                continue
            if self._missed == 0:
                self._missed_since_ns = int(times[start])
            self._missed += int(end - start)

    def _end_burst(self, until_ns: int | None) -> None:
        if self._missed >= BURST:
            self.bursts_ns.append((self._missed_since_ns, until_ns))
        self._missed = 0

    def _add_dropped(self, dropped: Table, segments: int | None) -> None:
        reasons = dropped.columns.get("reason")
        words = ["dropped"] * len(dropped) if reasons is None else [str(each) for each in reasons]
        self.reasons.update(words)
        times = dropped.log_time_ns
        kept = np.arange(times.size)
        if segments is not None:
            kept = decimated((times - times[0]) / 1e9, np.zeros(times.size), segments)
        heads = np.array([times, dropped.publish_time_ns, dropped.sequence])[:, kept]
        self.dropped.append((heads, [words[i] for i in kept]))


def _missed_ns(dropped: Table) -> Integers:
    """Return when messages were due that did not arrive; others were overtaken by newer ones."""
    reasons = dropped.columns.get("reason")
    if reasons is None:
        return dropped.log_time_ns
    return dropped.log_time_ns[[str(each) not in _ARRIVED for each in reasons]]


class LoopRecord:
    """The age of the measurement behind the command in force, over a link up and a link down.

    Parameters
    ----------
    step_ns : communication step [ns].
    span_ns : first and last communication point [ns]; ages beyond do not count.
    """

    def __init__(self, step_ns: int, span_ns: tuple[int, int]) -> None:
        self._step_ns, self._span_ns = step_ns, span_ns
        self._age = Points()
        self._up: Table | None = None
        self._down: Table | None = None

    def add(
        self, up: Table | None, down: Table | None, points: Integers, segments: int | None
    ) -> None:
        """Take the next messages of both links, and the instants of communication points."""
        self._up = self._up if up is None else up.after(self._up)
        self._down = self._down if down is None else down.after(self._down)
        if self._up is None or self._down is None:
            return
        arrivals = np.zeros(0, np.int64) if down is None else down.log_time_ns
        at = np.unique(np.concatenate([points, arrivals, arrivals - 1]))
        t, age = loop_age(self._up, self._down, at, self._step_ns)
        inside = np.isin(t, at) & (t >= self._span_ns[0]) & (t <= self._span_ns[1])
        if inside.any():
            self._age.add(t[inside], age[inside], segments)
        # what is in force at the end, and what it leads back to
        self._down = self._down.part(np.arange(max(len(self._down) - 1, 0), len(self._down)))
        sent = int(self._down.publish_time_ns.min()) - self._step_ns
        first = int(np.searchsorted(self._up.log_time_ns, sent, side="right")) - 1
        self._up = self._up.part(np.arange(max(first, 0), len(self._up)))

    def ages(self) -> tuple[Integers, Reals]:
        """Return times [ns] and ages [s]."""
        return self._age.points()
