"""Read the signals of a trace as curves: component, direction, name, unit, times, values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, LossError
from cosim.trace import Table, Trace
from cosim.trace.report.decimation import Indices, decimated
from cosim.trace.report.link_record import LinkRecord, LoopRecord, Points
from cosim.trace.rows.layout import (
    FRAME_TOPIC,
    LOG_TOPIC,
    VEHICLE,
    Signal,
    dropped_topic,
    input_topic,
    link_topic,
    pose_topic,
)

Reals = NDArray[np.float64]

_EPOCH_NS = 10**17
"""Later times are those of a wall clock, and shown from the first message on."""
LARGE = 4_000_000
"""Values of a trace that are read at once; of more, only points to draw are kept."""

WILD = 1e12
"""Values beyond are no sensible numbers."""

_SEGMENTS = 3000
_POSE = ("eta.", "reference.")
_NOT_DRAWN = (LOG_TOPIC, FRAME_TOPIC, pose_topic(VEHICLE))
_STAMP = ("timestamp.", "header.stamp.", "stamp.")
"""Fields that repeat the time of a message."""


@dataclass(frozen=True)
class DrawnSeries:
    """One signal over time.

    Attributes
    ----------
    component, direction : of the topic `/component/direction`; a link has the direction
        "link", any other topic is a component with the direction "".
    t, values : [s] and in `unit`, same shape; NaN where there is no number.
    stepwise : the value holds until the next one, and is drawn as steps.
    count, gaps : number of values in the trace, and of those that are no finite numbers; a large
        trace has more than there are points.
    """

    topic: str
    component: str
    direction: str
    name: str
    unit: str | None
    t: Reals
    values: Reals
    stepwise: bool
    count: int
    gaps: int

    @property
    def full_name(self) -> str:
        """`component.name`."""
        return f"{self.component}.{self.name}"


class Recording:
    """A trace with its topics read, and thinned if it is large.

    A large trace is read part by part. Of each signal and age the points that a drawing needs are
    kept: first, last, least and greatest of each segment of time, and the first value beyond all
    numbers. What is counted or measured is exact.

    Attributes
    ----------
    unread : by topic, why it could not be read.
    log : the lines of the log; None without.
    series : every signal of numbers.
    links : by name.
    loop : the age of the measurement behind the command in force; None without a loop.
    origin_ns : log time that is shown as t = 0 [ns].
    end_ns : greatest log time [ns].
    """

    def __init__(self, trace: Trace) -> None:
        self.trace = trace
        self.unread: dict[str, str] = {}
        topics = [t for t, info in trace.topics.items() if info.count and not info.is_computed]
        while True:
            self.log: Table | None = None
            self._signals: dict[tuple[str, str], _Signal] = {}
            self.links = {name: LinkRecord() for name in trace.link_names}
            self._pair, self.loop = self._loop()
            readable = [topic for topic in topics if topic not in self.unread]
            try:
                self._read(readable)
                break
            except (InputError, LossError):
                self._try_each(readable)
        spans = [trace.spans[topic] for topic in readable]
        first = min((low for low, _ in spans), default=0)
        self.origin_ns = first if first > _EPOCH_NS else 0
        self.end_ns = max((high for _, high in spans), default=0)
        for link in self.links.values():
            link.finish(self.end_ns)
        self.series = [
            signal.series(self.seconds) for signal in self._signals.values() if signal.count
        ]

    def seconds(self, time_ns: NDArray[np.int64]) -> Reals:
        """Convert log times [ns] to the times shown [s]."""
        return (time_ns - self.origin_ns) / 1e9

    def of(self, component: str, direction: str) -> dict[str, DrawnSeries]:
        """Return the signals of one topic of a component, by name."""
        return {
            s.name: s for s in self.series if s.component == component and s.direction == direction
        }

    def _read(self, topics: list[str]) -> None:
        trace = self.trace
        sizes = (trace.topics[t].count * (len(trace.topics[t].signals) + 3) for t in topics)
        if sum(sizes) <= LARGE:
            self._add(trace.read_all(topics), None)
            return
        streamed = [t for t in topics if trace.topics[t].encoding == "protobuf"]
        spans = [trace.spans[topic] for topic in topics]
        first, last = min(low for low, _ in spans), max(high for _, high in spans)
        for tables in trace.parts(streamed):
            times = [t.log_time_ns for t in tables.values()]
            length = max(int(t.max()) for t in times) - min(int(t.min()) for t in times)
            self._add(tables, 1 + _SEGMENTS * length // max(last - first, 1))
        for topic in topics:
            if topic not in streamed:
                self._add({topic: trace.read(topic)}, _SEGMENTS)

    def _try_each(self, topics: list[str]) -> None:
        """Find the topics that cannot be read."""
        for topic in topics:
            try:
                for _ in self.trace.parts([topic]):
                    pass
            except (InputError, LossError) as error:
                self.unread[topic] = ", ".join(filter(None, (error.what, error.got)))

    def _add(self, tables: Mapping[str, Table], segments: int | None) -> None:
        for topic, table in tables.items():
            if topic == LOG_TOPIC:
                self.log = table.after(self.log)
            if topic not in _NOT_DRAWN and not topic.endswith("/dropped"):
                self._add_signals(table, segments)
        for name, link in self.links.items():
            delivered, dropped = link_topic(name), dropped_topic(name)
            link.add(tables.get(delivered), tables.get(dropped), segments)
        if self._pair is not None and self.loop is not None:
            up, down, points = (tables.get(topic) for topic in self._pair)
            at = np.zeros(0, np.int64) if points is None else points.log_time_ns
            self.loop.add(up, down, at, segments)

    def _add_signals(self, table: Table, segments: int | None) -> None:
        if not len(table):
            return
        info = self.trace.topics[table.topic]
        component, direction = _place(table.topic)
        order = np.argsort(table.log_time_ns, kind="stable")
        t = table.log_time_ns[order]
        known = {s.name: s for s in info.signals}
        together: dict[str, Reals] = {}
        for name, column in table.columns.items():
            if column.dtype.kind not in "fiub" or name.startswith(_STAMP):
                continue
            signal = self._signals.get((table.topic, name))
            if signal is None:
                described = known.get(name, Signal(name))
                stepwise = direction in {"input", "link"} or _steps(described, info.metadata)
                place = table.topic, component, direction, name, described.unit
                signal = _Signal(place, stepwise=stepwise)
                self._signals[table.topic, name] = signal
            values = np.where(table.present[name], column.astype(np.float64), np.nan)[order]
            if name.startswith(_POSE):
                together[name] = values
            else:
                signal.add(t, values, signal.kept(t, values, segments))
        kept = [self._signals[table.topic, n].kept(t, v, segments) for n, v in together.items()]
        for name, values in together.items():  # a pose is drawn as a path: its rows stay together
            self._signals[table.topic, name].add(t, values, np.unique(np.concatenate(kept)))

    def _loop(self) -> tuple[tuple[str, str, str] | None, LoopRecord | None]:
        """Return the topics of the links up and down and of the points, if there is one loop."""
        trace = self.trace
        step = trace.run.get("step_ns", "")
        outputs = [t for t, info in trace.topics.items() if t.endswith("/output") and info.count]
        links = [link_topic(name) for name in self.links]
        there = [t for t in links if t in trace.topics and trace.topics[t].count]
        pairs = [(up, down) for up in there for down in there if self._closes(up, down)]
        if len(pairs) != 1 or not step.isdecimal() or not int(step) or not outputs:
            return None, None
        points = max(outputs, key=lambda topic: trace.topics[topic].count)
        return (*pairs[0], points), LoopRecord(int(step), trace.spans[points])

    def _closes(self, up: str, down: str) -> bool:
        """Whether `up` comes from a plant and `down` from its controller, which has references."""
        topics = self.trace.topics
        plant, controller = (
            {signal.name.partition(".")[0] for signal in topics[t].signals} for t in (up, down)
        )
        if plant == controller or len(plant) != 1 or len(controller) != 1:
            return False
        inputs = topics.get(input_topic(next(iter(controller))))
        return inputs is not None and any(s.name.startswith("reference.") for s in inputs.signals)


class _Signal:
    """The points kept of one signal, and how many there were."""

    def __init__(self, place: tuple[str, str, str, str, str | None], *, stepwise: bool) -> None:
        self.count = self._gaps = 0
        self._place, self._stepwise = place, stepwise
        self._points = Points()
        self._wild = False

    def kept(self, t: NDArray[np.int64], values: Reals, segments: int | None) -> Indices:
        """Return the numbers of the points to keep of a part."""
        if segments is None:
            return np.arange(t.size)
        chosen = [decimated((t - t[0]) / 1e9, values, segments, stepwise=self._stepwise)]
        wild = ~np.isfinite(values) | (np.abs(values) > WILD)
        if not self._wild and wild.any():
            self._wild = True
            chosen.append(np.array([int(np.argmax(wild))]))
        return np.unique(np.concatenate(chosen))

    def add(self, t: NDArray[np.int64], values: Reals, kept: Indices) -> None:
        self.count += t.size
        self._gaps += t.size - int(np.isfinite(values).sum())
        self._points.add(t[kept], values[kept], None)

    def series(self, seconds: Callable[[NDArray[np.int64]], Reals]) -> DrawnSeries:
        times, values = self._points.points()
        if (np.diff(times) < 0).any():
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
        t = seconds(times)
        return DrawnSeries(*self._place, t, values, self._stepwise, self.count, self._gaps)


def _place(topic: str) -> tuple[str, str]:
    """Return component and direction of a topic."""
    parts = topic.strip("/").split("/")
    if len(parts) == 2 and parts[0] == "link":
        return parts[1], "link"
    if len(parts) == 2 and parts[1] in {"input", "output"}:
        return parts[0], parts[1]
    return topic, ""


def _steps(signal: Signal, metadata: Mapping[str, str]) -> bool:
    """Whether a signal holds its value; in files of other tools, only booleans do."""
    if not any(key.endswith(".hold") for key in metadata):
        return signal.kind == "bool"
    return signal.hold != "continuous"
