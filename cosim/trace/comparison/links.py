"""Compare the messages of the links of two traces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.trace.reader import Table, Trace
from cosim.trace.rows.layout import dropped_topic, link_topic

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


class LinkMatch:
    """The comparison of one link, fed with the messages that both traces delivered.

    A message waits until the other trace has delivered it too.
    """

    def __init__(self, link: str) -> None:
        self._link = link
        self._waiting = [np.zeros((3, 0), np.int64) for _ in range(2)]
        self._delivered = [0, 0]
        self._moved = 0
        self._shift = 0
        self._first: int | None = None

    def add(self, a: Table, b: Table) -> None:
        """Take the next messages of both."""
        for k, table in enumerate((a, b)):
            self._delivered[k] += len(table)
            heads = np.array([table.sequence, table.log_time_ns, table.publish_time_ns])
            self._waiting[k] = np.concatenate([self._waiting[k], heads], axis=1)
        one, two = self._waiting
        keys = _numbered(one[0]), _numbered(two[0])
        _, i, j = np.intersect1d(*keys, assume_unique=True, return_indices=True)
        shift = two[1, j] - one[1, i]
        moved = (shift != 0) | (two[2, j] != one[2, i])
        self._moved += int(moved.sum())
        self._shift = max(self._shift, int(np.abs(shift).max(initial=0)))
        self._differs(np.minimum(one[1, i], two[1, j])[moved])
        self._waiting = [np.delete(one, i, axis=1), np.delete(two, j, axis=1)]

    def found(self, a: Trace, b: Trace, *, prefix: bool) -> LinkDiff:
        """Return the comparison, after the last messages."""
        for alone in self._waiting:
            self._differs(alone[1])
        topic = dropped_topic(self._link)
        drops = [trace.topics[topic].count if topic in trace.topics else 0 for trace in (a, b)]
        return LinkDiff(
            link=self._link,
            delivered=(self._delivered[0], self._delivered[1]),
            dropped=(drops[0], min(drops) if prefix else drops[1]),
            only=(self._waiting[0].shape[1], self._waiting[1].shape[1]),
            other_times=self._moved,
            largest_shift_s=self._shift / 1e9,
            first_s=None if self._first is None else self._first / 1e9,
        )

    def _differs(self, at_ns: Integers) -> None:
        if at_ns.size:
            first = int(at_ns.min())
            self._first = first if self._first is None else min(self._first, first)


def links_of(a: Trace, b: Trace) -> dict[str, LinkMatch]:
    """Return a comparison of every link that both traces have, by its topic."""
    return {link_topic(link): LinkMatch(link) for link in a.link_names if link in b.link_names}


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
