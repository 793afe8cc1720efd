"""Places in nested data by dotted path: `links.uplink.delay`, `design.gain[0][1]`."""

from __future__ import annotations

import re
from collections.abc import Mapping, MutableMapping
from typing import Any

from cosim.errors import InputError

Key = str | int
_PIECE = re.compile(
    r"""(?P<dot>\.)?(?:"(?P<quoted>[^"]+)"|(?P<bare>[^."\[\]]+)|\[(?P<place>\d+)\])"""
)
_PARAMETER = re.compile(r"^components\.(?P<component>[^.\[\]\"]+)\.parameters\.(?P<name>.+)$")


def split(path: str) -> tuple[Key, ...]:
    """The keys of a path; a number in brackets is a place in a list, counted from 0.

    The parameters of a component are one flat table, whose names may be written without quotes.

    Raises
    ------
    InputError : it is no path.
    """
    parameter = _PARAMETER.match(path)
    if parameter is not None:
        name = parameter["name"]
        return ("components", parameter["component"], "parameters", name.strip('"'))
    keys: list[Key] = []
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
            where=path,
            expected='keys with dots between them, as in links.uplink.delay; "a.b" for a key '
            "with a dot, [0] for a place in a list",
            got=repr(path),
        )
    return tuple(keys)


def put(data: MutableMapping[str, Any], path: str, value: Any) -> None:
    """Set what stands at a path; tables on the way that are not there are made.

    Raises
    ------
    InputError : a place in a list that is not there, or a way through what is no table.
    """
    *way, last = split(path)
    here: Any = data
    for key in way:
        following = _inside(here, key, path)
        if following is None:
            following = here[key] = {}
        here = following
    _inside(here, last, path)
    here[last] = value


def _inside(here: Any, key: Key, path: str) -> Any:
    if isinstance(key, int):
        if not isinstance(here, list):
            raise InputError("there is no list to count in", where=path, got=_kind(here))
        if key >= len(here):
            raise InputError(
                f"there is no place {key}", where=path, expected=f"0 to {len(here) - 1}"
            )
        return here[key]
    if not isinstance(here, dict):
        raise InputError(f"{key!r} lies in what is no table", where=path, got=_kind(here))
    return here.get(key)


def look(data: Any, path: str) -> Any:
    """What stands at a path into figures; keys may hold dots themselves (`final.plant.eta.x`).

    Raises
    ------
    InputError : nothing stands there; says the nearest keys that do.
    """
    here, rest = data, list(split(path))
    while rest:
        if here is None:
            return None
        if isinstance(rest[0], int):
            here = _inside(here, rest.pop(0), path)
            continue
        if not isinstance(here, Mapping):
            raise InputError(f"{rest[0]!r} lies in what is no table", where=path, got=_kind(here))
        # the longest key that fits: values by `component.variable` are one table
        for n in range(len(rest), 0, -1):
            key = _joined(rest[:n])
            if key in here:
                here, rest = here[key], rest[n:]
                break
        else:
            raise InputError.unknown("figure", _joined(rest), here, where=path)
    return here


def _joined(keys: list[Key]) -> str:
    joined = "".join(f"[{k}]" if isinstance(k, int) else f".{k}" for k in keys)
    return joined.removeprefix(".")


def _kind(value: Any) -> str:
    return f"{value!r}"[:60] if not isinstance(value, dict) else "a table"
