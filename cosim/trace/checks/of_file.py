"""Check the structure of an MCAP file: counts, indexes, offsets and checksums."""

from __future__ import annotations

import functools
import hashlib
from collections import Counter
from collections.abc import Iterator

import numpy as np
from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    ChunkIndex,
    Metadata,
    MetadataIndex,
    Statistics,
    SummaryOffset,
)

from cosim.trace.checks.results import CheckResult, Verdict, check_result
from cosim.trace.file.declared import DamagedDeclarations
from cosim.trace.file.messages import Messages, entries_of
from cosim.trace.file.records import DamageError, chunk_head, parsed
from cosim.trace.file.walk import Record, Walk
from cosim.trace.rows import layout

_MOST_PROBLEMS = 1000
"""More of one kind are counted, not kept."""


class FileChecks:
    """The checks of any MCAP file, made while a walk goes over its records.

    Of each chunk a digest of what its index ought to be is kept, and nothing else.

    Attributes
    ----------
    declared : the schemas and channels of the file.
    metadata : name and entries of each record; no entries but of those of a run.
    attached : SHA-256 of each attachment, by name.
    certificate : the attachment of that name; None without.
    first : opcode of the first record behind the header; 0 before it.
    end : end of the last record of the data [bytes].
    stated : number of messages as the summary has it; None without.
    counts : number of messages by channel.
    """

    def __init__(self, walk: Walk) -> None:
        self._walk = walk
        self.declared = DamagedDeclarations()
        self.metadata: list[tuple[str, dict[str, str]]] = []
        self.counts: Counter[int] = Counter()
        self.attached: dict[str, str] = {}
        self.certificate: bytes | None = None
        self.first = self.end = 0
        self.stated: int | None = None
        self._kinds: Counter[int] = Counter()
        self._records = 0
        self._times: tuple[int, int] | None = None
        self._unchecked = self._indexed = 0
        self._chunks: dict[int, int] = {}
        self._names: dict[int, tuple[int, int, str]] = {}
        self._indexes: list[str] = []
        self._unindexed: list[str] = []
        self._summary: list[str] = []
        self._runs: list[list[int]] = []
        self._in_summary: list[tuple[int, bytes]] = []
        self._groups: list[SummaryOffset] = []

    def add(self, record: Record) -> None:
        """Take the next record of the walk."""
        self._records += 1 if record.opcode != Opcode.MESSAGE else len(record.messages or ())
        if self._walk.ended is not None and record.position > self._walk.ended:
            self._behind(record)
            return
        self._kinds[record.opcode] += 1
        self.end = record.end
        if not self.first and record.opcode != Opcode.HEADER:
            self.first = record.opcode
        chunk = record.opcode == Opcode.CHUNK
        proved = chunk and record.suspect is None and chunk_head(record.content).checksum != 0
        self.declared.add(record.declarations, proved=proved)
        if record.messages is not None:
            times = record.messages.heads["log"]
            numbers, counts = np.unique(record.messages.heads["channel"], return_counts=True)
            for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
                self.counts[number] += count
            if times.size:
                low, high = int(times.min()), int(times.max())
                before = self._times or (low, high)
                self._times = min(before[0], low), max(before[1], high)
        if chunk:
            self._records += len(record.indexes)
            self._chunk(record)
        elif record.opcode == Opcode.METADATA:
            found = parsed(Metadata, record.content)
            ours = found.name in (layout.RUN, layout.RESULT, layout.RECOVERED)
            self.metadata.append((found.name, found.metadata if ours else {}))
            self._names[record.position] = record.opcode, record.size, found.name
        elif record.opcode == Opcode.ATTACHMENT:
            attached = parsed(Attachment, record.trusted)
            self.attached[attached.name] = hashlib.sha256(attached.data).hexdigest()
            if attached.name == layout.CERTIFICATE_ATTACHMENT:
                self.certificate = attached.data
            self._names[record.position] = record.opcode, record.size, attached.name

    @property
    def channels(self) -> dict[int, mcap.Channel]:
        """The channels declared, by id."""
        return self.declared.channels

    @property
    def schemas(self) -> dict[int, mcap.Schema]:
        """The schemas declared, by id."""
        return self.declared.schemas

    @property
    def attachments(self) -> int:
        """Number of attachments."""
        return self._kinds[Opcode.ATTACHMENT]

    @functools.cached_property
    def results(self) -> tuple[CheckResult, ...]:
        """The checks, after the walk."""
        return tuple(self._results())

    def _results(self) -> Iterator[CheckResult]:
        walk = self._walk
        # what the summary says of the data, now that all of them are known
        if walk.proved:
            self.declared.add([(o, memoryview(c)) for o, c in self._in_summary], proved=True)
        yield _end_of_file(walk)
        yield self._check_records()
        channels, schemas = self.declared.channels, self.declared.schemas
        problems = [*self.declared.conflicts]
        for number in self.counts:
            channel = channels.get(number)
            if channel is None:
                problems.append(f"messages on channel {number}, which is not declared")
            elif channel.schema_id and channel.schema_id not in schemas:
                problems.append(f"schema {channel.schema_id} of {channel.topic} is missing")
        fine = f"{len(schemas)} schemas, {len(channels)} channels"
        yield check_result("declarations", problems, fine)
        yield self._check_checksums()
        yield self._check_indexes()
        yield self._check_summary()

    def _chunk(self, record: Record) -> None:
        """Compare a chunk with the indexes behind it, and keep what its own index must be."""
        messages = record.messages
        if messages is None or record.suspect is not None:
            return
        head = chunk_head(record.content)
        self._unchecked += head.checksum == 0
        times = messages.heads["log"]
        span = (int(times.min()), int(times.max())) if times.size else (0, 0)
        if (head.first, head.last) != span:
            self._wrong(
                f"the chunk at byte {record.position} says {head.first} to {head.last} ns, "
                f"and holds {span[0]} to {span[1]} ns"
            )
        offsets = {
            int.from_bytes(content[:2], "little"): position for position, content in record.indexes
        }
        missing = [] if _is_indexed(record) else self._compare(record, messages)
        self._indexes += self._unindexed  # of the chunk before: the last one's may be cut off
        del self._indexes[_MOST_PROBLEMS:]
        self._unindexed = []
        if record.indexes:
            self._indexed += 1
            at = record.position
            self._unindexed = [
                f"the chunk at byte {at} has no index of channel {n}" for n in missing
            ]
        index_bytes = sum(9 + len(content) for _, content in record.indexes)
        self._chunks[record.position] = hash(
            (
                (head.first, head.last),
                record.end - record.position,
                frozenset(offsets.items()),
                index_bytes,
                head.compression,
                (head.packed, head.size),
            )
        )

    def _compare(self, record: Record, messages: Messages) -> list[int]:
        """Find what is wrong with the indexes behind a chunk; return the channels without one."""
        by_channel = dict(messages.by_channel())
        none = np.zeros(0, np.int64)
        times = messages.heads["log"]
        for position, content in record.indexes:
            number = int.from_bytes(content[:2], "little")
            entries = entries_of(content)
            if entries is None:
                self._wrong(f"the index at byte {position} is no list of messages")
                continue
            mine = by_channel.get(number, none)
            true = np.column_stack([times[mine], messages.places[mine].astype(np.uint64)])
            pairs = entries[1][np.argsort(entries[1][:, 1], kind="stable")]
            if not np.array_equal(pairs, true):
                self._wrong(
                    f"the index at byte {position}, channel {number}, does not lead to its messages"
                )
        named = {int.from_bytes(content[:2], "little") for _, content in record.indexes}
        return sorted(set(by_channel) - named)

    def _wrong(self, problem: str) -> None:
        if len(self._indexes) < _MOST_PROBLEMS:
            self._indexes.append(problem)

    def _behind(self, record: Record) -> None:
        """Take a record of the summary."""
        if record.opcode == Opcode.FOOTER:
            return
        if not self._runs or self._runs[-1][0] != record.opcode:
            self._runs.append([record.opcode, record.position, record.end])
        self._runs[-1][2] = record.end
        if record.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self.declared.add(record.declarations, proved=False)
            self._in_summary.append((record.opcode, record.content))
            return
        try:
            if record.opcode == Opcode.STATISTICS:
                stated = parsed(Statistics, record.content)
                self.stated = stated.message_count
                self._summary += self._statistics(stated)
            elif record.opcode == Opcode.CHUNK_INDEX:
                self._chunk_index(parsed(ChunkIndex, record.content))
            elif record.opcode == Opcode.ATTACHMENT_INDEX:
                self._named(Opcode.ATTACHMENT, parsed(AttachmentIndex, record.content))
            elif record.opcode == Opcode.METADATA_INDEX:
                self._named(Opcode.METADATA, parsed(MetadataIndex, record.content))
            elif record.opcode == Opcode.SUMMARY_OFFSET:
                self._groups.append(parsed(SummaryOffset, record.content))
        except DamageError as error:
            self._summary.append(f"a record of the summary cannot be read: {error}")

    def _statistics(self, stated: Statistics) -> Iterator[str]:
        first, last = self._times or (0, 0)
        for what, number_stated, number in (
            ("messages", stated.message_count, self.counts.total()),
            ("schemas", stated.schema_count, len(self.declared.schemas)),
            ("channels", stated.channel_count, len(self.declared.channels)),
            ("attachments", stated.attachment_count, self._kinds[Opcode.ATTACHMENT]),
            ("metadata records", stated.metadata_count, self._kinds[Opcode.METADATA]),
            ("chunks", stated.chunk_count, self._kinds[Opcode.CHUNK]),
            ("ns, first log time", stated.message_start_time, first),
            ("ns, last log time", stated.message_end_time, last),
        ):
            if number_stated != number:
                yield f"the statistics say {number_stated} {what}, found {number}"
        if {k: v for k, v in stated.channel_message_counts.items() if v} != dict(self.counts):
            yield "the statistics' counts by channel are not those found"

    def _chunk_index(self, index: ChunkIndex) -> None:
        at = index.chunk_start_offset
        expected = self._chunks.pop(at, None)
        stated = hash(
            (
                (index.message_start_time, index.message_end_time),
                index.chunk_length,
                frozenset(index.message_index_offsets.items()),
                index.message_index_length,
                index.compression,
                (index.compressed_size, index.uncompressed_size),
            )
        )
        if expected is None:
            self._summary.append(f"a chunk index leads to byte {at}, where no chunk is")
        elif stated != expected:
            self._summary.append(f"the index of the chunk at byte {at} is not as the chunk")
        del self._summary[_MOST_PROBLEMS:]

    def _named(self, opcode: Opcode, index: AttachmentIndex | MetadataIndex) -> None:
        kind, size, name = self._names.pop(index.offset, (0, 0, ""))
        if (kind, size) != (opcode, index.length):
            self._summary.append(
                f"an index of {index.name!r} leads to byte {index.offset}, where it is not"
            )
        elif name != index.name:
            self._summary.append(
                f"an index of {index.name!r} leads to another record, at byte {index.offset}"
            )

    def _check_records(self) -> CheckResult:
        """Report damage; what is cut off at the end is no damage but an end that is missing."""
        walk = self._walk
        damage = [d for d in walk.damage if d.length]
        if damage and not walk.whole and damage[-1].position + damage[-1].length == walk.size:
            damage = damage[:-1]
        problems = [f"byte {d.position}, {d.length} bytes: {d.reason}" for d in damage]
        return check_result("records", problems, f"{self._records} whole records")

    def _check_checksums(self) -> CheckResult:
        walk, chunks = self._walk, self._kinds[Opcode.CHUNK]
        problems = [d.reason for d in walk.damage if "checksum" in d.reason]
        covered = []
        if chunks:
            covered.append(f"{chunks - self._unchecked} of {chunks} chunks")
        if walk.summed:
            covered.append("the data")
        if walk.proved:
            covered.append("the summary")
        if not covered and not problems:
            return CheckResult("checksums", "not checked", "the file has none")
        return check_result("checksums", problems, "of " + ", ".join(covered))

    def _check_indexes(self) -> CheckResult:
        problems = self._indexes
        if self._walk.ended is not None:
            problems = problems + self._unindexed
        if not self._indexed and not problems:
            return CheckResult("message indexes", "not checked", "the file has none")
        fine = f"of {self._indexed} chunks: every entry leads to its message, every message has one"
        return check_result("message indexes", problems, fine)

    def _check_summary(self) -> CheckResult:
        walk, problems = self._walk, self._summary
        if walk.footer is None or not self._runs:
            verdict: Verdict = "not checked" if walk.whole else "incomplete"
            return CheckResult("summary", verdict, "the file has none")
        start, offsets, _ = walk.footer
        if start != self._runs[0][1]:
            problems.append(f"the footer says that the summary begins at byte {start}")
        own = next((first for kind, first, _ in self._runs if kind == Opcode.SUMMARY_OFFSET), 0)
        if offsets != own:
            problems.append(f"the footer says that the summary's offsets begin at byte {offsets}")
        kinds = {kind for kind, _, _ in self._runs}
        if Opcode.CHUNK_INDEX in kinds:
            problems += [f"the chunk at byte {at} has no index" for at in self._chunks]
        for opcode, index in (
            (Opcode.ATTACHMENT, Opcode.ATTACHMENT_INDEX),
            (Opcode.METADATA, Opcode.METADATA_INDEX),
        ):
            if index in kinds:
                left = [at for at, (kind, _, _) in self._names.items() if kind == opcode]
                what = opcode.name.lower()
                problems += [f"the {what} at byte {at} has no index" for at in left]
        for group in self._groups:
            there = [group.group_opcode, group.group_start, group.group_start + group.group_length]
            if group.group_length and there not in self._runs:
                problems.append(
                    f"a summary offset leads to byte {group.group_start}, where its group is not"
                )
        chunks = self._kinds[Opcode.CHUNK]
        fine = f"{self.counts.total()} messages, {chunks} chunks, as found"
        return check_result("summary", problems, fine)


def _is_indexed(record: Record) -> bool:
    """Whether the indexes behind a chunk are right, all at once: a chunk may have thousands."""
    messages, entries = record.messages, [entries_of(content) for _, content in record.indexes]
    known = [entry for entry in entries if entry is not None]
    if messages is None or len({number for number, _ in known}) < len(entries) or not entries:
        return False
    pairs = np.concatenate([entry for _, entry in known])
    numbers = np.repeat([number for number, _ in known], [len(entry) for _, entry in known])
    order = np.argsort(pairs[:, 1], kind="stable")
    return (
        np.array_equal(pairs[order, 1], messages.places.astype(np.uint64))
        and np.array_equal(pairs[order, 0], messages.heads["log"])
        and np.array_equal(numbers[order], messages.heads["channel"])
    )


def _end_of_file(walk: Walk) -> CheckResult:
    if walk.whole:
        return CheckResult(
            "end of file", "ok", "data end, summary, footer and closing magic are there"
        )
    missing = "the end of the data" if walk.ended is None else "the footer"
    if walk.footer is not None:
        missing = "the closing magic"
    return CheckResult(
        "end of file", "incomplete", f"{missing} is not there: cut after {walk.size} bytes"
    )
