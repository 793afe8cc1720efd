"""Play, pause, seek and rate, by a clock that the test turns."""

from __future__ import annotations

import pytest

from cosim.trace.live.playback import Due, Playback, Status

S = 10**9


class Clock:
    """A clock that moves only when set."""

    now = 0

    def __call__(self) -> int:
        return self.now

    def turn(self, seconds: float) -> None:
        self.now += round(seconds * S)


@pytest.fixture
def clock() -> Clock:
    return Clock()


def playback(clock: Clock, **more: object) -> Playback:
    """Channel 0 each second from 0 to 10 s, channel 1 at 2.5 s and 7.5 s."""
    return Playback(0, 10 * S, clock=clock, **more)  # type: ignore[arg-type]


def times_of(due: Due) -> list[float]:
    times = sorted([*range(11), 2.5, 7.5])
    until = -1 if due.latest_ns is None else due.latest_ns / S
    channels = [
        [t for t in times if t <= until and (t % 1 == 0) is whole] for whole in (True, False)
    ]
    latest = sorted(mine[-1] for mine in channels if mine)
    return latest + [t for t in times if due.first_ns <= t * S <= due.last_ns]


def sent(player: Playback) -> list[float]:
    return times_of(player.due())


def test_messages_are_due_by_the_clock_after_play(clock: Clock) -> None:
    """No message before play; then each message once, when due by clock and rate."""
    player = playback(clock, rate=2.0)
    clock.turn(5)
    assert sent(player) == []
    player.play()
    assert sent(player) == [0]
    clock.turn(1.25)
    assert sent(player) == [1, 2, 2.5]
    assert sent(player) == []
    assert player.position_ns == 2.5 * S


def test_pause_keeps_the_position(clock: Clock) -> None:
    """After any pause the playback continues at its position."""
    player = playback(clock)
    player.play()
    clock.turn(3.2)
    player.pause()
    assert player.status is Status.paused
    clock.turn(100)
    assert sent(player) == []
    player.play()
    assert sent(player) == [0, 1, 2, 2.5, 3]
    clock.turn(1)
    assert sent(player) == [4]


def test_seek_makes_the_last_messages_due_again(clock: Clock) -> None:
    """The last message of each channel up to that time, also while paused, in order."""
    player = playback(clock)
    player.seek(6 * S + 1)
    due = player.due()
    assert due.jumped
    assert times_of(due) == [2.5, 6]
    assert not player.due().jumped
    player.play()
    clock.turn(2)
    assert sent(player) == [7, 7.5, 8]
    player.seek(-5 * S)
    assert player.position_ns == 0
    assert sent(player) == [0]
    player.seek(99 * S)
    assert player.position_ns == 10 * S


def test_change_of_rate_keeps_the_position(clock: Clock) -> None:
    """A new rate makes no jump; an invalid one is ignored."""
    player = playback(clock)
    player.play()
    clock.turn(2)
    player.set_rate(4)
    assert player.position_ns == 2 * S
    clock.turn(1)
    assert player.position_ns == 6 * S
    for nonsense in (0.0, -1.0, float("nan"), float("inf")):
        player.set_rate(nonsense)
    assert player.rate == 4


def test_play_after_the_end_begins_again(clock: Clock) -> None:
    """Every message was sent; play begins at the start."""
    player = playback(clock)
    player.play()
    clock.turn(60)
    assert len(sent(player)) == 13
    assert player.status is Status.ended
    assert player.position_ns == 10 * S
    clock.turn(1)
    player.play()
    assert sent(player) == [0]
    clock.turn(1)
    assert sent(player) == [1]


def test_loop_returns_to_its_start_time(clock: Clock) -> None:
    """The loop begins again at `start_ns`."""
    player = playback(clock, loop=True, start_ns=8 * S)
    player.play()
    assert sent(player) == [7.5, 8]
    clock.turn(2)
    assert sent(player) == [9, 10]
    assert player.status is Status.playing
    due = player.due()
    assert due.jumped
    clock.turn(1)
    assert sent(player) == [9]
