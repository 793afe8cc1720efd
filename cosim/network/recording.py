"""A recorded link: what became of each message, and how a link replays it."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.network import draws
from cosim.network.checks import MAX_NS
from cosim.network.keys import ChoiceKey, CountKey, check_keys

Replay = Literal["once", "loop", "blocks"]
"""What follows the last row of a recording."""

RowOf = Literal["message", "time"]
"""Which row of a recording a message takes."""

IN_FLIGHT_NS = -1
"""Delay of a message that had not arrived when the recording ended."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Recording:
    """What became of the messages of a link, one row each in order of sending.

        >>> from cosim.network import PacketLink, Recording, deliver
        >>> sent, delays = [0, 10**9, 2 * 10**9], [10**8, 10**8, 3 * 10**8]
        >>> recorded = Recording(sent_ns=sent, lost=[False, True, False], delay_ns=delays)
        >>> up = PacketLink("up", sample_time_ns=10**9, recording=recorded)
        >>> counts = deliver(up, end_ns=2 * 10**9).statistics(2 * 10**9)
        >>> counts["delivered"], counts["lost"], counts["in_flight"]
        (1, 1, 1)

    Parameters
    ----------
    sent_ns : instant of sending, from that of the first row on [ns], int64 (n,), never
        decreasing, n >= 1.
    lost : which messages were lost, bool (n,).
    delay_ns : time from sending to arrival, of a lost message to the instant at which it was due
        [ns], int64 (n,); `IN_FLIGHT_NS` (-1) where it was still on its way when the recording
        ended. None: only losses were recorded, and the link has its own delay.
    replay : "once": row after row; a run must not last longer. "loop": from the beginning
        again after the last row. "blocks": blocks of consecutive rows, drawn by the seed
        (moving-block bootstrap: Kunsch, Annals of Statistics 17 (1989) 1217), which preserve
        everything that is shorter than a block, such as most outages. The last two end before the
        first row that was in flight.
    block : rows of a block; only with "blocks".
    rows : which row belongs to a message. "message": the k-th row to the k-th message. "time": the
        last row that was sent by the time of the message, both counted from the first. None: the
        row that both rules give; a recording whose messages were not sent in the rhythm of the link
        (each nearer to its own instant than to the next) is refused.
    range_m, size : distance [m] and size of each message if they were recorded, float64 (n,); for
        fits, not for the replay.
    start_ns : when the first row was sent, by the clock of the recorder [ns].

    Raises
    ------
    InputError : rows out of order or out of range, or keys that do not go together.
    """

    sent_ns: NDArray[np.int64]
    lost: NDArray[np.bool_]
    delay_ns: NDArray[np.int64] | None = None
    replay: Annotated[
        Replay, ChoiceKey("what follows the last recorded message", get_args(Replay))
    ] = "once"
    block: Annotated[int | None, CountKey('messages of a block that replay = "blocks" draws')] = (
        None
    )
    rows: Annotated[
        RowOf | None,
        ChoiceKey("which recorded message is taken: by number or by time", get_args(RowOf)),
    ] = None
    range_m: NDArray[np.float64] | None = None
    size: NDArray[np.float64] | None = None
    start_ns: int = 0

    def __post_init__(self) -> None:
        check_keys("recording.", self)
        if (self.replay == "blocks") != bool(self.block):
            raise InputError(
                "blocks have a length",
                where="recording.block",
                expected='messages of a block (1 or more) with replay = "blocks", else none',
                got=f'{self.block}, replay = "{self.replay}"',
                hint="a few times the longest outage to be kept whole: cosim link show has them",
            )
        kinds = {"sent_ns": np.int64, "lost": np.bool_, "delay_ns": np.int64}
        for name, kind in {**kinds, "range_m": np.float64, "size": np.float64}.items():
            if getattr(self, name) is not None:
                column: NDArray[Any] = np.array(getattr(self, name), kind)
                column.setflags(write=False)
                object.__setattr__(self, name, column)
        self._check_rows()

    def _check_rows(self) -> None:
        sent, delay = self.sent_ns, self.delay_ns
        shapes = {sent.shape, self.lost.shape} | (set() if delay is None else {delay.shape})
        if len(shapes) > 1 or sent.ndim != 1 or not sent.size:
            raise InputError(
                "a recording has a row for each message",
                where="recording",
                expected="columns of one length, at least 1",
                got=", ".join(str(shape) for shape in sorted(shapes)),
            )
        wrong = np.diff(sent, prepend=0) < 0
        wrong |= sent > MAX_NS
        wrong[0] |= sent[0] != 0
        if delay is not None:
            wrong |= (delay < IN_FLIGHT_NS) | (delay > MAX_NS)
            wrong |= self.lost & (delay < 0)
        if wrong.any():
            k = int(np.argmax(wrong))
            late = None if delay is None else int(delay[k])
            raise InputError(
                "a row of the recording is out of order or out of range",
                where=f"recording: message {k}",
                expected="sent after the one before, from 0 to 2**53 ns, and a delay from 0 there",
                got=f"sent {sent[k]} ns, delay {late} ns",
            )

    def __len__(self) -> int:
        return int(self.sent_ns.size)

    def __repr__(self) -> str:
        # links are compared and hashed by what this says
        keys = f"replay={self.replay!r}, block={self.block!r}, rows={self.rows!r}"
        return f"Recording({len(self)} messages, sha256={self.sha256}, {keys})"

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Recording) and repr(self) == repr(other)

    def __hash__(self) -> int:
        return hash(repr(self))

    @property
    def sha256(self) -> str:
        """SHA-256 of the rows, as far as a replay depends on them."""
        digest = hashlib.sha256(self.sent_ns.tobytes() + self.lost.tobytes())
        if self.delay_ns is not None:
            digest.update(self.delay_ns.tobytes())
        return digest.hexdigest()

    @property
    def arrived(self) -> NDArray[np.bool_]:
        """Which messages were not lost, and arrived before the recording ended, bool (n,)."""
        there = ~self.lost
        return there if self.delay_ns is None else there & (self.delay_ns >= 0)

    @property
    def ended(self) -> NDArray[np.bool_]:
        """Which messages were lost or arrived before the recording ended, bool (n,)."""
        none_in_flight = np.ones(len(self), np.bool_)
        return none_in_flight if self.delay_ns is None else self.delay_ns >= 0

    @property
    def least_ns(self) -> int:
        """Least delay of a message that arrived [ns]; 0 without delays or arrivals."""
        if self.delay_ns is None or not self.arrived.any():
            return 0
        return int(self.delay_ns[self.arrived].min())

    @property
    def greatest_ns(self) -> int:
        """Greatest delay of a message that arrived [ns]; 0 without delays or arrivals."""
        if self.delay_ns is None or not self.arrived.any():
            return 0
        return int(self.delay_ns[self.arrived].max())

    def played(self, replay: Replay, block: int | None = None) -> Recording:
        """Return the same recording, replayed in another way."""
        return replace(self, replay=replay, block=block)


class Player:
    """The rows of a recording that the messages of a link take.

    Parameters
    ----------
    recording : of the link.
    sample_time_ns : of the link.
    name, seed : of the link; blocks are drawn by them.
    count : messages that the link sends at most.

    Raises
    ------
    InputError : a recording that does not last as long, that is shorter than its blocks, or whose
        rhythm is another one and that does not say what is to be done.
    """

    def __init__(
        self, recording: Recording, sample_time_ns: int, name: str, seed: int, count: int
    ) -> None:
        self._is, self._name, self._seed = recording, name, seed
        where = f"link {name!r}: recording"
        sent = recording.sent_ns
        if recording.rows is None:
            _check_rhythm(where, sent, sample_time_ns)
        if recording.rows == "time":
            instants = np.arange(sent[-1] // sample_time_ns + 1) * sample_time_ns
            self._row = np.searchsorted(sent, instants, side="right") - 1
        else:
            self._row = np.arange(sent.size)
        if recording.replay != "once" and not recording.ended.all():
            first = int(np.argmin(recording.ended))
            self._row = self._row[: int(np.searchsorted(self._row, first))]
        known, block = self._row.size, recording.block or 1
        if recording.replay == "once" and count > known:
            raise InputError(
                "the recording ends before the run does",
                where=where,
                expected=f"at least {count} messages, as many as the link sends",
                got=f"{known}",
                hint='a shorter run, or replay = "loop" or "blocks"',
            )
        if known < block:
            raise InputError(
                "the recording is shorter than one block of it",
                where=f"{where}.block",
                expected=f"at most {known}, the messages of the recording that came or were lost",
                got=str(block),
            )

    def rows(self, first: int, last: int) -> NDArray[np.int64]:
        """Return the rows of messages first to last - 1, int64."""
        number = np.arange(first, last, dtype=np.int64)
        if self._is.replay == "loop":
            number %= self._row.size
        elif self._is.block and last > first:
            block = self._is.block
            begin = first // block
            count = (last - 1) // block + 1 - begin
            u = draws.uniform(self._seed, self._name, "recording", count, first=begin)
            starts = np.floor(u * (self._row.size - block + 1)).astype(np.int64)
            number = starts[number // block - begin] + number % block
        return self._row[number]

    def lost(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the probability of a loss of messages that take these rows: 0 or 1."""
        return self._is.lost[rows].astype(np.float64)

    def delay_ns(self, rows: NDArray[np.int64]) -> NDArray[np.int64] | None:
        """Return the delays of messages that take these rows [ns]; None if none were recorded."""
        if self._is.delay_ns is None:
            return None
        delay = self._is.delay_ns[rows]
        # what was in flight at the end of the recording does not come before that of the run
        return np.where(delay < 0, MAX_NS, delay)


def _check_rhythm(where: str, sent_ns: NDArray[np.int64], sample_time_ns: int) -> None:
    own = np.arange(sent_ns.size, dtype=np.int64) * sample_time_ns
    off = 2 * np.abs(sent_ns - own) >= sample_time_ns
    if off.any():
        k = int(np.argmax(off))
        raise InputError(
            "the recorded messages were not sent in the rhythm of the link",
            where=where,
            expected=f"message {k} about {own[k] / 1e9:g} s after the first, as sample_time says",
            got=f"{sent_ns[k] / 1e9:g} s",
            hint='another sample_time; or rows = "time" (the link as it was at that time), or '
            'rows = "message" (message by message, whatever the time)',
        )


def check_recording(where: str, recording: Any, given: dict[str, bool]) -> None:
    """Raise `InputError` unless it is a `Recording` or None, and does not meet what it replaces.

    `given` : whether the link has each of the settings that say what a recording says.
    """
    if recording is None:
        return
    if not isinstance(recording, Recording):
        raise InputError(
            "recording of the wrong type",
            where=f"{where}: recording",
            expected="a Recording or None",
            got=repr(recording),
        )
    delays = recording.delay_ns is not None
    for name, there in given.items():
        if there and (delays or name == "loss"):
            raise InputError(
                f"the recording says what {name} would say",
                where=f"{where}: {name}",
                expected=f"a recording without {name}, or {name} without a recording",
                got="both",
            )
