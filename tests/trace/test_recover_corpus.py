"""`recover` never has fewer messages than a plain reader, of files damaged in every way."""

from __future__ import annotations

import html
import random
import re
from collections import Counter
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType, IndexType, Writer
from mcap_files import HEAD_BYTES, MAGIC, records_of
from shared import sampled, slow_share_of
from test_trace_recover import a_trace

from cosim.core import InputError
from cosim.trace import describe, recover, verify
from cosim.trace.report import write_report

REFERENCE = Path(__file__).parents[2] / "traces" / "reference"
Messages = Counter[tuple[str, int, int, int, bytes]]


# --- plain readers


def by_package(path: Path, make: Callable[[Any], Any] = NonSeekingReader) -> Messages:
    """What a reader of the mcap package has of a file, its checks off, before it gives up."""
    found: Messages = Counter()
    with path.open("rb") as stream:
        try:
            for _, channel, m in make(stream).iter_messages(log_time_order=False):
                found[channel.topic, m.log_time, m.publish_time, m.sequence, bytes(m.data)] += 1
        except Exception:  # noqa: BLE001, S110 - it raises what it likes
            pass
    return found


def lenient(path: Path) -> Messages:
    """What a reader has that goes from record to record, and on behind chunks it cannot open."""
    found: Messages = Counter()
    topics: dict[int, str] = {}
    data, at = path.read_bytes(), 8
    while at + 9 <= len(data):
        opcode, end = data[at], at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        if end > len(data) or opcode == Opcode.DATA_END:
            break
        for record in opened(opcode, data[at + 9 : end]):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message) and record.channel_id in topics:
                m, topic = record, topics[record.channel_id]
                found[topic, m.log_time, m.publish_time, m.sequence, bytes(m.data)] += 1
        at = end
    return found


def opened(opcode: int, content: bytes) -> list[Any]:
    """The records of a chunk, or a channel or message outside; nothing of what is damaged."""
    stream = ReadDataStream(BytesIO(content))
    try:
        if opcode == Opcode.CHUNK:
            return breakup_chunk(Chunk.read(stream))
        if opcode == Opcode.MESSAGE:
            return [Message.read(stream, len(content))]
        return [Channel.read(stream)] if opcode == Opcode.CHANNEL else []
    except Exception:  # noqa: BLE001 - as above
        return []


READERS: dict[str, Callable[[Path], Messages]] = {
    "seeking": lambda path: by_package(path, make_reader),
    "not seeking": by_package,
    "lenient": lenient,
}


# --- files, and what is done to them


def official(path: Path, **options: Any) -> Path:
    """A file of the package's own writer: 120 messages on two channels, and what else there is."""
    with path.open("wb") as stream:
        writer = Writer(stream, **{"chunk_size": 1000, **options})
        writer.start("x", "lib")
        schema = writer.register_schema("a.B", "jsonschema", b"{}")
        channels = [writer.register_channel(f"/{n}", "json", schema * (n < 2)) for n in range(3)]
        writer.add_metadata("m", {"k": "v"})
        writer.add_attachment(1, 2, "att.txt", "text/plain", b"hello" * 50)
        for k in range(120):
            writer.add_message(channels[k % 3], k * 10, b'{"x":%d}' % k, k * 10, k)
        writer.finish()
    return path


_NONE = {"compression": CompressionType.NONE}
SOURCES: dict[str, Callable[[Path], Path]] = {
    "ours": a_trace,
    "ours, not compressed": lambda path: a_trace(path, compression="none"),
    "official": official,
    "official, lz4": lambda path: official(path, compression=CompressionType.LZ4),
    "official, not compressed": lambda path: official(path, **_NONE),
    "official, without chunks": lambda path: official(path, use_chunking=False),
    "official, without checksums": lambda path: official(path, enable_crcs=False, **_NONE),
    "official, without indexes": lambda path: official(path, index_types=IndexType.NONE, **_NONE),
}


def cut(data: bytearray, choose: random.Random) -> None:
    del data[choose.randrange(9, len(data)) :]


def flip(data: bytearray, choose: random.Random) -> None:
    for _ in range(choose.choice((1, 1, 3))):
        data[choose.randrange(8, len(data))] ^= 1 << choose.randrange(8)


def zeros(data: bytearray, choose: random.Random) -> None:
    at, size = choose.randrange(8, len(data)), choose.choice((8, 100, 600))
    data[at : at + size] = bytes(len(data[at : at + size]))


def noise(data: bytearray, choose: random.Random) -> None:
    at, size = choose.randrange(8, len(data)), choose.randrange(2, 500)
    data[at : at + size] = choose.randbytes(len(data[at : at + size]))


def gap(data: bytearray, choose: random.Random) -> None:
    at = choose.randrange(8, len(data))
    del data[at : at + choose.randrange(1, 500)]


def checksum(data: bytearray, choose: random.Random, starts: list[int]) -> None:
    """The checksum of a chunk, of which all the rest is right."""
    if starts:
        at = choose.choice(starts) + 9 + 24
        data[at : at + 4] = choose.randbytes(4)


def index(data: bytearray, choose: random.Random, starts: list[int]) -> None:
    """No message index behind a chunk, and all offsets of the summary false."""
    if starts:
        at = choose.choice(starts)
        end = begin = at + 9 + int.from_bytes(data[at + 1 : at + 9], "little")
        while end < len(data) and data[end] == Opcode.MESSAGE_INDEX:
            end += 9 + int.from_bytes(data[end + 1 : end + 9], "little")
        del data[begin:end]


def damaged(path: Path, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """So many copies of a file, damaged in one of the ways, or in two."""
    choose = random.Random(seed)  # noqa: S311 - to be repeatable
    whole = path.read_bytes()
    starts = [record.position for record in records_of(path) if record.opcode == Opcode.CHUNK]
    ways: dict[str, Callable[[bytearray], None]] = {
        way.__name__: lambda data, way=way: way(data, choose)
        for way in (cut, flip, zeros, noise, gap)
    }
    for of_chunks in (checksum, index):
        ways[of_chunks.__name__] = lambda data, way=of_chunks: way(data, choose, starts)
    for k in range(count):
        data, names = bytearray(whole), [[*ways][k % len(ways)]]
        if k % 5 == 4:
            names.append(choose.choice(["cut", "flip"]))
        for name in names:
            ways[name](data)
        yield f"{k} {' '.join(names)}", bytes(data)


def heads(messages: Messages) -> Messages:
    """Topic, times and number alone: of a message with a false length the right one is kept."""
    found: Messages = Counter()
    for message, number in messages.items():
        found[*message[:4], b""] += number
    return found


def outside_chunks(data: bytes, behind_damage: list[int]) -> int:
    """How many messages lie outside chunks, from the front on and from behind each damage."""
    found: set[int] = set()
    for begin in (len(MAGIC), *behind_damage):
        at = begin
        while at + HEAD_BYTES <= len(data) and at not in found:
            opcode, size = data[at], int.from_bytes(data[at + 1 : at + HEAD_BYTES], "little")
            if at + HEAD_BYTES + size > len(data) or opcode == Opcode.DATA_END:
                break
            found |= {at} if opcode == Opcode.MESSAGE else set()
            at += HEAD_BYTES + size
    return len(found)


def check_none_is_lost(source: Path, tmp_path: Path, count: int, seed: int) -> None:
    """Compare what is recovered, by default, with what each plain reader has."""
    true = by_package(source)
    assert true
    proved = "without" not in source.stem  # by checksums; else a false message is like any other
    bad, out = tmp_path / "bad.mcap", tmp_path / "out.mcap"
    for name, data in damaged(source, count, seed):
        bad.write_bytes(data)
        plain = {reader: read(bad) for reader, read in READERS.items()}
        try:
            result = recover(bad, out, force=True)
        except InputError:
            assert not any(plain.values()), name
            continue
        kept = by_package(result.output)
        assert kept.total() == result.messages, name
        if proved:  # but for messages outside chunks, which no checksum covers
            bare = outside_chunks(data, [d.position + d.length for d in result.damage])
            assert (kept - true).total() <= result.suspect_messages + bare, name
        for reader, found in plain.items():
            assert not (found & true) - kept, (name, reader)
            assert not (heads(found) & heads(true)) - heads(kept), (name, reader)
        strict = recover(bad, out, force=True, strict=True)
        assert strict.suspect_messages == 0, name
        assert strict.messages <= result.messages, name


@pytest.mark.parametrize("name", sampled(SOURCES, 3))
def test_no_message_is_lost_that_a_plain_reader_has(tmp_path: Path, name: str) -> None:
    """By the readers of the mcap package, and by one that goes on behind what it cannot open."""
    check_none_is_lost(SOURCES[name](tmp_path / f"{name}.mcap"), tmp_path, 35, seed=7)


@pytest.mark.parametrize("name", slow_share_of(SOURCES))
def test_no_message_of_many_files_is_lost(tmp_path: Path, name: str) -> None:
    check_none_is_lost(SOURCES[name](tmp_path / f"{name}.mcap"), tmp_path, 400, seed=8)


@pytest.mark.parametrize("name", slow_share_of(x.name for x in sorted(REFERENCE.glob("*.mcap"))))
def test_no_message_of_a_reference_is_lost(tmp_path: Path, name: str) -> None:
    check_none_is_lost(REFERENCE / name, tmp_path, 40, seed=9)


def test_views_name_what_is_marked(tmp_path: Path) -> None:
    """Info, report and verify; of a file with nothing marked, what was lost."""
    path = a_trace(tmp_path / "a.mcap", compression="none")
    whole = bytearray(path.read_bytes())
    with path.open("rb") as stream:
        chunks = [r for r in StreamReader(stream, emit_chunks=True).records if isinstance(r, Chunk)]
    times = [r.log_time for r in breakup_chunk(chunks[3]) if isinstance(r, Message)]
    place = [record for record in records_of(path) if record.opcode == Opcode.CHUNK][3]
    whole[place.end - 3] ^= 0x40  # a value of its last message
    path.write_bytes(whole)
    (marked, strict) = (recover(path, tmp_path / f"{s}.mcap", strict=bool(s)) for s in (0, 1))
    number = len(times)
    assert (marked.suspect_messages, strict.lost_messages) == (number, number)
    first, last = times[0] / 1e9, times[-1] / 1e9
    where = f"(/plant/output {number}; {first:g} s to {last:g} s)"
    words = f"Recovered from a damaged file: 0 messages lost; {number} marked, which may be wrong"
    found = describe(marked.output)
    assert found["recovered"]["suspect_messages"] == number
    assert found["recovered"]["words"] == f"{words} {where}."
    failed = [check.name for check in verify(marked.output).checks if check.verdict == "failed"]
    assert failed == ["suspect"]
    pytest.importorskip("plotly")
    page = html.unescape(write_report(marked.output).output.read_text("utf-8"))
    (why,) = re.findall(r'<p class="reason [a-z]+">(.*)</p>', page)
    assert words in why
    assert why.endswith(f"{where}.")
    lost = f"Recovered from a damaged file: {number} messages lost, none marked."
    assert describe(strict.output)["recovered"]["words"] == lost
    assert verify(strict.output).verdict == "ok"
