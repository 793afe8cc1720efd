"""Play, pause, seek and rate, as a client sees and commands them.

The clock is that of the machine: what has come by then is bounded from above by what the test
measures around it, and never from below.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
from foxglove_client import PAUSE, PLAY, Client, client
from mcap.writer import Writer

from cosim.trace.live import Player

MS = 10**6
FIRST = 10**10
"""The first log time [ns]: there is something to seek before it."""
WHOLE, HALVES = [100 * k for k in range(11)], [250, 750]
"""Instants behind the first [ms] of messages on `/whole` and on `/halves`."""
EVERY = sorted([*WHOLE, *HALVES])
PLAYING, PAUSED, ENDED = 0, 1, 3


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A second of messages on two topics."""
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("", "test")
        whole, halves = (writer.register_channel(t, "json", 0) for t in ("/whole", "/halves"))
        for at in EVERY:
            now = FIRST + at * MS
            writer.add_message(whole if at in WHOLE else halves, now, b"{}", now)
        writer.finish()
    return tmp_path / "a.mcap"


def instants(messages: list[tuple[str, int, bytes]]) -> list[int]:
    """Log times behind the first [ms]."""
    return [(at - FIRST) // MS for _, at, _ in messages]


def commanded(
    seen: Client, command: int, rate: float, seek_ms: int | None = None
) -> tuple[list[int], dict[str, Any]]:
    """What came before the answer to a request, and the answer, its instant behind the first [ms].

    An instant is rounded down.
    """
    name = str(time.monotonic_ns())
    seek_ns = None if seek_ms is None else FIRST + seek_ms * MS
    seen.control(command, rate, seek_ns=seek_ns, name=name)
    messages, state = seen.until("state", lambda state: state["name"] == name)
    return instants(messages), {**state, "at": (state["at"] - FIRST) / MS}


def quiet(seen: Client, ticks: int = 8) -> list[int]:
    """What comes during so many reports of the instant."""
    return [at for _ in range(ticks) for at in instants(seen.until("time")[0])]


def test_messages_are_due_by_the_clock_after_play(path: Path) -> None:
    """No message before play; then each message once, not before it is due by clock and rate."""
    with Player(path, port=0) as player, client(player.url) as seen:
        _, state = commanded(seen, PAUSE, 2.0)
        assert (state["status"], state["at"], state["rate"]) == (PAUSED, 0, 2.0)
        seen.subscribe("/whole", "/halves")
        assert quiet(seen) == []
        began = time.monotonic()
        seen.control(PLAY, 2.0)
        for at in EVERY:
            (message,) = seen.messages(1)
            assert instants([message]) == [at]
            assert at <= 1000 * 2.0 * (time.monotonic() - began)
        _, state = seen.until("state", lambda state: state["status"] == ENDED)
        assert state["at"] == FIRST + 1000 * MS
        assert quiet(seen) == []


def test_a_message_is_due_once_however_long_its_instant_lasts(path: Path) -> None:
    """At a crawl: a nanosecond of the recording takes seconds."""
    with Player(path, port=0, rate=1e-10) as player, client(player.url) as seen:
        seen.subscribe("/whole", "/halves")
        assert instants(seen.messages(1)) == [0]
        assert quiet(seen) == []


def test_pause_keeps_the_position(path: Path) -> None:
    """After any pause the playback continues at its position."""
    with Player(path, port=0) as player, client(player.url) as seen:
        commanded(seen, PAUSE, 1)
        seen.subscribe("/whole", "/halves")
        seen.control(PLAY, 1)
        messages = [*instants(seen.messages(4))]
        more, paused = commanded(seen, PAUSE, 0.0)  # which is no rate, and ignored
        assert (paused["status"], paused["rate"]) == (PAUSED, 1)
        messages += [*more, *quiet(seen, 30)]  # of which there are fifty per second
        began = time.monotonic()
        _, playing = commanded(seen, PLAY, 1)
        since = playing["at"] - paused["at"]
        assert playing["status"] == PLAYING
        assert 0 <= since <= 1000 * (time.monotonic() - began)
        messages += instants(seen.messages(len(EVERY) - len(messages)))
        assert messages == EVERY
        assert messages[3] <= paused["at"]


def test_seek_makes_the_last_messages_due_again(path: Path) -> None:
    """The last message of each channel up to that time, also while paused, in order."""
    with Player(path, port=0) as player, client(player.url) as seen:
        commanded(seen, PAUSE, 1)
        seen.subscribe("/whole", "/halves")
        _, state = commanded(seen, PAUSE, 1, seek_ms=601)
        assert (state["at"], state["jumped"]) == (601, True)
        assert instants(seen.messages(2)) == [250, 600]
        assert quiet(seen) == []
        _, state = commanded(seen, PLAY, 1)
        assert not state["jumped"]
        assert instants(seen.messages(5)) == [700, 750, 800, 900, 1000]
        for before, at, again in (
            (-5000, 0, [0]),
            (99_000, 1000, [750, 1000]),
            (300, 300, [250, 300]),
        ):
            _, state = commanded(seen, PAUSE, 1, seek_ms=before)
            assert (state["at"], state["status"]) == (at, PAUSED)
            assert instants(seen.messages(len(again))) == again
            assert quiet(seen) == []


def test_a_jump_is_reported_once(path: Path) -> None:
    """By the answer to who jumped: to play on is no other jump."""
    with Player(path, port=0) as player, client(player.url) as seen:
        commanded(seen, PAUSE, 1)
        seen.subscribe("/whole", "/halves")
        _, state = commanded(seen, PLAY, 4, seek_ms=500)
        states = [state]
        while states[-1]["status"] != ENDED:
            states.append(seen.until("state")[1])
        assert [state["jumped"] for state in states] == [True, False]


def test_change_of_rate_keeps_the_position(path: Path) -> None:
    """A new rate makes no jump; an invalid one is ignored."""
    with Player(path, port=0) as player, client(player.url) as seen:
        commanded(seen, PAUSE, 1)
        seen.subscribe("/whole", "/halves")
        began = time.monotonic()
        commanded(seen, PLAY, 0.5)
        seen.messages(3)
        _, faster = commanded(seen, PLAY, 4)
        changed = time.monotonic()
        assert 200 <= faster["at"] <= 1000 * 0.5 * (changed - began)
        for nonsense in (0.0, -1.0, float("nan"), float("inf"), 1e7):
            _, state = commanded(seen, PAUSE, nonsense)
            assert state["rate"] == player.playback.rate == 4
        assert state["at"] <= faster["at"] + 1000 * 4 * (time.monotonic() - changed) + 1e-3


def test_play_after_the_end_begins_again(path: Path) -> None:
    """Every message was sent; play begins at the start."""
    with Player(path, port=0, rate=20) as player, client(player.url) as seen:
        seen.subscribe("/whole", "/halves")
        for _ in range(2):
            assert instants(seen.messages(len(EVERY))) == EVERY
            _, state = seen.until("state", lambda state: state["status"] == ENDED)
            assert state["at"] == FIRST + 1000 * MS
            began = time.monotonic()
            _, state = commanded(seen, PLAY, 5)
            assert state["status"] == PLAYING
            assert 0 <= state["at"] <= 1000 * 5 * (time.monotonic() - began)


def test_loop_returns_to_its_start_time(path: Path) -> None:
    """The loop begins again where it began, with the last messages there, and says that it does."""
    with (
        Player(path, port=0, rate=2, start_s=0.8, loop=True) as player,
        client(player.url) as seen,
    ):
        seen.subscribe("/whole", "/halves")
        assert instants(seen.messages(8)) == [750, 800, 900, 1000] * 2
        _, state = seen.until("state", lambda state: state["jumped"])
        assert state["status"] == PLAYING
