"""Log messages of FMUs: C callbacks pass each to the sink of its instance.

A message of FMI 1 or 2 is a format with C arguments, which neither ctypes nor cffi can read; FMPy
ships a small library that formats it. That library has one receiver per process, so a copy of it is
loaded here for each version. The number of an FMI 2 instance is passed as its environment; FMI 1
has none, so that the name of the instance says which one it is.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import threading
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import fmpy
import fmpy.logging
from fmpy import fmi1, fmi2

from cosim.core import once
from cosim.fmu.returned import shortened
from cosim.fmu.unpacking import own_folder

LogSink = Callable[[str, str, str], None]
"""Takes (level, message, category): level is debug, info, warning, error or fatal; the category is
the FMU's own, or ""."""
MessageSink = Callable[[int, str, str], None]
"""Takes (status, category, message)."""

LEVELS: Final = MappingProxyType({0: "info", 1: "warning", 2: "warning", 3: "error", 4: "fatal"})
_sinks: dict[int, _Receiver] = {}
_numbers = count(1)


class _Receiver(NamedTuple):
    """A sink, the name of its instance, and the thread that made that."""

    name: str
    sink: MessageSink
    thread: int


def register_sink(name: str, sink: MessageSink) -> int:
    """Pass the messages of an instance to `sink`; return the number to use as its environment."""
    number = next(_numbers)
    _sinks[number] = _Receiver(name, sink, threading.get_ident())
    return number


def unregister_sink(number: int) -> None:
    """Stop passing messages to the sink of this number."""
    _sinks.pop(number, None)


def sink_of(number: int) -> MessageSink | None:
    """Return the sink of this number; None if its messages are passed on no longer."""
    found = _sinks.get(number)
    return None if found is None else found.sink


@fmi2.fmi2CallbackLoggerTYPE  # type: ignore[untyped-decorator]
def _fmi2_logger(
    environment: int | None, name: bytes, status: int, category: bytes, text: bytes
) -> None:
    _dispatch(environment, name, status, category, text)


@fmi1.fmi1CallbackLoggerTYPE  # type: ignore[untyped-decorator]
def _fmi1_logger(_: int | None, name: bytes, status: int, category: bytes, text: bytes) -> None:
    _dispatch(None, name, status, category, text)


def _dispatch(
    environment: int | None, name: bytes, status: int, category: bytes, text: bytes
) -> None:
    found = _sinks.get(environment or 0)
    if found is None:  # FMI 1, and FMUs that do not pass the environment that they were given
        called = shortened(name)
        alike = [one for one in list(_sinks.values()) if one.name == called]
        # several threads may run components of one name
        alike.sort(key=lambda one: one.thread != threading.get_ident())
        found = alike[0] if alike else None
    if found is not None:
        found.sink(status, shortened(category), shortened(text))


def fmi3_logger(environment: int) -> Callable[[int | None, int, bytes, bytes], None]:
    """Make the receiver of the messages of an FMI 3 instance (fmi3LogMessageCallback)."""

    def receive(_environment: int | None, status: int, category: bytes, message: bytes) -> None:
        _dispatch(environment, b"", status, category, message)

    return receive


@once
def _formatting(folder: Path, major: int) -> Any:
    """Load a copy of FMPy's formatting library from `folder`, which belongs to this process."""
    source = Path(fmpy.logging.logging._name)  # noqa: SLF001 - where it was loaded from
    # the folder may be another process's; a library that is loaded is never written again
    copy = folder / f"logger{major}-{os.getpid()}{source.suffix}"
    shutil.copyfile(source, copy)
    return ctypes.CDLL(str(copy))


def fmi2_callbacks(environment: int, *, formats: bool) -> Any:
    """Make the fmi2CallbackFunctions of an instance; keep them as long as it lives.

    `formats`: whether its messages are formats with arguments, or plain texts.
    """
    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _fmi2_logger
    callbacks.allocateMemory = _allocate
    callbacks.freeMemory = _release
    callbacks.componentEnvironment = environment
    if formats:
        _formatting(own_folder(), 2).addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


def fmi1_callbacks() -> Any:
    """Make the fmiCallbackFunctions of an instance; keep them as long as it lives.

    Without stepFinished, which is NULL, it may not step in the background.
    """
    callbacks = fmi1.fmi1CallbackFunctions()
    callbacks.logger = _fmi1_logger
    callbacks.allocateMemory = ctypes.cast(fmpy.calloc, fmi1.fmi1CallbackAllocateMemoryTYPE)
    callbacks.freeMemory = ctypes.cast(fmpy.free, fmi1.fmi1CallbackFreeMemoryTYPE)
    _formatting(own_folder(), 1).addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


_allocate = ctypes.cast(fmpy.calloc, fmi2.fmi2CallbackAllocateMemoryTYPE)
_release = ctypes.cast(fmpy.free, fmi2.fmi2CallbackFreeMemoryTYPE)
_VARIABLE: Final = re.compile(r"#([ribs])(\d+)#|##")
_FMI2_LETTERS: Final = MappingProxyType(
    {"r": "Real", "i": "Integer", "b": "Boolean", "s": "String"}
)


def with_names(message: str, names: Callable[[str, int], str | None]) -> str:
    """Replace references such as #r12# in a message of FMI 2 by the names of the variables."""

    def written(found: re.Match[str]) -> str:
        if found[0] == "##":
            return "#"
        return names(_FMI2_LETTERS[found[1]], int(found[2])) or found[0]

    return _VARIABLE.sub(written, message)
