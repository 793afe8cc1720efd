"""Read PE libraries (Windows) with pefile."""

from __future__ import annotations

import io
from types import MappingProxyType
from typing import Any

import pefile

from cosim.fmu.inspect.image import Image, NotALibraryError
from cosim.fmu.inspect.platforms import Machine

_MACHINES = MappingProxyType({0x8664: "x86_64", 0x014C: "x86", 0xAA64: "aarch64"})
_IS_DLL = 0x2000
_DIRECTORIES = ("IMAGE_DIRECTORY_ENTRY_EXPORT", "IMAGE_DIRECTORY_ENTRY_IMPORT")


def read_pe(stream: io.BytesIO) -> list[Image]:
    """Return the image in a PE file.

    Raises
    ------
    NotALibraryError : a program.
    """
    with pefile.PE(data=stream.getvalue(), fast_load=True) as pe:
        header: Any = pe.FILE_HEADER
        if not header.Characteristics & _IS_DLL:
            raise NotALibraryError("a Windows program, not a library")
        pe.parse_data_directories([pefile.DIRECTORY_ENTRY[name] for name in _DIRECTORIES])
        exported = getattr(pe, "DIRECTORY_ENTRY_EXPORT", None)
        imported = getattr(pe, "DIRECTORY_ENTRY_IMPORT", [])
        machine = _MACHINES.get(header.Machine, f"machine {header.Machine:#06x}")
        return [
            Image(
                format="PE",
                platform=Machine("windows", machine),
                exports=frozenset(_text(s.name) for s in (exported.symbols if exported else ())),
                imports=frozenset(_text(s.name) for library in imported for s in library.imports),
                libraries=tuple(_text(library.dll) for library in imported),
            )
        ]


def _text(name: bytes | None) -> str:
    return "" if name is None else name.decode("utf-8", "replace")
