"""Compare the rows of two traces, window of time by window."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.trace.comparison.tolerance import Tolerances, distances, exceeds
from cosim.trace.reader import Trace
from cosim.trace.rows.hold import rows_in_force, sample_and_hold
from cosim.trace.rows.layout import signal_name
from cosim.trace.tables.table import Table

Pair = tuple[Table, Table]
Seen = Callable[[str, str, NDArray[np.int64], NDArray[np.float64]], None]
"""Takes the topic and the name of a signal of numbers, instants [ns], and second minus first.

The difference is NaN where one of them has no value.
"""


@dataclass(frozen=True, slots=True)
class SignalDiff:
    """One signal in both traces.

    Attributes
    ----------
    name : as `Trace.signal` takes it.
    rows : number of rows in each.
    compared, differing : number of instants compared, and of those beyond the tolerance.
    max_abs, max_rel : largest differences, None where values are no finite numbers.
    max_at_s, first_s : time of the largest difference, and of the first beyond the tolerance [s].
    sample_and_hold : whether the rows are at other instants, and values in force were compared.
    """

    name: str
    topic: str
    unit: str | None
    rows: tuple[int, int]
    compared: int
    differing: int
    max_abs: float | None
    max_rel: float | None
    max_at_s: float | None
    first_s: float | None
    sample_and_hold: bool


@dataclass(frozen=True, slots=True)
class Window:
    """The rows of both traces in one window of time.

    Attributes
    ----------
    rows : by topic.
    alike : whether the topic has rows at the same instants in both traces, in all windows.
    """

    rows: Mapping[str, Pair]
    alike: Mapping[str, bool]


def in_step(a: Trace, b: Trace, topics: Sequence[str], *, prefix: bool) -> Iterator[Window]:
    """Yield the rows of topics in both traces, window by window.

    Topics whose rows are not in order of time, and JSON topics, come in one window.

    prefix : of b, only as many rows as a has.
    """
    limits = {t: a.topics[t].count for t in topics} if prefix else {}
    times = _times(a, topics, {}), _times(b, topics, limits)
    alike = {t: times[0][t][0] == times[1][t][0] for t in topics}
    whole = [t for t in topics if not _in_order(a, b, t, times)]
    for topic in whole:
        left, right = a.read(topic), b.read(topic)
        if prefix:
            right = right.part(np.arange(min(len(left), len(right))))
        same = np.array_equal(left.log_time_ns, right.log_time_ns)
        yield Window({topic: (left, right)}, {topic: same})
    streamed = [t for t in topics if t not in whole]
    borders = sorted({*a.borders(), *b.borders()})
    for one, two in zip(a.windows(streamed, borders), b.windows(streamed, borders), strict=True):
        rows = {}
        for topic in streamed:
            theirs = two[topic]
            if prefix:
                theirs = theirs.part(np.arange(min(limits[topic], len(theirs))))
                limits[topic] -= len(theirs)
            rows[topic] = one[topic], theirs
        yield Window(rows, alike)


def _in_order(
    a: Trace, b: Trace, topic: str, times: tuple[Mapping[str, tuple[bytes, bool]], ...]
) -> bool:
    protobuf = a.topics[topic].encoding == b.topics[topic].encoding == "protobuf"
    return protobuf and all(found[topic][1] for found in times)


def _times(
    trace: Trace, topics: Sequence[str], limits: Mapping[str, int]
) -> dict[str, tuple[bytes, bool]]:
    """Return a digest of the log times of each topic, and whether they do not decrease.

    limits : number of rows that count, by topic; all by default.
    """
    digests = {topic: hashlib.sha256() for topic in topics}
    ordered = dict.fromkeys(topics, True)
    last = dict.fromkeys(topics, 0)
    left = dict(limits)
    for block in trace.blocks():
        for number, mine in block.by_channel():
            topic = trace.channels[number].topic
            if topic not in digests:
                continue
            log = block.heads["log"][mine]
            if topic in left:
                log = log[: left[topic]]
                left[topic] -= log.size
            if log.size:
                ordered[topic] &= bool(log[0] >= last[topic] and (log[1:] >= log[:-1]).all())
                last[topic] = int(log[-1])
                digests[topic].update(log.tobytes())
    return {topic: (digests[topic].digest(), ordered[topic]) for topic in topics}


class _Signal:
    """What is found of one signal so far."""

    def __init__(self, unit: str | None) -> None:
        self.unit = unit
        self.differing = 0
        self.most, self.most_relative = -1.0, 0.0
        self.most_ns = self.first_ns = -1

    def add(
        self,
        instants: NDArray[np.int64],
        distance: NDArray[np.float64],
        relative: NDArray[np.float64],
        differs: NDArray[np.bool_],
    ) -> None:
        if not instants.size:
            return
        if self.first_ns < 0 and differs.any():
            self.first_ns = int(instants[int(np.argmax(differs))])
        self.differing += int(differs.sum())
        place = int(np.argmax(distance))
        if distance[place] > self.most:
            self.most, self.most_ns = float(distance[place]), int(instants[place])
        self.most_relative = max(self.most_relative, float(relative.max()))


class TopicDiff:
    """The comparison of one topic, fed with the rows of both traces in order of time.

    Parameters
    ----------
    tolerances : by the name of a signal.
    begin_ns, until_ns : where values in force are compared [ns]: from where both have begun, to
        where the shorter trace ends.
    seen : is given every difference, part by part.

    Attributes
    ----------
    only : names of the signals that only one of the traces has.
    """

    def __init__(
        self,
        topic: str,
        tolerances: Tolerances,
        begin_ns: int,
        until_ns: int,
        seen: Seen | None = None,
    ) -> None:
        self.only: tuple[dict[str, None], dict[str, None]] = {}, {}
        self._topic, self._tolerances = topic, tolerances
        self._begin_ns, self._until_ns = begin_ns, until_ns
        self._seen = seen
        self._alike = True
        self._in_force_before: Pair | None = None
        self._rows = [0, 0]
        self._compared = 0
        self._signals: dict[str, _Signal] = {}

    def add(self, a: Table, b: Table, *, alike: bool) -> None:
        """Take the next rows of both; alike : all rows of both are at the same instants."""
        self._alike = alike
        for k, table in enumerate((a, b)):
            self._rows[k] += len(table)
        for mine, theirs, only in ((a, b, self.only[0]), (b, a, self.only[1])):
            only.update(dict.fromkeys(n for n in mine.columns if n not in theirs.columns))
        for name in a.columns:
            if name in b.columns and name not in self._signals:
                self._signals[name] = _Signal(a.signals[name].unit)
        if alike:
            rows = np.arange(len(a))
            self._compare(a, b, a.log_time_ns, rows, rows)
            return
        instants = np.union1d(a.log_time_ns, b.log_time_ns)
        instants = instants[(instants >= self._begin_ns) & (instants <= self._until_ns)]
        if self._in_force_before is not None:
            a, b = a.after(self._in_force_before[0]), b.after(self._in_force_before[1])
        rows_a = rows_in_force(a.log_time_ns, instants)
        self._compare(a, b, instants, rows_a, rows_in_force(b.log_time_ns, instants))
        self._in_force_before = a.in_force(), b.in_force()

    def found(self) -> Iterator[SignalDiff]:
        """Yield the comparison of every signal that both traces have, after the last rows."""
        for name, one in self._signals.items():
            yield SignalDiff(
                name=signal_name(self._topic, name),
                topic=self._topic,
                unit=one.unit,
                rows=(self._rows[0], self._rows[1]),
                compared=self._compared,
                differing=one.differing,
                max_abs=_finite(one.most),
                max_rel=_finite(one.most_relative),
                max_at_s=None if one.most_ns < 0 else one.most_ns / 1e9,
                first_s=None if one.first_ns < 0 else one.first_ns / 1e9,
                sample_and_hold=not self._alike,
            )

    def _compare(
        self,
        a: Table,
        b: Table,
        instants: NDArray[np.int64],
        rows_a: NDArray[np.int64],
        rows_b: NDArray[np.int64],
    ) -> None:
        self._compared += int(instants.size)
        for name, one in self._signals.items():
            x, in_a = sample_and_hold(a[name], rows_a)
            y, in_b = sample_and_hold(b[name], rows_b)
            in_a &= sample_and_hold(a.present[name], rows_a)[0]
            in_b &= sample_and_hold(b.present[name], rows_b)[0]
            if self._seen is not None and x.dtype.kind in "fiub" and y.dtype.kind in "fiub":
                with np.errstate(all="ignore"):
                    apart = y.astype(np.float64) - x.astype(np.float64)
                there = np.where(in_a & in_b, apart, np.nan)
                self._seen(self._topic, signal_name(self._topic, name), instants, there)
            distance, relative = distances(x, y)
            distance[in_a != in_b] = relative[in_a != in_b] = np.inf
            distance[~in_a & ~in_b] = relative[~in_a & ~in_b] = 0.0
            allowed = self._tolerances.of(signal_name(self._topic, name))
            one.add(instants, distance, relative, exceeds(allowed, distance, relative))


def _finite(most: float) -> float | None:
    return max(most, 0.0) if np.isfinite(most) else None
