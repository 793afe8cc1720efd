"""Check the structure of an MCAP file: counts, indexes, offsets and checksums."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from cosim.trace.check_results import Check, Verdict, check_result
from cosim.trace.pieces import HEAD_BYTES, McapFile, Piece
from cosim.trace.records import Cursor, DamageError, chunk_data, inner_records
from cosim.trace.scan import Scan


@dataclass
class _Chunk:
    """What a chunk record is, as its index ought to have it."""

    piece: Piece
    times: tuple[int, int]
    sizes: tuple[int, int]
    compression: str
    indexes: dict[int, int] = field(default_factory=dict)
    index_bytes: int = 0


@dataclass
class _FileStatistics:
    """Who is there, counted while the file is read once more."""

    counts: Counter[int] = field(default_factory=Counter)
    first: int | None = None
    last: int = 0
    chunks: list[_Chunk] = field(default_factory=list)
    unchecked: int = 0
    """Chunks without a checksum."""
    declarations: list[str] = field(default_factory=list)
    indexes: list[str] = field(default_factory=list)
    indexed: int = 0
    """Chunks with an index of their messages."""


def checks_of_file(file: McapFile, found: Scan) -> Iterator[Check]:
    """Yield the checks of any MCAP file."""
    yield _end_of_file(file, found)
    yield _records(file, found)
    statistics = _collect_statistics(file, found)
    yield check_result(
        "declarations",
        [*found.conflicts, *statistics.declarations],
        f"{len(found.schemas)} schemas, {len(found.channels)} channels",
    )
    yield _checksums(file, found, statistics)
    yield _message_indexes(statistics)
    yield _summary(file, found, statistics)


def _end_of_file(file: McapFile, found: Scan) -> Check:
    if found.whole:
        return Check("end of file", "ok", "data end, summary, footer and closing magic are there")
    missing = "the end of the data" if found.ended is None else "the footer"
    if found.footer is not None:
        missing = "the closing magic"
    return Check(
        "end of file", "incomplete", f"{missing} is not there: cut after {file.size} bytes"
    )


def _records(file: McapFile, found: Scan) -> Check:
    """Damage; what is cut off at the end is not damage but an end that is missing."""
    damage = [d for d in found.damage if d.length]
    if damage and not found.whole and damage[-1].position + damage[-1].length == file.size:
        damage = damage[:-1]
    problems = [f"byte {d.position}, {d.length} bytes: {d.reason}" for d in damage]
    return check_result(
        "records", problems, f"{len(found.pieces) + len(found.summary)} whole records"
    )


def _collect_statistics(file: McapFile, found: Scan) -> _FileStatistics:
    statistics = _FileStatistics()
    expected: dict[int, list[tuple[int, int]]] = {}
    seen: set[int] = set()
    for piece in found.pieces:
        if piece.opcode == Opcode.MESSAGE_INDEX and statistics.chunks:
            _compare_index(file, piece, expected, seen, statistics)
            continue
        _end_of_indexes(expected, seen, statistics)
        expected, seen = {}, set()
        if piece.opcode == Opcode.MESSAGE:
            _count(file.content(piece), statistics)
        elif piece.opcode == Opcode.CHUNK:
            expected = _chunk(file, piece, statistics)
    if found.ended is not None:  # else the last of them may be cut off
        _end_of_indexes(expected, seen, statistics)
    for number in statistics.counts:
        channel = found.channels.get(number)
        if channel is None:
            statistics.declarations.append(f"messages on channel {number}, which is not declared")
        elif channel.schema and channel.schema not in found.schemas:
            statistics.declarations.append(f"schema {channel.schema} of {channel.topic} is missing")
    return statistics


def _count(content: bytes | memoryview, statistics: _FileStatistics) -> tuple[int, int]:
    number = int.from_bytes(content[:2], "little")
    log = int.from_bytes(content[6:14], "little")
    statistics.counts[number] += 1
    statistics.first = (
        log if statistics.first is None or log < statistics.first else statistics.first
    )
    statistics.last = max(statistics.last, log)
    return number, log


def _chunk(
    file: McapFile, piece: Piece, statistics: _FileStatistics
) -> dict[int, list[tuple[int, int]]]:
    """Take note of a chunk; (log time, offset) of its messages by channel."""
    content = file.content(piece)
    fields = Cursor(content)
    first, last, size, crc = (fields.number(n) for n in (8, 8, 8, 4))
    compression = fields.text()
    packed = fields.number(8)
    statistics.unchecked += crc == 0
    expected: dict[int, list[tuple[int, int]]] = {}
    low, high = None, 0
    for opcode, place, inside in inner_records(chunk_data(content)):
        if opcode == Opcode.MESSAGE:
            number, log = _count(inside, statistics)
            expected.setdefault(number, []).append((log, place))
            low, high = log if low is None else min(low, log), max(high, log)
    if (first, last) != (low or 0, high):
        statistics.indexes.append(
            f"the chunk at byte {piece.position} says {first} to {last} ns, "
            f"and holds {low or 0} to {high} ns"
        )
    statistics.chunks.append(_Chunk(piece, (first, last), (packed, size), compression))
    return expected


def _compare_index(
    file: McapFile,
    piece: Piece,
    expected: dict[int, list[tuple[int, int]]],
    seen: set[int],
    statistics: _FileStatistics,
) -> None:
    fields = Cursor(file.content(piece))
    number = fields.number(2)
    seen.add(number)
    chunk = statistics.chunks[-1]
    chunk.indexes[number] = piece.position
    chunk.index_bytes += piece.end - piece.position
    try:
        entries = np.frombuffer(fields.take(fields.number(4)), "<u8").reshape(-1, 2)
    except (DamageError, ValueError):
        statistics.indexes.append(f"the index at byte {piece.position} is no list of messages")
        return
    true = np.array(expected.get(number, []), np.uint64).reshape(-1, 2)
    if entries.shape != true.shape or not np.array_equal(_sorted(entries), _sorted(true)):
        statistics.indexes.append(
            f"the index at byte {piece.position}, channel {number}, does not lead to its messages"
        )


def _sorted(pairs: NDArray[np.uint64]) -> NDArray[np.uint64]:
    return pairs[np.lexsort((pairs[:, 0], pairs[:, 1]))]


def _end_of_indexes(
    expected: dict[int, list[tuple[int, int]]], seen: set[int], statistics: _FileStatistics
) -> None:
    if seen:
        statistics.indexed += 1
        for number in sorted(set(expected) - seen):
            at = statistics.chunks[-1].piece.position
            statistics.indexes.append(f"the chunk at byte {at} has no index of channel {number}")


def _checksums(file: McapFile, found: Scan, statistics: _FileStatistics) -> Check:
    problems = [d.reason for d in found.damage if "checksum" in d.reason]
    covered = []
    if statistics.chunks:
        checked = len(statistics.chunks) - statistics.unchecked
        covered.append(f"{checked} of {len(statistics.chunks)} chunks")
    if found.ended is not None and any(file.content(found.ended)[:4]):
        covered.append("the data")
    if found.proved:
        covered.append("the summary")
    if not covered and not problems:
        return Check("checksums", "not checked", "the file has none")
    return check_result("checksums", problems, "of " + ", ".join(covered))


def _message_indexes(statistics: _FileStatistics) -> Check:
    if not statistics.indexed and not statistics.indexes:
        return Check("message indexes", "not checked", "the file has none")
    fine = (
        f"of {statistics.indexed} chunks: every entry leads to its message, every message has one"
    )
    return check_result("message indexes", statistics.indexes, fine)


def _summary(file: McapFile, found: Scan, statistics: _FileStatistics) -> Check:
    if found.footer is None or not found.summary:
        verdict: Verdict = "not checked" if found.whole else "incomplete"
        return Check("summary", verdict, "the file has none")
    problems: list[str] = []
    start, offsets, _ = found.footer
    if start != found.summary[0].position:
        problems.append(f"the footer says that the summary begins at byte {start}")
    of_kind = {
        kind: [piece for piece in found.summary if piece.opcode == kind]
        for kind in (
            Opcode.STATISTICS,
            Opcode.CHUNK_INDEX,
            Opcode.ATTACHMENT_INDEX,
            Opcode.METADATA_INDEX,
            Opcode.SUMMARY_OFFSET,
        )
    }
    groups = of_kind[Opcode.SUMMARY_OFFSET]
    if offsets != (groups[0].position if groups else 0) and (groups or offsets):
        problems.append(f"the footer says that the summary's offsets begin at byte {offsets}")
    try:
        for piece in of_kind[Opcode.STATISTICS]:
            problems += _statistics(Cursor(file.content(piece)), found, statistics)
        problems += _chunk_indexes(file, of_kind[Opcode.CHUNK_INDEX], statistics)
        problems += _other_indexes(file, found, of_kind)
        for piece in groups:
            problems += _group(Cursor(file.content(piece)), found)
    except DamageError as error:
        problems.append(f"a record of the summary cannot be read: {error}")
    total = sum(statistics.counts.values())
    return check_result(
        "summary", problems, f"{total} messages, {len(statistics.chunks)} chunks, as found"
    )


def _statistics(fields: Cursor, found: Scan, statistics: _FileStatistics) -> Iterator[str]:
    kinds = Counter(piece.opcode for piece in found.pieces)
    true = {
        "messages": (8, sum(statistics.counts.values())),
        "schemas": (2, len(found.schemas)),
        "channels": (4, len(found.channels)),
        "attachments": (4, kinds[Opcode.ATTACHMENT]),
        "metadata records": (4, kinds[Opcode.METADATA]),
        "chunks": (4, len(statistics.chunks)),
        "ns, first log time": (8, statistics.first or 0),
        "ns, last log time": (8, statistics.last),
    }
    for what, (size, number) in true.items():
        stated = fields.number(size)
        if stated != number:
            yield f"the statistics say {stated} {what}, found {number}"
    inner = Cursor(fields.take(fields.number(4)))
    stated_counts = {}
    while inner.left:
        channel = inner.number(2)
        stated_counts[channel] = inner.number(8)
    if {k: v for k, v in stated_counts.items() if v} != dict(statistics.counts):
        yield "the statistics' counts by channel are not those found"


def _chunk_indexes(
    file: McapFile, pieces: list[Piece], statistics: _FileStatistics
) -> Iterator[str]:
    chunks = {chunk.piece.position: chunk for chunk in statistics.chunks}
    for piece in pieces:
        fields = Cursor(file.content(piece))
        times = fields.number(8), fields.number(8)
        at, length = fields.number(8), fields.number(8)
        inner = Cursor(fields.take(fields.number(4)))
        offsets = {}
        while inner.left:
            channel = inner.number(2)
            offsets[channel] = inner.number(8)
        index_bytes, compression = fields.number(8), fields.text()
        sizes = fields.number(8), fields.number(8)
        chunk = chunks.pop(at, None)
        if chunk is None:
            yield f"a chunk index leads to byte {at}, where no chunk is"
        elif (times, length, offsets, index_bytes, compression, sizes) != (
            chunk.times,
            chunk.piece.length + HEAD_BYTES,
            chunk.indexes,
            chunk.index_bytes,
            chunk.compression,
            chunk.sizes,
        ):
            yield f"the index of the chunk at byte {at} is not as the chunk"
    if pieces:
        yield from (f"the chunk at byte {at} has no index" for at in chunks)


def _other_indexes(
    file: McapFile, found: Scan, of_kind: dict[Opcode, list[Piece]]
) -> Iterator[str]:
    for kind, opcode, skipped in (
        (Opcode.ATTACHMENT_INDEX, Opcode.ATTACHMENT, 24),
        (Opcode.METADATA_INDEX, Opcode.METADATA, 0),
    ):
        true = {p.position: p for p in found.pieces if p.opcode == opcode}
        for piece in of_kind[kind]:
            fields = Cursor(file.content(piece))
            at, length = fields.number(8), fields.number(8)
            fields.take(skipped)
            name = fields.text()
            target = true.pop(at, None)
            if target is None or target.length + HEAD_BYTES != length:
                yield f"an index of {name!r} leads to byte {at}, where it is not"
                continue
            own = Cursor(file.content(target))
            own.take(16 if opcode == Opcode.ATTACHMENT else 0)
            if own.text() != name:
                yield f"an index of {name!r} leads to another record, at byte {at}"
        if of_kind[kind]:
            yield from (f"the {opcode.name.lower()} at byte {at} has no index" for at in true)


def _group(fields: Cursor, found: Scan) -> Iterator[str]:
    kind, first, length = fields.number(1), fields.number(8), fields.number(8)
    group = [p for p in found.summary if first <= p.position < first + length]
    right = group and group[0].position == first and group[-1].end == first + length
    if (length and not right) or any(p.opcode != kind for p in group):
        yield f"a summary offset leads to byte {first}, where its group is not"
