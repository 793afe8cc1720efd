"""Compile own C for this machine at first use, and keep the library for later processes."""

from __future__ import annotations

import ctypes
import hashlib
import platform
import shlex
from functools import cache
from pathlib import Path

from platformdirs import user_cache_path

from cosim.core import say_once, write_whole
from cosim.fmu.export.native.compiler import STANDARD, host_compiler, shared_library
from cosim.fmu.export.native.platforms import host
from cosim.fmu.unpacking import own_folder


@cache
def compiled_library(name: str, source: bytes) -> ctypes.CDLL:
    """Return the library of a C file, from the user's cache or compiled now.

    Where the cache cannot be written, the library lives as long as the process, and standard error
    says so.

    Raises
    ------
    InputError : no C compiler, or it rejects the source.
    """
    command = shlex.join([*host_compiler(), *STANDARD])
    kind = f"{platform.platform()}\0{platform.machine()}\0{command}\0".encode()
    digest = hashlib.sha256(kind + source).hexdigest()[:24]
    file = f"{name}-{digest}{host().suffix}"
    path = user_cache_path("auv-cosim", appauthor=False) / file
    if not path.is_file():
        library = shared_library(name, {f"{name}.c": source}, [f"{name}.c"], host(), cross=False)
        path = _kept(path, library)
    return ctypes.CDLL(str(path))


def _kept(path: Path, library: bytes) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, library)
    except OSError as error:
        say_once(
            f"{path.parent} cannot be written ({error.strerror}): what is compiled is kept in a "
            "temporary folder, and compiled again by the next command; XDG_CACHE_HOME names "
            "another place"
        )
        path = own_folder() / path.name
        write_whole(path, library)
    return path
