"""Read Mach-O libraries (macOS) with macholib."""

from __future__ import annotations

import io
from itertools import islice
from types import MappingProxyType
from typing import Any

from macholib import mach_o
from macholib.MachO import MachO

from cosim.fmu.inspect.image import MOST_SYMBOLS, Image, NotALibraryError
from cosim.fmu.inspect.platforms import Machine

_MACHINES = MappingProxyType({0x01000007: "x86_64", 7: "x86", 0x0100000C: "aarch64"})
_N_STAB, _N_TYPE, _N_EXT = 0xE0, 0x0E, 0x01
_UNDEFINED = 0


class _FromMemory(MachO):  # type: ignore[misc]
    """A Mach-O file in memory; macholib itself opens files by name only."""

    def __init__(self, stream: io.BytesIO) -> None:
        self.graphident = self.filename = self.loader_path = ""
        self.fat = None
        self.headers: list[Any] = []
        self.allow_unknown_load_commands = True
        self.load(stream)


def read_macho(stream: io.BytesIO) -> list[Image]:
    """Return the images in a Mach-O file: one for each architecture.

    Raises
    ------
    NotALibraryError : a program or an object file.
    """
    return [_image(header, stream) for header in islice(_FromMemory(stream).headers, 16)]


def _image(header: Any, stream: io.BytesIO) -> Image:
    if header.header.filetype not in (mach_o.MH_DYLIB, mach_o.MH_BUNDLE):
        raise NotALibraryError(
            f"a Mach-O file of type {int(header.header.filetype)}, not a library"
        )
    libraries, search = [], []
    for load, command, data in header.commands:
        if load.cmd in (mach_o.LC_LOAD_DYLIB, mach_o.LC_LOAD_WEAK_DYLIB, mach_o.LC_REEXPORT_DYLIB):
            libraries.append(_path(data))
        elif load.cmd == mach_o.LC_RPATH:
            # the path starts `path` bytes after the command; macholib has cut 12 of them
            search.append(_path(data[max(0, int(command.path) - 12) :]))
    exports, imports = _symbols(header, stream)
    machine = int(header.header.cputype)
    return Image(
        format="Mach-O",
        platform=Machine("darwin", _MACHINES.get(machine, f"cpu {machine:#x}")),
        exports=exports or None,
        imports=imports,
        libraries=tuple(libraries),
        search=tuple(search),
    )


def _symbols(header: Any, stream: io.BytesIO) -> tuple[frozenset[str], frozenset[str]]:
    """Return the defined and the undefined external symbols, without C's leading underscore.

    A stripped library keeps only the undefined ones here: it says nothing of what it defines.
    """
    table = header.getSymbolTableCommand()
    if table is None:
        return frozenset(), frozenset()
    stream.seek(header.offset + int(table.stroff))
    strings = stream.read(int(table.strsize))
    stream.seek(header.offset + int(table.symoff))
    # MH_MAGIC is as the bytes stand in the file, and differs by their order
    wide = header.mach_header is mach_o.mach_header_64
    entry = mach_o.nlist_64 if wide else mach_o.nlist
    exports: set[str] = set()
    imports: set[str] = set()
    for _ in range(min(int(table.nsyms), MOST_SYMBOLS)):
        symbol = entry.from_fileobj(stream, _endian_=header.endian)
        kind = int(symbol.n_type)
        if kind & _N_STAB or not kind & _N_EXT:
            continue
        start = int(symbol.n_un)
        name = strings[start : strings.find(b"\0", start)].decode("utf-8", "replace")
        undefined = kind & _N_TYPE == _UNDEFINED
        (imports if undefined else exports).add(name.removeprefix("_"))
    return frozenset(exports), frozenset(imports)


def _path(data: bytes) -> str:
    return bytes(data).partition(b"\0")[0].decode("utf-8", "replace")
