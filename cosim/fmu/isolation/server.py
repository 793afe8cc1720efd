"""What the process of an isolated slave does: it loads the FMU, and makes the calls asked for."""

from __future__ import annotations

import contextlib
import ctypes
import os
import socket
import threading
from collections.abc import Sequence
from typing import Any, Final

from cosim.core import FrameError, Frames, SharedMemory
from cosim.fmu.binary import Loadable, load_slave
from cosim.fmu.call_watch import watch_calls
from cosim.fmu.isolation.channel import declared, make_server
from cosim.fmu.isolation.requests import (
    Asked,
    CallBegun,
    CallEnded,
    FromSlave,
    Line,
    MethodReturned,
    Ready,
    failure,
)
from cosim.fmu.messages import register_sink
from cosim.fmu.unpacking import adopt_folder


def main(end: socket.socket, descriptors: Sequence[int], size: int, library: str) -> None:
    """Serve one slave until the master closes the connection.

    Parameters
    ----------
    end : the connection to the master.
    descriptors : of the memory, and of own and other bell where there is no futex.
    size : of the memory [bytes].
    library : path of the compiled channel.c.
    """
    memory, *bells = descriptors
    shared = SharedMemory(memory, size)
    os.close(memory)
    own, other = bells or (-1, -1)
    calls = declared(ctypes.CDLL(library))
    _Servant(Frames(end, Asked), calls, shared, (own, other)).serve()


_OWN: Final = ("load", "make_instance", "provide")
"""Methods of the server; all others are those of the slave."""


class _Servant:
    """Serves one slave."""

    def __init__(
        self, frames: Frames, calls: Any, memory: SharedMemory, bells: tuple[int, int]
    ) -> None:
        self._frames, self._calls, self._memory = frames, calls, memory
        self._server = make_server(memory, bells)
        self._address = ctypes.addressof(self._server)
        self._guard = threading.Lock()
        self._slave: Any = None

    def serve(self) -> None:
        """Do what the master asks for, until it closes the connection."""
        watch_calls(self)
        self._send(Ready())
        while True:
            self._calls.serve(self._address)
            try:
                asked = self._frames.receive()
            except (EOFError, OSError, FrameError):
                return
            number, method, arguments, options = asked.parts()
            try:
                do = getattr(self if method in _OWN else self._slave, method)
                self._send(MethodReturned(number, do(*arguments, **options)))
            except Exception as error:  # noqa: BLE001 - raised in the other process
                self._send(failure(number, error))

    def begin(self, _component: str, call: str) -> None:
        """Tell that a call begins that is none of the loop."""
        self._send(CallBegun(call))

    def end(self) -> None:
        """Tell that it has returned."""
        self._send(CallEnded())

    def load(self, binary: Loadable, component: str, where: str) -> None:
        """Load the FMU, from the folder where the master has unpacked it."""
        adopt_folder(binary.folder.parent)
        self._slave = load_slave(binary, component, where)

    def make_instance(self, **given: Any) -> None:
        """Instantiate; log lines go to the master."""
        environment = register_sink(self._slave.instanceName, self._line)
        self._slave.make_instance(environment, **given)
        self._server.component = self._slave.component

    def provide(self, name: str, number: int) -> None:
        """Look up a function; one with a number is called over the shared memory from now on."""
        address = self._slave.address(name)
        if number:
            self._server.functions[number] = address

    def _line(self, status: int, category: str, message: str) -> None:
        """Tell a log line; an FMU may log from a thread of its own."""
        self._send(Line(status, category, message))
        self._calls.announce_line(self._address)

    def _send(self, message: FromSlave) -> None:
        with self._guard, contextlib.suppress(OSError):  # the master is gone, and soon this one
            self._frames.send(message)
