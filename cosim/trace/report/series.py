"""Read the signals of a trace as curves: component, direction, name, unit, times, values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, LossError
from cosim.trace import Table, Trace
from cosim.trace.layout import FRAME_TOPIC, LOG_TOPIC, POSE_TOPIC, Signal

Reals = NDArray[np.float64]

_EPOCH_NS = 10**17
"""Later times are those of a wall clock, and shown from the first message on."""
_NOT_DRAWN = (LOG_TOPIC, FRAME_TOPIC, POSE_TOPIC)
_STAMP = ("timestamp.", "header.stamp.", "stamp.")
"""Fields that repeat the time of a message."""


@dataclass(frozen=True)
class Series:
    """One signal over time.

    Attributes
    ----------
    component, direction : of the topic `/component/direction`; a link has the direction
        "link", any other topic is a component with the direction "".
    t, values : [s] and in `unit`, same shape; NaN where there is no number.
    stepwise : the value holds until the next one, and is drawn as steps.
    """

    topic: str
    component: str
    direction: str
    name: str
    unit: str | None
    t: Reals
    values: Reals
    stepwise: bool

    @property
    def full_name(self) -> str:
        """`component.name`."""
        return f"{self.component}.{self.name}"


class Recording:
    """A trace with its topics read.

    Attributes
    ----------
    tables : by topic, of those that could be read; `unread` has the reason for the others.
    series : every signal of numbers.
    origin_ns : log time that is shown as t = 0 [ns].
    """

    def __init__(self, trace: Trace) -> None:
        self.trace = trace
        self.tables: dict[str, Table] = {}
        self.unread: dict[str, str] = {}
        for topic, info in trace.topics.items():
            if not info.count:
                continue
            try:
                self.tables[topic] = trace.read(topic)
            except (InputError, LossError) as error:
                self.unread[topic] = ", ".join(filter(None, (error.what, error.got)))
        starts = [int(t.log_time_ns.min()) for t in self.tables.values() if len(t)]
        first = min(starts, default=0)
        self.origin_ns = first if first > _EPOCH_NS else 0
        self.series = list(self._series())

    def seconds(self, time_ns: NDArray[np.int64]) -> Reals:
        """Convert log times [ns] to the times shown [s]."""
        return (time_ns - self.origin_ns) / 1e9

    def of(self, component: str, direction: str) -> dict[str, Series]:
        """Return the signals of one topic of a component, by name."""
        return {
            s.name: s for s in self.series if s.component == component and s.direction == direction
        }

    def links(self) -> dict[str, tuple[Table | None, Table | None]]:
        """Return delivered and dropped messages by link; None where there are none."""
        topics = [topic for topic in self.trace.topics if topic.startswith("/link/")]
        links = dict.fromkeys(topic.removesuffix("/dropped") for topic in topics)
        tables = self.tables
        return {
            link.removeprefix("/link/"): (tables.get(link), tables.get(f"{link}/dropped"))
            for link in links
        }

    def _series(self) -> Iterator[Series]:
        for topic, table in self.tables.items():
            if topic in _NOT_DRAWN or topic.endswith("/dropped") or not len(table):
                continue
            info = self.trace.topics[topic]
            component, direction = _place(topic)
            order = np.argsort(table.log_time_ns, kind="stable")
            t = self.seconds(table.log_time_ns[order])
            signals = {s.name: s for s in info.signals}
            for name, column in table.columns.items():
                if column.dtype.kind not in "fiub" or name.startswith(_STAMP):
                    continue
                signal = signals.get(name, Signal(name))
                values = np.where(table.present[name], column.astype(np.float64), np.nan)[order]
                stepwise = direction in {"input", "link"} or _steps(signal, info.metadata)
                yield Series(topic, component, direction, name, signal.unit, t, values, stepwise)


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
