"""What a topic holds, and windows of time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from cosim.core import InputError
from cosim.trace.declared import Channel
from cosim.trace.gather import decoder_of
from cosim.trace.layout import Signal

Spans = Mapping[str, tuple[int, int]]
"""Least and greatest log time [ns] by topic."""


class TopicInfo:
    """What a topic holds.

    Attributes
    ----------
    schema, encoding : name of the schema, and how its messages are written.
    metadata : of its channel.
    signals : of a protobuf topic; empty for others.
    count : how many messages.
    """

    def __init__(self, channel: Channel, count: int, spans: Callable[[], Spans]) -> None:
        self._spans = spans
        self.topic = channel.topic
        self.schema = channel.schema.name
        self.encoding = channel.encoding
        self.metadata = dict(channel.metadata)
        self.count = count
        self.signals: tuple[Signal, ...] = ()
        if channel.encoding == channel.schema.encoding == "protobuf":
            try:
                self.signals = decoder_of(channel).signals
            except ValueError:
                self.signals = ()  # `read` says what is wrong with the schema

    @property
    def start_ns(self) -> int | None:
        """Least log time [ns]; None without messages."""
        span = self._spans().get(self.topic)
        return None if span is None else span[0]

    @property
    def end_ns(self) -> int | None:
        """Greatest log time [ns]; None without messages."""
        span = self._spans().get(self.topic)
        return None if span is None else span[1]


def window_ns(start: float | None, end: float | None) -> tuple[int, int]:
    """A time window in nanoseconds, both ends included."""
    bounds = []
    for name, seconds, default in (("start", start, 0), ("end", end, 2**64 - 1)):
        if seconds is None:
            bounds.append(default)
        elif math.isfinite(seconds):
            bounds.append(min(max(round(seconds * 1e9), -1), 2**64 - 1))
        else:
            raise InputError("not a time", where=name, expected="finite seconds", got=repr(seconds))
    low, high = bounds
    if start is not None and end is not None and end < start:
        raise InputError(
            "the window ends before it starts", expected="start <= end", got=f"{start:g}, {end:g}"
        )
    return max(low, 0), high
