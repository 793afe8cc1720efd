"""The content hash of a trace, and whether one trace is the beginning of another.

What the hash covers: `cosim.trace.digest`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from os import PathLike

import numpy as np

from cosim.core import distinct
from cosim.trace.digest import ContentDigest, digest_of_channel, laid_out
from cosim.trace.reader import Trace
from cosim.trace.rows.layout import LOG_TOPIC


def content_hash(path: str | PathLike[str], *, incomplete: bool | None = None) -> str:
    """Return the content hash of a trace, of this version, as 64 hexadecimal digits.

    `incomplete` as in `Trace`: of a file cut short, the part that can be read is hashed.

    Raises
    ------
    InputError, LossError : as `Trace`.
    """
    return content_hash_of(Trace(path, incomplete=incomplete))


def content_hash_of(trace: Trace) -> str:
    """Return the content hash of an open trace."""
    trace.check()
    digest = ContentDigest()
    for number, channel in trace.channels.items():
        digest.declare(number, channel)
    for block in trace.blocks():
        digest.add(block)
    return digest.hexdigest()


def begins_with(whole: Trace, part: Trace) -> bool:
    """Whether every topic of `part` is the beginning of the same topic of `whole`, bit for bit.

    The topic /log is not compared: a run that was stopped early logs that. Nor is the scene, which
    follows from the rest.
    """
    covered = {t: i for t, i in part.topics.items() if t != LOG_TOPIC and not i.is_computed}
    counts = {topic: info.count for topic, info in covered.items() if info.count}
    if any(t not in whole.topics or whole.topics[t].count < n for t, n in counts.items()):
        return False
    return _beginnings(whole, counts) == _beginnings(part, counts)


def _beginnings(trace: Trace, counts: Mapping[str, int]) -> dict[str, bytes]:
    """Return the digest of the first messages of each topic."""
    heads = {number: digest_of_channel(channel) for number, channel in trace.channels.items()}
    digests = {topic: hashlib.sha256() for topic in counts}
    left = dict(counts)
    for block in trace.blocks():
        for number in distinct(block.heads["channel"]).tolist():
            topic = trace.channels[number].topic
            if not left.get(topic):
                continue
            mine = np.flatnonzero(block.heads["channel"] == number)[: left[topic]]
            digests[topic].update(laid_out(block.part(mine), heads))
            left[topic] -= mine.size
    return {topic: digest.digest() for topic, digest in digests.items()}
