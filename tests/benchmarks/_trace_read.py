"""What a record costs on its way out of an MCAP file into NumPy: 20 doubles each, three readers.

All read every record of a file of zstd chunks of 256 KiB, from the opening of the file to one
float64 array per signal and one of times, whose values are compared with those written. Each
case runs in a process of its own, the variants in turns; the figure is the median.

* ours: `Trace.read` of a trace of this project;
* mcap_protobuf_support: the official reader with the official protobuf decoder, the same file;
* json: the official reader and `json.loads`, the same rows as JSON by the official writer.
"""

from __future__ import annotations

import json
import statistics
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

from cosim.trace import Rows, Signal, Trace, TraceWriter

SIGNALS = 20
COUNTS = {60_000: {"ours": 5, "others": 3}, 1_000_000: {"ours": 3, "others": 1}}
"""Records, and how many times each variant reads them; the others take long."""

CHUNK = 256 * 1024
TOPIC = "/bench"
NAMES = [f"x[{i}]" for i in range(1, SIGNALS + 1)]
Columns = tuple[NDArray[np.int64], list[NDArray[np.float64]]]


def signals(count: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Instants [ns] and rows of smooth signals, the same every time."""
    times = np.arange(count, dtype=np.int64) * 1_000_000
    rates = 0.1 * np.arange(1, SIGNALS + 1)
    return times, np.sin(np.outer(times / 1e9, rates) + np.sqrt(np.arange(SIGNALS)))


def write_protobuf(path: Path, count: int) -> None:
    """A trace of this project."""
    times, rows = signals(count)
    with TraceWriter(path, run={}, chunk_bytes=CHUNK) as writer:
        topic = writer.add_topic(TOPIC, [Signal(n) for n in NAMES], schema_name="bench.Row")
        writer.write_rows([Rows(topic, times, rows)])
        writer.finish({})


def write_json(path: Path, count: int) -> None:
    """The same rows as JSON."""
    times, rows = signals(count)
    with path.open("wb") as stream:
        writer = Writer(stream, CHUNK, CompressionType.ZSTD)
        writer.start("", "benchmark")
        channel = writer.register_channel(
            TOPIC, "json", writer.register_schema("bench.Row", "jsonschema", b"{}")
        )
        for t, row in zip(times.tolist(), rows.tolist(), strict=True):
            writer.add_message(
                channel, t, json.dumps(dict(zip(NAMES, row, strict=True))).encode(), t
            )
        writer.finish()


def ours(path: Path) -> Columns:
    """The reader of this project."""
    table = Trace(path).read(TOPIC)
    return table.log_time_ns, [table[name] for name in NAMES]


def mcap_protobuf_support(path: Path) -> Columns:
    """The official decoder."""
    from mcap_protobuf.decoder import DecoderFactory  # noqa: PLC0415 - a package of the tests

    fields = [f"x_{i}" for i in range(1, SIGNALS + 1)]
    times: list[int] = []
    columns: list[list[float]] = [[] for _ in fields]
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, _, message, row in reader.iter_decoded_messages(log_time_order=False):
            times.append(message.log_time)
            for column, field in zip(columns, fields, strict=True):
                column.append(getattr(row, field))
    return np.array(times), [np.array(column) for column in columns]


def from_json(path: Path) -> Columns:
    """The official reader, and the standard library's JSON."""
    times: list[int] = []
    columns: list[list[float]] = [[] for _ in NAMES]
    with path.open("rb") as stream:
        for _, _, message in make_reader(stream).iter_messages(log_time_order=False):
            times.append(message.log_time)
            row: Any = json.loads(message.data)
            for column, name in zip(columns, NAMES, strict=True):
                column.append(row[name])
    return np.array(times), [np.array(column) for column in columns]


VARIANTS: dict[str, tuple[Callable[[Path, int], None], Callable[[Path], Columns]]] = {
    "ours": (write_protobuf, ours),
    "mcap_protobuf_support": (write_protobuf, mcap_protobuf_support),
    "json": (write_json, from_json),
}


def case(variant: str, count: int, folder: str) -> dict[str, float]:
    """Read one file, in this process."""
    write, read = VARIANTS[variant]
    path = Path(folder, f"{write.__name__}-{count}.mcap")
    first = Path(folder, f"{write.__name__}-first.mcap")
    for file, records in ((first, 100), (path, count)):
        if not file.exists():
            write(file, records)
    read(first)  # what is loaded and set up once in a process is no cost of a record
    began = time.perf_counter()
    times, columns = read(path)
    seconds = time.perf_counter() - began
    expected_times, expected = signals(count)
    same = all(np.array_equal(c, e) for c, e in zip(columns, expected.T, strict=True))
    if not (same and np.array_equal(times, expected_times)):
        raise SystemExit(f"{variant} read something else than was written")
    return {"seconds": seconds, "bytes": path.stat().st_size}


def measure(tell: Callable[[str], None] = lambda _: None) -> dict[str, dict[str, dict[str, float]]]:
    """{VARIANT: {COUNT: {records_per_s, bytes_per_record}}}."""
    found: dict[str, dict[str, dict[str, float]]] = {variant: {} for variant in VARIANTS}
    for count, repeats in COUNTS.items():
        cases: dict[str, list[dict[str, float]]] = {variant: [] for variant in VARIANTS}
        with tempfile.TemporaryDirectory() as folder:
            for turn in range(max(repeats.values())):
                for variant, done in cases.items():
                    if turn >= repeats.get(variant, repeats["others"]):
                        continue
                    tell(f"reading {count} records, turn {turn + 1}: {variant}")
                    done.append(_in_own_process(variant, count, folder))
        for variant, done in cases.items():
            seconds = statistics.median(one["seconds"] for one in done)
            found[variant][str(count)] = {
                "records_per_s": count / seconds,
                "bytes_per_record": done[0]["bytes"] / count,
            }
    return found


def _in_own_process(variant: str, count: int, folder: str) -> dict[str, float]:
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
        print(json.dumps(measure(lambda text: print(text, file=sys.stderr)), indent=1))
