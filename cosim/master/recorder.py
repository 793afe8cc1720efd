"""The trace of a run: every row as it is exchanged, every message as it is delivered."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.fmu import Port
from cosim.master.columns import Column
from cosim.master.course import Course, part_of
from cosim.master.journal import Observer
from cosim.master.stations import Station
from cosim.master.system import System
from cosim.network import DELIVERED, REASONS, Arrivals, PacketLink
from cosim.trace import Poses, Rows, Signal, TraceWriter, input_topic, link_topic, output_topic

_SENT, _POSED, _DELIVERED, _RECEIVED = 0, 1, 2, 1 << 30
"""Order of what has one and the same time: outputs, poses, deliveries link by link, inputs."""
_AT_ONCE = 4096
"""Rows laid out at once: enough to be fast, few enough to stay in the cache."""
_POSE = ("eta.x", "eta.y", "eta.z", "eta.psi")
_AS_DOUBLES = ("float", "int", "bool")
"""Kinds that the trace takes as doubles."""


class TraceRecorder(Observer):
    """An observer that writes rows, messages, drops, poses and log lines in order of time.

    Attributes
    ----------
    log_after_end : what was said when the trace had ended: `level`, `name`, `message`.
    """

    def __init__(self, writer: TraceWriter, system: System) -> None:
        self._writer = writer
        self._system = system
        self.log_after_end: list[dict[str, str]] = []

    def begin(self, stations: Sequence[Station]) -> None:
        """Declare a topic per component and direction, and two per link."""
        course = stations[0].course
        self._points = course.points_ns
        self._traffic = [
            _Traffic(self._writer, self._system, link, course, stations)
            for link in self._system.links.values()
            if isinstance(link, PacketLink)
        ]
        self._send: list[tuple[Station, int, _Cast]] = []
        self._receive: list[tuple[Station, int, _Cast]] = []
        self._poses = []
        for station in sorted(stations, key=lambda s: list(self._system.components).index(s.name)):
            component = identifier(station.name)
            for columns, topic, direction, into in (
                (station.output_columns, output_topic(station.name), "Output", self._send),
                (station.input_columns, input_topic(station.name), "Input", self._receive),
            ):
                if columns:
                    topic_id = self._writer.add_topic(
                        topic,
                        [signal_of(c.port, c.name) for c in columns],
                        schema_name=f"cosim.{component}.{direction}",
                        metadata={"component": station.name, "coupling": "held over a step"},
                    )
                    into.append((station, topic_id, _cast(station, columns)))
            places = [c.name for c in station.output_columns]
            if all(name in places for name in _POSE):
                self._poses.append((station, [places.index(name) for name in _POSE]))
        points = "as they come about" if course.grows else str(len(self._points))
        self._writer.log(
            int(self._points[0]),
            "info",
            "master",
            f"{len(stations)} components, {points} communication points to "
            f"t = {int(self._points[-1]) / 1e9:g} s",
        )

    def span(self, first: int, last: int) -> None:
        """Write the rows, each after what reached its receiver since the one before."""
        for begin in range(first, last, _AT_ONCE):
            self._write(begin, min(begin + _AT_ONCE, last))

    def _write(self, first: int, last: int) -> None:
        parts: list[Rows | Poses] = []
        for station, topic_id, cast in self._send:
            own, times = self._own(station, first, last)
            parts.append(Rows(topic_id, times, cast(station.outputs[own]), rank=(_SENT,)))
        for station, places in self._poses:
            own, times = self._own(station, first, last)
            parts.append(Poses(times, station.outputs[own][:, places], rank=(_POSED,)))
        for number, traffic in enumerate(self._traffic):
            parts += traffic.until(int(self._points[last - 1]), _DELIVERED + number)
        for station, topic_id, cast in self._receive:
            own, times = self._own(station, first, last)
            values = cast(station.inputs(last)[own])
            parts.append(Rows(topic_id, times, values, rank=(_RECEIVED,)))
        self._writer.write_rows(parts)

    def _own(
        self, station: Station, first: int, last: int
    ) -> tuple[slice | NDArray[np.int64], NDArray[np.int64]]:
        """Rows of a stretch that are a station's own, and their times."""
        if station.beat.always:
            return slice(first, last), self._points[first:last]
        begin, end = np.searchsorted(station.beat.own, [first, last])
        own = station.beat.own[begin:end]
        return own, self._points[own]

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Write a line to /log."""
        if self._writer.ended:
            self.log_after_end.append({"level": level, "name": name, "message": message})
        else:
            self._writer.log(time_ns, level, name, message)


_Cast = Callable[[Any], Any]


def signal_of(port: Port, name: str | None = None) -> Signal:
    """The trace's view of an FMI variable, under its own name or another."""
    return Signal(
        name=name or port.name,
        value_reference=port.reference,
        unit=port.unit,
        kind=port.kind or "float",
        hold=port.variability,
        description=port.description,
    )


def _cast(station: Station, columns: Sequence[Column]) -> _Cast:
    """Rows of doubles -> rows of values of the columns' own types."""
    if all(column.port.kind in _AS_DOUBLES for column in columns):
        return lambda rows: rows
    return lambda rows: station.values(rows, columns)


def identifier(name: str) -> str:
    """A name that protobuf and a topic can bear: ASCII letters, digits and _, a letter first."""
    text = re.sub(r"\W", "_", name, flags=re.ASCII)
    return text if text[:1].isalpha() else f"c{text}"


class _Traffic:
    """The messages of one packet link on their way into the trace."""

    def __init__(
        self,
        writer: TraceWriter,
        system: System,
        link: PacketLink,
        course: Course,
        stations: Sequence[Station],
    ) -> None:
        self._link, self._course = link, course
        by_name = {s.name: s for s in stations}
        sources = dict.fromkeys(c.source for c in system.connections if c.link == link.name)
        self._sources = []
        columns = []
        for end in sources:
            station = by_name[end.component]
            for j, column in enumerate(station.output_columns):
                if column.port.name == end.variable:
                    self._sources.append((station, j))
                    columns.append(Column(column.port, f"{end.component}.{column.name}"))
        self._topic = writer.add_topic(
            link_topic(link.name),
            [signal_of(column.port, column.name) for column in columns],
            schema_name=f"cosim.link.{identifier(link.name)}",
            metadata={"link": link.name, "order": link.order, "on_loss": str(link.on_loss)},
        )
        self._cast = _cast(stations[0], columns)
        self._dropped = writer.add_dropped_topic(link.name)
        self._told = 0

    def until(self, until_ns: int, rank: int) -> list[Rows | Poses]:
        """What arrived, or was due and lost, up to an instant and not before."""
        first = self._told
        found = self._course.arrivals(self._link.name, first)
        count = int(np.searchsorted(found.arrival_ns, until_ns, side="right"))
        self._told += count
        delivered = found.status[:count] == DELIVERED
        parts: list[Rows | Poses] = []
        for topic_id, which, values in (
            (self._topic, np.flatnonzero(delivered), self._values),
            (self._dropped, np.flatnonzero(~delivered), _reasons),
        ):
            mine = part_of(found, which)
            ranks = np.column_stack([np.full(which.size, rank), first + which])
            parts.append(
                Rows(topic_id, mine.arrival_ns, values(mine), mine.sent_ns, mine.sequence, ranks)
            )
        return parts

    def _values(self, messages: Arrivals) -> Any:
        rows = self._course.rows_at(messages.sent_ns)
        values = np.empty((rows.size, len(self._sources)))
        for column, (station, j) in enumerate(self._sources):
            values[:, column] = station.outputs[station.beat.last[rows], j]
        return self._cast(self._link.quantize(values))


def _reasons(messages: Arrivals) -> Any:
    return [[REASONS[status]] for status in messages.status]
