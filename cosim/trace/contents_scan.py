"""Read the contents of an MCAP file by a scan from its front, as far as it is whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.opcode import Opcode

from cosim.trace.contents import RECORD, Contents, Segment, declared_only
from cosim.trace.messages import Others, find_messages
from cosim.trace.records import Cursor, DamageError, chunk_data, outer_records

_LOOSE_BYTES = 2**22


def by_scan(path: Path) -> Contents:
    """Return the contents by a scan of the whole file; `damage` says where it stopped, and why.

    Raises
    ------
    InputError : no such file, or not an MCAP file.
    """
    return _Scan(path).contents


class _Scan:
    def __init__(self, path: Path) -> None:
        self.contents = Contents(spans={}, scanned=True)
        self._open_chunk: tuple[int, bytes] | None = None  # a chunk whose indexes are still to come
        self._index: list[bytes] = []
        self._loose: list[bytes] = []
        self._loose_at, self._loose_end = 0, 0
        try:
            try:
                for opcode, position, content in outer_records(path):
                    self._take(opcode, position, content)
            finally:
                self._settle()
        except DamageError as error:
            self.contents.damage = str(error)

    def _take(self, opcode: int, position: int, content: bytes) -> None:
        if opcode == Opcode.MESSAGE_INDEX and self._open_chunk is not None:
            self._index.append(content)
            return
        if opcode == Opcode.MESSAGE:
            if position != self._loose_end or self._loose_end - self._loose_at > _LOOSE_BYTES:
                self._settle()
                self._loose_at = position
            self._loose.append(RECORD.pack(opcode, len(content)) + content)
            self._loose_end = position + RECORD.size + len(content)
            return
        self._settle()
        known = self.contents
        if opcode == Opcode.CHUNK:
            self._open_chunk = position, content
        elif opcode == Opcode.METADATA:
            fields = Cursor(content)
            known.metadata.append((fields.text(), fields.mapping()))
        elif opcode == Opcode.ATTACHMENT:
            fields = Cursor(content)
            fields.take(16)
            name = fields.text()
            known.media_types[name] = fields.text()
            fields.take(fields.number(8))
            known.attachments[name] = (position, RECORD.size + len(content))
        elif opcode == Opcode.HEADER:
            fields = Cursor(content)
            fields.text()
            known.library = fields.text()
        else:
            self._declare([(opcode, memoryview(content))])

    def _declare(self, others: Others) -> None:
        for opcode, content in others:
            if opcode == Opcode.SCHEMA:
                self.contents.declared.add_schema(content)
            elif opcode == Opcode.CHANNEL:
                self.contents.declared.add_channel(content)

    def _settle(self) -> None:
        """Take note of the messages that came together."""
        if self._open_chunk is not None:
            (position, content), self._open_chunk = self._open_chunk, None
            index, self._index = self._index, []
            segment = Segment(position, RECORD.size + len(content), True)  # noqa: FBT003
            segment.index_size = sum(RECORD.size + len(entry) for entry in index)
            try:
                self._note(segment, chunk_data(content), index)
            except DamageError as error:
                raise DamageError(f"record at byte {position}: {error}") from None
        if self._loose:
            loose, self._loose = self._loose, []
            segment = Segment(self._loose_at, self._loose_end - self._loose_at, False)  # noqa: FBT003
            self._note(segment, b"".join(loose), [])

    def _note(self, segment: Segment, data: bytes, index: list[bytes]) -> None:
        messages, others, damage = find_messages(data, index)
        try:
            self._declare(others)
        except DamageError as error:
            damage, messages = error, messages.part(np.arange(0))
        messages, stranger = declared_only(messages, self.contents.declared)
        damage = stranger or damage
        segment.damaged = damage is not None
        heads = messages.heads
        if len(messages):
            segment.start_ns, segment.end_ns = int(heads["log"].min()), int(heads["log"].max())
        ids = np.unique(heads["channel"]).tolist()
        segment.channels = frozenset(ids)
        self.contents.segments.append(segment)
        counts, spans = self.contents.counts, self.contents.spans or {}
        for channel in ids:
            times = heads["log"][heads["channel"] == channel]
            low, high = int(times.min()), int(times.max())
            if channel in spans:
                low, high = min(low, spans[channel][0]), max(high, spans[channel][1])
            spans[channel] = (low, high)
            counts[channel] = counts.get(channel, 0) + times.size
        self.contents.spans = spans
        if damage is not None:
            raise damage
