"""What became of each message of a link, read from its delivery."""

from __future__ import annotations

from typing import NamedTuple

from cosim.network import IN_FLIGHT, REASONS, Delivery


class Entry(NamedTuple):
    """A message or a copy that came, was missed or refused."""

    arrival: int
    sent: int
    message: int
    fate: str


def entries(d: Delivery) -> list[Entry]:
    """All of them, in order of time."""
    when, sent, message, status = (column.tolist() for column in d.arrivals())
    words = [REASONS[k] for k in status]
    return [Entry(*row) for row in zip(when, sent, message, words, strict=True)]


def fates(d: Delivery) -> list[str]:
    """What became of each message, on a link that makes no copies."""
    words = [REASONS[IN_FLIGHT]] * d.message
    for entry in entries(d):
        words[entry.message] = entry.fate
    return words


def arrivals(d: Delivery) -> list[int]:
    """When each message came, was missed or refused; -1 in flight; without copies."""
    times = [-1] * d.message
    for entry in entries(d):
        times[entry.message] = entry.arrival
    return times


def delivered(d: Delivery) -> list[Entry]:
    """Those that the receiver accepted."""
    return [entry for entry in entries(d) if entry.fate == "delivered"]
