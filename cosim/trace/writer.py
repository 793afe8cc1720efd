"""Writing a trace: MCAP as it comes, readable at any moment.

The file is `<path>.partial` until `finish` renames it. Metadata record `cosim.run` and the
attachments come first, `cosim.result` last: without it the run did not finish. Messages lie in
the order of the calls, which is to be the order of delivery (log time).
"""

from __future__ import annotations

import contextlib
import operator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from cosim.core import CosimError, InputError
from cosim.trace import layout, process_exit
from cosim.trace.block import HEAD, Records, in_order
from cosim.trace.disk import Guard, PartialFile
from cosim.trace.encode import RowEncoder
from cosim.trace.flusher import Flusher
from cosim.trace.foxglove_topics import FoxgloveTopics
from cosim.trace.rows import Poses, Rows
from cosim.trace.stream import COMPRESSIONS, McapStream

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from os import PathLike

    from cosim.trace.layout import Signal


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file carried inside the trace: the scenario, a model description.

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
    """Writes one trace; use as a context manager.

    Left by an exception, or by `close` without `finish`, it leaves `<path>.partial`: a
    well-formed MCAP file without `cosim.result`. A process killed leaves what was flushed; one
    that is told to go (SIGTERM), or ends without closing the trace, everything. Once it is
    `ended` it takes nothing more.

    Parameters
    ----------
    path : final path; an existing file there is replaced by `finish`.
    run : entries of `cosim.run`. Keys that begin with `host.` (wall clock, machine) are not
        part of the content hash; everything else is to be the same in each rerun.
    attachments : files to carry, written right after `cosim.run`.
    flush_interval_s : longest wall-clock time [s] that a row waits in memory, whether or not
        more rows come.
    compression : "zstd", "lz4" or "none".
    chunk_bytes : size [bytes] before compression at which a chunk is closed.
    fsync : hand each flush on to the disk itself, so that it survives a power cut.

    Raises
    ------
    InputError : the file cannot be created, another run is writing it, or an entry is no string.
    LossError : from any method, when the disk fails; the writer is then closed and what had
        been written stays in the `.partial` file.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        *,
        run: Mapping[str, str],
        attachments: Sequence[Attachment] = (),
        flush_interval_s: float = 1.0,
        compression: str = "zstd",
        chunk_bytes: int = 256 * 1024,
        fsync: bool = False,
    ) -> None:
        entries = _strings(layout.RUN, run)
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
        self._stream = McapStream(self._file, chunk_bytes, compression, early=True)
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
        id : for `write`.

        Raises
        ------
        InputError : a topic or signal twice, or a name that is none.
        """
        files = FileDescriptorSet(file=[layout.file_descriptor(schema_name, signals)])
        message = layout.message_class(files, schema_name)
        entries = layout.channel_metadata(signals)
        if metadata:
            entries |= _strings(topic, metadata)
        topic_id = self._register(topic, schema_name, files, entries)
        self._encoders[topic_id] = RowEncoder(topic, signals, message)
        return topic_id

    def add_dropped_topic(self, link: str) -> int:
        """Declare `/link/<link>/dropped`; its one value is the reason, "lost" or "overtaken".

        Log time is the instant at which the message arrived or was due, publish time that of
        sending.
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
        self._add(topic_id, log_time_ns, encoder(values), publish_time_ns, sequence)

    def write_rows(self, parts: Sequence[Rows | Poses]) -> None:
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
                else:
                    records += self._rows(part)
        if not records:
            return
        low = min(int(min(r.log_ns.min(), r.publish_ns.min())) for r in records)
        if low < 0 or any(r.sequence.max() >= 2**32 or r.sequence.min() < 0 for r in records):
            raise InputError(
                "time or sequence number out of range",
                where="trace",
                expected="times from 0 to 2**63 - 1 ns, sequence from 0 to 2**32 - 1",
            )
        block = in_order(records)
        with self._guard:
            self._stream.add(block)
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
        return [
            Records(
                channel=part.topic_id,
                log_ns=part.log_ns[mine],
                publish_ns=part.publish_ns[mine],
                sequence=part.sequence[mine],
                lines=lines,
                rank=rank[mine] if rank.ndim == 2 else rank,
            )
            for mine, lines in encoder.many(part.values, HEAD.size)
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
        name : who speaks: a component, a link.
        message : what is said.
        """
        topic_id, data = self._foxglove.log(time_ns, level, name, message)
        self._add(topic_id, time_ns, data, None, 0)

    def pose(self, time_ns: int, x: float, y: float, z: float, psi: float) -> None:
        """Write to `/auv/pose` (`foxglove.PoseInFrame`), in the frame `ned`.

        Position (x north, y east, z down) [m] and heading psi about z [rad] go in as they are.
        With the first pose, the transform from `map` (x east, y north, z up: what a 3D view
        expects) to `ned` is written to `/tf`: choose `map` as the display frame and down is
        down.
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
            self._stream.flush()  # so that cosim.result comes after the last message
            self._stream.metadata(layout.RESULT, entries)
            self._stream.finish()
            self._file.finish()
            self._guard.open = False
        self._ended()
        return self.path

    def close(self) -> None:
        """Close without a result, if still open; the `.partial` file stays, well-formed."""
        if not self._guard.open:
            self._ended()
            return
        with self._guard:
            if self._stream.sound:
                self._stream.finish()
            self._file.close()
            self._guard.open = False
        self._ended()

    def forget(self) -> None:
        """In a forked process: the file is the parent's; nothing of it is touched here."""
        self._guard.forget()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(CosimError):  # what went wrong first is what matters
            self.close()

    def __del__(self) -> None:
        """Nobody can write any more: what there is goes to the disk."""
        if hasattr(self, "_foxglove"):  # the beginning was not refused
            with contextlib.suppress(CosimError):
                self.close()

    def _flush(self) -> None:
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
            schema_id = self._stream.schema(schema_name, "protobuf", data)
            topic_id = self._stream.channel(topic, "protobuf", schema_id, metadata)
        self._topics.add(topic)
        return topic_id

    def _add(
        self, topic_id: int, log_ns: int, data: bytes, publish_ns: int | None, sequence: int
    ) -> None:
        try:  # before the chunk is touched: half a message in it would spoil all that follow
            log_ns, sequence = operator.index(log_ns), operator.index(sequence)
            publish = log_ns if publish_ns is None else operator.index(publish_ns)
        except TypeError as error:
            raise InputError(
                "times and sequence numbers are integers",
                where="trace",
                expected="int or numpy integer",
                got=f"log time {log_ns!r}, publish time {publish_ns!r}, sequence {sequence!r}",
            ) from error
        if not (0 <= log_ns < 2**63 and 0 <= publish < 2**63 and 0 <= sequence < 2**32):
            raise InputError(
                "time or sequence number out of range",
                where="trace",
                expected="times from 0 to 2**63 - 1 ns, sequence from 0 to 2**32 - 1",
                got=f"log time {log_ns}, publish time {publish}, sequence {sequence}",
            )
        with self._guard:
            self._stream.message(topic_id, log_ns, publish, sequence, data)
            if self._flusher.due():
                self._flush()


def _strings(where: str, entries: Mapping[str, str]) -> dict[str, str]:
    """Entries as MCAP metadata, sorted by key so that their order says nothing."""
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
