"""Play the messages of a trace to Foxglove, at their recorded times."""

from __future__ import annotations

import math
import re
import threading
from collections.abc import Collection
from itertools import chain
from pathlib import Path
from typing import Self

from cosim.core import InputError
from cosim.trace.live.playback import LARGEST_RATE, Playback, Status
from cosim.trace.live.server import Control, Server
from cosim.trace.live.timed import TimedMessages
from cosim.trace.reader import Trace

_TICK_S = 0.02
_AFTER_SUBSCRIPTION_S = 0.25
"""Pause before the start [s]: the server reports a client before it serves it, and clients
subscribe to one channel after the other."""
_STATES = {Status.playing: 0, Status.paused: 1, Status.ended: 3}


class Player:
    """A server of a trace on the loopback interface, running within `with`.

    Every channel is advertised with its schema before any message is sent. The playback begins
    when the first client subscribes, so that it misses nothing. The protocol carries no publish
    time and no sequence number.

    Parameters
    ----------
    path : a trace, finished or not, or any MCAP file.
    rate : recorded seconds per second.
    port : 0 takes any free port.
    start_s : where to begin, from the first message [s].
    loop : begin again at the end.
    origins : of web pages that may be clients, beside those of Foxglove.
    token : that clients must give in the address; a new one if None.

    Attributes
    ----------
    playback : position, rate and status.

    Raises
    ------
    InputError : websockets is not installed, there is no trace or no message in it, or a rate,
        port, start or token is none.
    """

    def __init__(
        self,
        path: Path,
        *,
        rate: float = 1.0,
        port: int = 8765,
        start_s: float = 0.0,
        loop: bool = False,
        origins: Collection[str] = (),
        token: str | None = None,
    ) -> None:
        _check(rate, port, start_s, token)
        trace = Trace(path, incomplete=True, by_summary=True)
        if not any(trace.counts.values()):
            raise InputError(
                "nothing to play", where=str(path), expected="a trace with messages", got="none"
            )
        self._channels = dict(trace.channels)
        self._messages = TimedMessages(trace)
        first, last = self._messages.first_ns, self._messages.last_ns
        self.playback = Playback(
            first,
            last,
            rate=rate,
            start_ns=first + round(start_s * 1e9) if start_s else None,
            loop=loop,
        )
        self._server = Server(
            f"auv-cosim: {path.name}",
            self._channels,
            (first, last),
            port=port,
            listener=self,
            origins=origins,
            token=token,
        )
        # guards `playback`, and the order in which its messages and states are sent
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._listened_to = threading.Event()
        self._jumps = 0
        self._begun = False
        self._jump_sent = True

    def __enter__(self) -> Self:
        self._server.start()
        self._thread = threading.Thread(target=self._run, name="playback", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._server.stop()

    @property
    def port(self) -> int:
        """The port of the server."""
        return self._server.port

    @property
    def url(self) -> str:
        """The address for clients, with the token."""
        return self._server.url

    @property
    def damage(self) -> list[str]:
        """What could not be read of the trace, and why."""
        return self._messages.damage

    @property
    def topics(self) -> list[str]:
        """The topics advertised."""
        return list(dict.fromkeys(channel.topic for channel in self._channels.values()))

    def subscribed(self) -> None:
        """Register a subscription: the first one starts the playback."""
        self._listened_to.set()

    def control(self, request: Control) -> None:
        """Play, pause, change rate or seek as a client requests, and tell all the new state."""
        with self._lock:
            self.playback.set_rate(request.rate)
            if request.seek_ns is not None:
                self.playback.seek(request.seek_ns)
                self._jumps += 1
            if request.play:
                self.playback.play()
            else:
                self.playback.pause()
            self._begun = True
            self._jump_sent = request.seek_ns is not None
            self._tell(jumped=self._jump_sent, name=request.name)

    def wait(self) -> None:
        """Wait for an interruption, or for the end of `with` in another thread."""
        while not self._stop.wait(0.5):
            pass

    def _run(self) -> None:
        while not self._stop.wait(_TICK_S):
            if self._listened_to.is_set() and not self._begun:
                self._stop.wait(_AFTER_SUBSCRIPTION_S)
            self._step()

    def _step(self) -> None:
        with self._lock:
            if self._listened_to.is_set() and not self._begun:
                self._begun = True
                self.playback.play()
            if not self._begun:  # nobody listens: nothing may be missed
                self._server.send_time(self.playback.position_ns)
                return
            before, jumps = self.playback.status, self._jumps
            due = self.playback.due()
            at = self.playback.position_ns
            if due.jumped and not self._jump_sent and before is Status.playing:
                self._tell(jumped=True)  # a loop begins again
            self._jump_sent = False
        latest = [] if due.latest_ns is None else self._messages.latest(due.latest_ns)
        for message in chain(latest, self._messages.between(due.first_ns, due.last_ns)):
            with self._lock:
                # a client jumped, and the remaining messages are outdated; or this is the end
                if self._jumps != jumps or self._stop.is_set():
                    return
                self._server.send(message.channel, message.log_ns, message.payload)
        with self._lock:
            if self._jumps != jumps:
                return
            if self.playback.status is not before:
                self._tell(jumped=False)
            self._server.send_time(at)

    def _tell(self, *, jumped: bool, name: str = "") -> None:
        playback = self.playback
        at = playback.position_ns
        self._server.send_state(
            _STATES[playback.status], at, playback.rate, jumped=jumped, name=name
        )


def _check(rate: float, port: int, start_s: float, token: str | None) -> None:
    if token is not None and not re.fullmatch(r"[A-Za-z0-9_-]{8,}", token):
        raise InputError(
            "not a token",
            where="`token`",
            expected="at least eight letters, digits, - or _: it is a part of the address",
            got=repr(token),
        )
    if not 0 < rate <= LARGEST_RATE:
        raise InputError(
            "not a rate to play at",
            where="`rate`",
            expected=f"recorded seconds per second, above 0, at most {LARGEST_RATE:g}",
            got=str(rate),
        )
    if not 0 <= port <= 65535:
        raise InputError("not a port", where="`port`", expected="0 to 65535", got=str(port))
    if not (math.isfinite(start_s) and 0 <= start_s <= 1e9):
        raise InputError(
            "not a time to start at",
            where="`start`",
            expected="seconds, 0 or more",
            got=f"{start_s}",
        )
