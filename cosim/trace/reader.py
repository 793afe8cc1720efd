"""Reading a trace: what was run, with what result, and every topic as columns."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from mcap.opcode import Opcode

from cosim.errors import InputError, LossError
from cosim.trace import layout
from cosim.trace.decode import RowDecoder
from cosim.trace.records import Cursor, DamageError, records

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from os import PathLike

    from numpy.typing import NDArray

    from cosim.trace.layout import Signal

MESSAGE = struct.Struct("<HIQQ")
"""Head of a message record: channel, sequence, log time, publish time."""


@dataclass(frozen=True, slots=True)
class Schema:
    """An MCAP schema record; `encoding` "" and no data when the channel has none."""

    name: str = ""
    encoding: str = ""
    data: bytes = b""


@dataclass(frozen=True, slots=True)
class Channel:
    """An MCAP channel record with its schema."""

    topic: str
    encoding: str
    schema: Schema
    metadata: Mapping[str, str]


@dataclass(slots=True)
class TopicInfo:
    """What a topic holds.

    `signals` is empty when the topic is not protobuf; `start_ns` and `end_ns` are the least
    and greatest log time, None without messages.
    """

    topic: str
    schema: str
    encoding: str
    metadata: dict[str, str]
    signals: tuple[Signal, ...] = ()
    count: int = 0
    start_ns: int | None = None
    end_ns: int | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of a topic in file order.

    `columns` by FMI name: float64, int64, bool, or object (str); `present` says where each has
    a value. Where it has none, the column holds NaN, 0, False or "".
    """

    topic: str
    log_time_ns: NDArray[np.int64]
    publish_time_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    columns: dict[str, NDArray[Any]]
    present: dict[str, NDArray[np.bool_]]

    def __len__(self) -> int:
        return int(self.log_time_ns.size)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Column of a signal; `InputError` if there is none of this name."""
        if name not in self.columns:
            raise InputError(
                "no such signal",
                where=f"topic {self.topic}",
                expected=", ".join(self.columns),
                got=repr(name),
            )
        return self.columns[name]


@dataclass(slots=True)
class _Rows:
    log: list[int] = field(default_factory=list)
    publish: list[int] = field(default_factory=list)
    sequence: list[int] = field(default_factory=list)
    payloads: list[memoryview] = field(default_factory=list)


class Trace:
    """A trace file, read from its front.

    Parameters
    ----------
    path : the file; ours, or any MCAP file.
    incomplete : True: a file cut short or damaged is read as far as it goes. False: it is
        refused. None: True for a name that ends in `.partial`, else False.

    Attributes
    ----------
    run, result : entries of `cosim.run` ({} if there is none, as in foreign files) and
        `cosim.result` (None if the run did not finish).
    finished : whether there is a result.
    complete : whether the file is whole; `damage` says where and why it could not be read on.
    metadata : every metadata record, (name, entries), in file order.
    attachments, media_types : by name.
    topics : `TopicInfo` by topic, in order of appearance.
    library : who wrote the file, as its header says.

    Raises
    ------
    InputError : missing, a directory, empty, not MCAP.
    LossError : cut short or damaged, and `incomplete` does not allow it.
    """

    def __init__(self, path: str | PathLike[str], *, incomplete: bool | None = None) -> None:
        self.path = Path(path)
        self.run: dict[str, str] = {}
        self.result: dict[str, str] | None = None
        self.complete = False
        self.damage: str | None = None
        self.library = ""
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.attachments: dict[str, bytes] = {}
        self.media_types: dict[str, str] = {}
        self.topics: dict[str, TopicInfo] = {}
        self._schemas: dict[int, Schema] = {0: Schema()}
        self._channels: dict[int, Channel] = {}
        if incomplete is None:
            incomplete = self.path.name.endswith(".partial")
        try:
            self._scan()
            self.complete = True
        except DamageError as error:
            self.damage = str(error)
            if not incomplete:
                raise LossError(
                    "the trace is cut short or damaged",
                    where=str(self.path),
                    expected="a complete MCAP file",
                    got=self.damage,
                    hint="`cosim trace info` reads it as far as it goes",
                ) from error

    @property
    def finished(self) -> bool:
        """Whether the run finished: whether there is a `cosim.result`."""
        return self.result is not None

    @property
    def channels(self) -> Mapping[int, Channel]:
        """Every channel that the file declares, by its number in the file."""
        return self._channels

    def read(self, topic: str) -> Table:
        """All rows of one topic.

        Raises
        ------
        InputError : no such topic, or one that is not protobuf.
        LossError : a row that does not fit its schema.
        """
        return self.read_all([topic])[topic]

    def read_all(self, topics: Sequence[str] | None = None) -> dict[str, Table]:
        """Tables of several topics (all protobuf ones if None), in one pass over the file."""
        if topics is None:
            topics = [name for name, info in self.topics.items() if info.encoding == "protobuf"]
        decoders = {topic: self._decoder(topic) for topic in topics}
        rows = {topic: _Rows() for topic in topics}
        for channel, sequence, log, publish, payload in self.messages():
            if (collected := rows.get(channel.topic)) is not None:
                collected.log.append(log)
                collected.publish.append(publish)
                collected.sequence.append(sequence)
                collected.payloads.append(payload)
        return {topic: self._table(topic, decoders[topic], rows[topic]) for topic in topics}

    def messages(self) -> Iterator[tuple[Channel, int, int, int, memoryview]]:
        """Every message in file order: channel, sequence, log time, publish time, payload."""
        left = sum(info.count for info in self.topics.values())
        if not left:
            return
        for opcode, content in records(self.path):
            if opcode != Opcode.MESSAGE:
                continue
            channel_id, sequence, log, publish = MESSAGE.unpack_from(content)
            yield self._channels[channel_id], sequence, log, publish, content[MESSAGE.size :]
            left -= 1
            if not left:  # what lies behind the last good message may be damaged
                return

    def _scan(self) -> None:
        for opcode, content in records(self.path):
            if opcode == Opcode.MESSAGE:
                self._count(content)
            elif opcode == Opcode.CHANNEL:
                self._add_channel(Cursor(content))
            elif opcode == Opcode.SCHEMA:
                self._add_schema(Cursor(content))
            elif opcode == Opcode.METADATA:
                fields = Cursor(content)
                self._add_metadata(fields.text(), fields.mapping())
            elif opcode == Opcode.ATTACHMENT:
                fields = Cursor(content)
                fields.take(16)
                name = fields.text()
                self.media_types[name] = fields.text()
                self.attachments[name] = bytes(fields.take(fields.number(8)))
            elif opcode == Opcode.HEADER:
                fields = Cursor(content)
                fields.text()
                self.library = fields.text()

    def _count(self, content: memoryview) -> None:
        channel_id, _, log, _ = MESSAGE.unpack_from(content)
        channel = self._channels.get(channel_id)
        if channel is None:
            raise DamageError(f"a message on channel {channel_id}, which is not declared")
        info = self.topics[channel.topic]
        info.count += 1
        if info.start_ns is None or info.end_ns is None:
            info.start_ns = info.end_ns = log
        elif log > info.end_ns:
            info.end_ns = log
        elif log < info.start_ns:
            info.start_ns = log

    def _add_schema(self, fields: Cursor) -> None:
        schema_id = fields.number(2)
        name, encoding = fields.text(), fields.text()
        schema = Schema(name, encoding, bytes(fields.take(fields.number(4))))
        if schema_id == 0 or self._schemas.setdefault(schema_id, schema) != schema:
            raise DamageError(f"schema {schema_id} is declared twice, not alike")

    def _add_channel(self, fields: Cursor) -> None:
        channel_id, schema_id = fields.number(2), fields.number(2)
        topic, encoding = fields.text(), fields.text()
        if schema_id not in self._schemas:
            raise DamageError(f"channel {channel_id} has schema {schema_id}, which is not declared")
        channel = Channel(topic, encoding, self._schemas[schema_id], fields.mapping())
        known = self._channels.setdefault(channel_id, channel)
        if known is channel:
            self._add_topic(channel)
        elif known != channel:
            raise DamageError(f"channel {channel_id} is declared twice, not alike")

    def _add_topic(self, channel: Channel) -> None:
        if channel.topic in self.topics:  # foreign files have several channels on a topic
            return
        info = TopicInfo(
            channel.topic, channel.schema.name, channel.encoding, dict(channel.metadata)
        )
        if channel.encoding == channel.schema.encoding == "protobuf":
            try:
                info.signals = _decoder(channel).signals
            except ValueError:
                info.signals = ()  # `read` says what is wrong with the schema
        self.topics[channel.topic] = info

    def _add_metadata(self, name: str, entries: dict[str, str]) -> None:
        self.metadata.append((name, entries))
        if name == layout.RUN and not self.run:
            self.run = entries
        elif name == layout.RESULT:
            self.result = entries

    def _decoder(self, topic: str) -> RowDecoder:
        if topic not in self.topics:
            raise InputError(
                "no such topic",
                where=str(self.path),
                expected=", ".join(self.topics) or "a trace with topics",
                got=repr(topic),
            )
        channels = [c for c in self._channels.values() if c.topic == topic]
        if any(c.schema != channels[0].schema for c in channels):
            raise InputError("the topic has several schemas", where=f"{self.path}, {topic}")
        if not channels[0].encoding == channels[0].schema.encoding == "protobuf":
            raise InputError(
                "only protobuf topics are read as columns",
                where=f"{self.path}, {topic}",
                expected="protobuf",
                got=channels[0].encoding or "no encoding",
            )
        try:
            return _decoder(channels[0])
        except ValueError as error:
            raise InputError(
                "the topic's schema is unusable", where=f"{self.path}, {topic}", got=str(error)
            ) from error

    def _table(self, topic: str, decoder: RowDecoder, rows: _Rows) -> Table:
        try:
            columns, present = decoder(rows.payloads)
            return Table(
                topic=topic,
                log_time_ns=np.array(rows.log, dtype=np.int64),
                publish_time_ns=np.array(rows.publish, dtype=np.int64),
                sequence=np.array(rows.sequence, dtype=np.int64),
                columns=columns,
                present=present,
            )
        except (ValueError, OverflowError) as error:  # OverflowError: a time beyond 2**63 ns
            raise LossError(
                "the topic's rows cannot be read", where=f"{self.path}, {topic}", got=str(error)
            ) from error


def _decoder(channel: Channel) -> RowDecoder:
    return RowDecoder(channel.schema.name, channel.schema.data, channel.metadata)
