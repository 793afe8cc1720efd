"""Read and set places in nested data by path: `links.uplink.delay`, `connections[0].link`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import MutableMapping
from typing import Any

from cosim.core import InputError, KeyPath

_PIECE = re.compile(
    r"""(?P<dot>\.)?(?:"(?P<quoted>[^"]+)"|(?P<bare>[^."\[\]]+)|\[(?P<place>\d+)\])"""
)
_COPY = re.compile(r"^(components|links)\.([A-Za-z][A-Za-z0-9_-]*)\[(\d+)\]")
_PARAMETER = re.compile(r"^components\.(?P<component>[^.\[\]\"]+)\.parameters\.(?P<name>.+)$")
_BARE = re.compile(r"""[^\s"'\[\]{}=#][^"'\[\]{}=#]*""")


def split(path: str) -> KeyPath:
    """Split a path into its keys; a number in brackets is a place in a list, from 0.

    The parameters of a component are one flat table; their names need no quotes. Copy 3 of a
    component or link is `components.vehicle[3]`, which is `components.vehicle_3`.

    Raises
    ------
    InputError : not a path.
    """
    path = _COPY.sub(r"\1.\2_\3", path)
    parameter = _PARAMETER.match(path)
    if parameter is not None:
        name = parameter["name"]
        return ("components", parameter["component"], "parameters", name.strip('"'))
    keys: list[str | int] = []
    end = 0
    while end < len(path):
        piece = _PIECE.match(path, end)
        named = piece is not None and piece["place"] is None
        if piece is None or bool(piece["dot"]) != (named and bool(keys)):
            break
        keys.append(int(piece["place"]) if not named else piece["quoted"] or piece["bare"])
        end = piece.end()
    if end < len(path) or not keys or isinstance(keys[0], int):
        raise InputError(
            "not a path",
            where=path or None,
            expected='keys with dots between them, as in links.uplink.delay; "a.b" for a key '
            "with a dot, [0] for a place in a list",
            got=repr(path),
        )
    return tuple(keys)


def setting(text: str) -> tuple[KeyPath, Any]:
    """Parse `KEY=VALUE` into path and value: TOML, or a bare word or quantity.

    Raises
    ------
    InputError : not a setting.
    """
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise InputError(
            "not a setting",
            where=f"`set` {text}",
            expected="KEY=VALUE, as in links.uplink.delay=0.4 or run.step='50 ms'",
        )
    try:
        return split(name.strip()), tomllib.loads(f"value = {value.strip()}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        if _BARE.fullmatch(value.strip()):
            return split(name.strip()), value.strip()
        raise InputError(
            "the value of a setting must be written as in TOML",
            where=f"`set` {text}",
            expected="a number, true, false, a word, [..] or {..}",
            got=value,
        ) from error


def put(data: MutableMapping[str, Any], path: KeyPath, value: Any, where: str) -> None:
    """Set the value at a path; missing tables on the way are made.

    Raises
    ------
    InputError : a missing place in a list, or a path through something that is not a table.
    """
    *way, last = path
    here: Any = data
    for key in way:
        following = inside(here, key, where)
        if following is None:
            following = here[key] = {}
        here = following
    inside(here, last, where)
    here[last] = value


def remove(data: MutableMapping[str, Any], path: KeyPath, where: str) -> None:
    """Remove the value at a path; an InputError if there is none."""
    here: Any = data
    for key in path[:-1]:
        here = inside(here, key, where)
    if not isinstance(here, dict) or path[-1] not in here:
        known = list(here) if isinstance(here, dict) else []
        raise InputError.unknown("key", str(path[-1]), known, where=where)
    del here[path[-1]]


def inside(here: Any, key: str | int, where: str) -> Any:
    """Return the value under a key; None if the table does not have it."""
    if isinstance(key, int):
        if not isinstance(here, list):
            raise InputError("a number in brackets needs a list", where=where, got=kind_of(here))
        if key >= len(here):
            raise InputError(
                f"there is no place {key}", where=where, expected=f"0 to {len(here) - 1}"
            )
        return here[key]
    if not isinstance(here, dict):
        raise InputError(f"{key!r} is not inside a table", where=where, got=kind_of(here))
    return here.get(key)


def kind_of(value: Any) -> str:
    """Describe a value in a message."""
    return f"{value!r}"[:60] if not isinstance(value, dict) else "a table"
