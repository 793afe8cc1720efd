"""The messages of a link before they are sent: instants, delays, and all random draws.

Their schedule follows from these alone; message k has index k in every array.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.network import draws
from cosim.network.checks import check_duration
from cosim.network.delay_signal import DelaySignal
from cosim.network.packet import PacketLink
from cosim.network.profile import DelayProfile

MAX_MESSAGES = 50_000_000
"""More messages than this on one link are taken for a mistake in the units."""


class Messages(NamedTuple):
    """The messages of a link, copies not counted; arrays of shape (n,).

    Attributes
    ----------
    sent_ns : instant of sending [ns], int64, never decreasing.
    delay_ns : delay at that instant, without jitter [ns], int64.
    jitter_ns : extra delay [ns], int64.
    lost : which the channel loses, bool.
    copied : which the network copies if they get that far, bool.
    copy_jitter_ns : extra delay of the copy [ns], int64.
    """

    sent_ns: NDArray[np.int64]
    delay_ns: NDArray[np.int64]
    jitter_ns: NDArray[np.int64]
    lost: NDArray[np.bool_]
    copied: NDArray[np.bool_]
    copy_jitter_ns: NDArray[np.int64]

    def first(self, count: int) -> Messages:
        """Return the first `count` messages, in arrays of their own."""
        return Messages._make(column[:count].copy() for column in self)


def sending_instants(link: PacketLink, end_ns: int) -> NDArray[np.int64]:
    """Return the instants of sending in [0, end_ns] [ns], int64 (n,).

    Raises
    ------
    InputError : `end_ns` is no duration, or so many messages that the units must be wrong.
    """
    check_duration(f"link {link.name!r}: end_ns", end_ns)
    count = max(0, (int(end_ns) - int(link.offset_ns)) // int(link.sample_time_ns) + 1)
    if count > MAX_MESSAGES:
        raise InputError(
            "too many messages",
            where=f"link {link.name!r}",
            expected=f"at most {MAX_MESSAGES} in a run",
            got=f"{count}: one each {link.sample_time_ns} ns up to {end_ns} ns",
            hint="times are in nanoseconds",
        )
    if count * link.frame_ns >= 2**62:
        raise InputError(
            "the messages take longer to send than can be counted",
            where=f"link {link.name!r}: data_rate",
            expected="less than 2**62 ns for all messages of the run",
            got=f"{count} messages of {link.frame_ns} ns",
            hint="data_rate is in bit/s, frame_size in bits",
        )
    return link.offset_ns + np.arange(count, dtype=np.int64) * link.sample_time_ns


def draw_messages(
    link: PacketLink, sent_ns: NDArray[np.int64], delay_ns: NDArray[np.int64]
) -> Messages:
    """Make all random draws for the messages sent at these instants with these delays."""
    seed, name, count = link.seed, link.name, sent_ns.size
    jitter_ns, lost = draws.jitter_ns(link.jitter, seed, name, count), _lost(link, sent_ns)
    copied, copy_jitter_ns = np.zeros(count, np.bool_), np.zeros(count, np.int64)
    if link.duplicate > 0:
        copied = draws.duplicated(link.duplicate, seed, name, count)
        copy_jitter_ns = draws.jitter_ns(link.jitter, seed, name, count, "copy jitter")
    return Messages(sent_ns, delay_ns, jitter_ns, lost, copied, copy_jitter_ns)


def _lost(link: PacketLink, sent_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which messages the channel loses: as drawn, and in a window by the window's loss."""
    lost = draws.lost(link.loss, link.seed, link.name, sent_ns.size)
    for window in link.windows:
        inside = (sent_ns >= window.from_ns) & (sent_ns < window.until_ns)
        other = draws.lost(window.loss, link.seed, link.name, sent_ns.size)
        lost = np.where(inside, other, lost)
    return lost


def delays(link: PacketLink, sent_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the delays of messages sent at these instants, without jitter [ns], int64 (n,).

    Raises
    ------
    InputError : the delay follows a signal.
    """
    if isinstance(link.delay, DelaySignal):
        raise InputError(
            "the delay follows a signal, which is known only during the run",
            where=f"link {link.name!r}: delay",
            expected="a constant delay or a DelayProfile",
            got=repr(link.delay),
            hint="use LiveSchedule, and pass it the value of each message as it is sent",
        )
    if isinstance(link.delay, DelayProfile):
        return link.delay.delay_ns(sent_ns)
    return np.full(sent_ns.size, link.delay_ns, np.int64)


def resend_at(link: PacketLink, messages: Messages, sent_ns: NDArray[np.int64]) -> Messages:
    """Return the same messages sent at other instants.

    A recorded delay is that of the new instant; one that followed a signal stays as it was.
    """
    if isinstance(link.delay, DelaySignal):
        return messages._replace(sent_ns=sent_ns)
    return messages._replace(sent_ns=sent_ns, delay_ns=delays(link, sent_ns))
