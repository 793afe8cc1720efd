"""Load own C: the library that the wheel brings, or one compiled on this machine at first use."""

from __future__ import annotations

import ctypes
import hashlib
import platform
import shlex
from pathlib import Path

from cosim.core import cache_folder, once, say_once, write_whole
from cosim.fmu.compiled.prebuilt import prebuilt_file
from cosim.fmu.export.native.compiler import STANDARD, host_compiler, shared_library
from cosim.fmu.export.native.link_step import link_step_header
from cosim.fmu.export.native.target_platforms import Platform, host

_SOURCES = {
    "kernel": ("fmu/export/native/c/arithmetic.h", "network/delivery.c", "master/kernel.c"),
    "channel": ("fmu/isolation/channel.c",),
}
"""Their files, one after the other; the steps of a link stand in front of the kernel's."""


def library_source(name: str, *, futex: bool = True) -> bytes:
    """Return the C of a library of this package: the loops' "kernel", or the "channel" to slaves.

    `futex`: whether the channel sleeps on a futex, which Linux has.
    """
    package = Path(__file__).parents[2]
    source = b"".join(package.joinpath(file).read_bytes() for file in _SOURCES[name])
    if name == "kernel":
        source = link_step_header().encode() + source
    return source if futex else b"#define WITHOUT_FUTEX\n" + source


@once
def compiled_library(name: str, source: bytes) -> ctypes.CDLL:
    """Return the library of a C file: prebuilt, from the user's cache, or compiled now.

    Where the cache cannot be written, the library lives as long as the process, and standard error
    says so.

    Raises
    ------
    InputError : no C compiler, it rejects the source, or a damaged prebuilt library.
    """
    ready = prebuilt_file(_prebuilt_name(name, source, host()))
    if ready is not None:
        return ctypes.CDLL(str(ready))
    command = shlex.join([*host_compiler(), *STANDARD])
    kind = f"{platform.platform()}\0{platform.machine()}\0{command}\0".encode()
    digest = hashlib.sha256(kind + source).hexdigest()[:24]
    file = f"{name}-{digest}{host().suffix}"
    path = cache_folder() / file
    if not path.is_file():
        library = shared_library(name, {f"{name}.c": source}, [f"{name}.c"], host(), cross=False)
        path = _kept(path, library)
    return ctypes.CDLL(str(path))


def is_prebuilt(name: str, source: bytes) -> bool:
    """Whether `compiled_library` takes the library of a C file from the wheel."""
    return prebuilt_file(_prebuilt_name(name, source, host())) is not None


def write_library(name: str, source: bytes, folder: Path, target: Platform) -> None:
    """Cross-compile a C file to where `compiled_library` looks below the folder of a wheel.

    Raises
    ------
    InputError : no cross compiler, or it rejects the source.
    """
    path = folder / _prebuilt_name(name, source, target)
    library = shared_library(name, {f"{name}.c": source}, [f"{name}.c"], target, cross=True)
    write_whole(path, library)


def _prebuilt_name(name: str, source: bytes, target: Platform) -> str:
    """Return the path of a library below the folder of what is prebuilt; it names the source."""
    digest = hashlib.sha256(" ".join(STANDARD).encode() + b"\0" + source).hexdigest()[:24]
    return f"libraries/{target.tuple_name}/{name}-{digest}{target.suffix}"


def _kept(path: Path, library: bytes) -> Path:
    try:
        write_whole(path, library)
    except OSError as error:
        # what handles FMUs is loaded here: building a wheel does without it
        from cosim.fmu.unpacking import own_folder  # noqa: PLC0415

        say_once(
            f"{path.parent} cannot be written ({error.strerror}): what is compiled is kept in a "
            "temporary folder, and compiled again by the next command; XDG_CACHE_HOME names "
            "another place"
        )

        path = own_folder() / path.name
        write_whole(path, library)
    return path
