"""Where everything lies in an MCAP file, as its summary or a scan finds it."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

from cosim.trace.declared import Declarations
from cosim.trace.messages import Messages, on_channels
from cosim.trace.records import DamageError

RECORD = struct.Struct("<BQ")
"""Opcode and length of a record."""


@dataclass(slots=True)
class Segment:
    """A chunk, or messages outside chunks that follow each other.

    Attributes
    ----------
    position, size : of its records in the file.
    chunk : whether it is a chunk.
    index_size : bytes of the message indexes behind it.
    channels : ids of its messages' channels; None if that is not known yet.
    start_ns, end_ns : least and greatest log time of its messages.
    damaged : whether it could be read in part only.
    """

    position: int
    size: int
    chunk: bool
    index_size: int = 0
    channels: frozenset[int] | None = None
    start_ns: int = 0
    end_ns: int = 2**64 - 1
    damaged: bool = False


@dataclass(slots=True)
class Contents:
    """What is in a file, and where.

    Attributes
    ----------
    library : who wrote it, as its header says.
    counts : messages by id of their channel.
    spans : least and greatest log time by id; None where only the data can tell.
    metadata : name and entries of each record, in file order.
    attachments : position and size of the record of each, by name.
    damage : where and why it could not be read on; None if it is whole.
    scanned : whether all of it was gone through, with every checksum.
    """

    library: str = ""
    declared: Declarations = field(default_factory=Declarations)
    segments: list[Segment] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    spans: dict[int, tuple[int, int]] | None = None
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: dict[str, tuple[int, int]] = field(default_factory=dict)
    media_types: dict[str, str] = field(default_factory=dict)
    damage: str | None = None
    scanned: bool = False


def declared_only(
    messages: Messages, declared: Declarations
) -> tuple[Messages, DamageError | None]:
    """Messages up to the first on a channel that is not declared."""
    strange = ~on_channels(messages, declared.channels)
    if not strange.any():
        return messages, None
    first = int(np.argmax(strange))
    channel = int(messages.heads["channel"][first])
    error = DamageError(f"a message on channel {channel}, which is not declared")
    return messages.part(np.arange(first)), error
