"""What a record costs on its way into an MCAP file: 10, 20 and 200 doubles, by four writers.

All write zstd chunks of 256 KiB with checksums and indexes, to the same folder, from the same
values. Timed is from the opening of the file to its end, the encoding of the rows included.

* ours: `TraceWriter.write_rows`, in blocks as the recorder of a run hands them on;
* ours_row_by_row: `TraceWriter.write`, one row at a time;
* official_protobuf: the mcap package's `Writer`, rows packed by `struct` as protobuf has them;
* official_json: the same writer, rows as JSON;
* foxglove_sdk: `foxglove.open_mcap` and a channel that takes bytes, rows packed the same way.
"""

from __future__ import annotations

import functools
import json
import struct
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from cosim.trace import Rows, Signal, TraceWriter

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks._trace_rows import (
    CHUNK,
    RECORDS,
    TOPIC,
    Figures,
    Times,
    Values,
    measured,
    names,
    smooth,
    tag,
)

BLOCK = 4096
SCHEMA = "bench.Row"


def signals(rows: Values) -> list[Signal]:
    """Their names."""
    return [Signal(name) for name in names(rows.shape[1])]


def schema(rows: Values) -> bytes:
    """The descriptor that all protobuf variants carry: that of a trace of this project."""
    return _schema(rows.shape[1])


@functools.cache
def _schema(doubles: int) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        with TraceWriter(Path(folder, "schema.mcap"), run={}) as writer:
            described = [Signal(name) for name in names(doubles)]
            writer.add_topic(TOPIC, described, schema_name=SCHEMA)
            path = writer.finish({})
        with path.open("rb") as stream:
            summary = make_reader(stream).get_summary()
        if summary is None:
            raise SystemExit("a trace without a summary")
        (found,) = summary.schemas.values()
        return found.data


def packer(rows: Values) -> Callable[[list[float]], bytes]:
    """What a user writes by hand: tag, double, tag, double, ..."""
    tags = [tag(i + 1) for i in range(rows.shape[1])]
    packed = struct.Struct("<" + "".join(f"{len(t)}sd" for t in tags))
    parts: list[Any] = [part for t in tags for part in (t, 0.0)]

    def pack(row: list[float]) -> bytes:
        parts[1::2] = row
        return packed.pack(*parts)

    return pack


def ours(path: Path, times: Times, rows: Values) -> None:
    """Blocks of rows."""
    with TraceWriter(path, run={}, chunk_bytes=CHUNK) as writer:
        topic = writer.add_topic(TOPIC, signals(rows), schema_name=SCHEMA)
        for i in range(0, times.size, BLOCK):
            writer.write_rows([Rows(topic, times[i : i + BLOCK], rows[i : i + BLOCK])])
        writer.finish({})


def ours_row_by_row(path: Path, times: Times, rows: Values) -> None:
    """One row at a time."""
    with TraceWriter(path, run={}, chunk_bytes=CHUNK) as writer:
        topic = writer.add_topic(TOPIC, signals(rows), schema_name=SCHEMA)
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            writer.write(topic, t, row)
        writer.finish({})


def official_protobuf(path: Path, times: Times, rows: Values) -> None:
    """The mcap package's writer."""
    pack = packer(rows)
    with path.open("wb") as stream:
        writer = Writer(stream, CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
        writer.start("", "benchmark")
        channel = writer.register_channel(
            TOPIC, "protobuf", writer.register_schema(SCHEMA, "protobuf", schema(rows))
        )
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            writer.add_message(channel, t, pack(row), t)
        writer.finish()


def official_json(path: Path, times: Times, rows: Values) -> None:
    """The mcap package's writer, with JSON."""
    keys = names(rows.shape[1])
    shape = {"type": "object", "properties": {key: {"type": "number"} for key in keys}}
    with path.open("wb") as stream:
        writer = Writer(stream, CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
        writer.start("", "benchmark")
        described = writer.register_schema(SCHEMA, "jsonschema", json.dumps(shape).encode())
        channel = writer.register_channel(TOPIC, "json", described)
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            data = json.dumps(dict(zip(keys, row, strict=True))).encode()
            writer.add_message(channel, t, data, t)
        writer.finish()


def foxglove_sdk(path: Path, times: Times, rows: Values) -> None:
    """Foxglove's writer (Rust), fed from Python as its manual does."""
    import foxglove  # noqa: PLC0415 - an extra
    from foxglove.mcap import MCAPWriteOptions  # noqa: PLC0415

    pack = packer(rows)
    options = MCAPWriteOptions(chunk_size=CHUNK)
    with foxglove.open_mcap(path, writer_options=options):
        described = foxglove.Schema(name=SCHEMA, encoding="protobuf", data=schema(rows))
        channel = foxglove.Channel(TOPIC, schema=described, message_encoding="protobuf")
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            channel.log(pack(row), log_time=t)


VARIANTS: dict[str, Callable[[Path, Times, Values], None]] = {
    "ours": ours,
    "ours_row_by_row": ours_row_by_row,
    "official_protobuf": official_protobuf,
    "official_json": official_json,
    "foxglove_sdk": foxglove_sdk,
}


def case(variant: str, doubles: int, folder: str) -> dict[str, float]:
    """One file, in this process."""
    count = RECORDS[doubles]
    times, rows = smooth(doubles, count)
    # what is loaded and set up once in a process is no cost of a record
    VARIANTS[variant](Path(folder, "first.mcap"), times[:100], rows[:100])
    Path(folder, "first.mcap").unlink()
    path = Path(folder, "measured.mcap")
    began = time.process_time()
    VARIANTS[variant](path, times, rows)
    seconds = time.process_time() - began
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None or summary.statistics.message_count != count:
        raise SystemExit(f"{variant} did not write {count} messages")
    size = path.stat().st_size
    path.unlink()
    return {"cpu_us_per_record": 1e6 * seconds / count, "bytes_per_record": size / count}


def measure(tell: Callable[[str], None] = lambda _: None) -> Figures:
    """{VARIANT: {DOUBLES: {cpu_us_per_record, bytes_per_record}}}."""
    return measured(__file__, VARIANTS, tell)


if __name__ == "__main__":
    if len(sys.argv) == 4:
        print(json.dumps(case(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
    else:
        print("one half of trace.py, which measures both")
