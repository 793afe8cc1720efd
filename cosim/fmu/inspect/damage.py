"""Tell whether a library is damaged, by its own headers: what they announce is not in the file.

A reader that fails proves nothing about the file; this does. Only lengths are compared, so that
no format variant that is unknown here counts as damage.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator

_MOST_PARTS = 65536  # segments, sections, commands: more are not looked at
_SEGMENT_32, _SEGMENT_64 = 0x1, 0x19
_LOADED = 1  # PT_LOAD


def damage_of(kind: str, content: bytes) -> str | None:
    """Return what of an ELF ("elf"), PE ("pe") or Mach-O ("macho") file is not there, or None."""
    parts = {"elf": _elf, "pe": _pe, "macho": _macho}[kind]
    try:
        for what, end in parts(content):
            if end > len(content):
                return f"{what} ends at byte {end} of {len(content)}"
    except struct.error:
        return f"its headers end after {len(content)} bytes"
    return None


def _elf(content: bytes) -> Iterator[tuple[str, int]]:
    """Give the program headers and the segments that are loaded, each with its end."""
    wide = content[4:5] == b"\2"
    order = ">" if content[5:6] == b"\2" else "<"
    start, size, count = (0x20, 54, 56) if wide else (0x1C, 42, 44)
    (table,) = struct.unpack_from(f"{order}{'Q' if wide else 'I'}", content, start)
    (entry,) = struct.unpack_from(f"{order}H", content, size)
    (number,) = struct.unpack_from(f"{order}H", content, count)
    yield "the table of segments", table + entry * number
    for i in range(min(number, _MOST_PARTS)):
        place = table + i * entry
        (kind,) = struct.unpack_from(f"{order}I", content, place)
        if wide:
            offset, length = struct.unpack_from(f"{order}Q16xQ", content, place + 8)
        else:
            offset, length = struct.unpack_from(f"{order}I8xI", content, place + 4)
        if kind == _LOADED:
            yield f"segment {i}", offset + length


def _pe(content: bytes) -> Iterator[tuple[str, int]]:
    """Give the section table and where each section starts: linkers cut the padding of the last."""
    (header,) = struct.unpack_from("<I", content, 0x3C)
    number, options = struct.unpack_from("<H12xH", content, header + 6)
    table = header + 24 + options
    yield "the table of sections", table + 40 * number
    for i in range(min(number, _MOST_PARTS)):
        length, start = struct.unpack_from("<II", content, table + 40 * i + 16)
        if length:
            yield f"section {i}", start + 1


def _macho(content: bytes, base: int = 0) -> Iterator[tuple[str, int]]:
    """Give the architectures, the load commands and the segments."""
    magic = content[base : base + 4]
    if magic == b"\xca\xfe\xba\xbe":
        (number,) = struct.unpack_from(">I", content, 4)
        for i in range(min(number, 16)):
            offset, length = struct.unpack_from(">II", content, 8 + 20 * i + 8)
            yield f"architecture {i}", offset + length
            yield from _macho(content, offset)
        return
    order = ">" if magic[:2] == b"\xfe\xed" else "<"
    wide = b"\xcf" in magic
    number, size = struct.unpack_from(f"{order}II", content, base + 16)
    place = base + (32 if wide else 28)
    yield "the load commands", place + size
    for _ in range(min(number, _MOST_PARTS)):
        command, length = struct.unpack_from(f"{order}II", content, place)
        if command in (_SEGMENT_32, _SEGMENT_64):
            form = f"{order}QQ" if command == _SEGMENT_64 else f"{order}II"
            at = place + (40 if command == _SEGMENT_64 else 32)
            offset, filled = struct.unpack_from(form, content, at)
            yield "a segment", base + offset + filled
        place += max(length, 8)
