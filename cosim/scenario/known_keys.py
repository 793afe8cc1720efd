"""Where the keys of a file may stand, by its JSON schema, and which of them a word is meant for."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from typing import Any

from cosim.scenario.origin import Path

_ANY = "NAME"
"""Stands in a place for a name that the author chooses."""


def suggestion(word: str, table: Path, schema: dict[str, Any]) -> str | None:
    """Return what a key that does not exist is meant for: one of its table, or of another.

    table : where the key stands; list indices and chosen names as they are.
    """
    keys = [(place, name) for place, names in _tables(schema, schema, ()) for name in names]
    own = [name for place, name in keys if _is_at(table, place)]
    near = difflib.get_close_matches(word, own, n=1)
    if near:
        return f"did you mean {near[0]}?"
    near = difflib.get_close_matches(word, [name for _, name in keys], n=1)
    places = sorted({".".join((*place, name)) for place, name in keys if name in near})
    return f"did you mean {' or '.join(places[:3])}?" if places else None


def _is_at(path: Path, place: tuple[str, ...]) -> bool:
    """Whether a path leads to a table of the schema."""
    words = [part for part in path if isinstance(part, str)]
    return len(words) == len(place) and all(
        known in (_ANY, word) for word, known in zip(words, place, strict=True)
    )


def _tables(
    part: dict[str, Any], schema: dict[str, Any], place: tuple[str, ...], inside: str = ""
) -> Iterator[tuple[tuple[str, ...], dict[str, Any]]]:
    """Yield the place and the keys of every table below `part`; lists count as their items."""
    reference = part.get("$ref", "")
    if reference and reference in inside.split():
        return
    if reference:
        part, inside = schema["$defs"][reference.rpartition("/")[2]], f"{inside} {reference}"
    own = part.get("properties", {})
    if own:
        yield place, own
    for key, below in own.items():
        yield from _tables(below, schema, (*place, key), inside)
    chosen = [*part.get("patternProperties", {}).values(), part.get("additionalProperties")]
    for below in chosen:
        if isinstance(below, dict):
            yield from _tables(below, schema, (*place, _ANY), inside)
    for below in (*part.get("anyOf", ()), *part.get("oneOf", ()), part.get("items")):
        if isinstance(below, dict):
            yield from _tables(below, schema, place, inside)
