"""Read the headers of a shared library without loading it.

The readers are pure Python, so that a damaged file raises an exception and never crashes. A fault
of a reader itself is reported apart from damage: it says nothing about the file. So is a reader
that is not installed: pyelftools, pefile and macholib are in the extra `check`.
"""

from __future__ import annotations

import importlib
import io
import struct
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cosim.fmu.inspect.image import Image, NotALibraryError

_MAGIC: Mapping[bytes, str] = {
    b"\x7fELF": "elf",
    b"MZ": "pe",
    b"\xcf\xfa\xed\xfe": "macho",
    b"\xce\xfa\xed\xfe": "macho",
    b"\xca\xfe\xba\xbe": "macho",
}
_PACKAGES = ("elftools", "pefile", "macholib")
# what pyelftools, pefile and macholib raise for a damaged file
_OF_DAMAGE = (
    *(struct.error, ValueError, OSError, EOFError),
    *(LookupError, ArithmeticError, AssertionError, MemoryError),
)
_OWN_OF_DAMAGE = {"ELFError", "PEFormatError"}


@dataclass(frozen=True, slots=True)
class Binary:
    """A library of an FMU: its images (several in a universal Mach-O file), or why it has none.

    Attributes
    ----------
    folder : below binaries/.
    name : its path inside the FMU.
    damage : what is wrong with the file.
    unread : the fault of the reader; it says nothing about the file.
    unexamined : the package that would read it, which is not installed.
    """

    folder: str
    name: str
    images: tuple[Image, ...]
    damage: str | None = None
    unread: str | None = None
    unexamined: str | None = None


def read_binary(folder: str, name: str, content: bytes) -> Binary:
    """Read the headers of a library; damage and faults of a reader are returned, never raised."""
    for magic, kind in _MAGIC.items():
        if content.startswith(magic):
            try:
                reader = _reader(kind)
            except ModuleNotFoundError as error:
                package = str(error.name).partition(".")[0]
                if package not in _PACKAGES:
                    raise
                return Binary(folder, name, (), unexamined=package)
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


def _reader(kind: str) -> Callable[[io.BytesIO], list[Image]]:
    """Return the reader of a format; ModuleNotFoundError where its package is not installed."""
    module = importlib.import_module(f"cosim.fmu.inspect.{kind}")
    found: Callable[[io.BytesIO], list[Image]] = getattr(module, f"read_{kind}")
    return found


def _is_damage(error: Exception) -> bool:
    """Whether a reader's library raised it, and of a type that it raises for damage."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    ours = str(frame.f_globals.get("__name__")).startswith("cosim.")
    own = {each.__name__ for each in type(error).__mro__} & _OWN_OF_DAMAGE
    return (isinstance(error, _OF_DAMAGE) or bool(own)) and not ours
