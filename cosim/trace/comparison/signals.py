"""Compare two traces: which signals differ, from when on, and by how much.

Where a topic has rows at the same instants in both, they are compared row by row. Else (another
rate, other arrivals) the values in force are compared (sample and hold) at every instant of a row
of either, from where both have begun to where the shorter trace ends.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cosim.core import AnyPath
from cosim.trace.comparison.compared_rows import Seen, SignalDiff, TopicDiff, in_step
from cosim.trace.comparison.context import Context, context_of
from cosim.trace.comparison.links import LinkDiff, links_of
from cosim.trace.comparison.tolerance import Tolerances
from cosim.trace.content import content_hash_of, same_content
from cosim.trace.file.records import LATEST_SIGNED_NS
from cosim.trace.reader import Trace
from cosim.trace.rows.layout import LOG_TOPIC, signal_name


@dataclass(frozen=True, slots=True, repr=False)
class Diff:
    """The comparison of two traces; pairs belong to the first trace and the second.

        >>> from cosim import DelaySystem, Scenario, run
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> faster = lag.set("components.lag.parameters.A[1,1]", -1.1)
        >>> difference = run(faster, "faster.mcap").diff(run(lag, "lag.mcap"))
        >>> difference.identical, [(signal.name, signal.first_s) for signal in difference.parted]
        (False, [('lag.x[1]', 0.1)])

    Attributes
    ----------
    identical : the content hashes are equal; then only metadata, attachments and log were compared.
    signals : those in both, in the order of the first trace.
    only : topics and signals that only one of the traces has.
    other_bytes : topics of other encodings whose messages differ.
    ends_s : last instant of each [s].
    log_lines : number of lines of /log that only one of the traces has.
    prefix : whether the first is part of a run, and was compared with the beginning of the second.
    """

    paths: tuple[str, str]
    hashes: tuple[str, str]
    identical: bool
    signals: tuple[SignalDiff, ...] = ()
    only: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    other_bytes: tuple[str, ...] = ()
    links: tuple[LinkDiff, ...] = ()
    context: Context = field(default_factory=Context)
    ends_s: tuple[float, float] = (0.0, 0.0)
    log_lines: tuple[int, int] = (0, 0)
    prefix: bool = False

    def __repr__(self) -> str:
        found = f"{len(self.parted)} of {len(self.signals)} signals differ"
        return f"<Diff {' and '.join(self.paths)}: {'identical' if self.identical else found}>"

    @property
    def parted(self) -> list[SignalDiff]:
        """Signals that differ, in order of their first difference."""
        found = [signal for signal in self.signals if signal.differing]
        return sorted(found, key=lambda signal: signal.first_s or 0.0)

    @property
    def same_end(self) -> bool:
        """Whether both end at the same instant; True for a part of a run."""
        return self.prefix or self.ends_s[0] == self.ends_s[1]

    @property
    def equal(self) -> bool:
        """Whether signals, messages of links and end agree within the tolerances."""
        unlike = self.parted or self.other_bytes or any(self.only) or not self.same_end
        return self.identical or not (unlike or any(link.differs for link in self.links))


def diff(
    a: AnyPath,
    b: AnyPath,
    tolerances: Tolerances | None = None,
    *,
    prefix: bool = False,
    topics: Sequence[str] | None = None,
    seen: Seen | None = None,
) -> Diff:
    """Compare two traces signal by signal, with their links, log, metadata and attachments.

        >>> from cosim import DelaySystem, Scenario, run
        >>> from cosim.trace import diff
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> faster = lag.set("components.lag.parameters.A[1,1]", -1.1)
        >>> runs = run(lag, "lag.mcap"), run(lag, "again.mcap"), run(faster, "faster.mcap")
        >>> diff("lag.mcap", "again.mcap").identical, diff("lag.mcap", "faster.mcap").equal
        (True, False)

    Parameters
    ----------
    tolerances : none by default: values must be equal.
    prefix : a is part of a run; compare it with the first rows of b.
    topics : compare only these; by default all that do not follow from others.
    seen : called with every difference of numeric signals, part by part; not for identical traces.

    Raises
    ------
    InputError : a file is no trace, or a tolerance is for a signal that neither has.
    LossError : a trace is damaged.
    """
    allowed = tolerances or Tolerances()
    one, two = Trace(a), Trace(b)
    paths = str(one.path), str(two.path)
    hashes = content_hash_of(one), content_hash_of(two)
    if topics is None:
        allowed.check([*one.signals, *two.signals])
    # hashes of two versions differ, whatever the contents
    if hashes[0] == hashes[1] or (one.row_format != two.row_format and same_content(one, two)):
        log_lines = _log_lines(one, two) if topics is None else (0, 0)
        context = context_of(one, two)
        return Diff(paths, hashes, identical=True, context=context, log_lines=log_lines)
    everything = (set(one.topics) | set(two.topics)) - _computed(one) - _computed(two)
    chosen = everything if topics is None else set(topics)
    both = [t for t in one.topics if t in two.topics and t in chosen]
    readable = [t for t in both if _readable(one, t) and _readable(two, t) and t != LOG_TOPIC]
    ends = _end_ns(one, chosen), _end_ns(two, chosen)
    until = LATEST_SIGNED_NS if prefix else min(ends)
    compared = {
        topic: TopicDiff(topic, allowed, _begin_ns(one, two, topic), until, seen)
        for topic in readable
    }
    links = {} if topics is not None else links_of(one, two)
    for tables in in_step(one, two, readable, prefix=prefix):
        for topic, (left, right) in tables.rows.items():
            compared[topic].add(left, right, alike=tables.alike[topic])
            if topic in links:
                links[topic].add(left, right)
    only = _topics_only(one, two, chosen), _topics_only(two, one, chosen)
    for topic in readable:
        for mine, there in zip(compared[topic].only, only, strict=True):
            there += [signal_name(topic, name) for name in mine]
    return Diff(
        paths,
        hashes,
        identical=False,
        signals=tuple(signal for each in compared.values() for signal in each.found()),
        only=(tuple(only[0]), tuple(only[1])),
        other_bytes=tuple(
            t
            for t in both
            if t not in readable and t != LOG_TOPIC and _bytes(one, t) != _bytes(two, t)
        ),
        links=tuple(link.found(one, two, prefix=prefix) for link in links.values()),
        context=context_of(one, two),
        ends_s=(ends[0] / 1e9, ends[1] / 1e9),
        log_lines=_log_lines(one, two) if topics is None else (0, 0),
        prefix=prefix,
    )


def _computed(trace: Trace) -> set[str]:
    """Return the topics whose messages follow from those of others: the scene."""
    return {topic for topic, info in trace.topics.items() if info.is_computed}


def _topics_only(trace: Trace, other: Trace, chosen: set[str]) -> list[str]:
    """Return the chosen topics with messages that the other trace does not have."""
    only = [topic for topic in trace.topics if topic in chosen and topic not in other.topics]
    return [topic for topic in only if trace.topics[topic].count]


def _readable(trace: Trace, topic: str) -> bool:
    info = trace.topics[topic]
    return info.encoding == "json" or (info.encoding == "protobuf" and bool(info.signals))


def _begin_ns(a: Trace, b: Trace, topic: str) -> int:
    """Return the instant from which both have rows of a topic [ns]; 0 if one never has."""
    begun = [trace.spans[topic][0] for trace in (a, b) if topic in trace.spans]
    return max(begun) if len(begun) == 2 else 0


def _end_ns(trace: Trace, chosen: set[str]) -> int:
    return max((high for topic, (_, high) in trace.spans.items() if topic in chosen), default=0)


def _messages(trace: Trace, topic: str) -> Iterator[tuple[int, int, int, memoryview]]:
    """Yield sequence, log time, publish time and payload of a topic's messages."""
    if topic in trace.topics:
        yield from (message[1:] for message in trace.messages([topic]))


def _bytes(trace: Trace, topic: str) -> bytes:
    digest = hashlib.sha256()
    for sequence, log, publish, payload in _messages(trace, topic):
        digest.update(f"{sequence} {log} {publish} {len(payload)} ".encode())
        digest.update(payload)
    return digest.digest()


def _log_lines(a: Trace, b: Trace) -> tuple[int, int]:
    one, two = (
        Counter((log, bytes(payload)) for _, log, _, payload in _messages(trace, LOG_TOPIC))
        for trace in (a, b)
    )
    return (one - two).total(), (two - one).total()
