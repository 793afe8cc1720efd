"""Reading what is cut, damaged, hostile or no trace at all."""

from __future__ import annotations

import json
import os
import random
import struct
import zlib
from pathlib import Path

import pytest
from mcap_files import MAGIC
from written import write

from cosim.core import CosimError, InputError, LossError
from cosim.trace import (
    Attachment,
    Trace,
    content_hash,
    describe,
)


def test_cut_at_every_length(tmp_path: Path) -> None:
    """Cut after any byte, a `.partial` file reads without failing, and never loses more."""
    rows = [(k, k, k, [k, k]) for k in range(200)]
    whole = write(
        tmp_path / "a.mcap",
        rows=rows,
        chunk_bytes=600,
        attachments=[Attachment("a", "text/plain", b"hello")],
    ).read_bytes()
    cut = tmp_path / "cut.mcap.partial"
    last = 0
    lengths = sorted({*range(8, len(whole), 37), len(whole) - 1, len(whole)})
    for length in lengths:
        cut.write_bytes(whole[:length])
        trace = Trace(cut)
        assert trace.complete == (length == len(whole))
        info = trace.topics.get("/plant/output")
        count = info.count if info else 0
        assert count >= last
        last = count
        if count:
            assert trace.read("/plant/output")["eta.x"].tolist() == list(range(count))
    assert last == 200
    cut.rename(tmp_path / "cut.mcap")
    (tmp_path / "cut.mcap").write_bytes(whole[:-1])
    with pytest.raises(LossError, match="cut short"):
        Trace(tmp_path / "cut.mcap")


def test_a_flipped_bit_in_the_data_is_noticed(tmp_path: Path) -> None:
    """Checksums cover all that a trace says: who reads it all notices any flipped bit.

    Opening it reads the summary alone.
    """
    path = write(tmp_path / "a.mcap", rows=[(k, k, k, [k, k]) for k in range(50)])
    whole = path.read_bytes()
    end = whole.index(struct.pack("<BQI", 0x0F, 4, _data_checksum(whole)))
    choose = random.Random(1)  # noqa: S311 - to be repeatable
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[choose.randrange(8, end)] ^= 1 << choose.randrange(8)
        path.write_bytes(damaged)
        with pytest.raises(LossError):
            content_hash(path)
        assert not Trace(path, incomplete=True).complete


def _data_checksum(whole: bytes) -> int:
    """Find the CRC of the data section: the one DataEnd record that fits what precedes it."""
    at = -1
    while (at := whole.find(b"\x0f\x04\x00\x00\x00\x00\x00\x00\x00", at + 1)) >= 0:
        given = int.from_bytes(whole[at + 9 : at + 13], "little")
        if given == zlib.crc32(whole[:at]):
            return given
    raise AssertionError("no checksum of the data section")


def record(opcode: int, content: bytes) -> bytes:
    """One MCAP record."""
    return struct.pack("<BQ", opcode, len(content)) + content


def chunk(data: bytes, compression: str = "", size: int | None = None, crc: int = 0) -> bytes:
    """One chunk record, with any claim about its size."""
    name = compression.encode()
    claimed = len(data) if size is None else size
    head = struct.pack("<QQQI", 0, 0, claimed, crc) + struct.pack("<I", len(name)) + name
    return record(6, head + struct.pack("<Q", len(data)) + data)


def channel(channel_id: int = 1, schema_id: int = 0, topic: bytes = b"/t") -> bytes:
    """One channel record without encoding and metadata."""
    head = struct.pack("<HHI", channel_id, schema_id, len(topic))
    return record(4, head + topic + struct.pack("<II", 0, 0))


def message(channel_id: int = 1, data: bytes = b"") -> bytes:
    """One message record."""
    return record(5, struct.pack("<HIQQ", channel_id, 0, 0, 0) + data)


HEADER = record(1, struct.pack("<II", 0, 0))
ZSTD_BOMB = bytes.fromhex("28b52ffde0ffffffffffff0f00010000")
HOSTILE = {
    "nothing after the magic": (b"", "the file ends"),
    "zeros": (bytes(1000), "no record at byte 8"),
    "a record of 2**63 bytes": (struct.pack("<BQ", 1, 2**63), "byte 8 is cut short"),
    "a chunk that claims 2**62 bytes": (HEADER + chunk(b"x", size=2**62), "claims"),
    "a chunk that claims more than it has": (HEADER + chunk(b"x" * 20, size=40), "20 bytes where"),
    "a wrong checksum": (HEADER + channel() + chunk(message(), crc=1), "checksum of a chunk"),
    "not zstd": (HEADER + chunk(b"garbage!" * 4, "zstd", size=100), "does not decompress"),
    "not lz4": (HEADER + chunk(b"garbage!" * 4, "lz4", size=100), "does not decompress"),
    "a zstd frame of another size": (HEADER + chunk(ZSTD_BOMB, "zstd", size=100), "of the size"),
    "unknown compression": (HEADER + chunk(b"x", "rar"), "'rar'"),
    "a cut record inside a chunk": (HEADER + channel() + chunk(message()[:-1]), "inside the chunk"),
    "a chunk inside a chunk": (HEADER + chunk(chunk(b"")), "type 6 inside"),
    "a message without channel": (HEADER + message(), "channel 1, which is not declared"),
    "a message too short": (HEADER + channel() + record(5, b"abc"), "message is cut short"),
    "a channel without schema": (HEADER + channel(schema_id=7), "schema 7, which is not"),
    "a channel declared twice": (
        HEADER + channel() + channel(topic=b"/b"),
        "channel 1 is declared",
    ),
    "a text too long": (HEADER + record(12, struct.pack("<I", 2**31) + b"abcd"), "longer than"),
    "a text that is not UTF-8": (
        HEADER + record(12, struct.pack("<I", 2) + b"\xff\xfe" + b"\0" * 4),
        "UTF-8",
    ),
    "an attachment too short": (HEADER + record(9, b"abc"), "attachment is cut short"),
    "schema 0": (HEADER + record(3, struct.pack("<HIII", 0, 0, 0, 0)), "schema 0"),
    "bytes after the end": (HEADER + record(2, bytes(20)) + MAGIC + b"more", "closing magic"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_damaged_content_is_reported(tmp_path: Path, name: str) -> None:
    """Damage is a `LossError`; in a `.partial` file it is reported as `damage`."""
    path = tmp_path / "a.mcap"
    content, reported = HOSTILE[name]
    path.write_bytes(MAGIC + content)
    with pytest.raises(LossError) as caught:
        Trace(path)
    assert str(path) in str(caught.value)
    partial = path.rename(tmp_path / "a.mcap.partial")
    trace = Trace(partial)
    assert trace.damage
    assert reported in trace.damage
    assert not trace.complete
    json.dumps(describe(partial), allow_nan=False)


@pytest.mark.parametrize("content", [b"", b"\x89MCA", b"PK\x03\x04" * 100, b"\x89MCAP1\r\n" * 3])
@pytest.mark.parametrize("name", ["a.mcap", "a.mcap.partial"])
def test_not_a_trace(tmp_path: Path, content: bytes, name: str) -> None:
    """Empty files and files that are no MCAP are bad input, whatever their name."""
    (tmp_path / name).write_bytes(content)
    for read in (Trace, content_hash, describe):
        with pytest.raises(InputError, match=r"empty|not an MCAP"):
            read(tmp_path / name)


def test_path_that_is_no_readable_file_is_refused(tmp_path: Path) -> None:
    """Missing files, directories, pipes and impossible names are bad input."""
    os.mkfifo(tmp_path / "pipe.mcap")
    with pytest.raises(InputError, match="there is no such file"):
        Trace(tmp_path / "none.mcap")
    with pytest.raises(InputError, match="directory"):
        Trace(tmp_path)
    with pytest.raises(InputError, match="regular"):
        Trace(tmp_path / "pipe.mcap")
    with pytest.raises(InputError, match="opened"):
        Trace("a\0b.mcap")


def test_random_damage_raises_only_our_errors(tmp_path: Path) -> None:
    """Bytes changed at random give a trace or one of our errors, in every reading function."""
    path = tmp_path / "a.mcap.partial"
    rows = [(k, k, k, [k, None if k % 7 else k]) for k in range(60)]
    whole = write(tmp_path / "a.mcap", rows=rows, compression="none", chunk_bytes=500).read_bytes()
    # without checksums the damage reaches the inner layers
    whole = _without_checksums(whole)
    choose = random.Random(2)  # noqa: S311 - to be repeatable
    for _ in range(400):
        damaged = bytearray(whole)
        for _ in range(choose.randrange(1, 6)):
            damaged[choose.randrange(8, len(whole))] = choose.randrange(256)
        path.write_bytes(damaged)
        try:
            trace = Trace(path)
            json.dumps(describe(path), allow_nan=False)
            for topic in trace.topics:
                trace.read(topic)
        except CosimError as error:
            assert str(error)  # noqa: PT017 - most damage raises nothing


def _without_checksums(whole: bytes) -> bytes:
    changed, at = bytearray(whole), len(MAGIC)
    while at < len(whole) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", whole, at)
        start = at + 9
        if opcode == 6:
            changed[start + 24 : start + 28] = bytes(4)
        elif opcode == 15:
            changed[start : start + 4] = bytes(4)
        at = start + length
    return bytes(changed)
