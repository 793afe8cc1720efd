"""The trace of a run: every row as it is exchanged, every message as it is delivered."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cosim.fmu import Port
from cosim.master.system import System
from cosim.master.wiring import Rows, Station
from cosim.network import DELIVERED, LOST, OVERTAKEN, REASONS, PacketSchedule
from cosim.trace import Signal, TraceWriter, input_topic, link_topic, output_topic

_POSE = ("eta.x", "eta.y", "eta.z", "eta.psi")


class TraceRecorder:
    """An observer that writes rows, messages, drops, poses and log lines in order of time."""

    def __init__(self, writer: TraceWriter, system: System) -> None:
        self._writer = writer
        self._system = system

    def begin(self, stations: Sequence[Station]) -> None:
        """Declare a topic per component and direction, and two per link."""
        self._points = [int(t) for t in self._system.timetable.points_ns]
        self._traffic: list[_Traffic] = []
        for name, schedule in self._system.timetable.schedules.items():
            self._traffic.append(_Traffic(self._writer, self._system, name, schedule, stations))
        self._send: list[tuple[Station, int, _Cast]] = []
        self._receive: list[tuple[Station, int, _Cast]] = []
        self._poses = []
        for station in sorted(stations, key=lambda s: list(self._system.components).index(s.name)):
            component = _identifier(station.name)
            for ports, topic, direction, into in (
                (station.output_ports, output_topic(station.name), "Output", self._send),
                (station.input_ports, input_topic(station.name), "Input", self._receive),
            ):
                if ports:
                    topic_id = self._writer.add_topic(
                        topic,
                        [signal_of(p) for p in ports],
                        schema_name=f"cosim.{component}.{direction}",
                        metadata={"component": station.name, "coupling": "held over a step"},
                    )
                    into.append((station, topic_id, _cast(ports)))
            places = [p.name for p in station.output_ports]
            if all(name in places for name in _POSE):
                self._poses.append((station, [places.index(name) for name in _POSE]))
        self._writer.log(
            self._points[0],
            "info",
            "master",
            f"{len(stations)} components, {len(self._points)} communication points to "
            f"t = {self._points[-1] / 1e9:g} s",
        )

    def span(self, first: int, last: int) -> None:
        """Write the rows, each after what reached its receiver since the one before."""
        inputs = [station.inputs(last) for station, _, _ in self._receive]
        for k in range(first, last):
            self._point(k, inputs)

    def _point(self, k: int, inputs: Sequence[Rows]) -> None:
        now = self._points[k]
        for traffic in self._traffic:
            traffic.flush(now - 1)
        for station, topic_id, cast in self._send:
            self._writer.write(topic_id, now, cast(station.outputs[k]))
        for station, places in self._poses:
            self._writer.pose(now, *(float(station.outputs[k, i]) for i in places))
        for traffic in self._traffic:
            traffic.flush(now)
        for (_, topic_id, cast), rows in zip(self._receive, inputs, strict=True):
            self._writer.write(topic_id, now, cast(rows[k]))

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Write a line to /log."""
        self._writer.log(time_ns, level, name, message)


_Cast = Callable[[Any], list[Any]]


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


def _cast(ports: Sequence[Port]) -> _Cast:
    """Row of doubles -> list of values of the ports' own types."""
    if all(p.kind == "float" for p in ports):
        return lambda row: row.tolist()
    types = [{"float": float, "int": int, "bool": bool}[p.kind or "float"] for p in ports]
    return lambda row: [to(value) for to, value in zip(types, row, strict=True)]


def _identifier(name: str) -> str:
    text = re.sub(r"\W", "_", name, flags=re.ASCII)
    return text if text[0].isalpha() else f"c{text}"


class _Traffic:
    """The messages of one packet link on their way into the trace."""

    def __init__(
        self,
        writer: TraceWriter,
        system: System,
        name: str,
        schedule: PacketSchedule,
        stations: Sequence[Station],
    ) -> None:
        self._writer = writer
        self._schedule = schedule
        self._rows = schedule.sent_rows(system.timetable.points_ns)
        by_name = {s.name: s for s in stations}
        sources = list(dict.fromkeys(c.source for c in system.connections if c.link == name))
        self._sources = []
        for end in sources:
            station = by_name[end.component]
            column = [p.name for p in station.output_ports].index(end.variable)
            self._sources.append((station, column))
        ports = [system.port(end) for end in sources]
        link = schedule.link
        self._topic = writer.add_topic(
            link_topic(name),
            [signal_of(p, str(end)) for p, end in zip(ports, sources, strict=True)],
            schema_name=f"cosim.link.{_identifier(name)}",
            metadata={"link": name, "order": link.order, "on_loss": str(link.on_loss)},
        )
        self._cast = _cast(ports)
        self._dropped = writer.add_dropped_topic(name)
        told = np.isin(schedule.status, (DELIVERED, LOST, OVERTAKEN))
        order = np.argsort(schedule.arrival_ns, kind="stable")
        self._pending = [int(i) for i in order if told[i]]
        self._next = 0

    def flush(self, until_ns: int) -> None:
        """Write what arrived, or was due and lost, up to an instant."""
        s = self._schedule
        while self._next < len(self._pending):
            i = self._pending[self._next]
            arrival = int(s.arrival_ns[i])
            if arrival > until_ns:
                return
            self._next += 1
            sent, sequence = int(s.sent_ns[i]), int(s.sequence[i])
            if s.status[i] == DELIVERED:
                row = self._rows[i]
                values = np.array([station.outputs[row, j] for station, j in self._sources])
                self._writer.write(
                    self._topic,
                    arrival,
                    self._cast(s.link.quantize(values)),
                    publish_time_ns=sent,
                    sequence=sequence,
                )
            else:
                self._writer.write(
                    self._dropped,
                    arrival,
                    [REASONS[s.status[i]]],
                    publish_time_ns=sent,
                    sequence=sequence,
                )
