"""The schemas and channels that an MCAP file declares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mcap import records as mcap
from mcap.opcode import Opcode

from cosim.trace.file.messages import Others
from cosim.trace.file.records import DamageError, parsed


@dataclass(frozen=True, slots=True)
class Schema:
    """An MCAP schema record; `encoding` "" and no data when the channel has none."""

    name: str = ""
    encoding: str = ""
    data: bytes = b""


@dataclass(frozen=True, slots=True)
class Channel:
    """An MCAP channel record with its schema."""

    topic: str
    encoding: str
    schema: Schema
    metadata: Mapping[str, str]


class Declarations:
    """The schemas and channels of a file by id; a second declaration must equal the first."""

    def __init__(self) -> None:
        self.schemas: dict[int, Schema] = {0: Schema()}
        self.channels: dict[int, Channel] = {}
        self._topics: dict[str, dict[int, Channel]] = {}
        self._added: set[tuple[int, bytes]] = set()

    def add(self, others: Others) -> None:
        """Add schema and channel records.

        Raises
        ------
        DamageError : a record differs from an earlier one of its id, a schema has the id 0, or a
            channel has a schema that is not declared.
        """
        for opcode, content in others:
            record = opcode, bytes(content)
            if record in self._added:
                continue  # writers repeat them in the summary, and some in every chunk
            if opcode == Opcode.SCHEMA:
                self._schema(parsed(mcap.Schema, content))
            elif opcode == Opcode.CHANNEL:
                self._channel(parsed(mcap.Channel, content))
            self._added.add(record)

    def _schema(self, found: mcap.Schema) -> None:
        schema = Schema(found.name, found.encoding, found.data)
        if found.id == 0 or self.schemas.setdefault(found.id, schema) != schema:
            raise DamageError(f"schema {found.id} is declared twice, not alike")

    def _channel(self, found: mcap.Channel) -> None:
        if found.schema_id not in self.schemas:
            raise DamageError(
                f"channel {found.id} has schema {found.schema_id}, which is not declared"
            )
        schema = self.schemas[found.schema_id]
        channel = Channel(found.topic, found.message_encoding, schema, found.metadata)
        if self.channels.setdefault(found.id, channel) != channel:
            raise DamageError(f"channel {found.id} is declared twice, not alike")
        self._topics.setdefault(channel.topic, {})[found.id] = channel

    def of_topic(self, topic: str) -> dict[int, Channel]:
        """Return the channels of a topic by id; files of other tools may have several."""
        return self._topics.get(topic, {})


class DamagedDeclarations:
    """The schemas and channels of a file that may be damaged, as far as they can be read.

    Of two declarations of one id, one whose record a checksum proves counts, else the first.

    Attributes
    ----------
    schemas, channels : by id.
    conflicts : ids declared twice with different content.
    """

    def __init__(self) -> None:
        self.schemas: dict[int, mcap.Schema] = {}
        self.channels: dict[int, mcap.Channel] = {}
        self.conflicts: list[str] = []
        self._proved: set[tuple[int, int]] = set()
        self._added: set[tuple[int, bytes, bool]] = set()

    def add(self, others: Others, *, proved: bool) -> None:
        """Add schema and channel records; proved : a checksum covers them, and matches."""
        for opcode, content in others:
            again = opcode, bytes(content), proved
            if again in self._added:
                continue
            self._added.add(again)
            if opcode == Opcode.SCHEMA:
                self._add(opcode, parsed(mcap.Schema, content), self.schemas, proved=proved)
            elif opcode == Opcode.CHANNEL:
                self._add(opcode, parsed(mcap.Channel, content), self.channels, proved=proved)

    def _add(
        self,
        opcode: int,
        record: mcap.Schema | mcap.Channel,
        known: dict[int, Any],
        *,
        proved: bool,
    ) -> None:
        key = opcode, record.id
        if record.id not in known or (proved and key not in self._proved):
            differs = record.id in known and known[record.id] != record
            known[record.id] = record
        else:
            differs = known[record.id] != record
        if proved:
            self._proved.add(key)
        if differs:
            what = type(record).__name__.lower()
            self.conflicts.append(f"{what} {record.id} is declared twice, not alike")
