"""Read the contents of an MCAP file by a walk from its front, as far as it is whole."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Header, Metadata

from cosim.core import distinct
from cosim.trace.file.contents import Contents, Segment, declared_only
from cosim.trace.file.messages import Messages
from cosim.trace.file.records import LATEST_NS, DamageError, parsed
from cosim.trace.file.walk import Record, Walk


def by_scan(path: Path) -> Contents:
    """Return the contents by a walk over the whole file; `damage` says where it stopped, and why.

    Raises
    ------
    InputError : no such file, or not an MCAP file.
    """
    found = Contents(spans={}, scanned=True)
    try:
        for record in Walk(path, "stop"):
            _take(record, found)
    except DamageError as error:
        found.damage = str(error)
    return found


def _take(record: Record, found: Contents) -> None:
    damage = None
    try:
        found.declared.add(record.declarations)
    except DamageError as error:
        damage = error
    if record.messages is not None:
        messages = record.messages if damage is None else record.messages.part(np.arange(0))
        messages, stranger = declared_only(messages, found.declared)
        damage = damage or stranger
        _note(record, messages, found, damaged=bool(damage or record.suspect))
    elif record.opcode == Opcode.METADATA:
        metadata = parsed(Metadata, record.content)
        found.metadata.append((metadata.name, metadata.metadata))
    elif record.opcode == Opcode.ATTACHMENT:
        attachment = parsed(Attachment, record.content)
        found.media_types[attachment.name] = attachment.media_type
        found.attachments[attachment.name] = record.position, record.end - record.position
    elif record.opcode == Opcode.HEADER:
        found.library = parsed(Header, record.content).library
    if damage is not None:
        raise DamageError(f"record at byte {record.position}: {damage}")


def _note(record: Record, messages: Messages, found: Contents, *, damaged: bool) -> None:
    """Take note of messages that came together."""
    times, numbers = messages.heads["log"], messages.heads["channel"]
    ids = distinct(numbers).tolist()
    found.segments.append(
        Segment(
            record.position,
            record.end - record.position,
            chunk=record.opcode == Opcode.CHUNK,
            index_size=sum(9 + len(content) for _, content in record.indexes),
            channels=found.sets.setdefault(frozenset(ids), frozenset(ids)),
            start_ns=int(times.min()) if ids else 0,
            end_ns=int(times.max()) if ids else LATEST_NS,
            data_size=len(messages.data),
            damaged=damaged,
        )
    )
    spans = found.spans if found.spans is not None else {}
    for number, low, high, count in messages.spans():
        before = spans.get(number, (low, high))
        spans[number] = min(low, before[0]), max(high, before[1])
        found.counts[number] = found.counts.get(number, 0) + count
