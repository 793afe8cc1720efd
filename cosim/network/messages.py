"""The messages of a link before they are sent: instants, delays, and all random draws.

Their schedule follows from these alone. Message k has index k in the arrays of a whole run; in
blocks of a run, its place after the first of the block.
"""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cosim.core import InputError
from cosim.network import draws
from cosim.network.checks import check_duration
from cosim.network.delay_signal import DelaySignal
from cosim.network.grid import grid_of
from cosim.network.impairment import GilbertElliott, LossChain
from cosim.network.packet import PacketLink
from cosim.network.profile import DelayProfile
from cosim.network.recording import Player

MAX_MESSAGES = 50_000_000
"""More messages than this in the arrays of a whole run are taken for a mistake in the units."""

MAX_STREAMED = 1_000_000_000
"""The same for a run that is computed in blocks: 11 days at 1 ms."""

_DRAWN_AT_ONCE = 4096
"""At least so many messages are drawn at once, since to begin a stream costs 20 microseconds."""


class Messages(NamedTuple):
    """Messages of a link in order of sending, copies not counted; arrays of shape (n,).

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

    def select(self, first: int, last: int) -> Messages:
        """Return those at places first to last - 1, in the same arrays."""
        return Messages._make(column[first:last] for column in self)

    @classmethod
    def joined(cls, blocks: Iterable[Messages]) -> Messages:
        """Return the messages of some blocks as one, in arrays of their own."""
        return cls._make(np.concatenate(columns) for columns in zip(*blocks, strict=True))


_NO_MESSAGES = Messages(*(np.zeros(0, np.bool_ if k in (3, 4) else np.int64) for k in range(6)))


class Sendings:
    """The instants of sending of a link over [0, end_ns], rounded up to the points of a grid.

    Parameters
    ----------
    points_ns : the points, their step [ns], or None: every instant (`grid_of`).
    most : so many messages are allowed.

    Attributes
    ----------
    count : of all messages.
    grid : the points.

    Raises
    ------
    InputError : `end_ns` is no duration, or so many messages that the units must be wrong.
    """

    def __init__(
        self,
        link: PacketLink,
        end_ns: int,
        points_ns: int | ArrayLike | None = None,
        most: int = MAX_MESSAGES,
    ) -> None:
        check_duration(f"link {link.name!r}: end_ns", end_ns)
        self._offset, self._every = int(link.offset_ns), int(link.sample_time_ns)
        self.grid = grid_of(points_ns, int(end_ns))
        self.count = count = self._up_to(int(end_ns))
        if count > most:
            raise InputError(
                "too many messages",
                where=f"link {link.name!r}",
                expected=f"at most {most} in a run",
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

    def nominal(self, first: int, last: int) -> NDArray[np.int64]:
        """Return offset + k sample_time of messages first to last - 1 [ns], int64."""
        return self._offset + np.arange(first, last, dtype=np.int64) * self._every

    def instants(self, first: int, last: int) -> NDArray[np.int64]:
        """Return the points at which messages first to last - 1 are sent [ns], int64."""
        return self.grid.up(self.nominal(first, last))

    def instant(self, message: int) -> int:
        """Return the point at which a message is sent [ns]."""
        return self.grid.up_one(self._offset + message * self._every)

    def until(self, time_ns: int) -> int:
        """Return how many messages are sent up to an instant, it included."""
        return min(self._up_to(self.grid.down(time_ns)), self.count)

    def _up_to(self, time_ns: int) -> int:
        return max(0, (time_ns - self._offset) // self._every + 1)


def sending_instants(link: PacketLink, end_ns: int) -> NDArray[np.int64]:
    """Return the instants of sending in [0, end_ns] [ns], int64 (n,).

    Raises
    ------
    InputError : as `Sendings`.
    """
    sendings = Sendings(link, end_ns)
    return sendings.nominal(0, sendings.count)


class MessageStream:
    """The messages of a link in order of sending, drawn as they are needed.

    Delays that follow a signal are 0 until they are filled in.

    Attributes
    ----------
    next : number of the message that is taken next.

    Raises
    ------
    InputError : as `Player`.
    """

    def __init__(self, link: PacketLink, sendings: Sendings) -> None:
        self._link, self._sendings = link, sendings
        self._blocks = [_NO_MESSAGES]
        self._begin = self._end = 0  # of the last block
        self._state = 0  # of the chain of losses, at the last message drawn
        self._keeps = True
        self._player = (
            None
            if link.recording is None
            else Player(
                link.recording, int(link.sample_time_ns), link.name, link.seed, sendings.count
            )
        )
        self.next = 0

    def take(self, count: int) -> Messages:
        """Return the next `count` messages; one alone in the arrays that are kept."""
        first, self.next = self.next, self.next + count
        if self.next <= self._end:
            return self._blocks[-1].select(first - self._begin, self.next - self._begin)
        left = self._blocks[-1].select(first - self._begin, self._end - self._begin)
        missing = self.next - self._end
        self._draw(missing)
        fresh = self._blocks[-1].select(0, missing)
        return Messages.joined((left, fresh)) if left.sent_ns.size else fresh

    def first(self, count: int) -> Messages:
        """Return the first `count` messages of the run, in arrays of their own.

        Raises
        ------
        InputError : they were not kept.
        """
        if not self._keeps:
            raise InputError(
                "the messages of this link were not kept",
                where=f"link {self._link.name!r}",
                expected="a schedule of which nothing was forgotten",
                got="one of which the beginning was",
                hint="statistics() counts what was forgotten",
            )
        return Messages.joined(self._blocks).select(0, count)

    def forget(self) -> None:
        """Keep no messages from now on but those drawn and not taken yet."""
        self._keeps = False
        del self._blocks[:-1]

    def copy(self) -> MessageStream:
        """Return a copy from which the same messages are taken."""
        twin, last = copy(self), self._blocks[-1]
        # of the other blocks no delay or loss will be filled in
        own = last._replace(delay_ns=last.delay_ns.copy(), lost=last.lost.copy())
        blocks = [*self._blocks[:-1], own]
        vars(twin).update(_blocks=blocks)
        return twin

    def _draw(self, count: int) -> None:
        """Draw the next `count` messages, and some more of those that follow."""
        first, link = self._end, self._link
        last = first + max(count, min(_DRAWN_AT_ONCE, self._sendings.count - first))
        loss: float | NDArray[np.float64]
        recorded_ns: NDArray[np.int64] | None = None
        if self._player is not None:
            rows = self._player.rows(first, last)
            loss, recorded_ns = self._player.lost(rows), self._player.delay_ns(rows)
        elif isinstance(link.loss, GilbertElliott | LossChain):
            source = link.loss, link.seed, link.name, last - first, first
            states = draws.states(*source, before=self._state)
            self._state = int(states[-1])
            loss = np.array(link.loss.losses)[states]
        else:
            loss = link.loss
        block = _draw_messages(link, self._sendings, first, last, loss)
        if recorded_ns is not None:
            block = block._replace(delay_ns=recorded_ns)
        self._blocks = [*self._blocks, block] if self._keeps else [block]
        self._begin, self._end = first, last


def _draw_messages(
    link: PacketLink,
    sendings: Sendings,
    first: int,
    last: int,
    loss: float | NDArray[np.float64],
) -> Messages:
    """Make all random draws for messages first to last - 1; `loss` : outside the windows."""
    seed, name, count, sent_ns = link.seed, link.name, last - first, sendings.instants(first, last)
    # A window holds for the messages of a live link that are sent in it on the grid; for those
    # of another link that were to be sent in it: `align` moves them when they are drawn.
    live = link.is_live
    at_ns = sent_ns if live else sendings.nominal(first, last)
    for window in link.windows:
        inside = (at_ns >= window.from_ns) & (at_ns < window.until_ns)
        loss = np.where(inside, window.loss, loss)
    copied, copy_jitter_ns = np.zeros(count, np.bool_), np.zeros(count, np.int64)
    if link.duplicate > 0:
        copied = draws.duplicated(link.duplicate, seed, name, count, first)
        copy_jitter_ns = draws.jitter_ns(link.jitter, seed, name, count, "copy jitter", first)
    return Messages(
        sent_ns=sent_ns,
        delay_ns=known_delays(link, sent_ns),
        jitter_ns=draws.jitter_ns(link.jitter, seed, name, count, first=first),
        lost=draws.lost(loss, seed, name, count, first),
        copied=copied,
        copy_jitter_ns=copy_jitter_ns,
    )


def known_delays(link: PacketLink, sent_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the delays of messages sent at these instants, without jitter [ns], int64 (n,).

    0 where the delay follows a signal.
    """
    if isinstance(link.delay, DelaySignal):
        return np.zeros(sent_ns.size, np.int64)
    if isinstance(link.delay, DelayProfile):
        return link.delay.delay_ns(sent_ns)
    return np.full(sent_ns.size, link.delay_ns, np.int64)


def resend_at(link: PacketLink, messages: Messages, sent_ns: NDArray[np.int64]) -> Messages:
    """Return the same messages sent at other instants.

    A delay profile is read at the new instant; the delay of a live link, and one from a recording
    of messages, stay as they were.
    """
    recorded = link.recording is not None and link.recording.delay_ns is not None
    if link.is_live or recorded:
        return messages._replace(sent_ns=sent_ns)
    return messages._replace(sent_ns=sent_ns, delay_ns=known_delays(link, sent_ns))
