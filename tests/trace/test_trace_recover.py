"""What `recover` saves, as the official reader sees it; what it says was lost."""

from __future__ import annotations

import random
import struct
import zlib
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap.records import Chunk, DataEnd
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from shared import share_of
from written import write

from cosim.core import CosimError, InputError
from cosim.trace import Attachment, Trace, content_hash, recover

ROWS = [(10 * k, 10 * k, k, [0.5 * k, -k]) for k in range(200)]
NOTE = Attachment("note.txt", "text/plain", b"hello" * 30)


def contents(path: Path) -> tuple[list[Any], list[Any], list[Any]]:
    """Messages, metadata but that of the recovery, attachments: by the official reader."""
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        messages = [
            (schema and schema.name, channel.topic, m.log_time, m.publish_time, m.sequence, m.data)
            for schema, channel, m in reader.iter_messages(log_time_order=False)
        ]
        metadata = [
            (m.name, m.metadata) for m in reader.iter_metadata() if m.name != "cosim.recovered"
        ]
        attachments = [
            (a.name, a.media_type, a.log_time, a.data) for a in reader.iter_attachments()
        ]
    return messages, metadata, attachments


def a_trace(path: Path, **options: Any) -> Path:
    return write(path, rows=ROWS, chunk_bytes=600, attachments=[NOTE], **options)


def foreign(path: Path, *, chunking: bool, compression: CompressionType) -> Path:
    """JSON by the official writer, an attachment and metadata in between."""
    with path.open("wb") as stream:
        writer = Writer(stream, 500, compression, use_chunking=chunking, enable_data_crcs=True)
        writer.start("ros1", "someone else")
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channels = [writer.register_channel(f"/{i}", "json", schema, {"i": str(i)}) for i in (0, 1)]
        channels.append(writer.register_channel("/none", "json", 0))
        for k in range(60):
            writer.add_message(channels[k % 3], k, b'{"k": %d}' % k, k, k)
            if k == 30:
                writer.add_attachment(5, 6, "a.bin", "application/x", bytes(range(256)))
                writer.add_metadata("m", {"x": "y"})
        writer.finish()
    return path


def cut_everywhere(whole: Path, tmp_path: Path, step: int) -> None:
    """Check that a cut file gives a prefix of all records, or an error."""
    data = whole.read_bytes()
    everything = contents(whole)
    cut, out = tmp_path / "cut.mcap.partial", tmp_path / "out.mcap"
    kept = [0, 0, 0]
    refused = set()
    for length in sorted({*range(0, len(data), step), len(data) - 1, len(data)}):
        cut.write_bytes(data[:length])
        try:
            result = recover(cut, out, force=True)
        except InputError as error:
            assert kept == [0, 0, 0]
            refused.add(error.what)
            continue
        found = contents(out)
        for i in range(3):
            assert found[i] == everything[i][: len(found[i])]
            assert len(found[i]) >= kept[i]
        kept = [len(part) for part in found]
        assert kept == [result.messages, result.metadata, result.attachments]
        if not result.lost:
            assert found == everything
        if result.lost_messages is not None:
            assert kept[0] + result.lost_messages == len(everything[0])
        assert result.complete == (length == len(data))
    assert kept == [len(part) for part in everything]
    assert refused <= {
        "the file is empty",
        "not an MCAP file",
        "nothing in this file can be recovered",
    }


@pytest.mark.parametrize("compression", ["zstd", "none"])
def test_cut_at_many_lengths(tmp_path: Path, compression: str) -> None:
    cut_everywhere(a_trace(tmp_path / "a.mcap", compression=compression), tmp_path, 97)


@pytest.mark.slow
@pytest.mark.parametrize("compression", share_of(["zstd", "none"]))
def test_cut_at_every_length(tmp_path: Path, compression: str) -> None:
    options = {"rows": ROWS[:14], "chunk_bytes": 200, "compression": compression}
    whole = write(tmp_path / "a.mcap", **options)
    cut_everywhere(whole, tmp_path, 1)


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunking", [True, False])
def test_foreign_file_cut(tmp_path: Path, compression: CompressionType, *, chunking: bool) -> None:
    """Other tools' files, other encodings, without chunks."""
    whole = foreign(tmp_path / "a.mcap", chunking=chunking, compression=compression)
    cut_everywhere(whole, tmp_path, 41)
    out = tmp_path / "out.mcap"
    (tmp_path / "b.mcap").write_bytes(whole.read_bytes()[:-1])
    assert not recover(tmp_path / "b.mcap", out, force=True).lost
    with out.open("rb") as stream:
        reader = make_reader(stream)
        assert (reader.get_header().profile, reader.get_header().library) == (
            "ros1",
            "someone else",
        )


def test_recovered_trace_is_a_trace(tmp_path: Path) -> None:
    """It is finished, has the content hash of the cut file, and records its recovery."""
    whole = a_trace(tmp_path / "a.mcap")
    partial = tmp_path / "b.mcap.partial"
    partial.write_bytes(whole.read_bytes()[:4000])
    result = recover(partial)
    assert result.output == tmp_path / "b.recovered.mcap"
    assert (result.lost, result.lost_messages, result.finished) == (True, None, False)
    assert content_hash(result.output) == content_hash(partial)
    reported = dict(Trace(result.output).metadata)["cosim.recovered"]
    assert reported["host.lost_messages"] == "unknown"
    assert "ends within a record" in reported["host.damage"]
    assert partial.stat().st_size == 4000
    assert not list(tmp_path.glob("*recovering*"))


def chunks_of(path: Path) -> list[tuple[int, int, int]]:
    """Where each chunk lies, where it ends, and how many messages it holds."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
        assert summary is not None
        found = []
        for index in summary.chunk_indexes:
            start, end = index.chunk_start_offset, index.chunk_start_offset + index.chunk_length
            stream.seek(end)
            (count,) = struct.unpack("<I", stream.read(15)[11:])
            found.append((start, end, count // 16))
    return found


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
@pytest.mark.parametrize("with_end", [True, False])
def test_damaged_chunk_is_left_out_whole_and_counted(
    tmp_path: Path, compression: str, *, with_end: bool
) -> None:
    """With --strict. Also the first, which others of its kind declare their channels in."""
    path = a_trace(tmp_path / "a.mcap", compression=compression)
    whole = path.read_bytes()
    everything = contents(path)
    chunks = chunks_of(path)
    for number in (0, 1, len(chunks) - 1):
        start, end, count = chunks[number]
        before = sum(c[2] for c in chunks[:number])
        damaged = bytearray(whole)
        damaged[(start + 60 + end) // 2] ^= 0x10
        bad = tmp_path / "bad.mcap"
        bad.write_bytes(damaged if with_end else damaged[:-30])
        result = recover(bad, tmp_path / "out.mcap", force=True, strict=True)
        assert (result.lost, result.lost_messages) == (True, count)
        first = result.damage[0]
        assert (first.position, first.length) == (start, end - start)
        messages, metadata, attachments = contents(result.output)
        assert messages == everything[0][:before] + everything[0][before + count :]
        assert (metadata, attachments) == everything[1:]


def test_messages_on_a_channel_that_is_not_declared_are_counted(tmp_path: Path) -> None:
    """Neither in the data nor in the summary, of a file without checksums: they are of no use."""
    path = foreign(tmp_path / "a.mcap", chunking=False, compression=CompressionType.NONE)
    whole = bytearray(path.read_bytes())
    at, declared = 0, 0
    while (at := whole.find(b"\x02\x00\x00\x00/1", at + 1)) > 0:
        assert whole[at - 13] == 0x04  # a channel: opcode, length, id, schema, topic
        whole[at - 4 : at - 2] = b"\x63\x00"
        declared += 1
    assert declared == 2
    (start,) = struct.unpack("<Q", whole[-28:-20])
    whole[start - 4 : start] = whole[-12:-8] = bytes(4)
    path.write_bytes(bytes(whole))
    result = recover(path, tmp_path / "out.mcap")
    assert (result.messages, result.lost_messages, result.lost) == (40, 20, True)


@pytest.mark.slow
def test_overwritten_bytes_lose_no_other_message(tmp_path: Path) -> None:
    """Also in lengths, with --strict: kept messages are unchanged, losses reported."""
    choose = random.Random(3)  # noqa: S311 - to be repeatable
    out = tmp_path / "out.mcap"
    for compression in ("zstd", "none"):
        path = a_trace(tmp_path / "a.mcap", compression=compression)
        whole, everything = path.read_bytes(), contents(path)
        true = set(everything[0])
        for _ in range(120):
            at, size = choose.randrange(8, len(whole)), choose.choice([1, 4, 30, 700])
            noise = bytes(choose.randrange(256) for _ in range(size))
            damaged = (whole[:at] + noise + whole[at + size :])[: len(whole)]
            bad = tmp_path / "bad.mcap"
            bad.write_bytes(damaged)
            if damaged == whole:
                continue
            try:
                result = recover(bad, out, force=True, strict=True)
            except InputError:
                continue
            found = contents(out)[0]
            assert true.issuperset(found), (compression, at, size)
            assert [m for m in everything[0] if m in set(found)] == found
            if len(found) < len(everything[0]):
                assert result.lost
            if result.lost_messages is not None:
                assert len(found) + result.lost_messages == len(everything[0])


def test_whole_file_is_not_rewritten(tmp_path: Path) -> None:
    """Nothing is written, unless a copy is asked for."""
    path = a_trace(tmp_path / "a.mcap")
    before = sorted(tmp_path.iterdir())
    result = recover(path)
    assert (result.output, result.complete, result.lost) == (path, True, False)
    assert (result.messages, result.lost_messages) == (200, 0)
    assert sorted(tmp_path.iterdir()) == before
    copy = recover(path, tmp_path / "b.mcap")
    assert copy.output.read_bytes() == path.read_bytes()


def test_output_is_not_overwritten(tmp_path: Path) -> None:
    path = a_trace(tmp_path / "a.mcap")
    partial = path.rename(tmp_path / "a.mcap.partial")
    partial.write_bytes(partial.read_bytes()[:-9])
    taken = tmp_path / "taken.mcap"
    taken.write_bytes(b"mine")
    with pytest.raises(InputError, match="exists"):
        recover(partial, taken)
    with pytest.raises(InputError, match="is the file"):
        recover(partial, partial, force=True)
    recover(partial, tmp_path / "no" / "a.mcap")
    assert taken.read_bytes() == b"mine"
    recover(partial, taken, force=True)
    assert len(contents(taken)[0]) == 200
    # the name that the run would have given it
    recover(partial, path)
    assert len(contents(path)[0]) == 200
    assert partial.exists()


def test_hostile_lengths_take_no_memory(tmp_path: Path) -> None:
    """Records and fields that claim more than there is, zeros, and no end of small records."""
    start = b"\x89MCAP0\r\n" + struct.pack("<BQII", 1, 8, 0, 0)
    some = struct.pack("<BQI", 12, 12, 4) + b"name" + struct.pack("<I", 0)
    for hostile in (
        struct.pack("<BQ", 6, 2**63) + bytes(50),
        struct.pack("<BQ", 9, 2**40) + bytes(50),
        struct.pack("<BQ", 12, 2**33) + bytes(50),
        struct.pack("<BQQQQIIQ", 6, 40, 0, 0, 2**62, 0, 0, 0),
        struct.pack("<BQI", 12, 8, 2**31) + bytes(4),
        bytes(3_000_000),
        b"\x09" * 300_000,
        struct.pack("<BQ", 0x90, 2**50),
        zlib.compress(bytes(range(256)) * 500) * 50,
    ):
        path = tmp_path / "a.mcap"
        path.write_bytes(start + some + hostile + some)
        result = recover(path, tmp_path / "out.mcap", force=True)
        assert result.lost
        assert result.metadata >= 1


@pytest.mark.parametrize("content", [b"", b"\x89MC", b"PK\x03\x04" * 30, b"\x89MCAP0\r\n"])
def test_file_without_records_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.mcap").write_bytes(content)
    with pytest.raises(InputError) as caught:
        recover(tmp_path / "a.mcap")
    assert str(tmp_path) in str(caught.value)
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
    for path in (tmp_path, tmp_path / "none.mcap"):
        with pytest.raises(CosimError):
            recover(path)


def test_file_with_damaged_start_is_recovered(tmp_path: Path) -> None:
    """Even without its first bytes a file that is one is recovered."""
    path = a_trace(tmp_path / "a.mcap")
    whole = path.read_bytes()
    everything = contents(path)
    path.write_bytes(b"garbage!" + whole[8:])
    result = recover(path)
    assert (result.lost, result.damage[0].position) == (True, 0)
    assert contents(result.output) == everything


def test_chunks_are_kept_in_their_compression(tmp_path: Path) -> None:
    path = a_trace(tmp_path / "a.mcap", compression="lz4")
    path.write_bytes(path.read_bytes()[:-20])
    with recover(path).output.open("rb") as stream:
        kinds = [
            r.compression
            for r in StreamReader(stream, emit_chunks=True).records
            if isinstance(r, Chunk)
        ]
    assert set(kinds) == {"lz4"}
    with recover(path, tmp_path / "b.mcap").output.open("rb") as stream:
        end = [r for r in StreamReader(stream).records if isinstance(r, DataEnd)]
    assert end[0].data_section_crc != 0
