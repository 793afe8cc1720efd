"""A live server for Foxglove: the messages of a trace as they were, in their own time."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Any, Self

import numpy as np

from cosim.core import InputError, optional
from cosim.trace.live.playback import LARGEST_RATE, Playback, Status
from cosim.trace.reader import Trace

_TICK_S = 0.02
_AFTER_JUMP_S = 0.05
"""So long nothing is sent after a jump: the client hears of the jump first."""
_AFTER_SUBSCRIPTION_S = 0.25
"""So long it waits before it begins: the server takes a client in after it has told of it, and
clients ask for one channel after the other."""
_LATEST = 2**63 - 1
"""A file may claim times beyond; what comes that late is sent at the end."""
_BACKLOG = 1 << 17
_LOOPBACK = "127.0.0.1"


class Player:
    """Serves a trace on the loopback interface, from `with` to its end.

    Every channel is advertised with its schema before anything is sent. It begins to play when
    a client subscribes for the first time, so that nobody misses the start.

    Parameters
    ----------
    path : finished or not, ours or any MCAP file.
    rate : recorded seconds per second.
    port : 0 takes any that is free.
    start_s : where to begin, seconds from the first message.
    loop : begin again at the end.

    Attributes
    ----------
    port : the one that is listened on.
    playback : where it stands.

    Raises
    ------
    InputError : foxglove-sdk is not installed, no trace, no messages, a bad rate or port.
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
        self._sdk = _sdk()
        self._path, self._wanted_port = path, port
        trace = Trace(path, incomplete=True)
        self._channels = list(trace.channels.values())
        messages = list(trace.messages())
        if not messages:
            raise InputError(
                "nothing to play", where=str(path), expected="a trace with messages", got="none"
            )
        number = {id(channel): i for i, channel in enumerate(self._channels)}
        times = np.array([min(log, _LATEST) for _, _, log, _, _ in messages], np.int64)
        order = np.argsort(times, kind="stable")
        self._messages = [messages[i] for i in order]
        self._number = np.array([number[id(m[0])] for m in self._messages], np.int64)
        first = int(times[order[0]])
        self.playback = Playback(
            times[order],
            self._number,
            rate=rate,
            start_ns=first + round(start_s * 1e9) if start_s else None,
            loop=loop,
        )
        # guards `playback`, never held while the SDK is called: its callbacks want it too
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._listened_to = threading.Event()
        self._jumps = 0
        self._begun = False
        self._news = False
        self._reported_status = Status.paused

    def __enter__(self) -> Self:
        foxglove = self._sdk
        # the server alone does not keep it alive
        self._context = context = foxglove.Context()
        self._advertised = [_advertised(foxglove, channel, context) for channel in self._channels]
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
        for channel in self._advertised:
            channel.close()

    @property
    def url(self) -> str:
        """What a client connects to."""
        return f"ws://{_LOOPBACK}:{self.port}"

    @property
    def topics(self) -> list[str]:
        """Topics that are advertised."""
        return list(dict.fromkeys(channel.topic for channel in self._channels))

    def subscribed(self) -> None:
        """A client listens: the first one starts the playback."""
        self._listened_to.set()

    def control(self, request: Any) -> Any:
        """Do what a client asks for: play or pause, at a rate, from a time."""
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
            self._reported_status, self._news = self.playback.status, False  # the answer tells it
            return self._state(jumped=jumped, request=request.request_id)

    def wait(self) -> None:
        """Never return by itself: until an interruption, or the end of `with` elsewhere."""
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
            # an end is told one step late: the SDK lets it overtake the last messages
            state = self._state(jumped=looped, request=None) if looped or self._news else None
            self._news = self.playback.status is not before
            self._reported_status = self.playback.status
        if state is not None:
            self._server.broadcast_playback_state(state)
        for i in due.messages:
            if self._jumps != jumps:  # somebody went elsewhere: what is left is of no use
                return
            _, _, log, _, payload = self._messages[i]
            self._advertised[self._number[i]].log(bytes(payload), log_time=log)
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
    """What clients ask for."""

    def __init__(self, player: Player) -> None:
        self._player = player

    def on_subscribe(self, client: Any, channel: Any) -> None:
        del client, channel
        self._player.subscribed()

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Others may still listen: it plays on."""

    def on_playback_control_request(self, request: Any) -> Any:
        """Play, pause, rate, seek."""
        return self._player.control(request)


def _advertised(foxglove: Any, channel: Any, context: Any) -> Any:
    """A channel with the schema, encoding and metadata that it has in the file."""
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


def _sdk() -> Any:
    return optional(
        "foxglove",
        "foxglove.websocket",
        extra="foxglove",
        what="a trace is played with foxglove-sdk",
    )
