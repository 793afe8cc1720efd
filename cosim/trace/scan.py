"""Find every whole record of an MCAP file, and its damage.

Unlike `records`, which stops at the first fault, this goes on behind it: where a record cannot be
right, it looks for the next place where one can be.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from mcap.opcode import Opcode

from cosim.trace.pieces import Channel, McapFile, Piece, Schema, declarations
from cosim.trace.records import MAGIC, Cursor, DamageError

_CANDIDATE = re.compile(rb"(?=[\x02-\x06\x09\x0c\x0f].{4}\x00\x00\x00\x00)", re.DOTALL)
"""Where a record that can prove itself, of less than 4 GiB, could begin."""

_BARE = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
"""What lies within chunks, or outside them in a file that has none."""

_INDEX_ENTRY_BYTES = 16
_EXACT_BYTES: dict[int, int] = {Opcode.DATA_END: 4, Opcode.FOOTER: 20}


@dataclass(frozen=True)
class Damage:
    """Bytes that could not be used, and why."""

    position: int
    length: int
    reason: str


@dataclass
class Scan:
    """The whole records of a file, and its damage.

    Attributes
    ----------
    pieces : whole records of the data section, in file order, with chunks unopened.
    summary : whole records behind the data section.
    damage : in file order, with bytes at the end that are no whole record.
    schemas, channels : by id, wherever they are declared.
    conflicts : ids declared twice with different content.
    ended : the record that ends the data section, or None.
    footer : start of the summary, start of its offsets, its checksum; None without a footer.
    proved : whether the summary matches its checksum.
    whole : whether footer and closing magic are there.
    lost : number of messages in damage before the end, by the chunks' indexes; None if unknown.
    """

    pieces: list[Piece] = field(default_factory=list)
    summary: list[Piece] = field(default_factory=list)
    damage: list[Damage] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    conflicts: list[str] = field(default_factory=list)
    ended: Piece | None = None
    footer: tuple[int, int, int] | None = None
    proved: bool = False
    whole: bool = False
    lost: int | None = 0

    @property
    def chunked(self) -> bool:
        """Whether the file has chunks."""
        return any(piece.opcode == Opcode.CHUNK for piece in self.pieces)


def scan(file: McapFile) -> Scan:
    """Scan a file for whole records and damage, from the front to the end."""
    return _Scanner(file).run()


class _Scanner:
    def __init__(self, file: McapFile) -> None:
        self._file = file
        self._found = Scan()
        self._uncounted = False
        """A chunk was dropped, and its index has not turned up yet."""

    def run(self) -> Scan:
        found, file = self._found, self._file
        position = len(MAGIC)
        if file.data[:position] != MAGIC:
            self._lose(0, position, "the magic bytes at the start are not there")
        while position < file.size and found.footer is None:
            position = self._step(position)
        self._settle()
        if found.footer is None:
            return found
        start, _, given = found.footer
        # up to the checksum itself, the last field of the footer
        found.proved = bool(start and given) and given == file.checksum(start, position - 4)
        if start and given and not found.proved:
            self._lose(position, position, "the summary is not that of its checksum")
        closing = file.data[position : position + len(MAGIC)]
        found.whole = closing == MAGIC
        if not found.whole:
            self._lose(position, file.size, "the closing magic bytes are not there")
        elif file.size > position + len(MAGIC):
            self._lose(position + len(MAGIC), file.size, "bytes after the end of the file")
        return found

    def _step(self, position: int) -> int:
        """Look at one place; where to go on."""
        piece = self._file.at(position)
        if piece is None:
            cut = self._file.data[position] == Opcode.CHUNK
            return self._skip(position, None, bare=not cut)
        try:
            declared = declarations(self._file, piece)
        except DamageError as error:
            if not self._plausible(piece.end):
                return self._skip(position, str(error), bare=piece.opcode != Opcode.CHUNK)
            self._settle()
            self._lose(position, piece.end, str(error))
            self._uncounted = piece.opcode == Opcode.CHUNK
            return piece.end
        self._take(piece, declared)
        return piece.end

    def _take(self, piece: Piece, declared: list[Schema | Channel]) -> None:
        found, file = self._found, self._file
        for record in declared:
            if isinstance(record, Schema):
                same = found.schemas.setdefault(record.number, record) == record
            else:
                same = found.channels.setdefault(record.number, record) == record
            if not same:
                what = type(record).__name__.lower()
                found.conflicts.append(f"{what} {record.number} is declared twice, not alike")
        if piece.opcode == Opcode.MESSAGE_INDEX:
            if self._uncounted and found.lost is not None:
                entries = int.from_bytes(file.content(piece)[2:6], "little")
                found.lost += entries // _INDEX_ENTRY_BYTES
            self._uncounted = False
        else:
            self._settle()
        if piece.opcode == Opcode.FOOTER:
            fields = Cursor(file.content(piece))
            found.footer = fields.number(8), fields.number(8), fields.number(4)
        elif found.ended is not None:
            found.summary.append(piece)
        elif piece.opcode == Opcode.DATA_END:
            found.ended = piece
            given = int.from_bytes(file.content(piece)[:4], "little")
            if not found.damage and given not in (0, file.checksum(0, piece.position)):
                self._lose(piece.position, piece.position, "the data are not those of its checksum")
        else:
            found.pieces.append(piece)

    def _settle(self) -> None:
        """A dropped chunk without an index held nobody knows how many messages."""
        if self._uncounted:
            self._found.lost = None
        self._uncounted = False

    def _lose(self, first: int, last: int, reason: str) -> None:
        self._found.damage.append(Damage(first, last - first, reason))

    def _skip(self, position: int, reason: str | None, *, bare: bool) -> int:
        """Where the next record begins that proves itself, or the end of the file.

        bare : whether messages outside chunks may be among them.
        """
        self._settle()
        bare = bare and not self._found.chunked
        end = next(
            (
                match.start()
                for match in _CANDIDATE.finditer(self._file.data, position + 1)
                if self._proves_itself(match.start(), bare=bare)
            ),
            self._file.size,
        )
        if reason is None:
            cut = end == self._file.size
            reason = "the file ends within a record" if cut else "no record, or a damaged one"
        self._lose(position, end, reason)
        if self._found.ended is None:
            self._found.lost = None
        return end

    def _proves_itself(self, position: int, *, bare: bool) -> bool:
        piece = self._file.at(position)
        if piece is None or not self._plausible(piece.end):
            return False
        if piece.opcode in _BARE and not bare and self._found.ended is None:
            return False
        try:
            declarations(self._file, piece)
        except DamageError:
            return False
        if piece.opcode == Opcode.MESSAGE:
            number = int.from_bytes(self._file.content(piece)[:2], "little")
            return number in self._found.channels
        return piece.length == _EXACT_BYTES.get(piece.opcode, piece.length)

    def _plausible(self, position: int) -> bool:
        """Whether a record, the closing magic or the end could lie at a place."""
        left = self._file.data[position : position + len(MAGIC)]
        return left == MAGIC[: len(left)] or self._file.at(position) is not None
