"""The schemas and channels that an MCAP file declares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from cosim.trace.records import Cursor, DamageError


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

    def add_schema(self, content: bytes | memoryview) -> None:
        """Add a schema record; `DamageError` for id 0, or if it differs from an earlier one."""
        fields = Cursor(content)
        schema_id = fields.number(2)
        name, encoding = fields.text(), fields.text()
        schema = Schema(name, encoding, bytes(fields.take(fields.number(4))))
        if schema_id == 0 or self.schemas.setdefault(schema_id, schema) != schema:
            raise DamageError(f"schema {schema_id} is declared twice, not alike")

    def add_channel(self, content: bytes | memoryview) -> None:
        """Add a channel record; `DamageError` without schema, or if it differs from an earlier."""
        fields = Cursor(content)
        channel_id, schema_id = fields.number(2), fields.number(2)
        topic, encoding = fields.text(), fields.text()
        if schema_id not in self.schemas:
            raise DamageError(f"channel {channel_id} has schema {schema_id}, which is not declared")
        channel = Channel(topic, encoding, self.schemas[schema_id], fields.mapping())
        if self.channels.setdefault(channel_id, channel) != channel:
            raise DamageError(f"channel {channel_id} is declared twice, not alike")

    def of_topic(self, topic: str) -> dict[int, Channel]:
        """Return the channels of a topic by id; files of other tools may have several."""
        return {i: channel for i, channel in self.channels.items() if channel.topic == topic}
