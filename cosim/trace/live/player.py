"""Play the messages of a trace to Foxglove, at their recorded times."""

from __future__ import annotations

import math
import threading
from itertools import chain
from pathlib import Path
from typing import Any, Self

from cosim.core import InputError, optional
from cosim.trace.info import opened
from cosim.trace.live.playback import LARGEST_RATE, Playback, Status
from cosim.trace.live.timed import TimedMessages

_TICK_S = 0.02
_AFTER_JUMP_S = 0.05
"""Pause after a jump, so that the client is notified of it before any message [s]."""
_AFTER_SUBSCRIPTION_S = 0.25
"""Pause before the start [s]: the server reports a client before it serves it, and clients
subscribe to one channel after the other."""
_BACKLOG = 1 << 17
_LOOPBACK = "127.0.0.1"


class Player:
    """A server of a trace on the loopback interface, running within `with`.

    Every channel is advertised with its schema before any message is sent. The playback begins
    when the first client subscribes, so that it misses nothing.

    Parameters
    ----------
    path : a trace, finished or not, or any MCAP file.
    rate : recorded seconds per second.
    port : 0 takes any free port.
    start_s : where to begin, from the first message [s].
    loop : begin again at the end.

    Attributes
    ----------
    port : the port of the server.
    playback : position, rate and status.

    Raises
    ------
    InputError : foxglove-sdk is not installed, there is no trace or no message in it, or a rate,
        port or start is out of range.
    """

    def __init__(
        self,
        path: Path,
        *,
        rate: float = 1.0,
        port: int = 8765,
        start_s: float = 0.0,
        loop: bool = False,
    ) -> None:
        _check(rate, port, start_s)
        what = "a trace is played with foxglove-sdk"
        self._sdk = optional("foxglove", "foxglove.websocket", extra="foxglove", what=what)
        self._path, self._wanted_port = path, port
        trace = opened(path)
        self._channels = dict(trace.channels)
        if not any(trace.counts.values()):
            raise InputError(
                "nothing to play", where=str(path), expected="a trace with messages", got="none"
            )
        self._messages = TimedMessages(trace)
        first = self._messages.first_ns
        self.playback = Playback(
            first,
            self._messages.last_ns,
            rate=rate,
            start_ns=first + round(start_s * 1e9) if start_s else None,
            loop=loop,
        )
        # guards `playback`; never held while the SDK is called, whose callbacks take it
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._listened_to = threading.Event()
        self._jumps = 0
        self._begun = False
        self._news = False
        self._reported_status = Status.paused

    def __enter__(self) -> Self:
        foxglove = self._sdk
        # the server does not keep the context alive
        self._context = context = foxglove.Context()
        self._advertised = {
            number: _advertised(foxglove, channel, context)
            for number, channel in self._channels.items()
        }
        try:
            self._server = foxglove.start_server(
                name=f"auv-cosim: {self._path.name}",
                host=_LOOPBACK,
                port=self._wanted_port,
                capabilities=[foxglove.websocket.Capability.Time],
                server_listener=_Listener(self),
                context=context,
                playback_time_range=(self.playback.first_ns, self.playback.last_ns),
                message_backlog_size=_BACKLOG,
            )
        except (OSError, RuntimeError) as error:
            raise InputError(
                "the port cannot be listened on",
                where=f"{_LOOPBACK}:{self._wanted_port}",
                got=str(error),
                hint="another one: --port 0 takes any that is free",
            ) from error
        self.port = int(self._server.port)
        self._thread = threading.Thread(target=self._run, name="playback", daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._server.stop()
        for channel in self._advertised.values():
            channel.close()

    @property
    def url(self) -> str:
        """The address for clients."""
        return f"ws://{_LOOPBACK}:{self.port}"

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

    def control(self, request: Any) -> Any:
        """Play, pause, change rate or seek as a client requests, and return the new state."""
        play = request.playback_command == self._sdk.websocket.PlaybackCommand.Play
        jumped = request.seek_time is not None
        with self._lock:
            self.playback.set_rate(request.playback_speed)
            if jumped:
                self.playback.seek(request.seek_time)
                self._jumps += 1
            if play:
                self.playback.play()
            else:
                self.playback.pause()
            self._begun = True
            self._reported_status, self._news = self.playback.status, False  # by the answer
            return self._state(jumped=jumped, request=request.request_id)

    def wait(self) -> None:
        """Wait for an interruption, or for the end of `with` in another thread."""
        while not self._stop.wait(0.5):
            pass

    def _run(self) -> None:
        jumps_seen = 0
        while not self._stop.wait(_TICK_S):
            if self._listened_to.is_set() and not self._begun:
                self._stop.wait(_AFTER_SUBSCRIPTION_S)
            if self._jumps != jumps_seen:
                jumps_seen = self._jumps
                self._stop.wait(_AFTER_JUMP_S)
            self._step()

    def _step(self) -> None:
        with self._lock:
            if self._listened_to.is_set() and not self._begun:
                self._begun = True
                self.playback.play()
            before, jumps = self._reported_status, self._jumps
            due = self.playback.due()
            at = self.playback.position_ns
            looped = due.jumped and before is Status.playing is self.playback.status
            # an end is reported one step late: the SDK lets it overtake the last messages
            state = self._state(jumped=looped, request=None) if looped or self._news else None
            self._news = self.playback.status is not before
            self._reported_status = self.playback.status
        if state is not None:
            self._server.broadcast_playback_state(state)
        latest = [] if due.latest_ns is None else self._messages.latest(due.latest_ns)
        for message in chain(latest, self._messages.between(due.first_ns, due.last_ns)):
            # a client jumped, and the remaining messages are outdated; or this is the end
            if self._jumps != jumps or self._stop.is_set():
                return
            channel = self._advertised[message.channel]
            channel.log(bytes(message.payload), log_time=message.log_ns)
        self._server.broadcast_time(at)

    def _state(self, *, jumped: bool, request: str | None) -> Any:
        live, playback = self._sdk.websocket, self.playback
        words = {
            Status.playing: live.PlaybackStatus.Playing,
            Status.paused: live.PlaybackStatus.Paused,
            Status.ended: live.PlaybackStatus.Ended,
        }
        word = words[playback.status]
        return live.PlaybackState(word, playback.position_ns, playback.rate, jumped, request)


class _Listener:
    """The receiver of clients' requests."""

    def __init__(self, player: Player) -> None:
        self._player = player

    def on_subscribe(self, client: Any, channel: Any) -> None:
        del client, channel
        self._player.subscribed()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Do nothing: other clients may still be subscribed."""

    def on_playback_control_request(self, request: Any) -> Any:
        """Pass on a request to play, pause, change rate or seek."""
        return self._player.control(request)


def _advertised(foxglove: Any, channel: Any, context: Any) -> Any:
    """Advertise a channel with its schema, encoding and metadata in the file."""
    schema = channel.schema
    return foxglove.Channel(
        channel.topic,
        schema=foxglove.Schema(name=schema.name, encoding=schema.encoding, data=schema.data),
        message_encoding=channel.encoding,
        context=context,
        metadata=dict(channel.metadata),
    )


def _check(rate: float, port: int, start_s: float) -> None:
    if not 0 < rate <= LARGEST_RATE:
        raise InputError(
            "not a rate to play at",
            where="--rate",
            expected=f"recorded seconds per second, above 0, at most {LARGEST_RATE:g}",
            got=str(rate),
        )
    if not 0 <= port <= 65535:
        raise InputError("not a port", where="--port", expected="0 to 65535", got=str(port))
    if not (math.isfinite(start_s) and 0 <= start_s <= 1e9):
        raise InputError(
            "not a time to start at",
            where="--start",
            expected="seconds, 0 or more",
            got=f"{start_s}",
        )
