"""The places of everything in an MCAP file, from its summary or a scan."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from cosim.trace.file.declared import Declarations
from cosim.trace.file.messages import Messages, on_channels
from cosim.trace.file.records import LATEST_NS, DamageError


@dataclass(slots=True)
class Segment:
    """A chunk, or messages outside chunks that follow each other.

    Attributes
    ----------
    position, size : of its records in the file [bytes].
    chunk : whether it is a chunk.
    index_size : size of the message indexes behind it [bytes].
    channels : ids of its messages' channels; None if not known yet.
    start_ns, end_ns : least and greatest log time of its messages.
    data_size : size of its records, uncompressed [bytes].
    damaged : whether only a part of it can be read.
    """

    position: int
    size: int
    chunk: bool
    index_size: int = 0
    channels: frozenset[int] | None = None
    start_ns: int = 0
    end_ns: int = LATEST_NS
    data_size: int = 0
    damaged: bool = False


@dataclass(slots=True)
class Contents:
    """The contents of a file, and their places.

    Attributes
    ----------
    library : the writing library, from the file's header.
    counts : number of messages by channel id.
    spans : least and greatest log time by channel id; None if the data must be read for them.
    metadata : name and entries of each record, in file order.
    attachments : position and size of the record of each, by name.
    damage : where and why reading stopped; None if the file is whole.
    scanned : whether all records were read and every checksum was checked.
    sets : the sets of channels of the segments, each once: a file of many topics has many equal.
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
    sets: dict[frozenset[int], frozenset[int]] = field(default_factory=dict)


def declared_only(
    messages: Messages, declared: Declarations
) -> tuple[Messages, DamageError | None]:
    """Return the messages before the first on an undeclared channel, and the damage if any."""
    strange = ~on_channels(messages, declared.channels)
    if not strange.any():
        return messages, None
    first = int(np.argmax(strange))
    channel = int(messages.heads["channel"][first])
    error = DamageError(f"a message on channel {channel}, which is not declared")
    return messages.part(np.arange(first)), error
