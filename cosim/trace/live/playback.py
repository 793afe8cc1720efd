"""Control a playback: play, pause, seek, rate. Without network and threads."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

LARGEST_RATE = 1e6


class Status(Enum):
    """The status of a playback."""

    playing = "playing"
    paused = "paused"
    ended = "ended"


@dataclass(frozen=True)
class Due:
    """The messages to send now.

    Attributes
    ----------
    latest_ns : the last message of each channel up to this instant [ns]; None for none.
    first_ns, last_ns : then all of these log times, both included; none if the last is earlier.
    jumped : whether they follow a jump.
    """

    latest_ns: int | None
    first_ns: int
    last_ns: int
    jumped: bool


class Playback:
    """A position in recorded time that moves with the clock; it begins paused.

    Parameters
    ----------
    first_ns, last_ns : log times of the first and the last message [ns].
    rate : recorded seconds per second, > 0.
    start_ns : where it begins, and where a loop begins again [ns].
    loop : whether to begin again at the end.
    clock : returns the nanoseconds of a monotonic clock.
    """

    def __init__(
        self,
        first_ns: int,
        last_ns: int,
        *,
        rate: float = 1.0,
        start_ns: int | None = None,
        loop: bool = False,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self.first_ns, self.last_ns = first_ns, last_ns
        self._begin_ns = self.first_ns if start_ns is None else self._inside(start_ns)
        self._loop, self._clock = loop, clock
        self.rate = rate
        self.status = Status.paused
        self._anchor = (self._begin_ns, clock())
        self._next_ns = first_ns
        self._again: int | None = None
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
        self._next_ns, self._again = at + 1, at
        self._jumped = True

    def due(self) -> Due:
        """Return the messages due since the last call; at the end, end or begin again."""
        at = self.position_ns
        again, jumped, first = self._again, self._jumped, self._next_ns
        self._again, self._jumped = None, False
        if self.status is not Status.playing:
            return Due(again, first, first - 1, jumped)
        self._next_ns = max(first, at + 1)
        if at >= self.last_ns:
            if self._loop and self.last_ns > self._begin_ns:
                self.seek(self._begin_ns)
            else:
                self.status = Status.ended
                self._anchor = (self.last_ns, self._clock())
        return Due(again, first, at, jumped)

    def _inside(self, time_ns: int) -> int:
        return min(max(time_ns, self.first_ns), self.last_ns)
