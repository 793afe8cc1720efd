"""What a record costs on its way out of an MCAP file into NumPy, by four readers.

All read every record of a file of zstd chunks of 256 KiB, from the opening of the file to one
float64 array per signal and one of times, whose values are compared with those written.

* ours: `Trace.read` of a trace of this project;
* frombuffer: no reader, the bound: the same file's chunks unpacked by zstandard and joined, and
  `np.frombuffer` told where the doubles are; no index, no checksum, no damage is looked at;
* mcap_protobuf_support: the official reader with the official protobuf decoder, the same file;
* json: the official reader and `json.loads`, the same rows as JSON by the official writer.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from cosim.trace import Rows, Signal, Trace, TraceWriter

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

Columns = tuple[NDArray[np.int64], list[NDArray[np.float64]]]


def write_protobuf(path: Path, times: Times, rows: Values) -> None:
    """A trace of this project."""
    signals = [Signal(name) for name in names(rows.shape[1])]
    with TraceWriter(path, run={}, chunk_bytes=CHUNK) as writer:
        topic = writer.add_topic(TOPIC, signals, schema_name="bench.Row")
        writer.write_rows([Rows(topic, times, rows)])
        writer.finish({})


def write_json(path: Path, times: Times, rows: Values) -> None:
    """The same rows as JSON."""
    keys = names(rows.shape[1])
    with path.open("wb") as stream:
        writer = Writer(stream, CHUNK, CompressionType.ZSTD)
        writer.start("", "benchmark")
        channel = writer.register_channel(
            TOPIC, "json", writer.register_schema("bench.Row", "jsonschema", b"{}")
        )
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            writer.add_message(
                channel, t, json.dumps(dict(zip(keys, row, strict=True))).encode(), t
            )
        writer.finish()


def ours(path: Path, doubles: int) -> Columns:
    """The reader of this project."""
    table = Trace(path).read(TOPIC)
    return table.log_time_ns, [table[name] for name in names(doubles)]


def frombuffer(path: Path, doubles: int) -> Columns:
    """NumPy alone, told the layout."""
    tags = [len(tag(i + 1)) for i in range(doubles)]
    at = 31 + np.cumsum(tags) + 8 * np.arange(doubles)
    size = int(at[-1]) + 8
    unpack = zstandard.ZstdDecompressor().decompress
    data = []
    with path.open("rb") as stream:
        for record in StreamReader(stream, emit_chunks=True).records:
            if isinstance(record, Chunk):
                chunk = unpack(record.data)
                begin = 0
                while chunk[begin] != Opcode.MESSAGE:  # what is declared stands first
                    begin += 9 + int.from_bytes(chunk[begin + 1 : begin + 9], "little")
                data.append(chunk[begin:])
    layout = {"names": ["log", *names(doubles)], "offsets": [15, *at], "itemsize": size}
    fields = np.dtype({**layout, "formats": ["<i8", *["<f8"] * doubles]})  # type: ignore[call-overload]
    rows = np.frombuffer(b"".join(data), fields)
    return rows["log"].copy(), [rows[name].copy() for name in names(doubles)]


def mcap_protobuf_support(path: Path, doubles: int) -> Columns:
    """The official decoder."""
    from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415 - a package of the tests

    fields = [f"x_{i}" for i in range(1, doubles + 1)]
    times: list[int] = []
    columns: list[list[float]] = [[] for _ in fields]
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, message, row in reader.iter_decoded_messages(log_time_order=False):
            times.append(message.log_time)
            for column, field in zip(columns, fields, strict=True):
                column.append(getattr(row, field))
    return np.array(times), [np.array(column) for column in columns]


def from_json(path: Path, doubles: int) -> Columns:
    """The official reader, and the standard library's JSON."""
    times: list[int] = []
    columns: list[list[float]] = [[] for _ in range(doubles)]
    with path.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(log_time_order=False):
            times.append(message.log_time)
            row: Any = json.loads(message.data)
            for column, name in zip(columns, names(doubles), strict=True):
                column.append(row[name])
    return np.array(times), [np.array(column) for column in columns]


Write = Callable[[Path, Times, Values], None]
VARIANTS: dict[str, tuple[Write, Callable[[Path, int], Columns]]] = {
    "ours": (write_protobuf, ours),
    "frombuffer": (write_protobuf, frombuffer),
    "mcap_protobuf_support": (write_protobuf, mcap_protobuf_support),
    "json": (write_json, from_json),
}


def case(variant: str, doubles: int, folder: str) -> dict[str, float]:
    """Read one file, in this process."""
    count = RECORDS[doubles]
    write, read = VARIANTS[variant]
    path = Path(folder, f"{write.__name__}-{doubles}.mcap")
    first = Path(folder, f"{write.__name__}-first.mcap")
    expected_times, expected = smooth(doubles, count)
    for file, records in ((first, 100), (path, count)):
        if not file.exists():
            write(file, expected_times[:records], expected[:records])
    read(first, doubles)  # what is loaded and set up once in a process is no cost of a record
    began = time.process_time()
    times, columns = read(path, doubles)
    seconds = time.process_time() - began
    same = all(np.array_equal(c, e) for c, e in zip(columns, expected.T, strict=True))
    if not (same and np.array_equal(times, expected_times)):
        raise SystemExit(f"{variant} read something else than was written")
    return {
        "cpu_us_per_record": 1e6 * seconds / count,
        "bytes_per_record": path.stat().st_size / count,
    }


def measure(tell: Callable[[str], None] = lambda _: None) -> Figures:
    """{VARIANT: {DOUBLES: {cpu_us_per_record, bytes_per_record}}}."""
    return measured(__file__, VARIANTS, tell)


if __name__ == "__main__":
    if len(sys.argv) == 4:
        print(json.dumps(case(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
    else:
        print("one half of trace.py, which measures both")
