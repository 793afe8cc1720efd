"""A shared library read by its headers alone; nothing of it is loaded.

Pure Python readers, on purpose: a damaged file ends in an exception, never in a crash. What a
reader stumbles over by a mistake of its own is told apart from that: it is no fault of the file.
"""

from __future__ import annotations

import io
import struct
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from elftools.common.exceptions import ELFError
from pefile import PEFormatError

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
# what pyelftools, pefile and macholib raise for a damaged file
_OF_DAMAGE = (
    *(ELFError, PEFormatError, struct.error, ValueError, OSError, EOFError),
    *(LookupError, ArithmeticError, AssertionError, MemoryError),
)


@dataclass(frozen=True, slots=True)
class Binary:
    """A library of an FMU: its images (several in a universal Mach-O file), or why there are none.

    Attributes
    ----------
    folder : below binaries/.
    name : its path inside the FMU.
    damage : what is wrong with the file.
    unread : what the reader stumbled over; it says nothing about the file.
    """

    folder: str
    name: str
    images: tuple[Image, ...]
    damage: str | None = None
    unread: str | None = None


def read_binary(folder: str, name: str, content: bytes) -> Binary:
    """The headers of a library; damage is told, never raised, and so is a mistake of a reader."""
    for magic, reader in _MAGIC.items():
        if content.startswith(magic):
            try:
                return Binary(folder, name, tuple(reader(io.BytesIO(content))))
            except NotALibraryError as error:
                return Binary(folder, name, (), str(error))
            except Exception as error:  # noqa: BLE001 - each reader has many ways to stumble
                declared = f"{type(error).__name__}: {error}"
                if _speaks_of_the_file(error):
                    return Binary(folder, name, (), declared)
                return Binary(folder, name, (), unread=declared)
    return Binary(folder, name, (), f"it starts with {content[:4].hex() or 'nothing'}")


def _speaks_of_the_file(error: Exception) -> bool:
    """Whether a reader's library raised it, as one that it raises for damage."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    ours = str(frame.f_globals.get("__name__")).startswith("cosim.")
    return isinstance(error, _OF_DAMAGE) and not ours
