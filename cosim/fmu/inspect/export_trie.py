"""Read the export trie of a Mach-O library, which keeps its exports when symbols are stripped.

Each node: its own entry (length and data, empty where no name ends), the number of branches,
and for each branch a piece of a name and the offset of the next node. Numbers are ULEB128.
Format: `mach-o/loader.h` of macOS, above `dyld_info_command`.
"""

from __future__ import annotations

from cosim.fmu.inspect.image import MOST_SYMBOLS

_MOST_NAME = 4096


def exported_names(trie: bytes) -> frozenset[str]:
    """Return every name in the trie.

    Raises
    ------
    ValueError : a node points outside the trie or back to itself.
    """
    names: set[str] = set()
    seen: set[int] = set()
    waiting = [(0, b"")] if trie else []
    while waiting:
        place, name = waiting.pop()
        if place in seen or len(seen) > MOST_SYMBOLS or len(name) > _MOST_NAME:
            raise ValueError("a Mach-O file with a damaged export trie")
        seen.add(place)
        own, place = _uleb(trie, place)
        if own:
            names.add(name.decode("utf-8", "replace"))
        place += own
        branches = trie[place : place + 1]
        place += 1
        for _ in range(branches[0] if branches else 0):
            end = trie.find(b"\0", place)
            if end < 0:
                raise ValueError("a Mach-O file with a cut export trie")
            piece = trie[place:end]
            following, place = _uleb(trie, end + 1)
            waiting.append((following, name + piece))
    return frozenset(names)


def _uleb(data: bytes, place: int) -> tuple[int, int]:
    """Return a ULEB128 number and the offset after it."""
    value = 0
    for i in range(10):
        if place + i >= len(data):
            break
        byte = data[place + i]
        value |= (byte & 0x7F) << (7 * i)
        if byte < 0x80:
            return value, place + i + 1
    raise ValueError("a Mach-O file with a damaged export trie")
