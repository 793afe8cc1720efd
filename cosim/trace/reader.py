"""Read a trace: its run and result, and every topic as columns.

Opening a trace reads the summary and the indexes; a read decompresses only the chunks with the
topics and the time window wanted.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cosim.core import AnyPath, InputError, LossError, Seconds
from cosim.trace.file.contents import Segment
from cosim.trace.file.contents_scan import by_scan
from cosim.trace.file.declared import Channel
from cosim.trace.file.file_parts import attachment_data, check_outer_records, read_segment, times_of
from cosim.trace.file.messages import Messages, groups, on_channels, together
from cosim.trace.file.records import LATEST_NS, DamageError, open_trace
from cosim.trace.file.summary import from_summary
from cosim.trace.outcome.run_outcome import RunOutcome, outcome_of
from cosim.trace.recorded_rows import Recorded
from cosim.trace.rows import layout
from cosim.trace.tables.gather import TopicRows
from cosim.trace.tables.table import Series, Table
from cosim.trace.tables.time_base import window_ns
from cosim.trace.tables.topic_info import TopicInfo

PART_BYTES = 2**23
"""Payload of the rows that a stream holds at once [bytes]."""

_TOGETHER_BYTES = 2**20
"""Bytes of chunks of which each topic is taken together: in one it has few messages."""

__all__ = ["Series", "Table", "TopicInfo", "Trace"]


class Trace(Recorded):
    """A trace file: a recorded run, or any MCAP file.

        >>> from cosim import DelaySystem, Scenario, Trace, run
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> flight = run(tank, "tank.mcap")
        >>> trace = Trace("tank.mcap")
        >>> trace.finished, trace.outcome.status, list(trace.topics)
        (True, 'finished', ['/tank/output', '/log'])
        >>> level = trace["tank.x[1]"]
        >>> level.values.shape, float(level.values[0]), float(level.delivered[-1])
        ((21,), 1.0, 2.0)

    As a data frame, an Arrow table or a dataset: see `cosim.trace.tables.frames.Framed`.

    Parameters
    ----------
    path : the file.
    incomplete : True: read a file that is cut short or damaged as far as possible, by a scan of
        the whole file. False: refuse it; damaged data are noticed when they are read. None:
        True for a name that ends in `.partial`, else False.
    by_summary : use the summary, also of an `incomplete` file, if it is there and consistent;
        damaged data are then noticed when they are read.

    Attributes
    ----------
    run, result : entries of `cosim.run` ({} in files of other tools), and `cosim.result` (None if
        the run did not finish).
    finished : whether there is a result.
    complete : whether the file is whole; if not, `damage` says where and why reading stopped.
    metadata : every metadata record, (name, entries), in file order.
    attachments, media_types : by name.
    topics : `TopicInfo` by topic, in order of appearance.
    library : the writing library, from the file's header.

    Raises
    ------
    InputError : the file is missing, empty, a directory or no MCAP file.
    LossError : it is cut short or damaged, and `incomplete` does not allow that.
    """

    def __init__(
        self,
        path: AnyPath,
        *,
        incomplete: bool | None = None,
        by_summary: bool = False,
    ) -> None:
        self.path = Path(path)
        if incomplete is None:
            incomplete = self.path.name.endswith(".partial")
        found = None if incomplete and not by_summary else from_summary(self.path)
        self._contents = known = by_scan(self.path) if found is None else found
        self.damage = known.damage
        self.complete = known.damage is None
        if known.damage is not None and not incomplete:
            raise self._lost(known.damage)
        self.library, self.metadata = known.library, known.metadata
        self.media_types = known.media_types
        self.run = dict(next((e for n, e in self.metadata if n == layout.RUN), {}))
        self._row_format = self.run.pop(layout.ROW_FORMAT, "1")
        results = [entries for name, entries in self.metadata if name == layout.RESULT]
        self.result: dict[str, str] | None = results[-1] if results else None
        self.topics: dict[str, TopicInfo] = {}
        for number, channel in sorted(known.declared.channels.items()):
            count = known.counts.get(number, 0)
            if channel.topic in self.topics:  # foreign files have several channels on a topic
                self.topics[channel.topic].count += count
            else:
                self.topics[channel.topic] = TopicInfo.of_channel(
                    channel, count, lambda: self.spans
                )

    @property
    def where(self) -> str:
        """The path of the file."""
        return str(self.path)

    @property
    def row_format(self) -> int:
        """Format of the rows of components and links: 2; 1 in older files and those of others.

        Rows are read in either format; the content hash depends on it.

        Raises
        ------
        InputError : the file names another format.
        """
        known = ("1", layout.NEWEST_ROW_FORMAT)
        if self._row_format not in known:
            raise InputError(
                "the rows of this trace are of another format",
                where=f"{self.path}: {layout.RUN}, {layout.ROW_FORMAT}",
                expected=" or ".join(known),
                got=repr(self._row_format),
                hint="a newer auv-cosim knows its content hash",
            )
        return int(self._row_format)

    @property
    def content_hash_version(self) -> int:
        """The version of its content hash, which has changed with the format of the rows."""
        return self.row_format + 1

    def __reduce__(self) -> tuple[Any, ...]:
        """Return how it is opened again, in another process too."""
        return functools.partial(Trace, incomplete=not self.complete), (self.path,)

    def __repr__(self) -> str:
        status = "not finished" if self.outcome is None else self.outcome.headline
        messages = sum(info.count for info in self.topics.values())
        name = self.run.get("scenario", "")
        state = f"{name}, {status}" if name else "no run of this project"
        return f"<Trace {self.path}: {state}, {len(self.topics)} topics, {messages} messages>"

    @property
    def finished(self) -> bool:
        """Whether the run finished: there is a `cosim.result`."""
        return self.result is not None

    @functools.cached_property
    def outcome(self) -> RunOutcome | None:
        """How the run ended; None where it did not, and in files of other tools."""
        return outcome_of(self.result)

    @property
    def metrics(self) -> Mapping[str, Any]:
        """The metrics of the run, as in its outcome; empty where there are none."""
        return {} if self.outcome is None else self.outcome.metrics

    @property
    def links(self) -> Mapping[str, Mapping[str, Any]]:
        """The figures of each link, as in the run's outcome; empty where there are none."""
        return {} if self.outcome is None else self.outcome.links

    @functools.cached_property
    def attachments(self) -> dict[str, bytes]:
        """The attached files by name; `LossError` where one is damaged."""
        with self._damage_as_loss():
            return attachment_data(self.path, self._contents.attachments)

    @functools.cached_property
    def spans(self) -> dict[str, tuple[int, int]]:
        """Least and greatest log time [ns] by topic, of those with messages."""
        known = self._contents
        with self._damage_as_loss():
            by_id = times_of(self.path, known) if known.spans is None else known.spans
        found: dict[str, tuple[int, int]] = {}
        for number, (low, high) in by_id.items():
            topic = known.declared.channels[number].topic
            before = found.get(topic, (low, high))
            found[topic] = min(low, before[0]), max(high, before[1])
        return found

    def read_all(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: Seconds | None = None,
        end: Seconds | None = None,
    ) -> dict[str, Table]:
        """Read several topics (all protobuf topics if None) in one pass over the file."""
        if topics is None:
            topics = [name for name, info in self.topics.items() if info.encoding == "protobuf"]
        expected = self.counts if start is None and end is None else {}
        gathered = {topic: self._gathered(topic, expected) for topic in topics}
        for _ in self._collect(gathered, *window_ns(start, end)):
            pass
        tables = {topic: each.table() for topic, each in gathered.items()}
        if start is None and end is None:
            for topic, table in tables.items():
                self._check_count(topic, len(table))
        return tables

    def parts(
        self,
        topics: Sequence[str] | None = None,
        *,
        start: Seconds | None = None,
        end: Seconds | None = None,
        part_bytes: int = PART_BYTES,
    ) -> Iterator[dict[str, Table]]:
        """Yield the rows of topics (all protobuf topics if None) in file order, part by part.

        A part has the tables of the topics with rows in it. The columns of a JSON topic are those
        found in the part.

        part_bytes : payload after which a part ends [bytes].

        Raises
        ------
        InputError, LossError : as `read`.
        """
        if topics is None:
            topics = [name for name, info in self.topics.items() if info.encoding == "protobuf"]
        gathered = {topic: self._gathered(topic) for topic in topics}
        counts = dict.fromkeys(topics, 0)
        filled, touched = 0, dict[str, None]()
        together_bytes = min(_TOGETHER_BYTES, part_bytes // 8)
        for topic, size in self._collect(gathered, *window_ns(start, end), together_bytes):
            if topic is not None:
                filled += size
                touched[topic] = None
            elif filled >= part_bytes:
                yield _taken(gathered, touched, counts)
                filled, touched = 0, {}
        if touched:
            yield _taken(gathered, touched, counts)
        if start is None and end is None:
            for topic, count in counts.items():
                self._check_count(topic, count)

    def windows(
        self, topics: Sequence[str], borders_ns: Sequence[int], *, first_ns: int = 0
    ) -> Iterator[dict[str, Table]]:
        """Yield the rows of topics up to each border [ns], included, and beyond the last before.

        borders_ns : increasing; `borders` proposes some. Those before `first_ns` are passed over.

        Raises
        ------
        InputError, LossError : as `read`.
        """
        gathered = {topic: self._gathered(topic) for topic in topics}
        first = first_ns
        for last in borders_ns:
            if last < first:
                continue
            for _ in self._collect(gathered, first, last):
                pass
            yield {topic: each.taken() for topic, each in gathered.items()}
            first = last + 1

    def borders(self, part_bytes: int = PART_BYTES) -> list[int]:
        """Return instants [ns] between which there are about so many bytes of messages.

        They are those of chunks, the last is beyond all messages.
        """
        found: list[int] = []
        filled = 0
        for segment in sorted(self._contents.segments, key=lambda s: s.start_ns):
            if filled >= part_bytes and segment.start_ns > (found[-1] + 1 if found else 0):
                found.append(segment.start_ns - 1)
                filled = 0
            filled += segment.data_size
        return [*found, LATEST_NS]

    def empty(self, topic: str) -> Table:
        """Return a table with the columns of a protobuf topic, and no rows."""
        return self._gathered(topic).table()

    def _collect(
        self,
        gathered: Mapping[str, TopicRows],
        first: int,
        last: int,
        together_bytes: int = _TOGETHER_BYTES,
    ) -> Iterator[tuple[str | None, int]]:
        """Add messages to the rows of their topics; yield topic and bytes, None after a block."""
        places = np.full(2**16, -1, np.int32)
        for place, each in enumerate(gathered.values()):
            places[list(each.channels)] = place
        names = list(gathered)
        wanted = {number for each in gathered.values() for number in each.channels}
        # one chunk at a time costs half as much again: each topic is taken out of each block
        for block in together(self._segments(wanted, first, last), together_bytes):
            messages, place = block, places[block.heads["channel"]]
            inside = place >= 0
            if first > 0 or last < LATEST_NS:
                log = block.heads["log"]
                inside &= (log >= first) & (log <= last)
            if not inside.all():
                messages, place = block.part(inside), place[inside]
            for number, mine in groups(place):
                part = messages if mine.size == len(messages) else messages.part(mine)
                gathered[names[number]].add(part)
                yield names[number], int(part.sizes.sum()) + 64 * mine.size
            yield None, 0

    def messages(
        self, topics: Sequence[str] | None = None
    ) -> Iterator[tuple[Channel, int, int, int, memoryview]]:
        """Yield channel, sequence, log time, publish time and payload of each message in order.

        topics : only of these; all by default.
        """
        channels = self.channels
        wanted = None
        if topics is not None:
            wanted = {number for number, channel in channels.items() if channel.topic in topics}
        for each in self._segments(wanted, 0, LATEST_NS):
            block = each if wanted is None else each.part(on_channels(each, wanted))
            heads = block.heads
            columns = [heads[key].tolist() for key in ("channel", "sequence", "log", "publish")]
            for number, *rest in zip(*columns, block.payloads(), strict=True):
                yield channels[number], *rest

    def blocks(self) -> Iterator[Messages]:
        """Yield the messages in file order, a chunk at a time; `LossError` where one is damaged."""
        return self._segments(None, 0, LATEST_NS)

    @property
    def segments(self) -> Sequence[Segment]:
        """The chunks, and messages outside chunks that follow each other, in file order."""
        return self._contents.segments

    @property
    def counts(self) -> Mapping[int, int]:
        """Number of messages by id of the channel."""
        return self._contents.counts

    def read_segment(self, segment: Segment) -> Messages:
        """Read the messages of a segment; `LossError` if it is damaged."""
        with open_trace(self.path) as stream, self._damage_as_loss():
            return read_segment(stream, segment, self._contents.declared)

    @property
    def channels(self) -> Mapping[int, Channel]:
        """Channels by id."""
        return self._contents.declared.channels

    def check(self) -> None:
        """Check every record of the file and its checksums; `LossError` if it is damaged.

        Records inside a chunk are checked when the chunk is read.
        """
        if not self._contents.scanned:
            with self._damage_as_loss():
                check_outer_records(self.path)

    @contextmanager
    def _damage_as_loss(self) -> Iterator[None]:
        try:
            yield
        except DamageError as error:
            raise self._lost(str(error)) from error

    def _segments(self, wanted: set[int] | None, first: int, last: int) -> Iterator[Messages]:
        """Yield the messages of the segments that have these channels and overlap the window."""
        declared = self._contents.declared
        with open_trace(self.path) as stream:
            for segment in self._contents.segments:
                if segment.end_ns < first or segment.start_ns > last:
                    continue
                there = segment.channels
                if wanted is not None and there is not None and not there & wanted:
                    continue
                with self._damage_as_loss():
                    messages = read_segment(stream, segment, declared)
                yield messages

    def _gathered(self, topic: str, expected: Mapping[int, int] | None = None) -> TopicRows:
        if topic not in self.topics:
            raise InputError.unknown("topic", topic, self.topics, where=str(self.path))
        channels = self._contents.declared.of_topic(topic)
        return TopicRows(f"{self.path}, {topic}", topic, channels, expected or {})

    def _check_count(self, topic: str, found: int) -> None:
        if found != self.topics[topic].count:
            raise self._lost(
                f"{found} messages on {topic}, where the summary has {self.topics[topic].count}"
            )

    def _lost(self, damage: str) -> LossError:
        return LossError(
            "the trace is cut short or damaged",
            where=str(self.path),
            expected="a complete MCAP file",
            got=damage,
            hint="cosim trace info reads it as far as it goes",
        )


def _taken(
    gathered: Mapping[str, TopicRows], topics: Iterable[str], counts: dict[str, int]
) -> dict[str, Table]:
    tables = {topic: gathered[topic].taken() for topic in topics}
    for topic, table in tables.items():
        counts[topic] += len(table)
    return tables
