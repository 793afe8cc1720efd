"""`recover` loses nothing that a plain reader has, and `verify` agrees with it."""

from __future__ import annotations

import json
import random
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap_files import records_of
from shared import slow_share_of
from test_trace_recover import ROWS, a_trace, chunks_of, contents
from test_trace_verify import a_run, patched
from written import write

from cosim.core import CosimError, InputError
from cosim.trace import Trace, recover, verify

Key = tuple[str, int, int, int, bytes]


def plain(path: Path, *, seeking: bool) -> Counter[Key]:
    """What the official reader has of a file, its checks off, before it gives up."""
    found: Counter[Key] = Counter()
    with path.open("rb") as stream:
        try:
            reader = make_reader(stream) if seeking else NonSeekingReader(stream)
            for _, channel, m in reader.iter_messages(log_time_order=False):
                found[channel.topic, m.log_time, m.publish_time, m.sequence, bytes(m.data)] += 1
        except Exception:  # noqa: BLE001, S110 - it raises what it likes
            pass
    return found


def flips(whole: bytes, count: int, seed: int) -> Iterator[tuple[int, bytes]]:
    choose = random.Random(seed)  # noqa: S311 - to be repeatable
    for _ in range(count):
        damaged = bytearray(whole)
        at = choose.randrange(8, len(whole))
        damaged[at] ^= 1 << choose.randrange(8)
        yield at, bytes(damaged)


def kept(path: Path) -> Counter[Key]:
    return Counter({m[1:]: n for m, n in Counter(contents(path)[0]).items()})


@pytest.mark.parametrize(
    ("compression", "count"),
    [
        ("none", 60),
        ("zstd", 30),
        ("lz4", 30),
        *slow_share_of((c, 500) for c in ("none", "zstd", "lz4")),
    ],
)
def test_no_flipped_bit_loses_what_a_plain_reader_has(
    tmp_path: Path, compression: str, count: int
) -> None:
    """By its index or from front to end, and whatever the bit is in; and verify is of one mind."""
    source = a_trace(tmp_path / "a.mcap", compression=compression)
    whole, true = source.read_bytes(), kept(source)
    bad, out = tmp_path / "bad.mcap", tmp_path / "out.mcap"
    for at, damaged in flips(whole, count, seed=count):
        bad.write_bytes(damaged)
        try:
            result = recover(bad, out, force=True)
        except InputError:
            assert at < 30
            continue
        assert (verify(bad).verdict == "ok") == result.complete, at
        found = kept(result.output)
        for seeking in (True, False):
            # by topic, times and number: of a message with a false length, the right one is kept
            there = {m[:4] for m in plain(bad, seeking=seeking)} & {m[:4] for m in true}
            lost = there - {m[:4] for m in found}
            assert not lost, (at, seeking, lost)
        wrong = sum((found - true).values())
        assert wrong <= max(result.suspect_messages, 0), at


def test_a_flipped_byte_costs_one_value(tmp_path: Path) -> None:
    """Without compression: all messages are there, those of the chunk are named."""
    path = a_trace(tmp_path / "a.mcap", compression="none")
    whole, everything = path.read_bytes(), contents(path)[0]
    start, end, count = chunks_of(path)[1]
    damaged = bytearray(whole)
    damaged[whole.index(everything[15][-1], start, end) + 5] ^= 0x10
    path.write_bytes(damaged)
    assert recover(path, tmp_path / "b.mcap", strict=True).lost_messages == count
    result = recover(path, tmp_path / "c.mcap")
    assert (result.lost, result.lost_messages, result.suspect_messages) == (True, 0, count)
    assert [d.outcome for d in result.damage] == ["suspect"]
    messages = contents(result.output)[0]
    assert sum(a != b for a, b in zip(messages, everything, strict=True)) == 1
    entries = dict(Trace(result.output).metadata)["cosim.recovered"]
    (named,) = json.loads(entries["host.suspect"])
    first = chunks_of(tmp_path / "b.mcap")[0][2]
    assert named["messages"][1] - named["messages"][0] == count
    assert named["messages"][0] <= first
    assert named["topics"] == {"/plant/output": count}
    (low, high) = named["log_ns"]
    assert [m[2] for m in messages[slice(*named["messages"])]] == list(range(low, high + 1, 10))
    suspect = [c for c in verify(result.output).checks if c.name == "suspect"]
    assert [c.verdict for c in suspect] == ["failed"]


def test_a_zstd_frame_is_kept_up_to_its_damage(tmp_path: Path) -> None:
    """Of a chunk that does not decompress, the blocks before."""
    choose = random.Random(1)  # noqa: S311 - to be repeatable
    rows = [(k, k, k, [choose.random(), choose.random()]) for k in range(8000)]
    path = write(tmp_path / "a.mcap", rows=rows, chunk_bytes=2**20)
    everything = contents(path)[0]
    (start, end, count), *_ = chunks_of(path)
    damaged = bytearray(path.read_bytes())
    damaged[end - 2000 : end] = bytes(2000)
    path.write_bytes(damaged)
    result = recover(path, tmp_path / "b.mcap")
    assert start < end
    messages = contents(result.output)[0]
    assert 0.4 * count < len(messages) < count == len(everything)
    assert messages == everything[: len(messages)]
    assert result.lost_messages == count - len(messages)


def test_a_record_whose_head_is_damaged_is_mended_by_its_index(tmp_path: Path) -> None:
    """A chunk and an attachment that their checksums prove: nothing is lost, nothing suspect."""
    path = a_trace(tmp_path / "a.mcap")
    whole, everything = path.read_bytes(), contents(path)
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    attached = summary.attachment_indexes[0].offset
    for place in (chunks_of(path)[2][0], attached):
        for byte, value in ((0, 0x7F), (2, 0x55), (8, 1)):
            damaged = bytearray(whole)
            damaged[place + byte] = value
            path.write_bytes(damaged)
            result = recover(path, tmp_path / "b.mcap", force=True)
            assert (result.lost, result.lost_messages, result.complete) == (False, 0, False)
            assert [d.outcome for d in result.damage] == ["mended"]
            assert contents(result.output) == everything


def test_a_chunk_with_the_opcode_of_another_record_is_found(tmp_path: Path) -> None:
    """Some of them are no damage by themselves: an index, a summary offset, a private record."""
    path = a_trace(tmp_path / "a.mcap")
    whole, true = path.read_bytes(), kept(path)
    starts = [record.position for record in records_of(path) if record.opcode == Opcode.CHUNK]
    for at in starts[:2]:
        for opcode in (*range(1, 16), 0x86):
            path.write_bytes(patched(whole, at, bytes([opcode])))
            result = recover(path, tmp_path / "b.mcap", force=True)
            assert kept(result.output) == true, (at, opcode)
            assert result.complete == (opcode == Opcode.CHUNK)


def test_a_message_that_may_be_another_record_is_marked(tmp_path: Path) -> None:
    """A message index with the opcode of a message, where all messages are in chunks."""
    path = a_trace(tmp_path / "a.mcap")
    whole, true = bytearray(path.read_bytes()), kept(path)
    (at, *_) = [r.position for r in records_of(path) if r.opcode == Opcode.MESSAGE_INDEX]
    whole[at] = Opcode.MESSAGE
    path.write_bytes(whole)
    result = recover(path, tmp_path / "b.mcap")
    found = kept(result.output)
    assert not true - found
    assert (found - true).total() == result.suspect_messages == 1
    assert recover(path, tmp_path / "c.mcap", strict=True).suspect_messages == 0


def test_what_is_left_of_a_chunk_is_found_by_a_damaged_summary(tmp_path: Path) -> None:
    """The head of one chunk, and the size of another's indexes in the summary."""
    path = a_trace(tmp_path / "a.mcap", compression="zstd")
    whole, true = bytearray(path.read_bytes()), kept(path)
    (_, (start, end, count), (other, behind, _), *_) = chunks_of(path)
    whole[start : start + 30] = bytes(30)
    whole[whole.rindex(struct.pack("<QQ", other, behind - other)) + 17] ^= 1
    path.write_bytes(whole)
    result = recover(path, tmp_path / "b.mcap")
    assert not true - kept(result.output)
    assert result.suspect_messages == count
    assert end < other


@pytest.mark.parametrize("what", ["message index", "chunk index", "value"])
def test_recover_calls_nothing_whole_that_verify_fails(tmp_path: Path, what: str) -> None:
    """With right checksums: false indexes are made anew, a false value is told."""
    path = a_run(tmp_path / "a.mcap")
    whole = path.read_bytes()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunk = summary.chunk_indexes[1]
    if what == "message index":
        path.write_bytes(patched(whole, min(chunk.message_index_offsets.values()) + 15, b"\x77"))
    elif what == "chunk index":
        at = whole.index(struct.pack("<QQ", chunk.chunk_start_offset, chunk.chunk_length))
        path.write_bytes(patched(whole, at, struct.pack("<Q", 2**63)))
    else:
        path = write(path, run={"end_ns": "7"}, rows=ROWS, result={"status": "finished"})
    assert verify(path).verdict == "failed"
    result = recover(path, tmp_path / "b.mcap")
    assert not result.complete
    assert result.failed
    assert (verify(result.output).verdict == "ok") == (what != "value")
    assert result.lost == (what == "value")


@pytest.mark.parametrize("place", [2**63, 2**64 - 1, 2**62])
def test_an_index_that_leads_beyond_any_file_is_damage(tmp_path: Path, place: int) -> None:
    """Every command answers; the rows are read without it."""
    path = a_trace(tmp_path / "a.mcap")
    whole = path.read_bytes()
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    for index in (
        *((c.chunk_start_offset, c.chunk_length) for c in summary.chunk_indexes[:1]),
        *((a.offset, a.length) for a in summary.attachment_indexes),
        *((m.offset, m.length) for m in summary.metadata_indexes[:1]),
    ):
        at = whole.index(struct.pack("<QQ", *index))
        path.write_bytes(patched(whole, at, struct.pack("<Q", place)))
        assert len(Trace(path).read("/plant/output")) == len(ROWS)
        assert verify(path).verdict == "failed"
        assert len(contents(recover(path, tmp_path / "b.mcap", force=True).output)[0]) == len(ROWS)


def test_cuts_lose_nothing_that_a_plain_reader_has(tmp_path: Path) -> None:
    path = a_trace(tmp_path / "a.mcap")
    whole, cut = path.read_bytes(), tmp_path / "cut.mcap.partial"
    for length in range(9, len(whole), len(whole) // 40):
        cut.write_bytes(whole[:length])
        try:
            result = recover(cut, tmp_path / "b.mcap", force=True)
        except CosimError:
            assert not plain(cut, seeking=False)
            continue
        assert not plain(cut, seeking=False) - kept(result.output)
