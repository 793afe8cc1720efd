"""Control a playback: play, pause, seek, rate. Without network and threads."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

LARGEST_RATE = 1e6


class Status(Enum):
    """The status of a playback."""

    playing = "playing"
    paused = "paused"
    ended = "ended"


@dataclass(frozen=True)
class Due:
    """The messages to send now: their numbers in order, and whether they follow a jump."""

    messages: NDArray[np.int64]
    jumped: bool


class Playback:
    """A position in recorded time that moves with the clock; it begins paused.

    Parameters
    ----------
    times_ns : log times [ns], not decreasing, (m,).
    channels : number of the channel of each message, (m,).
    rate : recorded seconds per second, > 0.
    start_ns : where it begins, and where a loop begins again [ns].
    loop : whether to begin again at the end.
    clock : returns the nanoseconds of a monotonic clock.
    """

    def __init__(
        self,
        times_ns: NDArray[np.int64],
        channels: NDArray[np.int64],
        *,
        rate: float = 1.0,
        start_ns: int | None = None,
        loop: bool = False,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._times = times_ns
        self._of_channel = [np.flatnonzero(channels == c) for c in np.unique(channels)]
        self.first_ns = int(times_ns[0]) if times_ns.size else 0
        self.last_ns = int(times_ns[-1]) if times_ns.size else 0
        self._begin_ns = self.first_ns if start_ns is None else self._inside(start_ns)
        self._loop, self._clock = loop, clock
        self.rate = rate
        self.status = Status.paused
        self._anchor = (self._begin_ns, clock())
        self._next = 0
        self._again: NDArray[np.int64] = np.zeros(0, np.int64)
        self._jumped = False
        if start_ns is not None:
            self.seek(start_ns)

    @property
    def position_ns(self) -> int:
        """Recorded time reached [ns]."""
        at, since = self._anchor
        if self.status is not Status.playing:
            return at
        return min(at + round((self._clock() - since) * self.rate), self.last_ns)

    def play(self) -> None:
        """Start or continue; from the beginning if the end was reached."""
        if self.status is Status.ended:
            self.seek(self._begin_ns)
        self._anchor = (self.position_ns, self._clock())
        self.status = Status.playing

    def pause(self) -> None:
        """Stop at the present position."""
        at = self.position_ns
        if self.status is Status.playing:
            self.status = Status.paused
        self._anchor = (at, self._clock())

    def set_rate(self, rate: float) -> None:
        """Change the rate from here on; ignore one that is not positive, or too large."""
        if 0 < rate <= LARGEST_RATE:
            self._anchor = (self.position_ns, self._clock())
            self.rate = rate

    def seek(self, time_ns: int) -> None:
        """Go to a time [ns]; the last message of each channel up to it is due again."""
        if self.status is Status.ended:
            self.status = Status.paused
        at = self._inside(time_ns)
        self._anchor = (at, self._clock())
        self._next = int(np.searchsorted(self._times, at, side="right"))
        counts = [int(np.searchsorted(mine, self._next)) for mine in self._of_channel]
        last = [mine[n - 1] for mine, n in zip(self._of_channel, counts, strict=True) if n]
        self._again = np.sort(np.array(last, np.int64))
        self._jumped = True

    def due(self) -> Due:
        """Return the messages due since the last call; at the end, end or begin again."""
        at = self.position_ns
        again, jumped = self._again, self._jumped
        self._again, self._jumped = np.zeros(0, np.int64), False
        if self.status is not Status.playing:
            return Due(again, jumped)
        until = int(np.searchsorted(self._times, at, side="right"))
        fresh = np.arange(self._next, max(until, self._next), dtype=np.int64)
        self._next = max(until, self._next)
        if at >= self.last_ns:
            if self._loop and self.last_ns > self._begin_ns:
                self.seek(self._begin_ns)
            else:
                self.status = Status.ended
                self._anchor = (self.last_ns, self._clock())
        return Due(np.concatenate([again, fresh]), jumped)

    def _inside(self, time_ns: int) -> int:
        return min(max(time_ns, self.first_ns), self.last_ns)
