"""A shared library read by its headers alone; nothing of it is loaded.

Pure Python readers, on purpose: a damaged file ends in an exception, never in a crash.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cosim.fmu.inspect.elf import read_elf
from cosim.fmu.inspect.image import Image, NotALibraryError
from cosim.fmu.inspect.macho import read_macho
from cosim.fmu.inspect.pe import read_pe

_MAGIC: Mapping[bytes, Callable[[io.BytesIO], list[Image]]] = {
    b"\x7fELF": read_elf,
    b"MZ": read_pe,
    b"\xcf\xfa\xed\xfe": read_macho,
    b"\xce\xfa\xed\xfe": read_macho,
    b"\xca\xfe\xba\xbe": read_macho,
}


@dataclass(frozen=True, slots=True)
class Binary:
    """A library of an FMU: its images (several in a universal Mach-O file), or why there are none.

    Attributes
    ----------
    folder : below binaries/.
    name : its path inside the FMU.
    """

    folder: str
    name: str
    images: tuple[Image, ...]
    damage: str | None = None


def read_binary(folder: str, name: str, content: bytes) -> Binary:
    """The headers of a library; damage is told, never raised."""
    for magic, reader in _MAGIC.items():
        if content.startswith(magic):
            try:
                return Binary(folder, name, tuple(reader(io.BytesIO(content))))
            except NotALibraryError as error:
                return Binary(folder, name, (), str(error))
            except Exception as error:  # noqa: BLE001 - each reader has many ways to stumble
                return Binary(folder, name, (), f"{type(error).__name__}: {error}")
    return Binary(folder, name, (), f"it starts with {content[:4].hex() or 'nothing'}")
