"""Walk over the records of an MCAP file from its front to its end, whatever state it is in.

Every reader of whole files uses this walk. It holds one chunk at a time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Footer,
    Header,
    McapRecord,
    Metadata,
    Schema,
)

from cosim.trace.file.checksum import crc32
from cosim.trace.file.file_bytes import WINDOW, FileBytes, NamedRecord
from cosim.trace.file.messages import Messages, Others, find_messages, salvaged_messages
from cosim.trace.file.records import (
    HEAD,
    MAGIC,
    MAX_CHUNK_BYTES,
    DamageError,
    bytes_left,
    check_start,
    chunk_data,
    chunk_head,
    is_chunk,
    open_trace,
    parsed,
    salvaged,
)

Policy = Literal["stop", "skip", "keep"]
"""What to do at damage.

stop : raise `DamageError` at the first damage; the records before it are whole.
skip : leave out what cannot be right, and go on at the next record that proves itself.
keep : as skip, and yield what is left of damaged chunks and attachments, marked as suspect.
"""

Outcome = Literal["lost", "suspect", "mended"]

_CANDIDATE = re.compile(rb"(?=[\x02-\x06\x09\x0c\x0f].{4}\x00\x00\x00\x00)", re.DOTALL)
"""Where a record that can prove itself, of less than 4 GiB, could begin."""

_BARE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
"""What lies within chunks, or outside them in a file that has none."""
_LOOSE_BYTES = 2**20
_PARSED: dict[int, type[McapRecord]] = {
    Opcode.HEADER: Header,
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.METADATA: Metadata,
    Opcode.ATTACHMENT: Attachment,
}


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that are damaged, and why.

    Attributes
    ----------
    position, length : in the file [bytes].
    reason : what is wrong.
    outcome : "lost"; "suspect" if what could be read of them was kept; "mended" if nothing was
        lost, as other records prove.
    """

    position: int
    length: int
    reason: str
    outcome: Outcome = "lost"


@dataclass(slots=True)
class Record:
    """A record; or messages outside chunks that follow each other, with the opcode of the first.

    Attributes
    ----------
    position, end : in the file [bytes].
    content : without opcode and length; of messages outside chunks, all their records.
    messages : of a chunk, or outside chunks.
    others : schemas and channels within a chunk.
    indexes : position and content of the message indexes behind a chunk.
    suspect : why it cannot be trusted, or why a part of it is missing; None if it is whole.
    """

    opcode: int
    position: int
    end: int
    content: bytes
    messages: Messages | None = None
    others: Others = field(default_factory=list)
    indexes: list[tuple[int, bytes]] = field(default_factory=list)
    suspect: str | None = None

    @property
    def size(self) -> int:
        """Bytes of the record in the file."""
        return self.end - self.position

    @property
    def trusted(self) -> bytes:
        """The content; of a suspect attachment, without its checksum, so that it can be read."""
        suspect = self.suspect is not None and self.opcode == Opcode.ATTACHMENT
        return self.content[:-4] + bytes(4) if suspect else self.content

    @property
    def declarations(self) -> Others:
        """Opcode and content of the schemas and channels in it."""
        if self.opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            return [(self.opcode, memoryview(self.content))]
        return self.others


class Walk:
    """One walk over a file; iterate over it once.

    Parameters
    ----------
    path : the file.
    policy : what to do at damage.
    chunks : open them, and check what is inside; else a chunk comes with its content alone.

    Attributes
    ----------
    size : of the file [bytes].
    position : how far the walk has come [bytes].
    damage : in file order, with bytes at the end that are no whole record.
    ended : position of the record that ends the data section; None before it.
    footer : start of the summary, start of its offsets, its checksum; None without a footer.
    refuted : why what lies outside chunks is not as it was written; None if that is not known.
    proved : whether the summary matches its checksum.
    whole : whether footer and closing magic are there.
    lost : number of messages in damage before the end, by the chunks' indexes; None if unknown.

    Raises
    ------
    InputError : when it begins, if there is no such file, or it is no MCAP file.
    DamageError : with the policy "stop".
    """

    def __init__(self, path: Path, policy: Policy = "stop", *, chunks: bool = True) -> None:
        self._path, self._policy, self._chunks = path, policy, chunks
        self.size = self.position = 0
        self.damage: list[Damage] = []
        self.ended: int | None = None
        self.refuted: str | None = None
        self.footer: tuple[int, int, int] | None = None
        self.proved = self.whole = self.chunked = self.summed = False
        self.lost: int | None = 0
        self._known: set[int] = set()
        self._places: dict[int, NamedRecord] | None = None
        self._checksum: int | None = 0
        self._sure = len(MAGIC)
        self._visited: set[int] = set()

    def __iter__(self) -> Iterator[Record]:
        with open_trace(self._path) as stream:
            self._file = FileBytes(stream, any_opcode=self._policy == "stop")
            self.size = self._file.size
            self._start()
            while self.position < self.size and self.footer is None:
                before = self.position
                record = self._next()
                if record is not None:
                    yield record
                    if record.suspect is not None and self._policy == "stop":
                        raise DamageError(f"record at byte {record.position}: {record.suspect}")
                if self.ended is None and self._checksum is not None:
                    self._checksum = self._file.checksum(before, self.position, self._checksum)
            self._finish()

    def _start(self) -> None:
        start = self._file(0, len(MAGIC))
        self.position = len(MAGIC)
        if start != MAGIC:
            at, file = len(MAGIC), self._file
            header = file.fault(at) is None and file.head(at)[0] == Opcode.HEADER
            if self._policy == "stop" or not header:
                check_start(start, self.size, self._path)
            self._lose(0, len(MAGIC), "the magic bytes at the start are not there")
        self._checksum = crc32(start)

    def _next(self) -> Record | None:
        """Take what lies at the position, and go on behind it."""
        position = self.position
        reason = self._file.fault(position)
        if reason is not None:
            return self._at_fault(position, reason)
        opcode, end = self._file.head(position)
        if self._is_mistaken(position, opcode):
            return self._named(position)
        if opcode == Opcode.MESSAGE:
            return self._loose(position)
        record = Record(opcode, position, end, self._file.content(position, end))
        try:
            self._open(record)
        except DamageError as error:
            if self._policy == "stop":
                raise DamageError(f"record at byte {position}: {error}") from None
            return self._damaged(record, str(error))
        if record.opcode == Opcode.CHUNK and self._policy != "stop" and self._is_long(record):
            return self._named(position)
        self._take(record)
        return record

    def _at_fault(self, position: int, reason: str) -> Record | None:
        """Go on where no record can lie: back, by the summary, or at the next one proved."""
        if self._policy == "stop":
            raise DamageError(reason)
        named = (p for p in self._index() if self._sure <= p < position)
        passed = [p for p in named if p not in self._visited]
        if passed:  # what lies before had a false length
            self.position = min(passed)
            self._lose(self._sure, self.position, "a record with a false length")
            self._sure = self.position + 1
            return None
        record = self._named(position)
        return self._skip(position, None) if self.position == position else record

    def _is_mistaken(self, position: int, opcode: int) -> bool:
        """Whether the summary has another kind of record at a place: its opcode is damaged.

        A chunk and an attachment prove themselves, and so the summary is not read for them.
        """
        if self._policy == "stop" or opcode in (Opcode.CHUNK, Opcode.ATTACHMENT):
            return False
        named = self._index().get(position)
        return named is not None and named[0] != opcode and named[1] <= self.size

    def _is_long(self, record: Record) -> bool:
        """Whether a whole chunk is longer than its data and its index: its length is damaged."""
        head = chunk_head(record.content)
        if head.at + head.packed == len(record.content):
            return False
        named = self._index().get(record.position)
        return named is not None and named[0] == Opcode.CHUNK and named[1] < record.end

    def _take(self, record: Record) -> None:
        """Go on behind a record, and its indexes."""
        opcode = record.opcode
        if opcode in (Opcode.CHUNK, Opcode.ATTACHMENT):  # by their checksums, or their indexes
            self._sure = record.end
            self._visited.clear()
        else:
            self._visited.add(record.position)
        self.position = record.indexes[-1][0] + HEAD.size if record.indexes else record.end
        self.position += len(record.indexes[-1][1]) if record.indexes else 0
        self.chunked |= opcode == Opcode.CHUNK
        for kind, content in record.declarations:
            if kind == Opcode.CHANNEL:
                self._known.add(int.from_bytes(content[:2], "little"))
        if opcode == Opcode.FOOTER:
            found = parsed(Footer, record.content)
            self.footer = found.summary_start, found.summary_offset_start, found.summary_crc
        elif opcode == Opcode.DATA_END and self.ended is None:
            self.ended = record.position
            given = int.from_bytes(record.content[:4], "little")
            self.summed = given != 0
            if not self.damage and given not in (0, self._checksum):
                reason = "the checksum of the data section does not match"
                if self._policy == "stop":
                    raise DamageError(f"record at byte {record.position}: {reason}")
                self.refuted = reason
                self._lose(record.position, record.position, reason)

    def _loose(self, position: int) -> Record:
        """Take the messages outside chunks that begin here."""
        places, at = [], position
        while at - position < _LOOSE_BYTES and self._file.fault(at) is None:
            opcode, end = self._file.head(at)
            if opcode != Opcode.MESSAGE:
                break
            places.append(at - position)
            at = end
        raw = self._file(position, at - position)
        self.position = at
        return Record(
            Opcode.MESSAGE, position, at, raw, Messages.at(raw, np.array(places, np.int64))
        )

    def _open(self, record: Record) -> None:
        """Check a record's content and checksum, and find the messages of a chunk."""
        kind = _PARSED.get(record.opcode)
        if kind is not None:
            more = bytes_left(kind, record.content)
            if more and self._file.plausible(record.end - more):
                self._shorten(record, more)
        if record.opcode != Opcode.CHUNK or not self._chunks:
            return
        data = chunk_data(record.content)
        record.indexes = self._indexes(record.end)
        record.messages, record.others, damage = find_messages(
            data, [content for _, content in record.indexes]
        )
        for opcode, content in record.others:
            parsed(Schema if opcode == Opcode.SCHEMA else Channel, content)
        if damage is not None:
            if self._policy != "stop":
                raise damage
            record.suspect = str(damage)

    def _shorten(self, record: Record, more: int) -> None:
        """Take a record as long as what is in it, where another follows that."""
        if self._policy == "stop":
            raise DamageError("the record is longer than what is in it")
        record.content, record.end = record.content[:-more], record.end - more
        self.damage.append(Damage(record.position, HEAD.size, "the length of a record", "mended"))

    def _indexes(self, position: int) -> list[tuple[int, bytes]]:
        found = []
        while self._file.fault(position) is None:
            opcode, end = self._file.head(position)
            if opcode != Opcode.MESSAGE_INDEX or self._is_mistaken(position, opcode):
                break
            found.append((position, self._file.content(position, end)))
            position = end
        return found

    def _named(self, position: int) -> Record | None:
        """Return the record whose head is damaged, by its index, if its content is right."""
        opcode, end, _ = self._index().get(position, (0, 0, None))
        if not opcode or end > self.size:
            return None
        record = Record(opcode, position, end, self._file.content(position, end))
        try:
            self._open(record)
        except DamageError as error:
            return self._damaged(record, f"its head is damaged, and {error}")
        self.damage.append(Damage(position, HEAD.size, "the head of a record", "mended"))
        self._take(record)
        return record

    def _damaged(self, record: Record, reason: str) -> Record | None:
        """Return what is left of a record whose content is damaged, if that is wanted."""
        named = self._index().get(record.position)
        if named is not None and named[1] <= self.size:
            if named[0] != record.opcode:
                return self._named(record.position)
            end = named[1]
            record.content = self._file.content(record.position, end)
            record.end = end
        elif not self._file.plausible(record.end):
            return self._skip(record.position, reason)
        record.indexes = self._indexes(record.end) if record.opcode == Opcode.CHUNK else []
        entries = [content for _, content in record.indexes]
        count = sum((len(content) - 6) // 16 for content in entries)
        kept = 0
        if self._policy == "keep" and self._salvage(record, None if named is None else named[2]):
            record.suspect = reason
            kept = 0 if record.messages is None else len(record.messages)
        outcome: Outcome = "lost" if record.suspect is None else "suspect"
        self._lose(record.position, record.end, reason, outcome)
        if record.opcode == Opcode.CHUNK:
            unknown = self.lost is None or not entries
            self.lost = None if unknown else (self.lost or 0) + max(count - kept, 0)
        self._take(record)
        return record if record.suspect is not None else None

    def _salvage(self, record: Record, packed: int | None) -> bool:
        """Find what is left of a damaged chunk or attachment."""
        if record.opcode == Opcode.ATTACHMENT:
            try:  # its data may be wrong; the record with its checksum left out
                parsed(Attachment, record.content[:-4] + bytes(4))
            except DamageError:
                return False
            return True
        if record.opcode != Opcode.CHUNK:
            return False
        entries = [content for _, content in record.indexes]
        data = salvaged(record.content, packed)
        cut = len(data) != int.from_bytes(record.content[16:24], "little")
        found = salvaged_messages(data, entries, self._known, cut=cut)
        record.messages, record.others = found
        return bool(len(record.messages) or record.others)

    def _index(self) -> dict[int, NamedRecord]:
        """Return where chunks, attachments and metadata lie, as the summary has it, by position.

        Of a summary that its checksum does not prove, where such a record is whole, or what is left
        of a chunk. Read at the first damage.
        """
        if self._places is None:
            self._places, places, proved = {}, dict[int, NamedRecord](), False
            with suppress(DamageError):
                for place, named in self._file.named():
                    places[place] = named
                proved = self._file.proves_summary()
            if not proved:
                places = {place: one for place, one in places.items() if self._is_at(place, one)}
            self._places = places
        return self._places

    def _is_at(self, position: int, named: NamedRecord) -> bool:
        """Whether the record that an index names is at a place, whatever its head says.

        It is whole, or what is left of a chunk, up to a record.
        """
        opcode, end, _ = named
        if not len(MAGIC) <= position < end <= self.size:
            return False
        noted, content = len(self.damage), self._file.content(position, end)
        try:
            self._open(Record(opcode, position, end, content))
        except DamageError:
            return opcode == Opcode.CHUNK and is_chunk(content) and self._file.plausible(end)
        finally:
            del self.damage[noted:]
        return True

    def _finish(self) -> None:
        """Check what lies behind the footer, or that it is missing."""
        position = self.position
        if self.footer is None:
            if self._policy == "stop":
                raise DamageError(
                    f"the file ends after {self.size} bytes, without its closing records"
                )
            return
        start, _, given = self.footer
        # up to the checksum itself, the last field of the footer
        self.proved = bool(start and given) and given == self._file.checksum(start, position - 4)
        if start and given and not self.proved and self._policy != "stop":
            self._lose(position, position, "the summary is not that of its checksum")
        self.whole = self._file(position, len(MAGIC)) == MAGIC
        behind = self.size - position - len(MAGIC)
        if self._policy == "stop":
            if not self.whole or behind:
                raise DamageError(
                    f"the closing magic is not where it should be, at byte {position}"
                )
        elif not self.whole:
            self._lose(position, self.size, "the closing magic bytes are not there")
        elif behind:
            self._lose(position + len(MAGIC), self.size, "bytes after the end of the file")

    def _lose(self, first: int, last: int, reason: str, outcome: Outcome = "lost") -> None:
        self.damage.append(Damage(first, last - first, reason, outcome))

    def _skip(self, position: int, reason: str | None) -> Record | None:
        """Go on where the next record begins that proves itself, or at the end of the file.

        Return what is left of chunks before that, if that is wanted.
        """
        chunk = self._file(position, 1)[0] == Opcode.CHUNK
        bare = not self.chunked and not chunk
        named = (place for place in self._index() if place > position)
        end = min(self._candidate(position + 1, bare=bare), min(named, default=self.size))
        if reason is None:
            at_end = end == self.size
            reason = "the file ends within a record" if at_end else "no record, or a damaged one"
        record = Record(Opcode.CHUNK, position, end, b"")
        if self._policy == "keep" and self.ended is None and not bare:
            raw = self._file(position, min(end - position, MAX_CHUNK_BYTES))
            record.content = raw[HEAD.size :]
            if not (chunk and is_chunk(record.content) and self._salvage(record, None)):
                # of a chunk whose head is not there, or is no head, if it is not compressed
                record.messages, record.others = salvaged_messages(raw, [], self._known, cut=True)
            if len(record.messages or ()) or record.others:
                record.suspect = reason
        self._lose(position, end, reason, "lost" if record.suspect is None else "suspect")
        if self.ended is None:
            self.lost = None
        if record.suspect is not None:
            self._take(record)
            return record
        self.position = end
        return None

    def _candidate(self, position: int, *, bare: bool) -> int:
        for begin in range(position, self.size, WINDOW):
            window = self._file(begin, WINDOW + HEAD.size)
            for match in _CANDIDATE.finditer(window):
                at = begin + match.start()
                if match.start() < WINDOW and self._proves_itself(at, bare=bare):
                    return at
        return self.size

    def _proves_itself(self, position: int, *, bare: bool) -> bool:
        """Whether a record lies at a place; bare : whether messages outside chunks may."""
        if self._file.fault(position) is not None:
            return False
        opcode, end = self._file.head(position)
        if not self._file.plausible(end):
            return False
        if opcode in _BARE and not bare and self.ended is None:
            return False
        record = Record(opcode, position, end, self._file.content(position, end))
        if opcode == Opcode.MESSAGE:
            return int.from_bytes(record.content[:2], "little") in self._known
        noted = len(self.damage)
        try:
            self._open(record)
        except DamageError:
            return False
        finally:
            del self.damage[noted:]  # it is noted when the record is taken
        return True
