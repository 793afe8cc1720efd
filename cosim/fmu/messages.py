"""What FMUs say: one C callback per FMI version and process, which finds whose message it is.

FMI 2 passes a format and its arguments, which neither ctypes nor cffi can read; FMPy brings a
small library that puts them together. It knows one receiver per process, hence a copy of it
that is ours alone, and the number of the instance as its environment.
"""

from __future__ import annotations

import ctypes
import re
import shutil
from collections.abc import Callable
from functools import cache
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import fmpy
import fmpy.logging
from fmpy import fmi2, fmi3

from cosim.fmu.unpacking import own_folder

LogSink = Callable[[str, str, str], None]
"""Takes (level, message, category): level is debug, info, warning, error or fatal; the category
is the FMU's own, "" for none."""
MessageSink = Callable[[int, str, str], None]
"""Takes (status, category, message)."""

LEVELS: Final = MappingProxyType({0: "info", 1: "warning", 2: "warning", 3: "error", 4: "fatal"})
_sinks: dict[int, tuple[str, MessageSink]] = {}
_numbers = count(1)


def register_sink(name: str, sink: MessageSink) -> int:
    """Hear what the instance of that name says; its environment is the number given back."""
    number = next(_numbers)
    _sinks[number] = (name, sink)
    return number


def unregister_sink(number: int) -> None:
    """Hear nothing more."""
    _sinks.pop(number, None)


def _dispatch(
    environment: int | None, name: bytes, status: int, category: bytes, text: bytes
) -> None:
    found = _sinks.get(environment or 0)
    if found is None:  # some FMUs pass on anything but their environment
        called = _text(name)
        found = next((one for one in _sinks.values() if one[0] == called), None)
    if found is not None:
        found[1](status, _text(category), _text(text))


def _text(raw: bytes | None) -> str:
    return raw.decode("utf-8", "replace") if raw else ""


@fmi2.fmi2CallbackLoggerTYPE  # type: ignore[untyped-decorator]
def _fmi2_logger(
    environment: int, name: bytes, status: int, category: bytes, message: bytes
) -> None:
    _dispatch(environment, name, status, category, message)


@fmi3.fmi3LogMessageCallback  # type: ignore[untyped-decorator]
def fmi3_logger(environment: int, status: int, category: bytes, message: bytes) -> None:
    """fmi3LogMessageCallback, for all instances."""
    _dispatch(environment, b"", status, category, message)


@cache
def _formatting(folder: Path) -> Any:
    """Our copy of the library that puts messages together; the folder is this process's."""
    source = Path(fmpy.logging.logging._name)  # noqa: SLF001 - where it was loaded from
    copy = folder / f"logger{source.suffix}"
    shutil.copyfile(source, copy)
    return ctypes.CDLL(str(copy))


def fmi2_callbacks(environment: int, *, formats: bool) -> Any:
    """fmi2CallbackFunctions of an instance; to be kept as long as it lives.

    `formats` says whether its messages are formats with arguments, or texts.
    """
    callbacks = fmi2.fmi2CallbackFunctions()
    callbacks.logger = _fmi2_logger
    callbacks.allocateMemory = _allocate
    callbacks.freeMemory = _release
    callbacks.componentEnvironment = environment
    if formats:
        _formatting(own_folder()).addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


_allocate = ctypes.cast(fmpy.calloc, fmi2.fmi2CallbackAllocateMemoryTYPE)
_release = ctypes.cast(fmpy.free, fmi2.fmi2CallbackFreeMemoryTYPE)
_VARIABLE: Final = re.compile(r"#([ribs])(\d+)#|##")
_FMI2_LETTERS: Final = MappingProxyType(
    {"r": "Real", "i": "Integer", "b": "Boolean", "s": "String"}
)


def with_names(message: str, names: Callable[[str, int], str | None]) -> str:
    """A message of FMI 2 with the names of the variables that it writes as #r12#."""

    def written(found: re.Match[str]) -> str:
        if found[0] == "##":
            return "#"
        return names(_FMI2_LETTERS[found[1]], int(found[2])) or found[0]

    return _VARIABLE.sub(written, message)
