"""What the process of an isolated slave does: it loads the FMU, and makes the calls asked for."""

from __future__ import annotations

import contextlib
import ctypes
import os
import pickle
import threading
from multiprocessing.connection import Connection
from typing import Any, Final

from cosim.core import flush_output, prepare_for_foreign_code
from cosim.fmu.binary import Binary, load_slave
from cosim.fmu.call_watch import watch_calls
from cosim.fmu.isolation.channel import SharedMemory, declared, make_server
from cosim.fmu.isolation.messages import BEGIN, END, LINE, RAISED, READY, RETURNED, packed, unpacked
from cosim.fmu.messages import register_sink
from cosim.fmu.unpacking import adopt_folder


def main(
    connection: int | str,
    memory: int | str,
    own_bell: int | str,
    other_bell: int | str,
    size: int | str,
    parent: int | str,
    library: str,
) -> None:
    """Serve one slave until the master closes the connection, then leave; never returns.

    Parameters
    ----------
    connection, memory, own_bell, other_bell : file descriptors; -1 for no bell.
    size : of the memory [bytes].
    parent : number of the process of the master; this one ends with it, even in a call.
    library : path of the compiled channel.c.
    """
    prepare_for_foreign_code()
    calls = declared(ctypes.CDLL(library))
    try:
        if not calls.watch_parent(int(parent)):
            shared = SharedMemory(int(memory), int(size))
            os.close(int(memory))
            bells = int(own_bell), int(other_bell)
            _Servant(Connection(int(connection)), calls, shared, bells).serve()
    finally:
        flush_output()
        os._exit(0)


_OWN: Final = ("load", "make_instance", "provide")
"""Methods of the server; all others are those of the slave."""


class _Servant:
    """Serves one slave."""

    def __init__(
        self, connection: Connection, calls: Any, memory: SharedMemory, bells: tuple[int, int]
    ) -> None:
        self._connection, self._calls, self._memory = connection, calls, memory
        self._server = make_server(memory, bells)
        self._address = ctypes.addressof(self._server)
        self._guard = threading.Lock()
        self._slave: Any = None

    def serve(self) -> None:
        """Do what the master asks for, until it closes the connection."""
        watch_calls(self)
        self._send(READY)
        while True:
            self._calls.serve(self._address)
            try:
                number, method, arguments, options = unpacked(self._connection.recv_bytes())
            except (EOFError, OSError):
                return
            try:
                do = getattr(self if method in _OWN else self._slave, method)
                reply = packed(RETURNED, number, do(*arguments, **options))
            except Exception as error:  # noqa: BLE001 - raised in the other process
                reply = _raised(number, error)
            self._write(reply)

    def begin(self, _component: str, call: str) -> None:
        """Tell that a call begins that is none of the loop."""
        self._send(BEGIN, call)

    def end(self) -> None:
        """Tell that it has returned."""
        self._send(END)

    def load(self, binary: Binary, component: str, where: str) -> None:
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
        self._send(LINE, status, category, message)
        self._calls.announce_line(self._address)

    def _send(self, *message: Any) -> None:
        self._write(packed(*message))

    def _write(self, data: bytes) -> None:
        with self._guard, contextlib.suppress(OSError):  # the master is gone, and soon this one
            self._connection.send_bytes(data)


def _raised(number: int, error: Exception) -> bytes:
    try:
        return packed(RAISED, number, error)
    except (pickle.PicklingError, TypeError, AttributeError):
        return packed(RAISED, number, RuntimeError(f"{type(error).__name__}: {error}"))
