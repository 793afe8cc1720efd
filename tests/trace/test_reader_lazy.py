"""Opening reads no data; reading reads what is asked for; a summary is believed if it adds up."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from shared import slow_share_of
from written import ETA, write

from cosim.core import CosimError, InputError, LossError
from cosim.trace import Attachment, Rows, Trace, TraceWriter, content_hash


def two_topics(path: Path, **options: Any) -> Path:
    """A topic in the first half, another in the second, in many chunks."""
    with TraceWriter(path, run={}, chunk_bytes=2000, **options) as writer:
        first = writer.add_topic("/plant/output", ETA, schema_name="t.A")
        second = writer.add_topic("/link/up", ETA, schema_name="t.B")
        times = np.arange(1000) * 10**9
        values = np.column_stack([np.arange(1000.0), -np.arange(1000.0)])
        writer.write_rows([Rows(first, times, values)])
        later = times + 1000 * 10**9
        writer.write_rows([Rows(second, later, values, later - 10**8, np.arange(1000))])
        writer.finish({})
    return path


def chunks_of(path: Path) -> list[int]:
    """Where the chunks of a file begin, by its summary."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    return [index.chunk_start_offset for index in summary.chunk_indexes]


def opened(path: Path, read: Callable[[Trace], object]) -> list[int]:
    """Which chunks a reading opens: those whose damage it notices, each damaged in its turn."""
    whole, found = path.read_bytes(), []
    for position in chunks_of(path):
        damaged = bytearray(whole)
        damaged[position + 80] ^= 1
        path.write_bytes(damaged)
        try:
            read(Trace(path))
        except LossError:
            found.append(position)
    path.write_bytes(whole)
    return found


def test_only_the_chunks_that_are_needed_are_opened(tmp_path: Path) -> None:
    path = two_topics(tmp_path / "a.mcap")
    trace, chunks = Trace(path), chunks_of(path)
    info = trace.topics["/link/up"]
    assert (info.count, info.start_ns, info.end_ns) == (1000, 1000 * 10**9, 1999 * 10**9)
    assert opened(path, lambda trace: trace.topics["/link/up"].end_ns) == []
    assert len(trace.read("/plant/output")) == 1000
    of_one = opened(path, lambda trace: trace.read("/plant/output"))
    assert of_one == chunks[: len(of_one)]
    assert 0.4 * len(chunks) < len(of_one) < 0.6 * len(chunks)
    window: dict[str, float] = {"start": 1500.0, "end": 1501.0}
    assert trace.read("/link/up", **window)["eta.x"].tolist() == [500.0, 501.0]
    assert 1 <= len(opened(path, lambda trace: trace.read("/link/up", **window))) <= 2


@pytest.mark.parametrize(
    ("start", "end", "rows"),
    [
        (None, 2.0, [0, 1, 2]),
        (997.5, None, [998, 999]),
        (3.0, 3.0, [3]),
        (-5.0, 0.5, [0]),
        (5000.0, None, []),
        (0.5, 0.6, []),
    ],
)
def test_windows_include_their_ends(
    tmp_path: Path, start: float | None, end: float | None, rows: list[int]
) -> None:
    trace = Trace(two_topics(tmp_path / "a.mcap"))
    table = trace.read("/plant/output", start=start, end=end)
    assert table["eta.x"].tolist() == rows
    assert table["eta.psi"].dtype == np.float64


@pytest.mark.parametrize("window", [{"start": float("nan")}, {"start": 2.0, "end": 1.0}])
def test_invalid_windows_are_refused(tmp_path: Path, window: dict[str, float]) -> None:
    trace = Trace(two_topics(tmp_path / "a.mcap"))
    with pytest.raises(InputError):
        trace.read("/plant/output", **window)


def test_signals_by_name(tmp_path: Path) -> None:
    """Unit, description, hold, both times; NumPy takes the series itself."""
    trace = Trace(two_topics(tmp_path / "a.mcap"))
    assert list(trace.signals) == [
        "plant.eta.x",
        "plant.eta.psi",
        "/link/up:eta.x",
        "/link/up:eta.psi",
    ]
    series = trace["plant.eta.psi"]
    assert (series.unit, series.hold, series.topic) == ("rad", "discrete", "/plant/output")
    assert float(np.max(series)) == 0.0
    late = trace.signal("/link/up:eta.x", end=1000.0)
    assert late.delivered.tolist() == [1000.0]
    assert late.sent.tolist() == [999.9]
    assert (late.delivered_ns - late.sent_ns).tolist() == [10**8]
    for name in ("plant.eta.y", "eta.x", "/link/up:z", "/nothing:x"):
        with pytest.raises(InputError):
            trace.signal(name)
    with pytest.raises(InputError, match=r"plant\.eta\.x"):
        trace.signal("plant.eta.xx")


def test_summary_and_scan_agree(tmp_path: Path) -> None:
    path = two_topics(tmp_path / "a.mcap", attachments=[Attachment("a", "text/plain", b"hello")])
    by_summary, found = Trace(path), Trace(path, incomplete=True)
    assert [
        (s.position, s.size, s.channels, s.start_ns, s.end_ns) for s in by_summary.segments
    ] == [(s.position, s.size, s.channels, s.start_ns, s.end_ns) for s in found.segments]
    assert (by_summary.counts, by_summary.metadata) == (found.counts, found.metadata)
    assert by_summary.attachments == found.attachments == {"a": b"hello"}
    assert (by_summary.media_types, by_summary.library) == (found.media_types, found.library)
    assert by_summary.spans == found.spans


def without_summary_checksum(whole: bytes) -> bytearray:
    changed = bytearray(whole)
    changed[-12:-8] = bytes(4)
    return changed


def test_inconsistent_summary_is_not_used(tmp_path: Path) -> None:
    """No byte of the summary, checksum switched off, makes a reader miss or invent a row."""
    path = two_topics(tmp_path / "a.mcap")
    truth = Trace(path).read("/plant/output")["eta.x"].tolist()
    whole = without_summary_checksum(path.read_bytes())
    start = struct.unpack_from("<Q", whole, len(whole) - 28)[0]
    choose = random.Random(3)  # noqa: S311 - to be repeatable
    read = refused = 0
    for _ in range(150):
        damaged = bytearray(whole)
        damaged[choose.randrange(start, len(whole) - 28)] ^= 1 << choose.randrange(8)
        path.write_bytes(damaged)
        try:
            got = Trace(path).read("/plant/output")["eta.x"].tolist()
        except CosimError:
            refused += 1
            continue
        read += 1
        assert got == truth
    assert read > 20


def test_a_message_outside_what_the_summary_names_is_found(tmp_path: Path) -> None:
    """Chunks and, between them, messages without a chunk."""
    path = tmp_path / "m.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE)
        writer.start("", "judge")
        channel = writer.register_channel("/j", "json", 0)
        writer.add_message(channel, 5, b'{"k": 1}', 5)
        writer.finish()
    whole = path.read_bytes()
    loose = b"\x05" + struct.pack("<QHIQQ", 22 + 8, channel, 0, 9, 9) + b'{"k": 2}'
    end = whole.rindex(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00")
    grown = bytearray(whole[:end] + loose + whole[end:])
    footer = len(grown) - 37
    start, offsets = struct.unpack_from("<QQ", grown, footer + 9)
    struct.pack_into("<QQI", grown, footer + 9, start + len(loose), offsets + len(loose), 0)
    struct.pack_into("<I", grown, end + len(loose) + 9, 0)
    path.write_bytes(grown)
    assert Trace(path).read("/j")["k"].tolist() == [1, 2]


def test_damage_behind_a_whole_summary_is_reported_when_it_is_read(tmp_path: Path) -> None:
    path = two_topics(tmp_path / "a.mcap")
    damaged = bytearray(path.read_bytes())
    position = chunks_of(path)[3]
    damaged[position + 80] ^= 1
    path.write_bytes(damaged)
    trace = Trace(path)
    assert len(trace.read("/link/up")) == 1000
    with pytest.raises(LossError, match=str(path)):
        trace.read("/plant/output")
    with pytest.raises(LossError):
        content_hash(path)
    read = Trace(path, incomplete=True)
    assert read.damage
    assert 0 < len(read.read("/plant/output")) < 1000


def bomb(size: int, claimed: int) -> bytes:
    """A chunk that unpacks to `size` zeros and claims `claimed`."""
    packed = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(size))
    head = struct.pack("<QQQI", 0, 0, claimed, 0) + struct.pack("<I", 4) + b"zstd"
    content = head + struct.pack("<Q", len(packed)) + packed
    return b"\x06" + struct.pack("<Q", len(content)) + content


@pytest.mark.parametrize(("size", "claimed"), [(2**28 + 1, 2**28 + 1), (2**28, 100), (100, 2**60)])
def test_decompression_bombs_are_refused(tmp_path: Path, size: int, claimed: int) -> None:
    """What unpacks to more than it claims, or claims more than a chunk may have."""
    path = tmp_path / "bomb.mcap"
    path.write_bytes(b"\x89MCAP0\r\n" + bomb(size, claimed))
    with pytest.raises(LossError):
        Trace(path)


def test_more_rows_than_memory_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.sysconf", lambda _name: 1)
    with pytest.raises(InputError, match="memory"):
        Trace(two_topics(tmp_path / "a.mcap")).read("/plant/output")


@pytest.mark.parametrize(("first", "every"), [(0, 13), *slow_share_of((k, 4) for k in range(4))])
def test_cut_at_every_byte(tmp_path: Path, first: int, every: int) -> None:
    """A prefix or a clear error, whatever the name; never anything else."""
    rows = [(k, k, k, [k, -k]) for k in range(12)]
    whole = write(tmp_path / "a.mcap", rows=rows, chunk_bytes=200).read_bytes()
    for name in ("cut.mcap", "cut.mcap.partial"):
        path = tmp_path / name
        for length in range(first, len(whole), every):
            path.write_bytes(whole[:length])
            try:
                trace = Trace(path)
                rows_read = trace.read("/plant/output")["eta.x"].tolist()
            except CosimError as error:
                assert name in str(error)  # noqa: PT017 - most lengths of one name raise nothing
                continue
            assert rows_read == list(range(len(rows_read)))


def test_wall_clock_stamps(tmp_path: Path) -> None:
    """Instants of this century to the nanosecond; beyond 292 years a clear error."""
    now = 1_790_000_000_123_456_789
    path = write(tmp_path / "a.mcap", rows=[(now, now, 0, [1, 2])])
    assert Trace(path).read("/plant/output").log_time_ns.tolist() == [now]
    path = tmp_path / "far.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "judge")
        writer.add_message(writer.register_channel("/j", "json", 0), 2**63, b"{}", 0)
        writer.finish()
    with pytest.raises(LossError, match="2\\*\\*63"):
        Trace(path).read("/j")


def test_checksums_are_those_of_zlib(tmp_path: Path) -> None:
    """Of the summary, of the data before it, and of each chunk."""
    path = two_topics(tmp_path / "a.mcap")
    whole = path.read_bytes()
    section = struct.unpack_from("<Q", whole, len(whole) - 28)[0]
    covered = whole[section : len(whole) - 12]
    assert zlib.crc32(covered) == struct.unpack_from("<I", whole, len(whole) - 12)[0]
    end = section - 13
    assert struct.unpack_from("<BQI", whole, end) == (0x0F, 4, zlib.crc32(whole[:end]))
    with path.open("rb") as stream:  # which the mcap package checks by zlib
        assert len([*make_reader(stream, validate_crcs=True).iter_messages()]) == 2000


def test_checksum_of_the_summary_is_checked(tmp_path: Path) -> None:
    """A summary that it does not prove is not used: the whole file is looked at, at once."""
    path = two_topics(tmp_path / "a.mcap")
    damaged = bytearray(path.read_bytes())
    damaged[chunks_of(path)[3] + 80] ^= 1
    path.write_bytes(damaged)
    assert Trace(path).complete
    # a letter of the first schema's name, which nothing but the checksum knows to be wrong
    damaged[struct.unpack_from("<Q", damaged, len(damaged) - 28)[0] + 15] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(LossError):
        Trace(path)
