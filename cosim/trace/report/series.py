"""The signals of a trace as curves: component, direction, name, unit, times, values."""

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
"""Times beyond are counted from 1970, and shown from the first message on."""
_NOT_DRAWN = (LOG_TOPIC, FRAME_TOPIC, POSE_TOPIC)
_STAMP = ("timestamp.", "header.stamp.", "stamp.")
"""Fields that say again when a message was."""


@dataclass(frozen=True)
class Series:
    """One signal over time.

    Attributes
    ----------
    component, direction : of the topic `/component/direction`; a link has the direction
        "link", any other topic is a component without a direction.
    t, values : [s] and in `unit`, same shape; NaN where there is no number.
    stepwise : the value goes on until the next, so that it is drawn as steps.
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
    tables : by topic, as far as they could be read; `unread` says why the others were not.
    series : every signal that is a number.
    origin_ns : the log time that is shown as t = 0.
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
        """Times as they are shown [s]."""
        return (time_ns - self.origin_ns) / 1e9

    def of(self, component: str, direction: str) -> dict[str, Series]:
        """Signals of one topic of a component, by name."""
        return {
            s.name: s for s in self.series if s.component == component and s.direction == direction
        }

    def links(self) -> dict[str, tuple[Table | None, Table | None]]:
        """Delivered and dropped messages, by link."""
        found: dict[str, tuple[Table | None, Table | None]] = {}
        for topic in self.trace.topics:
            name = topic.removeprefix("/link/")
            if name == topic:
                continue
            link = name.removesuffix("/dropped")
            found[link] = (
                self.tables.get(f"/link/{link}"),
                self.tables.get(f"/link/{link}/dropped"),
            )
        return found

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
                values = column[order].astype(np.float64)
                present = table.present.get(name)
                if present is not None:
                    values = np.where(present[order], values, np.nan)
                stepwise = direction in {"input", "link"} or _steps(signal, info.metadata)
                yield Series(topic, component, direction, name, signal.unit, t, values, stepwise)


def _place(topic: str) -> tuple[str, str]:
    """Component and direction of a topic."""
    parts = topic.strip("/").split("/")
    if len(parts) == 2 and parts[0] == "link":
        return parts[1], "link"
    if len(parts) == 2 and parts[1] in {"input", "output"}:
        return parts[0], parts[1]
    return topic, ""


def _steps(signal: Signal, metadata: Mapping[str, str]) -> bool:
    """Whether a signal holds its value; a foreign topic that does not say is a curve."""
    if not any(key.endswith(".hold") for key in metadata):
        return signal.kind == "bool"
    return signal.hold != "continuous"
