"""Where the keys of a file may stand, by its JSON schema, and which of them a word is meant for."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from functools import cache
from typing import Any

from cosim.core.errors import did_you_mean, nearest
from cosim.core.origin import KeyPath
from cosim.core.part import Part

_ALIKE = 0.8
_ANY = "NAME"
"""Stands in a place for a name that the author chooses."""


def suggestion(word: str, table: KeyPath, model: type[Part]) -> str | None:
    """Return what a key that does not exist is meant for: one of its table, or of another.

    table : where the key stands; list indices and chosen names as they are.
    """
    keys = [(place, name) for place, names in _tables_of(model) for name in names]
    own = keys_of_table(table, model)
    letters = "".join(c for c in word.lower() if c.isalnum())
    first = next((f"{part}.{letters}" for part in table if isinstance(part, str)), letters)
    meant = model.meant.get(first) or model.meant.get(letters, word)
    near = [meant] if meant in own or "." in meant else nearest(word, own, most=1)
    if near:
        return did_you_mean(near)
    # of other tables only what is nearly the same word: others only look alike, and what a word
    # of another tool is meant for depends on the table
    wanted = word if table else meant
    names = {name for _, name in keys}
    others = {wanted} & names or {name for name in names if _alike(name, wanted)}
    places = sorted({".".join((*place, name)) for place, name in keys if name in others})
    return did_you_mean(sorted(places, key=lambda name: not name.startswith("run."))[:3])


def example_of(path: KeyPath, model: type[Part]) -> str | None:
    """Return how a key is written with a value that is allowed; None where no example is known."""
    words = [part for part in path if isinstance(part, str)]
    if not words:
        return None
    places = (f"{words[0]}.{words[-1]}", words[-1])
    value = next((model.examples[place] for place in places if place in model.examples), None)
    return None if value is None else f"{words[-1]} = {value}"


def keys_of_table(table: KeyPath, model: type[Part]) -> list[str]:
    """Return the keys that a table may have, in the order of the schema."""
    found = (names for place, names in _tables_of(model) if _is_at(table, place))
    return list(dict.fromkeys(name for names in found for name in names))


@cache
def _tables_of(model: type[Part]) -> list[tuple[tuple[str, ...], dict[str, Any]]]:
    schema = model.model_json_schema()
    return list(_tables(schema, schema, ()))


def _alike(name: str, word: str) -> bool:
    return bool(difflib.get_close_matches(word, [name], cutoff=_ALIKE))


def _is_at(path: KeyPath, place: tuple[str, ...]) -> bool:
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
