"""Write a trace as a bag of ROS 2 (`trace export --to ros2`): one MCAP file, profile ros2."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, Progress, Seconds, not_written, silent, written_beside
from cosim.trace.file.block import HEAD, Records, in_order
from cosim.trace.file.stream import McapStream
from cosim.trace.reader import Trace
from cosim.trace.ros2.ros_messages import definition, serialised
from cosim.trace.ros2.topics import Converter, Outgoing, converters
from cosim.trace.rows.layout import RESULT, RUN
from cosim.trace.tables.table import Table

Integers = NDArray[np.int64]

_PART_BYTES = 2**22
_CHUNK_BYTES = 2**20
_RANK = np.zeros(1, np.int64)
"""Messages of one instant are in the order in which they are made."""

_MOST_TOPICS = 2**16 - 1

_FOREVER = "sec: 9223372036\n    nsec: 854775807"
_KEPT = f"""\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline:
    {_FOREVER}
  lifespan:
    {_FOREVER}
  liveliness: 1
  liveliness_lease_duration:
    {_FOREVER}
  avoid_ros_namespace_conventions: false
"""
"""The quality of service of /tf_static: who comes late gets the last message, too."""


@dataclass(frozen=True, slots=True)
class WrittenBag:
    """A bag that was written.

    Attributes
    ----------
    topics : number of messages by ROS 2 topic.
    left_out : topics of the trace that have no counterpart.
    """

    path: Path
    topics: Mapping[str, int]
    left_out: tuple[str, ...] = field(default=())


def export_bag(
    path: Path,
    target: Path | None,
    *,
    topics: Sequence[str] | None = None,
    start: Seconds | None = None,
    end: Seconds | None = None,
    report_progress: Progress | None = None,
) -> WrittenBag:
    """Write the topics of a trace as messages of ROS 2; see `cosim.trace.ros2.topics`.

    Log time is the time of delivery, publish time that of sending, as in the trace. The metadata
    of the run go along.

    Parameters
    ----------
    target : the file; NAME.ros2.mcap beside the trace if None.
    topics : only these of the trace; by default all.
    start, end : least and greatest time of delivery [s].

    Raises
    ------
    InputError : a topic does not exist, there is nothing to write, an instant does not fit, or
        the file cannot be written.
    LossError : the trace is damaged.
    """
    notify = report_progress or silent
    trace = Trace(path)
    for topic in topics or ():
        if topic not in trace.topics:
            raise InputError.unknown("topic", topic, trace.topics, where=str(trace.path))
    wanted = {t: i for t, i in trace.topics.items() if i.count and (not topics or t in topics)}
    made = converters(wanted)
    if not made:
        raise InputError(
            "no topic can be written as messages of ROS 2",
            where=str(trace.path),
            expected="protobuf topics with values",
            got=", ".join(sorted({info.encoding for info in wanted.values()})) or "no messages",
        )
    stem = trace.path.name.partition(".")[0]
    target = target or trace.path.with_name(f"{stem}.ros2.mcap")
    if target.exists() and target.samefile(trace.path):
        raise InputError("the bag would overwrite its trace", where=str(target), hint="use `out`")
    latest = max(high for _, high in trace.spans.values())
    with (
        not_written("the bag", target),
        written_beside(target) as beside,
        beside.open("wb") as file,
    ):
        bag = _Bag(McapStream(file, _CHUNK_BYTES, "zstd"), trace)
        for tables in trace.parts(list(made), start=start, end=end, part_bytes=_PART_BYTES):
            bag.add(_records(bag, tables, made))
            now = max(int(table.log_time_ns.max()) for table in tables.values())
            notify(f"writing {target.name}", now / max(latest, 1))
        bag.finish(made)
    left_out = tuple(t for t in wanted if t not in made and t not in bag.counts)
    return WrittenBag(target, bag.counts, left_out)


def _records(
    bag: _Bag, tables: Mapping[str, Table], made: Mapping[str, Sequence[Converter]]
) -> Iterator[Records]:
    for topic, table in tables.items():
        for converter in made[topic]:
            for one in converter(table):
                yield from bag.records(topic, one, table)


class _Bag:
    """The file: each topic is declared with its first message."""

    def __init__(self, stream: McapStream, trace: Trace) -> None:
        self._stream, self._trace = stream, trace
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._latest: dict[str, tuple[int, ...]] = {}
        self.counts: dict[str, int] = {}
        stream.start("auv-cosim", "ros2")
        stream.metadata(RUN, trace.run)

    def records(self, topic: str, one: Outgoing, table: Table) -> Iterator[Records]:
        """Yield messages as records of their channel."""
        if not one.rows.size:
            return
        self.counts[one.topic] = self.counts.get(one.topic, 0) + one.rows.size
        last = int(np.argmax(table.log_time_ns))
        columns = table.log_time_ns, table.publish_time_ns, table.sequence
        self._latest[topic] = tuple(int(column[last]) for column in columns)
        yield from self._laid_out(one, *(column[one.rows] for column in columns))

    def _laid_out(
        self, one: Outgoing, log: Integers, sent: Integers, number: Integers
    ) -> Iterator[Records]:
        """Yield the records of messages, those of one size together."""
        channel, found = self._channel(one), [serialised(one.type, x) for x in one.messages]
        sizes = np.array([len(data) for data in found])
        for size in np.unique(sizes):
            mine = np.flatnonzero(sizes == size)
            lines = np.zeros((mine.size, HEAD.size + size), np.uint8)
            content = np.frombuffer(b"".join(found[k] for k in mine), np.uint8)
            lines[:, HEAD.size :] = content.reshape(mine.size, size)
            yield Records(channel, log[mine], sent[mine], number[mine], lines, _RANK)

    def add(self, records: Iterable[Records]) -> None:
        """Write records in order of time."""
        found = list(records)
        if found:
            self._stream.add(in_order(found))

    def finish(self, made: Mapping[str, Sequence[Converter]]) -> None:
        """Write what concludes topics, and close the file."""
        for topic, (log_ns, publish_ns, sequence) in self._latest.items():
            for one in (last for converter in made[topic] for last in converter.last()):
                self.counts[one.topic] = self.counts.get(one.topic, 0) + 1
                columns = (np.array([value]) for value in (log_ns, publish_ns, sequence))
                self.add(self._laid_out(one, *columns))
        self._stream.flush()
        if self._trace.result is not None:
            self._stream.metadata(RESULT, self._trace.result)
        self._stream.finish()

    def _channel(self, one: Outgoing) -> int:
        if one.topic not in self._channels:
            if len(self._channels) == _MOST_TOPICS:
                raise InputError(
                    "a bag has no room for so many topics",
                    where=str(self._trace.path),
                    expected=f"up to {_MOST_TOPICS} signals",
                    hint="choose some with `topic`",
                )
            if one.type not in self._schemas:
                text = definition(one.type).encode()
                self._schemas[one.type] = self._stream.schema(one.type, "ros2msg", text)
            static = one.topic == "/tf_static"
            entries = {"offered_qos_profiles": _KEPT if static else "", **one.notes}
            schema = self._schemas[one.type]
            self._channels[one.topic] = self._stream.channel(one.topic, "cdr", schema, entries)
        return self._channels[one.topic]
