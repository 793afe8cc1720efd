"""Serve messages by Foxglove's WebSocket protocol, on the loopback interface, to who has the token.

Any web page that a browser on this machine shows can reach a port of this machine. So a client
must know the token, which is new in each run; its `Origin`, which a browser always sends, must be
on the list; and `Host` must name the loopback interface, so that no other name leads here.
The server of foxglove-sdk (0.30) asks for neither a token nor an `Origin`: it is not used.

Protocol: `foxglove.sdk.v1`, https://github.com/foxglove/ws-protocol, with playback control.
"""

from __future__ import annotations

import base64
import hmac
import json
import secrets
import struct
import threading
import time
from collections import deque
from collections.abc import Collection, Mapping
from contextlib import suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from cosim.core import InputError, optional
from cosim.trace.file.declared import Channel

LOOPBACK = "127.0.0.1"
ORIGINS = ("https://app.foxglove.dev", "file://")
"""Where Foxglove runs: in a browser, and as an application of its own."""

_PROTOCOL = "foxglove.sdk.v1"
_HOSTS = (LOOPBACK, "localhost", "[::1]")
_MESSAGE, _TIME, _STATE, _CONTROL = 1, 2, 5, 3
_MOST_BYTES = 2**26
"""A client that reads more slowly loses the oldest messages beyond so many bytes."""
_FAREWELL_S = 1.0
_BINARY = ("protobuf", "flatbuffer")
_ERROR = 2


@dataclass(frozen=True)
class Control:
    """A client's request: play or pause, at a rate, after a jump to an instant [ns] or None."""

    play: bool
    rate: float
    seek_ns: int | None
    name: str


class Listener(Protocol):
    """What a server tells of its clients; called from threads of its own."""

    def subscribed(self) -> None:
        """Register a subscription."""

    def control(self, request: Control) -> None:
        """Do as a client requests."""


class Server:
    """A server of channels, running from `start` to `stop`.

    Parameters
    ----------
    name : shown to clients.
    channels : by the id that messages are sent with.
    span_ns : first and last log time [ns].
    port : 0 takes any free port.
    origins : allowed in requests of browsers, beside `ORIGINS`.
    token : that clients must give; a new one if None.

    Raises
    ------
    InputError : from the constructor, if the package websockets is not installed.
    """

    def __init__(
        self,
        name: str,
        channels: Mapping[int, Channel],
        span_ns: tuple[int, int],
        *,
        port: int,
        listener: Listener,
        origins: Collection[str] = (),
        token: str | None = None,
    ) -> None:
        self._websockets = optional(
            "websockets",
            "websockets.sync.server",
            "websockets.exceptions",
            extra="foxglove",
            what="a trace is played with websockets",
        )
        self.port = port
        self.token = secrets.token_urlsafe(16) if token is None else token
        self._origins = {*ORIGINS, *(origin.rstrip("/") for origin in origins)}
        self._listener = listener
        self._clients: dict[int, _Client] = {}
        self._known = set(channels)
        start, end = ({"sec": ns // 10**9, "nsec": ns % 10**9} for ns in span_ns)
        self._greeting = [
            json.dumps(
                {
                    "op": "serverInfo",
                    "name": name,
                    "capabilities": ["time", "playbackControl"],
                    "supportedEncodings": [],
                    "metadata": {"not sent": "publish time, sequence number"},
                    "sessionId": str(time.time_ns()),
                    "dataStartTime": start,
                    "dataEndTime": end,
                }
            ),
            json.dumps(
                {"op": "advertise", "channels": [_advertised(*each) for each in channels.items()]}
            ),
        ]

    @property
    def url(self) -> str:
        """The address for clients, with the token."""
        return f"ws://{LOOPBACK}:{self.port}/?token={self.token}"

    def start(self) -> None:
        """Listen; `InputError` if the port cannot be listened on."""
        try:
            self._server = self._websockets.sync.server.serve(
                self._serve,
                LOOPBACK,
                self.port,
                subprotocols=[_PROTOCOL],
                process_request=self._refusal,
                compression=None,
                max_size=2**20,
                ping_interval=None,
                close_timeout=_FAREWELL_S,
            )
        except OSError as error:
            raise InputError(
                "the port cannot be listened on",
                where=f"{LOOPBACK}:{self.port}",
                got=str(error),
                hint="another one: `port` 0 takes any that is free",
            ) from error
        self.port = int(self._server.socket.getsockname()[1])
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close every connection and the port."""
        self._server.shutdown()
        for client in list(self._clients.values()):
            client.close()
        self._thread.join()

    @property
    def _closed(self) -> type[Exception]:
        closed: type[Exception] = self._websockets.exceptions.ConnectionClosed
        return closed

    def send(self, channel: int, log_ns: int, payload: memoryview) -> None:
        """Send a message to the clients that are subscribed to its channel."""
        for client in list(self._clients.values()):
            number = client.subscriptions.get(channel)
            if number is not None:
                client.put(struct.pack("<BIQ", _MESSAGE, number, log_ns) + payload, spare=True)

    def send_time(self, time_ns: int) -> None:
        """Send the instant reached [ns]."""
        for client in list(self._clients.values()):
            client.put(struct.pack("<BQ", _TIME, time_ns), spare=True)

    def send_state(
        self, status: int, time_ns: int, rate: float, *, jumped: bool, name: str = ""
    ) -> None:
        """Send the state of the playback: 0 playing, 1 paused, 3 ended; name : of the request."""
        text = name.encode()
        head = struct.pack("<BBQfBI", _STATE, status, time_ns, rate, jumped, len(text))
        for client in list(self._clients.values()):
            client.put(head + text)

    def _refusal(self, connection: Any, request: Any) -> Any:
        """Return the answer to a request that is refused; None to accept it."""
        why = self._why_refused(request.path, request.headers)
        return None if why is None else connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")

    def _why_refused(self, path: str, headers: Any) -> str | None:
        hosts = headers.get_all("Host")
        if len(hosts) != 1 or hosts[0].rpartition(":")[0] not in _HOSTS:
            return "this server answers to 127.0.0.1 and localhost only"
        origins = headers.get_all("Origin")
        if any(origin not in self._origins for origin in origins):
            return f"pages of {origins[0]} may not read this trace: allow them with --origin"
        given = parse_qs(urlsplit(path).query).get("token", [""])
        if len(given) != 1 or not hmac.compare_digest(given[0].encode(), self.token.encode()):
            return "the token is missing or wrong: take the whole address that play printed"
        return None

    def _serve(self, connection: Any) -> None:
        """Serve one client until it leaves; in a thread of its own."""
        client = _Client(connection, self._closed)
        for text in self._greeting:
            client.put(text)
        self._clients[id(client)] = client
        client.start()
        try:
            for received in connection:
                try:
                    self._take(client, received)
                except (ValueError, KeyError, TypeError, AttributeError, struct.error) as error:
                    client.complain(f"this message cannot be read: {error}")
        except self._closed:
            pass
        finally:
            del self._clients[id(client)]
            client.close()

    def _take(self, client: _Client, received: str | bytes) -> None:
        """Do as a message of a client says."""
        if isinstance(received, bytes):
            if received[:1] == bytes([_CONTROL]):
                _, command, rate, seeks, at, size = struct.unpack_from("<BBfBQI", received)
                name = received[19 : 19 + size].decode()
                request = Control(command == 0, rate, at if seeks else None, name)
                self._listener.control(request)
            return
        wanted = json.loads(received)
        if wanted["op"] == "subscribe":
            for one in wanted["subscriptions"]:
                number, channel = int(one["id"]), int(one["channelId"])
                if channel in self._known and 0 <= number < 2**32:
                    client.subscriptions[channel] = number
                    self._listener.subscribed()
                else:
                    client.complain(f"there is no channel {channel}")
        elif wanted["op"] == "unsubscribe":
            gone = set(wanted["subscriptionIds"])
            kept = {c: n for c, n in client.subscriptions.items() if n not in gone}
            client.subscriptions = kept


class _Client:
    """A connection, and what waits to be sent over it."""

    def __init__(self, connection: Any, closed: type[Exception]) -> None:
        self.subscriptions: dict[int, int] = {}
        self._connection, self._closed = connection, closed
        self._waiting: deque[tuple[str | bytes, bool]] = deque()
        self._bytes = 0
        self._news = threading.Condition()
        self._open = True
        self._sender = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to send."""
        self._sender.start()

    def put(self, message: str | bytes, *, spare: bool = False) -> None:
        """Send a message soon; spare : it may be left out if the client is slow."""
        with self._news:
            self._waiting.append((message, spare))
            self._bytes += len(message)
            while self._bytes > _MOST_BYTES and self._waiting[0][1]:
                self._bytes -= len(self._waiting.popleft()[0])
            self._news.notify()

    def complain(self, what: str) -> None:
        """Tell the client what is wrong with its request."""
        self.put(json.dumps({"op": "status", "level": _ERROR, "message": what}))

    def close(self) -> None:
        """End the sending, and the connection; at once if the client does not read."""
        with self._news:
            self._open = False
            self._news.notify()
        self._sender.join(_FAREWELL_S)
        self._connection.close_socket()

    def _run(self) -> None:
        """Send what waits until the connection is closed."""
        with suppress(self._closed, OSError):
            while self._open:
                with self._news:
                    self._news.wait_for(lambda: self._waiting or not self._open)
                    messages, self._waiting, self._bytes = self._waiting, deque(), 0
                for message, _ in messages:
                    if not self._open:
                        break
                    self._connection.send(message)
            self._connection.close()


def _advertised(number: int, channel: Channel) -> dict[str, Any]:
    schema = channel.schema
    text = (
        base64.b64encode(schema.data).decode()
        if schema.encoding in _BINARY
        else schema.data.decode("utf-8", "replace")
    )
    return {
        "id": number,
        "topic": channel.topic,
        "encoding": channel.encoding,
        "schemaName": schema.name,
        "schemaEncoding": schema.encoding,
        "schema": text,
        "metadata": dict(channel.metadata),
    }
