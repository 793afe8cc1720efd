"""The content hash of a trace, and whether two traces have the same content.

What the hash covers: `cosim.trace.digest`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from cosim.core import AnyPath
from cosim.trace.digest import ContentDigest
from cosim.trace.file.block import HEAD, Records, in_order
from cosim.trace.file.declared import Channel
from cosim.trace.file.messages import Messages
from cosim.trace.former_digest import FormerDigest
from cosim.trace.reader import Trace
from cosim.trace.rows.decode import RowDecoder
from cosim.trace.rows.encode import RowEncoder
from cosim.trace.rows.layout import LOG_TOPIC, in_fixed_width


def content_hash(path: AnyPath, *, incomplete: bool | None = None) -> str:
    """Return the content hash of a trace as 64 hexadecimal digits.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import content_hash
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> runs = run(lag, "one.mcap"), run(lag, "two.mcap")
        >>> content_hash("one.mcap") == content_hash("two.mcap") == runs[0].content_hash
        True

    For traces with rows of format 1, the hash is that of version 2, so that it has never changed.
    `incomplete` as in `Trace`: of a file cut short, the part that can be read is hashed.

    Raises
    ------
    InputError, LossError : as `Trace`.
    """
    return content_hash_of(Trace(path, incomplete=incomplete))


def content_hash_of(trace: Trace) -> str:
    """Return the content hash of an open trace."""
    trace.check()
    digest = FormerDigest() if trace.row_format == 1 else ContentDigest()
    for number, channel in trace.channels.items():
        digest.declare(number, channel)
    for block in trace.blocks():
        digest.add(block)
    return digest.hexdigest()


def same_content(one: Trace, other: Trace) -> bool:
    """Whether two traces have the same content, whatever the formats of their rows."""
    if one.row_format == other.row_format:
        return content_hash_of(one) == content_hash_of(other)
    return _topics(one) == _topics(other)


def begins_with(whole: Trace, part: Trace) -> bool:
    """Whether every topic of `part` is the beginning of the same topic of `whole`, bit for bit.

    The topic /log is not compared: a run that was stopped early logs that. Nor is the scene, which
    follows from the rest.
    """
    covered = {t: i for t, i in part.topics.items() if t != LOG_TOPIC and not i.is_computed}
    counts = {topic: info.count for topic, info in covered.items() if info.count}
    if any(t not in whole.topics or whole.topics[t].count < n for t, n in counts.items()):
        return False
    return _topics(whole, counts) == _topics(part, counts)


def _topics(trace: Trace, counts: Mapping[str, int] | None = None) -> dict[str, list[bytes]]:
    """Return the digest of each topic, or of so many of its first messages, in fixed width."""
    digest, left = ContentDigest(), dict(counts or {})
    anew = {
        number: _Anew(channel)
        for number, channel in trace.channels.items()
        if trace.row_format == 1 and channel.schema.name.startswith("cosim.")
    }
    for number, channel in trace.channels.items():
        if counts is None or channel.topic in counts:
            digest.declare(number, anew[number].channel if number in anew else channel)
    for block in trace.blocks():
        for number, mine in block.by_channel():
            topic = trace.channels[number].topic
            if counts is not None:
                mine = mine[: left.get(topic, 0)]  # noqa: PLW2901
                left[topic] = left.get(topic, 0) - mine.size
            if not mine.size:
                continue
            if number in anew:
                records = [*anew[number](number, block.part(mine))]
                in_order(records, by_time=False, watch=digest.add_records)
            else:
                digest.add(block.part(mine))
    return digest.of_topics()


class _Anew:
    """A channel whose rows are encoded anew, in fixed width.

    Attributes
    ----------
    channel : as it would be declared.
    """

    def __init__(self, channel: Channel) -> None:
        schema = replace(channel.schema, data=in_fixed_width(channel.schema.data))
        self.channel = replace(channel, schema=schema)
        self._decode = RowDecoder(channel.schema.name, channel.schema.data, channel.metadata)
        message = RowDecoder(schema.name, schema.data, {}).message
        self._encode = RowEncoder(channel.topic, self._decode.signals, message)

    def __call__(self, number: int, messages: Messages) -> Iterator[Records]:
        """Yield the records of messages, in their order by rank."""
        columns = (
            values if present is None else np.where(present, values, np.array(None))
            for values, present in self._decode(messages)
        )
        rows = [*zip(*columns, strict=True)] or [()] * len(messages)
        heads = messages.heads
        for which, lines in self._encode.many(rows, HEAD.size):
            own = heads[which]
            yield Records(
                number,
                own["log"].astype(np.int64),
                own["publish"].astype(np.int64),
                own["sequence"].astype(np.int64),
                lines,
                np.arange(len(messages))[which][:, None],
            )
