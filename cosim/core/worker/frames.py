"""Typed messages between a process and its worker; the parent never waits for one.

A frame is its length, four bytes, and a message in msgpack: numbers, texts, bytes, and structures
of these. It is read as one of the types that are expected and as nothing else, so that whatever a
foreign program writes into the socket becomes a message of these types or a `FrameError`.
"""

from __future__ import annotations

import math
import os
import select
import socket
import struct
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from ctypes import c_void_p
from typing import Any, Final, NoReturn

import msgspec
import numpy as np

MOST_BYTES: Final = 1 << 28
"""Of a frame: the state of an FMU is the largest thing that is sent."""
_HEAD: Final = struct.Struct("<I")
_AT_ONCE: Final = 1 << 16
_MOST_READ: Final = 1 << 22
"""What is read before a message is looked at: the reader has limits to check."""
_ADDRESS: Final = 1


class FrameError(Exception):
    """What has arrived is no message, or one that is too long."""


class Frames:
    """One end of a socket for messages.

    Parameters
    ----------
    end : the socket, which is closed with this object.
    received : the type of the messages that arrive, such as a union of `msgspec.Struct`s.
    takes_descriptors : file descriptors may come with a message: only in the worker, since whoever
        sends them decides what they are.
    most : bytes of a message that arrives.

    Attributes
    ----------
    descriptors : those that have arrived and that nobody has taken, in order.
    """

    def __init__(
        self,
        end: socket.socket,
        received: Any,
        *,
        takes_descriptors: bool = False,
        most: int = MOST_BYTES,
    ) -> None:
        end.settimeout(0.0)
        self._end, self._most, self._takes_descriptors = end, most, takes_descriptors
        self._encoder = msgspec.msgpack.Encoder(enc_hook=_encoded)
        self._decoder = msgspec.msgpack.Decoder(received, ext_hook=_decoded)
        self._arrived = bytearray()
        self._waiting: deque[tuple[memoryview, tuple[int, ...]]] = deque()
        self._ended = False
        self.descriptors: deque[int] = deque()

    @property
    def closed(self) -> bool:
        """Whether it is closed."""
        return self._end.fileno() < 0

    def fileno(self) -> int:
        """Return the descriptor, for a selector."""
        return self._end.fileno()

    def close(self) -> None:
        """Close it; what waits to be sent is forgotten."""
        for _, descriptors in self._waiting:
            _close(descriptors)
        self._waiting.clear()
        self._end.close()

    def send(self, message: Any, descriptors: tuple[int, ...] = (), *, wait: bool = True) -> None:
        """Send a message, with copies of file descriptors.

        wait : until it is sent; else what the other process does not take yet is kept, and `flush`
            goes on with it.

        Raises
        ------
        OSError : the other process is gone.
        FrameError : the message is too long.
        """
        content = self._encoder.encode(message)
        if len(content) > MOST_BYTES:
            raise FrameError(f"a message of {len(content)} bytes; at most {MOST_BYTES} are sent")
        data = memoryview(_HEAD.pack(len(content)) + content)
        self._waiting.append((data, tuple(map(os.dup, descriptors))))
        self.flush(wait=wait)

    def flush(self, *, wait: bool = False) -> bool:
        """Send what waits to be sent, as far as the other process takes it; whether all is sent.

        Raises
        ------
        OSError : the other process is gone.
        """
        while self._waiting:
            data, descriptors = self._waiting[0]
            try:
                if descriptors:
                    sent = socket.send_fds(self._end, [data[:_AT_ONCE]], list(descriptors))
                else:
                    sent = self._end.send(data)
            except BlockingIOError:
                if not wait:
                    return False
                _ready([self._end.fileno()], select.POLLOUT, None)
                continue
            _close(descriptors)
            if sent < len(data):
                self._waiting[0] = (data[sent:], ())
            else:
                self._waiting.popleft()
        return True

    def take(self) -> Any:
        """Return the next message that has arrived, None if there is none; does not wait.

        Raises
        ------
        EOFError : no message is left, and none will come.
        OSError : the connection has failed.
        FrameError : what has arrived is no message.
        """
        found = self._next()
        if found is None and not self._ended:
            self._read()
            found = self._next()
        if found is None and self._ended:
            raise EOFError
        return found

    def receive(self, timeout_s: float | None = None) -> Any:
        """Return the next message as soon as it is there; None after a time without one.

        Raises
        ------
        EOFError, OSError, FrameError : as `take`.
        """
        while (found := self.take()) is None:
            if not _ready([self._end.fileno()], select.POLLIN, timeout_s):
                return None
        return found

    def _read(self) -> None:
        """Read what has arrived, but no more than is to be looked at at once."""
        begun = len(self._arrived)
        while len(self._arrived) - begun < _MOST_READ:
            try:
                if self._takes_descriptors:
                    data, descriptors, _, _ = socket.recv_fds(self._end, _AT_ONCE, 16)
                    self.descriptors.extend(descriptors)
                else:
                    data = self._end.recv(_AT_ONCE)
            except BlockingIOError:
                return
            if not data:
                self._ended = True
                return
            self._arrived += data
            if len(data) < _AT_ONCE:
                return

    def _next(self) -> Any | None:
        if len(self._arrived) < _HEAD.size:
            return None
        (size,) = _HEAD.unpack_from(self._arrived)
        if size > self._most:
            _refuse(f"a message of {size} bytes was announced; at most {self._most} are read")
        end = _HEAD.size + size
        if len(self._arrived) < end:
            return None
        content = bytes(memoryview(self._arrived)[_HEAD.size : end])
        del self._arrived[:end]
        try:
            return self._decoder.decode(content)
        except (msgspec.MsgspecError, RecursionError, UnicodeDecodeError, ValueError) as error:
            raise FrameError(f"what arrived is no message: {error}") from error


def _refuse(what: str) -> NoReturn:
    raise FrameError(what)


def _encoded(thing: Any) -> Any:
    """Return what no type of msgpack is: an address, a scalar of NumPy."""
    if isinstance(thing, c_void_p):
        return msgspec.msgpack.Ext(_ADDRESS, str(thing.value or 0).encode())
    if isinstance(thing, np.generic):
        return thing.item()
    raise NotImplementedError(f"a {type(thing).__name__} is not sent")


def _decoded(code: int, data: memoryview) -> Any:
    if code != _ADDRESS:
        raise ValueError(f"an unknown kind of value, {code}")
    return c_void_p(int(bytes(data[:_MOST_DIGITS])))


_MOST_DIGITS: Final = 20


def ready_to_read(sources: Sequence[Any], timeout_s: float | None = None) -> list[Any]:
    """Wait until one of some descriptors, or of what has one, can be read; return those."""
    numbered = {one if isinstance(one, int) else one.fileno(): one for one in sources}
    return [numbered[number] for number in _ready(list(numbered), select.POLLIN, timeout_s)]


def _ready(descriptors: Sequence[int], events: int, timeout_s: float | None) -> list[int]:
    poller = select.poll()  # descriptors may be of any number
    for descriptor in descriptors:
        poller.register(descriptor, events)
    # rounded up: a wait that ends too early is made again at once
    most = None if timeout_s is None else math.ceil(max(0.0, timeout_s * 1e3))
    return [descriptor for descriptor, _ in poller.poll(most)]


def _close(descriptors: tuple[int, ...]) -> None:
    for descriptor in descriptors:
        with suppress(OSError):
            os.close(descriptor)
