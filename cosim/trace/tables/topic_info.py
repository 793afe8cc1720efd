"""Topics of a trace: what each holds, and what can be read of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Self

from cosim.trace.file.declared import Channel
from cosim.trace.rows.layout import COMPUTED, Signal
from cosim.trace.tables.gather import decoder_of

Spans = Mapping[str, tuple[int, int]]
"""Least and greatest log time [ns] by topic."""


class TopicInfo:
    """The description of a topic.

        >>> from cosim import DelaySystem, Scenario, Trace, run
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> result = run(lag, "lag.mcap")
        >>> topic = Trace("lag.mcap").topics["/lag/output"]
        >>> topic.count, [signal.name for signal in topic.signals], topic.end_ns
        (11, ['x[1]'], 1000000000)

    Attributes
    ----------
    schema, encoding : name of the schema, and encoding of the messages.
    metadata : of its channel.
    signals : of a protobuf topic; empty for others.
    count : number of messages.
    """

    def __init__(
        self,
        topic: str,
        signals: Sequence[Signal],
        metadata: Mapping[str, str],
        count: int,
        spans: Callable[[], Spans],
        schema: str = "",
        encoding: str = "protobuf",
    ) -> None:
        self._spans = spans
        self.topic, self.schema, self.encoding = topic, schema, encoding
        self.metadata = dict(metadata)
        self.count = count
        self.signals = tuple(signals)

    @classmethod
    def of_channel(cls, channel: Channel, count: int, spans: Callable[[], Spans]) -> Self:
        """Return what a channel of a file declares."""
        signals: Sequence[Signal] = ()
        if channel.encoding == channel.schema.encoding == "protobuf":
            with suppress(ValueError):  # `read` reports what is wrong with the schema
                signals = decoder_of(channel).signals
        return cls(
            *(channel.topic, signals, channel.metadata, count, spans),
            schema=channel.schema.name,
            encoding=channel.encoding,
        )

    def __repr__(self) -> str:
        kind = f"{self.schema} ({self.encoding})"
        return (
            f"<TopicInfo {self.topic}: {self.count} messages, {len(self.signals)} signals, {kind}>"
        )

    @property
    def is_computed(self) -> bool:
        """Whether the messages follow from those of other topics, as those of the scene do."""
        return COMPUTED.items() <= self.metadata.items()

    @property
    def start_ns(self) -> int | None:
        """Least log time [ns]; None without messages."""
        return self._spans().get(self.topic, (None, None))[0]

    @property
    def end_ns(self) -> int | None:
        """Greatest log time [ns]; None without messages."""
        return self._spans().get(self.topic, (None, None))[1]
