"""Compute the schedule of a packet link: sender's queue, transit, order, receiver.

All messages at once, for known delays; `cosim.network.stepping` does the same message by message.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.network.messages import Messages, delays, draw_messages, sending_instants
from cosim.network.packet import PacketLink
from cosim.network.packet_schedule import (
    DELIVERED,
    DUPLICATE,
    IN_FLIGHT,
    LOST,
    OVERTAKEN,
    QUEUE_FULL,
    PacketSchedule,
    earliest_newer,
)
from cosim.network.stepping import rules_of


def schedule(link: PacketLink, end_ns: int) -> PacketSchedule:
    """Compute the schedule of every message sent in [0, end_ns], in exact integer nanoseconds.

    A longer run begins with the same messages, delays, losses and copies.

    Raises
    ------
    InputError : as `sending_instants`, or a delay that follows a signal (`LiveSchedule`).
    """
    sent = sending_instants(link, end_ns)
    return resolve_messages(link, int(end_ns), draw_messages(link, sent, delays(link, sent)))


def resolve_messages(
    link: PacketLink,
    end_ns: int,
    messages: Messages,
    points_ns: NDArray[np.int64] | None = None,
) -> PacketSchedule:
    """Compute the schedule of messages already drawn; arrivals are rounded up to the points."""
    out, refused = _transmitted(link, messages.sent_ns)
    message, copy = _with_copies(messages.copied & ~messages.lost & ~refused)
    jitter = messages.jitter_ns[message]
    jitter[copy] = messages.copy_jitter_ns[message[copy]]
    transit = messages.delay_ns[message] + jitter
    arrival = out[message] + transit
    if points_ns is not None:
        arrival = rounded_up(arrival, points_ns)
    refused = refused[message]
    gone = messages.lost[message] | refused
    if link.order == "fifo":
        # a lost message delays no other, but is not noticed before its predecessors arrive
        arrival = np.maximum(arrival, np.maximum.accumulate(np.where(gone, 0, arrival)))
    arrival[refused] = messages.sent_ns[message[refused]]
    status = np.full(message.size, DELIVERED, np.int8)
    if link.order == "newest-wins":
        status[_again(arrival, copy)] = DUPLICATE
        status[earliest_newer(arrival, copy, ~gone) < arrival] = OVERTAKEN
    status[gone] = LOST
    status[refused] = QUEUE_FULL
    status[arrival > end_ns] = IN_FLIGHT
    return PacketSchedule(
        link=link,
        end_ns=end_ns,
        sent_ns=messages.sent_ns[message],
        transit_ns=transit,
        arrival_ns=arrival,
        delivered_ns=np.where(status == DELIVERED, arrival, -1),
        sequence=message,
        status=status,
        lost=messages.lost[message],
        copy=copy,
        messages=messages,
    )


def rounded_up(times: NDArray[np.int64], points: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the first point at or after each time; times after the last point stay."""
    place = np.searchsorted(points, times)
    return np.where(place < points.size, np.append(points, 0)[place], times)


def _with_copies(copied: NDArray[np.bool_]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return message number, and whether it is a copy, of each entry; copies follow originals."""
    message = np.repeat(np.arange(copied.size, dtype=np.int64), 1 + copied)
    copy = np.zeros(message.size, np.bool_)
    copy[1:] = message[1:] == message[:-1]
    return message, copy


def _transmitted(
    link: PacketLink, sent: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return when the sender has sent each message, and whether the queue refuses it.

    One after the other: out[k] = max(sent[k], out[k-1]) + frame, which unrolls into
    frame (k + 1) + max over j <= k of (sent[j] - frame j).
    """
    frame = np.int64(link.frame_ns)
    before = frame * np.arange(sent.size, dtype=np.int64)
    out: NDArray[np.int64] = np.maximum.accumulate(sent - before) + before + frame
    refused = np.zeros(sent.size, np.bool_)
    longest = rules_of(link).longest_wait_ns
    if not (out - frame - sent > longest).any():
        return out, refused
    free = 0
    for k, instant in enumerate(sent.tolist()):
        refused[k] = free - instant > longest
        if not refused[k]:
            free = max(free, instant) + link.frame_ns
        out[k] = free
    return out, refused


def _again(arrival: NDArray[np.int64], copy: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the entries whose twin arrived before; at one instant the original is first."""
    twin = np.flatnonzero(copy)
    again = np.zeros(arrival.size, np.bool_)
    again[twin] = arrival[twin - 1] <= arrival[twin]
    again[twin - 1] = ~again[twin]
    return again
