"""Compare the messages of the links of two traces."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.trace.layout import dropped_topic
from cosim.trace.reader import Trace
from cosim.trace.traffic import deliveries, dropped, link_names

Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LinkDiff:
    """One link in both traces; messages of equal sequence number are compared.

    Attributes
    ----------
    delivered, dropped : number of messages in each.
    only : number of messages that only this trace delivered, in each.
    other_times : number of messages that both delivered, sent or delivered at other instants.
    largest_shift_s : largest difference of the delivery times of one message [s].
    first_s : first instant at which the deliveries differ [s]; None if they do not.
    """

    link: str
    delivered: tuple[int, int]
    dropped: tuple[int, int]
    only: tuple[int, int]
    other_times: int
    largest_shift_s: float
    first_s: float | None

    @property
    def differs(self) -> bool:
        """Whether deliveries or the number of dropped messages differ."""
        return self.first_s is not None or self.dropped[0] != self.dropped[1]


def compare_links(a: Trace, b: Trace, *, prefix: bool = False) -> Iterator[LinkDiff]:
    """Compare every link that both traces have; with `prefix`, only as many messages as a has."""
    theirs = link_names(b)
    for link in link_names(a):
        if link in theirs:
            yield _compare(a, b, link, prefix=prefix)


def _compare(a: Trace, b: Trace, link: str, *, prefix: bool) -> LinkDiff:
    one, two = deliveries(a, link), deliveries(b, link)
    drops = [
        dropped(trace, link).log_time_ns
        if dropped_topic(link) in trace.topics
        else np.zeros(0, np.int64)
        for trace in (a, b)
    ]
    if prefix:
        two = two.part(np.arange(min(len(one), len(two))))
        drops[1] = drops[1][: drops[0].size]
    keys = _numbered(one.sequence), _numbered(two.sequence)
    _, i, j = np.intersect1d(*keys, assume_unique=True, return_indices=True)
    alone = np.ones(len(one), np.bool_), np.ones(len(two), np.bool_)
    alone[0][i], alone[1][j] = False, False
    shift = two.log_time_ns[j] - one.log_time_ns[i]
    moved = (shift != 0) | (two.publish_time_ns[j] != one.publish_time_ns[i])
    differing = np.concatenate(
        [
            one.log_time_ns[alone[0]],
            two.log_time_ns[alone[1]],
            np.minimum(one.log_time_ns[i], two.log_time_ns[j])[moved],
        ]
    )
    return LinkDiff(
        link=link,
        delivered=(len(one), len(two)),
        dropped=(drops[0].size, drops[1].size),
        only=(int(alone[0].sum()), int(alone[1].sum())),
        other_times=int(moved.sum()),
        largest_shift_s=int(np.abs(shift).max(initial=0)) / 1e9,
        first_s=int(differing.min()) / 1e9 if differing.size else None,
    )


def _numbered(sequence: Integers) -> Integers:
    """Return a key per message: its sequence number, and its place among those of this number."""
    order = np.argsort(sequence, kind="stable")
    in_order = sequence[order]
    begins = np.append(True, np.diff(in_order) != 0) if sequence.size else np.zeros(0, np.bool_)
    place = np.arange(sequence.size)
    turn = place - np.maximum.accumulate(np.where(begins, place, 0)) if sequence.size else place
    keys = np.empty(sequence.size, np.int64)
    keys[order] = in_order + (turn << 33)  # sequence numbers have 32 bits
    return keys
