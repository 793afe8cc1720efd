"""Record a run as a trace: rows, messages, drops, poses and log lines."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.fmu import Port, SignalKind
from cosim.master.communication_points import CommunicationPoints
from cosim.master.component_instance import MOST_EXACT, Column, ComponentInstance
from cosim.master.observers import Observer
from cosim.master.system import System
from cosim.network import DELIVERED, LOST, REASONS, Arrivals, PacketLink
from cosim.trace import Lines, Poses, Rows, RowsInMemory, Signal, TraceWriter
from cosim.trace.outcome import RunEvent
from cosim.trace.rows import (
    COMPUTED,
    GREATEST_AGE,
    LINK_STATE_SCHEMA,
    LINK_STATE_SIGNALS,
    MODE_SIGNALS,
    VEHICLE,
    Thinned,
    input_topic,
    link_state_topic,
    link_topic,
    modes_topic,
    output_topic,
)

_SENT, _POSED, _DELIVERED, _RECEIVED, _SCENE, _LOGGED = 0, 1, 2, 1 << 30, (1 << 30) + 1, 1 << 31
"""Order of records of the same time: outputs, poses, deliveries link by link, inputs, then
references and states of links, and events."""
_INSTANT = 1 << 32
"""More than any of these: the super-dense instants of one time follow each other."""
_WITHIN = -1
"""Rank of outputs within steps: what a step ends with comes before the row of its end."""
_AT_ONCE = 4096
"""Rows written at once: enough to be fast, few enough to stay in the cache."""
_POSE = ("eta.x", "eta.y", "eta.z", "eta.psi")
_REFERENCE = ("reference.x", "reference.y", "reference.z", "reference.psi")


class TraceRecorder(Observer):
    """An observer that writes rows, messages, drops, poses and log lines in order of time.

    Parameters
    ----------
    events : returns the events of the run up to an instant [ns] that it has not returned before,
        in order of time; an observer that comes before this one has found them.

    Attributes
    ----------
    run_ended : set it when the run is at its end: later log lines are not part of it.
    log_after_end : log lines after the end of the run: `level`, `name`, `message`.
    """

    def __init__(
        self,
        writer: TraceWriter | RowsInMemory,
        system: System,
        events: Callable[[int], Sequence[RunEvent]] | None = None,
    ) -> None:
        self._writer = writer
        self._system = system
        self._events = events
        self._latest_ns = self._start_ns = 0
        self._traffic: list[_Traffic] = []
        self.run_ended = False
        self.log_after_end: list[dict[str, str]] = []

    def begin(self, instances: Sequence[ComponentInstance]) -> None:
        """Declare a topic per component and direction, and two per link."""
        self._comm_points = comm_points = instances[0].comm_points
        self._points = comm_points.points_ns
        self._traffic = [
            _Traffic(self._writer, self._system, link, comm_points, instances)
            for link in self._system.links.values()
            if isinstance(link, PacketLink)
        ]
        self._send: list[tuple[ComponentInstance, int, _Cast]] = []
        self._receive: list[tuple[ComponentInstance, int, _Cast]] = []
        posed: list[_Posed] = []
        for instance in sorted(
            instances, key=lambda s: list(self._system.components).index(s.name)
        ):
            component = identifier(instance.name)
            for columns, topic, direction, into in (
                (instance.output_columns, output_topic(instance.name), "Output", self._send),
                (instance.input_columns, input_topic(instance.name), "Input", self._receive),
            ):
                if columns:
                    topic_id = self._writer.add_topic(
                        topic,
                        [signal_of(c.port, c.name) for c in columns],
                        schema_name=f"cosim.{component}.{direction}",
                        metadata={"component": instance.name, "coupling": "held over a step"},
                    )
                    into.append((instance, topic_id, _cast(instance, columns)))
            for signals, reference in ((_POSE, False), (_REFERENCE, True)):
                columns = instance.input_columns if reference else instance.output_columns
                places = [c.name for c in columns]
                if all(name in places for name in signals):
                    where = [places.index(name) for name in signals]
                    posed.append(_Posed(instance, where, component, reference=reference))
        self._modes = {
            name: self._writer.add_topic(
                modes_topic(name),
                MODE_SIGNALS,
                schema_name=f"cosim.modes.{identifier(name)}",
                metadata={"machine": name, "states": ", ".join(modes.states)},
            )
            for name, modes in self._system.modes.items()
        }
        self._modes_until = -1
        self._within = {
            instance.name: self._topic_within_steps(instance)
            for instance in instances
            if instance.component.intermediate
        }
        self._posed = _named(posed)
        known = comm_points.final < comm_points.most and not comm_points.grows
        points = str(comm_points.count) if known else "as they come about"
        self._start_ns = comm_points.start_ns
        self._writer.log(
            int(self._points[0]) + self._start_ns,
            "info",
            "master",
            f"{len(instances)} components, {points} communication points to "
            f"t = {comm_points.at_s(comm_points.end_ns):g} s",
        )

    def _topic_within_steps(self, instance: ComponentInstance) -> tuple[int, list[_Within]]:
        ports = [
            instance.component.description.ports[name] for name in instance.component.intermediate
        ]
        topic_id = self._writer.add_topic(
            f"/{instance.name}/intermediate",
            [signal_of(port) for port in ports],
            schema_name=f"cosim.{identifier(instance.name)}.Intermediate",
            metadata={"component": instance.name, "coupling": "within the steps"},
        )
        return topic_id, []

    def within_steps(
        self, component: str, times_ns: NDArray[np.int64], values: NDArray[np.float64]
    ) -> None:
        """Keep the outputs of a component within steps, until the rows of their time are there."""
        self._within[component][1].append((times_ns, values))

    def _within_until(self, until_ns: int) -> Iterator[Rows]:
        """Yield the outputs within steps up to an instant [ns]."""
        for topic_id, waiting in self._within.values():
            if not waiting:
                continue
            times = np.concatenate([times for times, _ in waiting])
            values = np.concatenate([values for _, values in waiting])
            count = int(np.searchsorted(times, until_ns, side="right"))
            waiting[:] = [(times[count:], values[count:])] if count < times.size else []
            if count:
                yield Rows(topic_id, times[:count], values[:count], rank=(_WITHIN,))

    def rows_complete(self, first: int, last: int) -> None:
        """Write the rows, each after the messages delivered since the row before."""
        for begin in range(first, last, _AT_ONCE):
            self._write(begin, min(begin + _AT_ONCE, last))

    def _write(self, first: int, last: int) -> None:
        parts: list[Rows | Poses | Lines] = [*self._within_until(int(self._points[last - 1]))]
        for instance, topic_id, cast in self._send:
            own, times = self._own(instance, first, last)
            rank = self._rank(own, times, _SENT)
            parts.append(Rows(topic_id, times, cast(instance.outputs[own]), rank=rank))
        for one in self._posed:
            own, times = self._own(one.instance, first, last)
            rank = self._rank(own, times, _SCENE if one.reference else _POSED)
            parts.append(one.poses(own, times, rank))
        for number, traffic in enumerate(self._traffic):
            parts += traffic.until(int(self._points[last - 1]), _DELIVERED + number)
        for instance, topic_id, cast in self._receive:
            own, times = self._own(instance, first, last)
            values = cast(instance.inputs[own])
            rank = self._rank(own, times, _RECEIVED)
            parts.append(Rows(topic_id, times, values, rank=rank))
        parts += [traffic.state(self._points[first:last]) for traffic in self._traffic]
        until_ns = int(self._points[last - 1])
        parts += self._changes_of_mode(until_ns)
        self._write_rows([*parts, *self._event_lines(until_ns)])
        self._latest_ns = max(self._latest_ns, until_ns)

    def _changes_of_mode(self, until_ns: int) -> Iterator[Rows]:
        """Yield the states that machines came into up to an instant [ns], not yielded before."""
        for name, topic_id in self._modes.items():
            times, numbers = self._comm_points.event_values.changes(name)
            which = np.flatnonzero((times > self._modes_until) & (times <= until_ns))
            states = self._system.modes[name].states
            values = [[states[k], k] for k in numbers[which].astype(np.int64).tolist()]
            if values:
                yield Rows(topic_id, times[which], values, rank=(_SCENE,))
        self._modes_until = until_ns

    def _rank(
        self, own: slice | NDArray[np.int64], times: NDArray[np.int64], rank: int
    ) -> tuple[int] | NDArray[np.int64]:
        """Return the rank of rows: with events that of the super-dense instant comes first."""
        if not self._comm_points.has_events:
            return (rank,)
        rows = np.arange(own.start, own.stop) if isinstance(own, slice) else own
        superdense = rows - self._comm_points.rows_at(times)
        return (superdense * _INSTANT + rank)[:, None]

    def _event_lines(self, until_ns: int) -> list[Lines]:
        found = self._events(until_ns) if self._events is not None else ()
        if not found:
            return []
        # one that is found late comes after what is written
        times = np.array([max(event.time_ns, self._latest_ns) for event in found], np.int64)
        lines = [(event.level, event.subject, event.message) for event in found]
        return [Lines(times, lines, rank=(_LOGGED,))]

    def _own(
        self, instance: ComponentInstance, first: int, last: int
    ) -> tuple[slice | NDArray[np.int64], NDArray[np.int64]]:
        """Return which rows from first to last - 1 are an instance's own, and their times."""
        if instance.own_points.always:
            return slice(first, last), self._points[first:last]
        own = instance.own_points.own_between(first, last)
        return own, self._points[own]

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Write a line to /log; of a link, "outage ..." says that one begins (warning) or ends."""
        for traffic in self._traffic:
            if name == traffic.link.name and message.startswith("outage "):
                traffic.outage = level == "warning"
        if self.run_ended or self._writer.ended:
            self.log_after_end.append({"level": level, "name": name, "message": message})
            return
        if time_ns > self._latest_ns:  # what was due before comes before
            before: list[Rows | Poses | Lines] = [*self._within_until(time_ns - 1)]
            for number, traffic in enumerate(self._traffic):
                before += traffic.until(time_ns - 1, _DELIVERED + number)
            self._write_rows(before)
            self._latest_ns = time_ns
        self._writer.log(time_ns + self._start_ns, level, name, message)

    def _write_rows(self, parts: Sequence[Rows | Poses | Lines]) -> None:
        """Write rows; the times of a trace are those of the components."""
        for part in parts if self._start_ns else ():
            part.log_ns = part.log_ns + self._start_ns
            if isinstance(part, Rows):
                part.publish_ns = part.publish_ns + self._start_ns
        self._writer.write_rows(parts)

    def conclude(self, end_ns: int, lines: Sequence[tuple[str, str, str]]) -> None:
        """Write the last events, then lines that conclude the run: level, name, message."""
        now = max(self._latest_ns, end_ns)
        found = self._events(now) if self._events is not None else ()
        last = [(event.level, event.subject, event.message) for event in found]
        for level, name, message in [*last, *lines]:
            self._writer.log(now + self._start_ns, level, name, message)


_Cast = Callable[[Any], Any]
_Within = tuple[NDArray[np.int64], NDArray[np.float64]]
"""Instants within steps [ns], and the values of outputs there."""


class _Posed:
    """A component whose outputs have a vehicle's pose, or whose inputs have its reference."""

    def __init__(
        self, instance: ComponentInstance, places: list[int], vehicle: str, *, reference: bool
    ) -> None:
        self.instance, self.vehicle, self.reference = instance, vehicle, reference
        self._places = places

    def poses(
        self,
        own: slice | NDArray[np.int64],
        times: NDArray[np.int64],
        rank: tuple[int] | NDArray[np.int64],
    ) -> Poses:
        """Return the poses in rows `own`, at these times."""
        if not self.reference:
            values = self.instance.outputs[own][:, self._places]
            return Poses(times, values, rank, self.vehicle)
        values = self.instance.inputs[own][:, self._places]
        return Poses(times, values, rank, self.vehicle, reference=True)


def _named(posed: list[_Posed]) -> list[_Posed]:
    """Call the only vehicle of a run auv; of several, each has the name of its component."""
    vehicles = [one for one in posed if not one.reference]
    references = [one for one in posed if one.reference]
    if len(vehicles) == 1:
        for one in vehicles + references * (len(references) == 1):
            one.vehicle = VEHICLE
    return posed


_KINDS: Mapping[SignalKind | None, Literal["float", "int", "bool", "string"]] = {
    "float": "float",
    "int": "int",
    "bool": "bool",
    "string": "string",
    "binary": "string",
    "clock": "bool",
}
"""Kind of a variable -> of its signal: Binary is the hexadecimal text of its bytes."""


def signal_of(port: Port, name: str | None = None) -> Signal:
    """Describe an FMI variable as a signal of the trace, under its own name or another."""
    return Signal(
        name=name or port.name,
        value_reference=port.reference,
        unit=port.unit,
        kind="uint" if port.getter_type == "UInt64" else _KINDS.get(port.kind, "float"),
        hold=port.variability,
        description=port.description,
    )


def _cast(instance: ComponentInstance, columns: Sequence[Column]) -> _Cast:
    """Return a function from rows of doubles to rows of values of the columns' own types."""
    if not all(column.port.kind in ("float", "int", "bool", "clock") for column in columns):
        return lambda rows: instance.values(rows, columns)
    wide = [j for j, column in enumerate(columns) if column.port.c_type in ("i8", "u8")]
    if not wide:
        return lambda rows: rows

    def cast(rows: NDArray[np.float64]) -> Any:
        numbers = bool((np.abs(rows[:, wide]) <= MOST_EXACT).all())
        return rows if numbers else instance.values(rows, columns)

    return cast


def identifier(name: str) -> str:
    """Make a name valid in protobuf and topics: ASCII letters, digits and _, a letter first."""
    text = re.sub(r"\W", "_", name, flags=re.ASCII)
    return text if text[:1].isalpha() else f"c{text}"


class _Traffic:
    """Records the messages of one packet link."""

    def __init__(
        self,
        writer: TraceWriter | RowsInMemory,
        system: System,
        link: PacketLink,
        comm_points: CommunicationPoints,
        instances: Sequence[ComponentInstance],
    ) -> None:
        self.link, self._comm_points = link, comm_points
        self.outage = False
        by_name = {s.name: s for s in instances}
        sources = dict.fromkeys(c.source for c in system.connections if c.link == link.name)
        self._sources = []
        columns = []
        for end in sources:
            instance = by_name[end.component]
            for j, column in enumerate(instance.output_columns):
                if column.port.name == end.variable:
                    self._sources.append((instance, j))
                    columns.append(Column(column.port, f"{end.component}.{column.name}"))
        self._topic = writer.add_topic(
            link_topic(link.name),
            [signal_of(column.port, column.name) for column in columns],
            schema_name=f"cosim.link.{identifier(link.name)}",
            metadata={"link": link.name, "order": link.order, "on_loss": str(link.on_loss)}
            | ({GREATEST_AGE: str(link.greatest_age_ns)} if link.greatest_age_ns else {}),
        )
        self._cast = _cast(instances[0], columns)
        self._dropped = writer.add_dropped_topic(link.name)
        self._state = writer.add_topic(
            link_state_topic(link.name),
            LINK_STATE_SIGNALS,
            schema_name=LINK_STATE_SCHEMA,
            metadata={"link": link.name, **COMPUTED},
        )
        self._written_count = 0
        self._thinned = Thinned()
        self._lost_ns: list[NDArray[np.int64]] = []
        self._lost = 0

    def until(self, until_ns: int, rank: int) -> list[Rows | Poses]:
        """Return arrivals and drops up to an instant that were not returned before."""
        first = self._written_count
        found = self._comm_points.arrivals(self.link.name, first)
        count = int(np.searchsorted(found.arrival_ns, until_ns, side="right"))
        self._written_count += count
        delivered = found.status[:count] == DELIVERED
        self._lost_ns.append(found.arrival_ns[:count][found.status[:count] == LOST])
        parts: list[Rows | Poses] = []
        for topic_id, which, values in (
            (self._topic, np.flatnonzero(delivered), self._values),
            (self._dropped, np.flatnonzero(~delivered), _reasons),
        ):
            mine = found.select(which)
            ranks = np.column_stack([np.full(which.size, rank), first + which])
            parts.append(
                Rows(topic_id, mine.arrival_ns, values(mine), mine.sent_ns, mine.sequence, ranks)
            )
        return parts

    def state(self, points_ns: NDArray[np.int64]) -> Rows:
        """Return age and counts at some of these points, up to which `until` has returned all."""
        times = points_ns[self._thinned(points_ns)]
        schedule = self._comm_points.links[self.link.name]
        # a run may break off where the delay of a message that is sent is not known yet
        found = schedule.state(times, broken_off=True)
        lost_ns = np.concatenate([np.zeros(0, np.int64), *self._lost_ns])
        values = np.column_stack(
            [
                found.age_s,
                schedule.in_flight(times),
                found.delivered,
                self._lost + np.searchsorted(lost_ns, times, side="right"),
                found.dropped,
                np.full(times.size, self.outage),
            ]
        )
        self._lost, self._lost_ns = self._lost + lost_ns.size, []
        return Rows(self._state, times, values, rank=(_SCENE,))

    def _values(self, messages: Arrivals) -> Any:
        rows = self._comm_points.rows_sent_at(messages.sent_ns)
        if self._comm_points.has_events:  # what arrives at once is what was there by then
            at_once = messages.arrival_ns == messages.sent_ns
            rows = np.where(at_once, self._comm_points.rows_at(messages.sent_ns), rows)
        values = np.empty((rows.size, len(self._sources)))
        for column, (instance, j) in enumerate(self._sources):
            values[:, column] = instance.outputs[instance.own_points.last[rows], j]
        return self._cast(self.link.quantize(values))


def _reasons(messages: Arrivals) -> Any:
    return [[REASONS[status]] for status in messages.status]
