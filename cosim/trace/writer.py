"""Write a trace as an MCAP file that is readable at any moment.

The file is `<path>.partial` until `finish` renames it. The metadata record `cosim.run` and the
attachments come first, `cosim.result` last: without it the run did not finish. Messages have the
order of the calls, which must be the order of delivery (log time).
"""

from __future__ import annotations

import contextlib
import operator
import struct
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from cosim.core import AnyPath, CosimError, InputError
from cosim.trace.digest import ContentDigest
from cosim.trace.file import process_exit
from cosim.trace.file.block import HEAD, Records, in_order
from cosim.trace.file.declared import Channel, Schema
from cosim.trace.file.disk import Guard, PartialFile
from cosim.trace.file.flusher import Flusher
from cosim.trace.file.records import LATEST_SIGNED_NS
from cosim.trace.file.stream import COMPRESSIONS, McapStream
from cosim.trace.rows import layout
from cosim.trace.rows.encode import RowEncoder, laid_out, waiting_message
from cosim.trace.rows.foxglove_topics import FoxgloveTopics
from cosim.trace.rows.layout import Signal
from cosim.trace.rows.rows import Lines, Poses, Rows


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file attached to the trace: the scenario, a model description.

    Parameters
    ----------
    name : file name.
    media_type : MIME type, `application/toml`, `text/xml`.
    data : its bytes.
    """

    name: str
    media_type: str
    data: bytes


class TraceWriter:
    """A writer of one trace, and a context manager that closes it.

        >>> from cosim import Trace
        >>> from cosim.trace import Signal, TraceWriter
        >>> with TraceWriter("dive.mcap", run={"title": "A dive"}) as writer:
        ...     depth = writer.add_topic("/log/depth", [Signal("z")], schema_name="log.Depth")
        ...     for second in range(3):
        ...         writer.write(depth, second * 10**9, [2.0 * second])
        ...     path = writer.finish({"status": "finished"})
        >>> Trace("dive.mcap").read("/log/depth")["z"].tolist()
        [0.0, 2.0, 4.0]

    After an exception, or `close` without `finish`, there is `<path>.partial`: a well-formed MCAP
    file without `cosim.result`. If the process is killed, it has everything flushed; on SIGTERM,
    or if the process ends without closing the trace, it has everything. An `ended` writer
    refuses further calls.

    Parameters
    ----------
    path : final path; `finish` replaces an existing file.
    run : entries of `cosim.run`. Keys that begin with `host.` (wall clock, machine) are not
        part of the content hash; all others must be the same in each rerun.
    attachments : attached files, written right after `cosim.run`.
    flush_interval_s : longest wall-clock time that a row waits in memory [s].
    compression : "zstd", "lz4" or "none".
    chunk_bytes : size before compression at which a chunk is closed [bytes].
    fsync : flush to the disk itself, so that data survive a power cut.
    content_hash : compute the content hash while writing.

    Raises
    ------
    InputError : the file cannot be created, another run is writing it, or an entry is no string.
    LossError : from any method, when the disk fails; the writer is then closed, and the
        `.partial` file has what was written before.
    """

    def __init__(
        self,
        path: AnyPath,
        *,
        run: Mapping[str, str],
        attachments: Sequence[Attachment] = (),
        flush_interval_s: float = 1.0,
        compression: str = "zstd",
        chunk_bytes: int = 256 * 1024,
        fsync: bool = False,
        content_hash: bool = False,
    ) -> None:
        entries = _strings(layout.RUN, {**run, layout.ROW_FORMAT: layout.NEWEST_ROW_FORMAT})
        if compression not in COMPRESSIONS:
            raise InputError(
                "unknown compression",
                where="TraceWriter",
                expected=", ".join(COMPRESSIONS),
                got=repr(compression),
            )
        if not flush_interval_s >= 0:
            raise InputError(
                "the flush interval is a time",
                where="TraceWriter",
                expected="flush_interval_s >= 0",
                got=repr(flush_interval_s),
            )
        self.path = Path(path)
        self.ended = False
        self._encoders: dict[int, RowEncoder] = {}
        self._topics: set[str] = set()
        self._file = PartialFile(self.path, fsync=fsync)
        self.partial_path = self._file.partial_path
        self._content = ContentDigest() if content_hash else None
        self._stream = McapStream(self._file, chunk_bytes, compression, early=True)
        self._chunk_bytes = chunk_bytes
        self._waiting: deque[bytes] = deque()
        self._guard = Guard(self._file, self._stream)
        self._flusher = Flusher(self._guard, self._flush, flush_interval_s)
        self._foxglove = FoxgloveTopics(self._register)
        process_exit.register(self)
        with self._guard:
            self._stream.start("auv-cosim")
            self._stream.metadata(layout.RUN, entries)
            for item in attachments:
                self._stream.attachment(item.name, item.media_type, item.data)
            self._stream.flush()

    def add_topic(
        self,
        topic: str,
        signals: Sequence[Signal],
        *,
        schema_name: str,
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Declare a topic of flat rows.

        Parameters
        ----------
        topic : `/plant/output`.
        signals : its signals, in the order in which `write` takes their values.
        schema_name : protobuf name of its message, `cosim.plant.Output`.
        metadata : further entries of the channel's metadata, beside those of the signals.

        Returns
        -------
        id : of the topic, for `write`.

        Raises
        ------
        InputError : a topic or signal is declared twice, a name is invalid, or there are more
            signals than protobuf has room for.
        """
        files = FileDescriptorSet(file=[layout.file_descriptor(schema_name, signals)])
        try:
            message = layout.message_class(files, schema_name)
        except TypeError as error:  # Google's implementation, beyond 65,535 bytes of fields
            raise InputError(
                "a topic of a trace has no room for so many signals",
                where=topic,
                expected="about 8,000 numbers at most",
                got=str(len(signals)),
                hint="in Python, cosim.run(..., trace=None) runs without a trace",
            ) from error
        entries = layout.channel_metadata(signals) | _strings(topic, metadata or {})
        topic_id = self._register(topic, schema_name, files, entries)
        self._encoders[topic_id] = RowEncoder(topic, signals, message)
        return topic_id

    def add_dropped_topic(self, link: str) -> int:
        """Declare `/link/<link>/dropped`; its one value is the reason, "lost", "late", ...

        Log time is when the message arrived or was due, publish time when it was sent.
        """
        return self.add_topic(
            layout.dropped_topic(link), layout.DROPPED_SIGNALS, schema_name="cosim.link.Dropped"
        )

    def write(
        self,
        topic_id: int,
        log_time_ns: int,
        values: Sequence[Any],
        *,
        publish_time_ns: int | None = None,
        sequence: int = 0,
    ) -> None:
        """Write one row.

        Parameters
        ----------
        topic_id : as `add_topic` returned it.
        log_time_ns : instant [ns] of the row; of delivery, on a link.
        values : one per signal, None where absent.
        publish_time_ns : instant of sending [ns]; the log time if None.
        sequence : sequence number, 0 to 2**32 - 1.

        Raises
        ------
        InputError : an unknown topic, the wrong number or kind of values, a time or sequence
            out of range.
        """
        encoder = self._encoder(topic_id, "write")
        publish = log_time_ns if publish_time_ns is None else publish_time_ns
        try:
            row = encoder.waiting(topic_id, sequence, log_time_ns, publish, values)
        except struct.error as error:
            raise _wrong_numbers(log_time_ns, publish, sequence) from error
        if log_time_ns > LATEST_SIGNED_NS or publish > LATEST_SIGNED_NS:
            raise _wrong_numbers(log_time_ns, publish, sequence)
        self._add(row)

    def write_rows(self, parts: Sequence[Rows | Poses | Lines]) -> None:
        """Write many rows of several topics, in order of log time, then of rank.

        The file is the same as if they had been written one by one in that order.

        Raises
        ------
        InputError : as `write`.
        """
        records: list[Records] = []
        for part in parts:
            if part.log_ns.size:
                if isinstance(part, Poses):
                    records += self._foxglove.poses(part)
                elif isinstance(part, Lines):
                    records += self._foxglove.lines(part)
                else:
                    records += self._rows(part)
        if not records:
            return
        low = min(int(min(r.log_ns.min(), r.publish_ns.min())) for r in records)
        if low < 0 or any(r.sequence.max() >= 2**32 or r.sequence.min() < 0 for r in records):
            raise _out_of_range()
        with self._guard:
            self._lay_out()
            self._put(records)
            if self._flusher.due():
                self._flush()

    def _rows(self, part: Rows) -> list[Records]:
        encoder = self._encoder(part.topic_id, "write_rows")
        if len(part.values) != part.log_ns.size:
            raise InputError(
                "rows and their times do not match",
                where="write_rows",
                expected=f"{part.log_ns.size} rows, one per time",
                got=str(len(part.values)),
            )
        rank = np.asarray(part.rank, np.int64)
        groups = list(encoder.many(part.values, HEAD.size))
        if len(groups) > 1:  # of several sizes: rows of one instant and rank stay as they are given
            numbers = np.arange(part.log_ns.size)
            ranks = np.broadcast_to(rank, (numbers.size, rank.shape[-1]))
            rank = np.column_stack([ranks, numbers])
        return [
            Records(
                channel=part.topic_id,
                log_ns=part.log_ns[mine],
                publish_ns=part.publish_ns[mine],
                sequence=part.sequence[mine],
                lines=lines,
                rank=rank[mine] if rank.ndim == 2 else rank,
            )
            for mine, lines in groups
        ]

    def _encoder(self, topic_id: int, where: str) -> RowEncoder:
        encoder = self._encoders.get(topic_id)
        if encoder is None:
            raise InputError(
                "unknown topic", where=where, expected="an id from add_topic", got=repr(topic_id)
            )
        return encoder

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Write to `/log` (`foxglove.Log`).

        Parameters
        ----------
        time_ns : instant in the run [ns].
        level : "debug", "info", "warning", "error" or "fatal".
        name : origin of the message: a component, a link.
        message : the text.
        """
        topic_id, data = self._foxglove.log(time_ns, level, name, message)
        self._add(waiting_message(topic_id, 0, time_ns, time_ns, data))

    def pose(self, time_ns: int, x: float, y: float, z: float, psi: float) -> None:
        """Write to `/auv/pose` (`foxglove.PoseInFrame`), in the frame `ned`, and to `/tf`.

        Position (x north, y east, z down) is in m, heading psi about z in rad. The first pose
        also writes the transform from `map` (x east, y north, z up) to `ned` to `/tf_static`: with
        `map` as its display frame, a 3D view shows down as down; and the hull to `/auv/hull`. The
        path so far is written to `/auv/path` every so often, and when the trace is finished.
        """
        row = np.array([[x, y, z, psi]], np.float64)
        self.write_rows([Poses(np.array([time_ns], np.int64), row)])

    def flush(self) -> None:
        """Close the chunk in progress and hand everything to the operating system."""
        with self._guard:
            self._flush()

    def finish(self, result: Mapping[str, str]) -> Path:
        """Write `cosim.result`, close the file and rename it; returns the final path."""
        entries = _strings(layout.RESULT, result)
        with self._guard:
            self._lay_out()
            if self._foxglove.has_paths:
                self._stream.flush()  # it knows the latest instant then
                now = self._stream.last_ns
                for topic_id, data in self._foxglove.whole_paths(now):
                    self._stream.message(topic_id, now, now, 0, data)
            self._stream.flush()  # cosim.result comes after the last message
            self._stream.metadata(layout.RESULT, entries)
            self._stream.finish()
            self._file.finish()
            self._guard.open = False
        self._ended()
        return self.path

    def close(self) -> None:
        """Close without a result, if still open; the `.partial` file stays, well-formed."""
        if self._guard.open:
            with self._guard:
                if self._stream.sound:
                    self._lay_out()
                    self._stream.finish()
                self._file.close()
                self._guard.open = False
        self._ended()

    def forget(self) -> None:
        """Release the file untouched, in a forked process: it is the parent's."""
        self._guard.forget()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(CosimError):  # the first error is the one to report
            self.close()

    def __del__(self) -> None:
        """Close a writer that nobody refers to any more."""
        if hasattr(self, "_foxglove"):  # the constructor raised no error
            with contextlib.suppress(CosimError):
                self.close()

    def _flush(self) -> None:
        self._lay_out()
        self._stream.flush()
        self._flusher.flushed()

    def _ended(self) -> None:
        self.ended = True
        self._flusher.stop()
        process_exit.unregister(self)

    def _register(
        self,
        topic: str,
        schema_name: str,
        files: FileDescriptorSet,
        metadata: Mapping[str, str],
    ) -> int:
        if topic in self._topics or not topic.startswith("/"):
            raise InputError(
                "topic declared twice" if topic in self._topics else "not a topic",
                where=f"add_topic: {topic!r}",
                expected="a new name that begins with /",
                got=repr(topic),
            )
        data = files.SerializeToString(deterministic=True)
        with self._guard:
            self._lay_out()
            schema_id = self._stream.schema(schema_name, "protobuf", data)
            topic_id = self._stream.channel(topic, "protobuf", schema_id, metadata)
        if self._content is not None:
            schema = Schema(schema_name, "protobuf", data)
            self._content.declare(topic_id, Channel(topic, "protobuf", schema, metadata))
        self._topics.add(topic)
        return topic_id

    @property
    def content_hash(self) -> str:
        """The content hash of what is written so far, as `cosim.trace.content_hash`."""
        if self._content is None:
            raise ValueError("expected TraceWriter(..., content_hash=True)")
        return self._content.hexdigest()

    def _add(self, row: bytes) -> None:
        if not self._guard.open:
            self._guard.check()
        # not under the guard, which would be a tenth of the cost of a row
        self._waiting.append(row)
        enough = len(self._waiting) * len(row) >= self._chunk_bytes
        if enough or self._flusher.asks():
            with self._guard:
                if self._flusher.due():
                    self._flush()
                elif enough:
                    self._lay_out()

    def _lay_out(self) -> None:
        """Hand the rows that wait to the stream (guard held)."""
        if not self._waiting:
            return
        with self._stream.undivided():
            rows = [self._waiting.popleft() for _ in range(len(self._waiting))]
            parts = [
                Records(
                    channel=int(heads["channel"][0]),
                    log_ns=heads["log"].astype(np.int64),
                    publish_ns=heads["publish"].astype(np.int64),
                    sequence=heads["sequence"].astype(np.int64),
                    lines=lines,
                    rank=mine[:, None],
                )
                for mine, heads, lines in laid_out(rows, self._encoders, HEAD.size)
            ]
            self._put(parts, by_time=False)

    def _put(self, records: Sequence[Records], *, by_time: bool = True) -> None:
        """Hand records to the content hash, and in order to the stream (guard held)."""
        with self._stream.undivided():
            watch = None if self._content is None else self._content.add_records
            self._stream.add(in_order(records, by_time=by_time, watch=watch))


def _wrong_numbers(log_ns: Any, publish_ns: Any, sequence: Any) -> InputError:
    try:
        numbers = [operator.index(number) for number in (log_ns, publish_ns, sequence)]
    except TypeError:
        return InputError(
            "times and sequence numbers are integers",
            where="trace",
            expected="int or numpy integer",
            got=f"log time {log_ns!r}, publish time {publish_ns!r}, sequence {sequence!r}",
        )
    return _out_of_range("log time {}, publish time {}, sequence {}".format(*numbers))


def _out_of_range(got: str | None = None) -> InputError:
    return InputError(
        "time or sequence number out of range",
        where="trace",
        expected="times from 0 to 2**63 - 1 ns, sequence from 0 to 2**32 - 1",
        got=got,
    )


def _strings(where: str, entries: Mapping[str, str]) -> dict[str, str]:
    """Check that metadata are strings, and sort them by key."""
    for key, value in entries.items():
        if not isinstance(key, str) or not isinstance(value, str):
            raise InputError(
                "metadata is text",
                where=f"{where}: {key!r}",
                expected="a string",
                got=f"{value!r} ({type(value).__name__})",
                hint="write numbers as str(number), structures as JSON",
            )
    return dict(sorted(entries.items()))
