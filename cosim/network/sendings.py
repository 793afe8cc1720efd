"""The messages of a link before they are sent: instants, delays, and all random draws."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.network import draws
from cosim.network.checks import check_duration
from cosim.network.delay_signal import DelaySignal
from cosim.network.impairment import GilbertElliott, LossChain
from cosim.network.packet import PacketLink
from cosim.network.profile import DelayProfile
from cosim.network.recording import Player
from cosim.network.stepping import Message

Integers = NDArray[np.int64]

MOST_MESSAGES: Final = 1_000_000_000
"""More messages than this are taken for a mistake in the units: 11 days at 1 ms."""
DRAWN_AT_ONCE: Final = 4096
"""So many messages are drawn at once, since to begin a stream costs 20 microseconds."""
NEVER: Final = 2**63 - 1
"""Behind every instant [ns]."""


class Sendings:
    """The messages of a link over [0, end_ns] in order of sending, drawn as they are needed.

    Message k is sent at offset + k sample_time, rounded up to a point. The points are the multiples
    of a step and the end; nothing is kept of them, so that a run of any length needs no memory.

    Parameters
    ----------
    step_ns : of the points [ns]; 1: every instant is one.

    Attributes
    ----------
    count : of all messages.

    Raises
    ------
    InputError : `end_ns` or `step_ns` is no duration, or so many messages that the units must be
        wrong; as `Player`.
    """

    def __init__(self, link: PacketLink, end_ns: int, step_ns: int = 1) -> None:
        check_duration(f"link {link.name!r}: end_ns", end_ns)
        check_duration(f"link {link.name!r}: step_ns", step_ns, minimum=1)
        self._link, self._step, self._end = link, int(step_ns), int(end_ns)
        self._offset, self._every = int(link.offset_ns), int(link.sample_time_ns)
        self.count = self._nominally_until(self._end)
        self._check_count()
        self._player = None
        if link.recording is not None:
            rhythm = self._every, link.name, link.seed, self.count
            self._player = Player(link.recording, *rhythm)
        self._drawn: Integers = np.zeros((0, len(Message._fields)), np.int64)
        self._first = 0  # number of the first one drawn
        self._state = 0  # of the chain of losses, at the last one drawn

    def _check_count(self) -> None:
        link, count = self._link, self.count
        if count > MOST_MESSAGES:
            raise InputError(
                "too many messages",
                where=f"link {link.name!r}",
                expected=f"at most {MOST_MESSAGES} in a run",
                got=f"{count}: one each {link.sample_time_ns} ns up to {self._end} ns",
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

    @property
    def points(self) -> tuple[int, int]:
        """Their step, and the end [ns]."""
        return self._step, self._end

    def up(self, time_ns: int) -> int:
        """Return the first point at or after an instant [ns]; one after the end stays."""
        if self._step == 1 or time_ns > self._end:
            return time_ns
        return min(-(-time_ns // self._step) * self._step, self._end)

    def _up(self, times_ns: Integers) -> Integers:
        if self._step == 1:
            return times_ns
        multiples = -(-times_ns // self._step) * self._step
        return np.where(times_ns > self._end, times_ns, np.minimum(multiples, self._end))

    def down(self, time_ns: int) -> int:
        """Return the last point at or before an instant [ns]; -1 before the first."""
        if time_ns < 0:
            return -1
        return self._end if time_ns >= self._end else time_ns // self._step * self._step

    def until(self, time_ns: int) -> int:
        """Return how many messages are sent up to an instant, it included."""
        return min(self._nominally_until(self.down(time_ns)), self.count)

    def _nominally_until(self, time_ns: int) -> int:
        return max(0, (time_ns - self._offset) // self._every + 1)

    def instant(self, message: int) -> int:
        """Return the point at which a message is sent [ns]; `NEVER` for those after the last."""
        return self.up(self._offset + message * self._every) if message < self.count else NEVER

    def instants(self, first: int, last: int) -> Integers:
        """Return the points at which messages first to last - 1 are sent [ns], int64 (n,)."""
        return self._up(self._nominal(first, last))

    def _nominal(self, first: int, last: int) -> Integers:
        return self._offset + np.arange(first, last, dtype=np.int64) * self._every

    def message(self, number: int) -> Message:
        """Return a message, of those drawn last or the next one."""
        return Message._make(self.block(number, number + 1)[0].tolist())

    def block(self, first: int, last: int) -> Integers:
        """Return messages from `first` on, those before `last` that were drawn at once.

        int64 (n, 6), a row for each `Message`. `first` : of those drawn last, or the next one.
        """
        if first == self._first + len(self._drawn) and first < last:
            end = min(first + DRAWN_AT_ONCE, self.count)
            self._drawn, self._first = self._draw(first, end), first
        return self._drawn[first - self._first : last - self._first]

    def _draw(self, first: int, last: int) -> Integers:
        """Make all random draws for messages first to last - 1; where a signal delays them, 0."""
        link, seed, name, count = self._link, self._link.seed, self._link.name, last - first
        drawn = np.zeros((count, len(Message._fields)), np.int64)
        nominal = self._nominal(first, last)
        sent, loss = self._up(nominal), link.loss
        delay: int | Integers = link.delay_ns
        if isinstance(link.delay, DelaySignal):
            delay = 0
        elif isinstance(link.delay, DelayProfile):
            delay = link.delay.delay_ns(sent)
        probability: float | NDArray[np.float64]
        if self._player is not None:
            rows = self._player.rows(first, last)
            probability, recorded = self._player.lost(rows), self._player.delay_ns(rows)
            delay = delay if recorded is None else recorded
        elif isinstance(loss, GilbertElliott | LossChain):
            states = draws.states(loss, seed, name, count, first, self._state)
            self._state = int(states[-1])
            probability = np.array(loss.losses)[states]
        else:
            probability = loss
        # A window is about the instants at which the messages of a live link are sent, and about
        # those at which the messages of any other one were to be sent.
        at = sent if link.is_live else nominal
        for window in link.windows:
            inside = (at >= window.from_ns) & (at < window.until_ns)
            probability = np.where(inside, window.loss, probability)
        column = dict(zip(Message._fields, drawn.T, strict=True))
        column["sent_ns"][:], column["delay_ns"][:] = sent, delay
        column["jitter_ns"][:] = draws.jitter_ns(link.jitter, seed, name, count, first=first)
        column["lost"][:] = draws.lost(probability, seed, name, count, first)
        if link.duplicate > 0:
            again: Any = link.jitter, seed, name, count, "copy jitter", first
            column["copied"][:] = draws.duplicated(link.duplicate, seed, name, count, first)
            column["copy_jitter_ns"][:] = draws.jitter_ns(*again)
        return drawn
