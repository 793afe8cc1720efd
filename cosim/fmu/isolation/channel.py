"""The shared memory of a channel, and the library (`channel.c`) that both processes call."""

from __future__ import annotations

import ctypes
import sys
from ctypes import c_char_p, c_int32, c_uint32, c_uint64, c_void_p
from functools import cache
from typing import Any, Final

from cosim.core import InputError, SharedMemory
from cosim.fmu.compiled.own_library import compiled_library, library_source

GONE: Final = -2147483647
"""The status of a proxy whose slave cannot answer; no status of FMI."""
DATA: Final = 256
"""Where references and values begin in the shared memory."""
FUTEX: Final = sys.platform == "linux"
"""Whether processes sleep on a futex; elsewhere on a pipe."""


class Channel(ctypes.Structure):
    """`Channel` of channel.c: what the proxies get as their component."""

    _fields_ = (
        ("shared", c_void_p),
        ("room", c_uint64),
        ("own", c_int32),
        ("other", c_int32),
        ("look", c_void_p),
        ("function", c_int32),
        ("given_up", c_int32),
        ("lines", c_uint32),
    )


class Server(ctypes.Structure):
    """`Server` of channel.c: the side of the slave."""

    _fields_ = (
        ("shared", c_void_p),
        ("component", c_void_p),
        ("functions", c_void_p * 64),
        ("taken", c_uint32),
        ("own", c_int32),
        ("other", c_int32),
    )


@cache
def channel_library() -> Any:
    """Return the library of channel.c; the first call may compile it.

    Raises
    ------
    InputError : no C compiler, it rejects the source, or a system without POSIX processes.
    """
    if sys.platform == "win32":
        raise InputError(
            "components cannot be isolated on this system",
            where="components",
            expected="Linux, or another system with POSIX processes and pipes",
            got="Windows",
            hint="isolate = false",
        )
    try:
        return declared(compiled_library("channel", library_source("channel", futex=FUTEX)))
    except InputError as error:
        raise InputError(
            "components cannot be isolated here",
            where="components",
            expected="a C compiler, once",
            got=error.got or error.what,
            hint="install one (Debian: apt install gcc), or isolate = false",
        ) from error


def declared(library: Any) -> Any:
    """Return the library with the types of its functions."""
    library.function_number.argtypes = [c_char_p]
    library.proxy_of.argtypes, library.proxy_of.restype = [c_int32], c_void_p
    library.function_name.argtypes, library.function_name.restype = [c_int32], c_char_p
    for name in ("announce_message", "announce_line", "serve"):
        function = getattr(library, name)
        function.argtypes, function.restype = [c_void_p], None
    return library


def reserve(size: int) -> tuple[SharedMemory, int]:
    """Reserve memory for a channel; return it and its file descriptor.

    Raises
    ------
    InputError : there is not so much.
    """
    try:
        return SharedMemory.reserve("cosim-channel", size)
    except OSError as error:
        raise InputError(
            "an isolated component has no memory to share",
            where="components",
            expected=f"{size / 1e6:.1f} MB",
            got=str(error),
            hint="a greater limit of file sizes (ulimit -f), or isolate = false",
        ) from error


def _address_of(memory: SharedMemory) -> int:
    return ctypes.addressof(ctypes.c_char.from_buffer(memory.mapping))


def make_channel(memory: SharedMemory, bells: tuple[int, int], look: int) -> Channel:
    """Make the master's side; `look` : address of int(int64_t), see `Channel` of channel.c."""
    return Channel(_address_of(memory), len(memory.mapping) - DATA, *bells, look)


def make_server(memory: SharedMemory, bells: tuple[int, int]) -> Server:
    """Make the side of the slave."""
    return Server(shared=_address_of(memory), own=bells[0], other=bells[1])
