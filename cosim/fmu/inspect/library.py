"""Read the headers of a shared library without loading it.

The readers are pure Python, so that a damaged file raises an exception and never crashes. A fault
of a reader itself is reported apart from damage: it says nothing about the file.
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
    """A library of an FMU: its images (several in a universal Mach-O file), or why it has none.

    Attributes
    ----------
    folder : below binaries/.
    name : its path inside the FMU.
    damage : what is wrong with the file.
    unread : the fault of the reader; it says nothing about the file.
    """

    folder: str
    name: str
    images: tuple[Image, ...]
    damage: str | None = None
    unread: str | None = None


def read_binary(folder: str, name: str, content: bytes) -> Binary:
    """Read the headers of a library; damage and faults of a reader are returned, never raised."""
    for magic, reader in _MAGIC.items():
        if content.startswith(magic):
            try:
                return Binary(folder, name, tuple(reader(io.BytesIO(content))))
            except NotALibraryError as error:
                return Binary(folder, name, (), str(error))
            except Exception as error:  # noqa: BLE001 - readers raise many kinds
                declared = f"{type(error).__name__}: {error}"
                if _is_damage(error):
                    return Binary(folder, name, (), declared)
                return Binary(folder, name, (), unread=declared)
    return Binary(folder, name, (), f"it starts with {content[:4].hex() or 'nothing'}")


def _is_damage(error: Exception) -> bool:
    """Whether a reader's library raised it, and of a type that it raises for damage."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    ours = str(frame.f_globals.get("__name__")).startswith("cosim.")
    return isinstance(error, _OF_DAMAGE) and not ours
