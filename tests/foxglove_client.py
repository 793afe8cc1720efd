"""A client that speaks Foxglove's protocol, and shares no code with the server of a trace."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from websockets.sync.client import connect

MESSAGE, TIME, STATE = 1, 2, 5
PLAY, PAUSE = 0, 1


class Client:
    """Channels by topic; events in the order in which they came: (kind, what)."""

    def __init__(self, socket: Any) -> None:
        self._socket = socket
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.before: list[int] = []
        while not self.channels:
            received = socket.recv()
            if isinstance(received, bytes):
                self.before.append(received[0])
                continue
            data = json.loads(received)
            if data["op"] == "serverInfo":
                self.info = data
            elif data["op"] == "advertise":
                self.channels = {c["topic"]: c for c in data["channels"]}

    def subscribe(self, *topics: str) -> None:
        self.topics = list(topics)
        wanted = [{"id": i, "channelId": self.channels[t]["id"]} for i, t in enumerate(topics)]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def control(
        self, command: int, rate: float, seek_ns: int | None = None, name: str = "r"
    ) -> None:
        body = struct.pack(
            "<BBfBQI", 3, command, rate, seek_ns is not None, seek_ns or 0, len(name)
        )
        self._socket.send(body + name.encode())

    def event(self) -> tuple[str, Any]:
        """The next message (topic, log time [ns], payload), time or state."""
        while True:
            received = self._socket.recv()
            if isinstance(received, str):
                continue
            if received[0] == MESSAGE:
                number, at = struct.unpack_from("<IQ", received, 1)
                return "message", (self.topics[number], at, received[13:])
            if received[0] == TIME:
                return "time", struct.unpack_from("<Q", received, 1)[0]
            if received[0] == STATE:
                status, at, rate, jumped, size = struct.unpack_from("<BQfBI", received, 1)
                state = {"status": status, "at": at, "rate": rate, "jumped": bool(jumped)}
                return "state", {**state, "name": received[19 : 19 + size].decode()}

    def messages(self, count: int) -> list[tuple[str, int, bytes]]:
        """The next messages, so many: topic, log time [ns], payload."""
        return [self.until("message")[1] for _ in range(count)]

    def until(self, kind: str, enough: Any = lambda _: True) -> tuple[list[Any], Any]:
        """Messages on the way to the first event of a kind that is enough; and that event."""
        messages = []
        while True:
            what, event = self.event()
            if what == "message":
                messages.append(event)
            if what == kind and enough(event):
                return messages, event


@contextmanager
def client(url: str) -> Iterator[Client]:
    names = ["foxglove.sdk.v1"]
    # without bounds: a queue that is full keeps the answer to the farewell out, for ten seconds
    options = {"max_size": None, "max_queue": None, "open_timeout": None, "ping_interval": None}
    with connect(url, subprotocols=names, **options) as socket:  # type: ignore[arg-type]
        assert socket.subprotocol == names[0]
        yield Client(socket)
