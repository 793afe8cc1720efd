"""What a record costs on its way into an MCAP file: 20 doubles each, by four writers.

All write zstd chunks of 256 KiB with checksums and indexes, to the same folder, from the same
values (smooth signals: their digits do not compress, which is the harder case). Each case runs
in a process of its own, the variants in turns; the figure is the median. Timed is the wall
clock from the opening of the file to its end, the encoding of the rows included.

* ours: `TraceWriter.write_rows`, in blocks as the recorder of a run hands them on;
* ours_row_by_row: `TraceWriter.write`, one row at a time;
* official_protobuf: the mcap package's `Writer`, rows packed by `struct` as protobuf has them;
* official_json: the same writer, rows as JSON;
* foxglove_sdk: `foxglove.open_mcap` and a channel that takes bytes, rows packed the same way.
"""

from __future__ import annotations

import json
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from cosim.trace import Rows, Signal, TraceWriter
from cosim.trace.encode import tag
from cosim.trace.layout import file_descriptor

SIGNALS = 20
COUNTS = {60_000: 5, 1_000_000: 2}
"""Records, and how many times each variant writes them."""

ONCE = "official_json"
"""Writes the million once: it takes longer than all the others together."""

BLOCK = 4096
CHUNK = 256 * 1024
TOPIC, SCHEMA = "/bench", "bench.Row"
NAMES = [Signal(f"x[{i}]") for i in range(1, SIGNALS + 1)]
ROW = struct.Struct("<" + "".join(f"{len(tag(i + 1))}sd" for i in range(SIGNALS)))
Values = NDArray[np.float64]
Times = NDArray[np.int64]


def signals(count: int) -> tuple[Times, Values]:
    """Instants [ns] and rows of smooth signals, the same every time."""
    times = np.arange(count, dtype=np.int64) * 1_000_000
    rates = 0.1 * np.arange(1, SIGNALS + 1)
    return times, np.sin(np.outer(times / 1e9, rates) + np.sqrt(np.arange(SIGNALS)))


def schema() -> bytes:
    """The descriptor that all protobuf variants carry."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet  # noqa: PLC0415 - used here alone

    return FileDescriptorSet(file=[file_descriptor(SCHEMA, NAMES)]).SerializeToString()


def packer() -> Callable[[list[float]], bytes]:
    """What a user writes by hand: tag, double, tag, double, ..."""
    parts: list[Any] = [part for i in range(SIGNALS) for part in (tag(i + 1), 0.0)]

    def pack(row: list[float]) -> bytes:
        parts[1::2] = row
        return ROW.pack(*parts)

    return pack


def ours(path: Path, times: Times, rows: Values) -> None:
    """Blocks of rows."""
    with TraceWriter(path, run={}, chunk_bytes=CHUNK) as writer:
        topic = writer.add_topic(TOPIC, NAMES, schema_name=SCHEMA)
        for i in range(0, times.size, BLOCK):
            writer.write_rows([Rows(topic, times[i : i + BLOCK], rows[i : i + BLOCK])])
        writer.finish({})


def ours_row_by_row(path: Path, times: Times, rows: Values) -> None:
    """One row at a time."""
    with TraceWriter(path, run={}, chunk_bytes=CHUNK) as writer:
        topic = writer.add_topic(TOPIC, NAMES, schema_name=SCHEMA)
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            writer.write(topic, t, row)
        writer.finish({})


def official_protobuf(path: Path, times: Times, rows: Values) -> None:
    """The mcap package's writer."""
    pack = packer()
    with path.open("wb") as stream:
        writer = Writer(stream, CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
        writer.start("", "benchmark")
        channel = writer.register_channel(
            TOPIC, "protobuf", writer.register_schema(SCHEMA, "protobuf", schema())
        )
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            writer.add_message(channel, t, pack(row), t)
        writer.finish()


def official_json(path: Path, times: Times, rows: Values) -> None:
    """The mcap package's writer, with JSON."""
    names = [signal.name for signal in NAMES]
    shape = {"type": "object", "properties": {name: {"type": "number"} for name in names}}
    with path.open("wb") as stream:
        writer = Writer(stream, CHUNK, CompressionType.ZSTD, enable_data_crcs=True)
        writer.start("", "benchmark")
        described = writer.register_schema(SCHEMA, "jsonschema", json.dumps(shape).encode())
        channel = writer.register_channel(TOPIC, "json", described)
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            data = json.dumps(dict(zip(names, row, strict=True))).encode()
            writer.add_message(channel, t, data, t)
        writer.finish()


def foxglove_sdk(path: Path, times: Times, rows: Values) -> None:
    """Foxglove's writer (Rust), fed from Python as its manual does."""
    import foxglove  # noqa: PLC0415 - an extra
    from foxglove.mcap import MCAPWriteOptions  # noqa: PLC0415

    pack = packer()
    options = MCAPWriteOptions(chunk_size=CHUNK)
    with foxglove.open_mcap(path, writer_options=options):
        described = foxglove.Schema(name=SCHEMA, encoding="protobuf", data=schema())
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


def case(variant: str, count: int, folder: str) -> dict[str, float]:
    """One file, in this process."""
    times, rows = signals(count)
    # what is loaded and set up once in a process is no cost of a record
    VARIANTS[variant](Path(folder, "first.mcap"), times[:100], rows[:100])
    path = Path(folder, "measured.mcap")
    began, cpu = time.perf_counter(), time.process_time()
    VARIANTS[variant](path, times, rows)
    seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    if summary is None or summary.statistics is None or summary.statistics.message_count != count:
        raise SystemExit(f"{variant} did not write {count} messages")
    return {"seconds": seconds, "cpu_seconds": cpu, "bytes": path.stat().st_size}


def measure(tell: Callable[[str], None] = lambda _: None) -> dict[str, dict[str, dict[str, float]]]:
    """{VARIANT: {COUNT: {records_per_s, bytes_per_record}}}."""
    found: dict[str, dict[str, dict[str, float]]] = {variant: {} for variant in VARIANTS}
    for count, repeats in COUNTS.items():
        cases: dict[str, list[dict[str, float]]] = {variant: [] for variant in VARIANTS}
        for turn in range(repeats):
            for variant, done in cases.items():
                if turn and variant == ONCE and count > 100_000:
                    continue
                tell(f"writing {count} records, turn {turn + 1} of {repeats}: {variant}")
                done.append(_in_own_process(variant, count))
        for variant, done in cases.items():
            seconds = statistics.median(one["seconds"] for one in done)
            found[variant][str(count)] = {
                "records_per_s": count / seconds,
                "bytes_per_record": done[0]["bytes"] / count,
            }
    return found


def _in_own_process(variant: str, count: int) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(  # noqa: S603 - this very file
            [sys.executable, __file__, variant, str(count), folder],
            check=True,
            stdout=subprocess.PIPE,
        )
    figures: dict[str, float] = json.loads(done.stdout)
    return figures


if __name__ == "__main__":
    if len(sys.argv) == 4:
        print(json.dumps(case(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
    else:
        print("one half of trace.py, which measures both")
