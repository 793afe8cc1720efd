"""Read the headers of a shared library without loading it.

The readers are pure Python, so that a hostile file raises an exception and never crashes. What a
reader raises says nothing about the file: it is "unread", unless `damage_of` finds by the file's
own headers that a part of it is missing. A reader that is not installed is reported apart:
pyelftools, pefile and macholib are in the extra `check`.
"""

from __future__ import annotations

import importlib
import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cosim.fmu.inspect.damage import damage_of
from cosim.fmu.inspect.image import Image, NotALibraryError

_MAGIC: Mapping[bytes, str] = {
    b"\x7fELF": "elf",
    b"MZ": "pe",
    b"\xcf\xfa\xed\xfe": "macho",
    b"\xce\xfa\xed\xfe": "macho",
    b"\xfe\xed\xfa\xcf": "macho",
    b"\xfe\xed\xfa\xce": "macho",
    b"\xca\xfe\xba\xbe": "macho",
}
_PACKAGES = ("elftools", "pefile", "macholib")


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
    kind = next((kind for magic, kind in _MAGIC.items() if content.startswith(magic)), "")
    begin = f"it starts with {content[:4].hex() or 'nothing'}"
    text = content[:64].isascii()  # or nothing at all
    damage = damage_of(kind, content) if kind else begin if text else None
    if damage is not None:
        return Binary(folder, name, (), damage)
    if not kind:
        return Binary(folder, name, (), unread=f"{begin}, a format that is not read here")
    try:
        reader = _reader(kind)
    except ModuleNotFoundError as error:
        package = str(error.name).partition(".")[0]
        if package not in _PACKAGES:
            raise
        return Binary(folder, name, (), unexamined=package)
    damage = unread = None
    images: tuple[Image, ...] = ()
    try:
        images = tuple(reader(io.BytesIO(content)))
    except NotALibraryError as error:
        damage = str(error)
    except Exception as error:  # noqa: BLE001 - readers raise many kinds
        unread = f"{type(error).__name__}: {error}"
    return Binary(folder, name, images, damage, unread)


def _reader(kind: str) -> Callable[[io.BytesIO], list[Image]]:
    """Return the reader of a format; ModuleNotFoundError where its package is not installed."""
    module = importlib.import_module(f"cosim.fmu.inspect.{kind}")
    found: Callable[[io.BytesIO], list[Image]] = getattr(module, f"read_{kind}")
    return found
