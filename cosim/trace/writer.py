"""Writing a trace: MCAP as it comes, readable at any moment.

The file is `<path>.partial` until `finish` renames it. Metadata record `cosim.run` and the
attachments come first, `cosim.result` last: without it the run did not finish. Messages lie in
the order of the calls, which is to be the order of delivery (log time).
"""

from __future__ import annotations

import contextlib
import math
import operator
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import CompressionType, Writer

from cosim.errors import CosimError, InputError, LossError
from cosim.trace import foxglove, layout
from cosim.trace.encode import RowEncoder

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from os import PathLike
    from types import TracebackType

    from cosim.trace.layout import Signal

NED, MAP = "ned", "map"
"""Frames: x north, y east, z down, as the vehicle's equations; x east, y north, z up."""


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
    well-formed MCAP file without `cosim.result`. A process killed leaves what was flushed.

    Parameters
    ----------
    path : final path; an existing file there is replaced by `finish`.
    run : entries of `cosim.run`. Keys that begin with `host.` (wall clock, machine) are not
        part of the content hash; everything else is to be the same in each rerun.
    attachments : files to carry, written right after `cosim.run`.
    flush_interval_s : longest wall-clock time [s] that a row waits in memory, as long as rows
        keep coming; before a step that may never return, call `flush`.
    compression : "zstd", "lz4" or "none".
    chunk_bytes : size [bytes] before compression at which a chunk is closed.

    Raises
    ------
    InputError : the file cannot be created, or an entry is no string.
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
    ) -> None:
        self.path = Path(path)
        self.partial_path = self.path.with_name(self.path.name + ".partial")
        self._encoders: dict[int, RowEncoder] = {}
        self._topics: dict[str, int] = {}
        self._interval = flush_interval_s
        self._open = False
        entries = _strings(layout.RUN, run)
        try:
            method = CompressionType[compression.upper()]
        except KeyError:
            raise InputError(
                "unknown compression",
                where="TraceWriter",
                expected="zstd, lz4 or none",
                got=repr(compression),
            ) from None
        if self.path.is_dir():
            raise InputError("the trace's path is a directory", where=str(self.path))
        try:
            self._stream = self.partial_path.open("wb")
        except OSError as error:
            raise InputError(
                "the trace cannot be created",
                where=str(self.partial_path),
                expected="a writable folder",
                got=str(error),
            ) from error
        self._open = True
        self._writer = Writer(
            self._stream, chunk_size=chunk_bytes, compression=method, enable_data_crcs=True
        )
        with self._disk():
            self._writer.start(profile="", library="auv-cosim")
            self._writer.add_metadata(layout.RUN, entries)
            for item in attachments:
                self._writer.add_attachment(0, 0, item.name, item.media_type, item.data)
            self._stream.flush()
        self._flushed = time.monotonic()

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
        encoder = self._encoders.get(topic_id)
        if encoder is None:
            raise InputError(
                "unknown topic", where="write", expected="an id from add_topic", got=repr(topic_id)
            )
        self._add(topic_id, log_time_ns, encoder(values), publish_time_ns, sequence)

    def log(self, time_ns: int, level: str, name: str, message: str) -> None:
        """Write to `/log` (`foxglove.Log`).

        Parameters
        ----------
        time_ns : instant in the run [ns].
        level : "debug", "info", "warning", "error" or "fatal".
        name : who speaks: a component, a link.
        message : what is said.
        """
        if level not in foxglove.LEVELS:
            raise InputError(
                "unknown level",
                where="log",
                expected=", ".join(foxglove.LEVELS),
                got=repr(level),
            )
        self._foxglove(
            layout.LOG_TOPIC,
            "foxglove.Log",
            time_ns,
            {"level": foxglove.LEVELS[level], "name": name, "message": message},
        )

    def pose(self, time_ns: int, x: float, y: float, z: float, psi: float) -> None:
        """Write to `/auv/pose` (`foxglove.PoseInFrame`), in the frame `ned`.

        Position (x north, y east, z down) [m] and heading psi about z [rad] go in as they are.
        With the first pose, the transform from `map` (x east, y north, z up: what a 3D view
        expects) to `ned` is written to `/tf`: choose `map` as the display frame and down is
        down.
        """
        if layout.FRAME_TOPIC not in self._topics:
            half = math.sqrt(0.5)  # half a turn about the line between x and y: x <-> y, z -> -z
            self._foxglove(
                layout.FRAME_TOPIC,
                "foxglove.FrameTransform",
                time_ns,
                {
                    "parent_frame_id": MAP,
                    "child_frame_id": NED,
                    "translation": {"x": 0.0, "y": 0.0, "z": 0.0},
                    "rotation": {"x": half, "y": half, "z": 0.0, "w": 0.0},
                },
            )
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(psi / 2), "w": math.cos(psi / 2)}
        self._foxglove(
            layout.POSE_TOPIC,
            "foxglove.PoseInFrame",
            time_ns,
            {"frame_id": NED, "pose": {"position": {"x": x, "y": y, "z": z}, "orientation": turn}},
        )

    def flush(self) -> None:
        """Close the chunk in progress and hand everything to the operating system."""
        with self._disk():
            self._writer.flush()  # type: ignore[no-untyped-call]
        self._flushed = time.monotonic()

    def finish(self, result: Mapping[str, str]) -> Path:
        """Write `cosim.result`, close the file and rename it; returns the final path."""
        entries = _strings(layout.RESULT, result)
        with self._disk():
            self._writer.flush()  # type: ignore[no-untyped-call]  # so that cosim.result comes after the last message
            self._writer.add_metadata(layout.RESULT, entries)
            self._end()
            self.partial_path.replace(self.path)
        return self.path

    def close(self) -> None:
        """Close without a result, if still open; the `.partial` file stays, well-formed."""
        if self._open:
            with self._disk():
                self._end()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.close()
            return
        with contextlib.suppress(CosimError):  # what went wrong first is what matters
            self.close()

    def _end(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._stream.close()
        self._open = False

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
        with self._disk():
            schema_id = self._writer.register_schema(schema_name, "protobuf", data)
            topic_id = self._writer.register_channel(topic, "protobuf", schema_id, dict(metadata))
        self._topics[topic] = topic_id
        return topic_id

    def _foxglove(self, topic: str, schema: str, time_ns: int, fields: Mapping[str, Any]) -> None:
        topic_id = self._topics.get(topic)
        if topic_id is None:
            topic_id = self._register(topic, schema, foxglove.descriptors(schema), {})
        seconds, nanos = divmod(int(time_ns), 10**9)
        message = foxglove.message_type(schema)(
            timestamp={"seconds": seconds, "nanos": nanos}, **fields
        )
        self._add(topic_id, time_ns, message.SerializeToString(deterministic=True), None, 0)

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
        with self._disk():
            self._writer.add_message(topic_id, log_ns, data, publish, sequence)
        if time.monotonic() - self._flushed >= self._interval:
            self.flush()

    @contextlib.contextmanager
    def _disk(self) -> Iterator[None]:
        """Refuse work after the end; turn a failing disk into an error that says so."""
        if not self._open:
            raise InputError(
                "the trace is closed", where=str(self.path), hint="write before finish() or close()"
            )
        try:
            yield
        except OSError as error:
            self._open = False
            with contextlib.suppress(OSError):
                self._stream.close()
            raise LossError(
                "the trace could not be written",
                where=str(self.partial_path),
                got=str(error),
                hint="make room on the disk; what was written before is in the .partial file",
            ) from error


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
