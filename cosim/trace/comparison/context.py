"""Compare the metadata and attachments of two traces: scenario, design, run and result."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from cosim.trace.outcome.run_outcome import other_entries, outcome_of
from cosim.trace.reader import Trace
from cosim.trace.rows.layout import HOST_PREFIX

_MOST_LINES = 200
_MOST_ENTRIES = 500
_LONGEST = 100


@dataclass(frozen=True, slots=True)
class ChangedEntry:
    """An entry that differs; a value is None where the entry is absent."""

    where: str
    key: str
    a: str | None
    b: str | None

    @property
    def informative(self) -> bool:
        """Whether the entry tells a reader something: no hash, and no matrix of a proof."""
        silent = ("variables.", "system.", "final.", "certificate.claim")
        return not self.key.startswith(silent) and not self.key.endswith("sha256")


@dataclass(frozen=True, slots=True)
class Context:
    """Differences of metadata and attachments.

    Attributes
    ----------
    texts : attached texts (the scenario) by name: the lines that differ, as by `diff -u`.
    entries : entries of `cosim.run`, `cosim.result` and attached JSON (the design) that differ.
    left_out : number of further entries that differ.
    """

    texts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    entries: tuple[ChangedEntry, ...] = ()
    left_out: int = 0


def context_of(a: Trace, b: Trace) -> Context:
    """Compare the metadata and attachments of two traces."""
    changes = [
        *_changes("cosim.run", _open(a.run), _open(b.run)),
        *_changes("cosim.result", _ended(a.result), _ended(b.result)),
    ]
    texts: dict[str, tuple[str, ...]] = {}
    for name in sorted(set(a.attachments) | set(b.attachments)):
        one, two = a.attachments.get(name), b.attachments.get(name)
        if one == two:
            continue
        if one is None or two is None:
            sizes = (None if data is None else f"{len(data)} bytes" for data in (one, two))
            changes.append(ChangedEntry("attachment", name, *sizes))
        elif name.endswith(".json"):
            changes += _json_changes(name, one, two)
        else:
            texts[name] = _lines(one, two)
    # the numbers of a proof are many and tell a reader least: last
    changes.sort(key=lambda change: change.key.startswith(("variables", "system")))
    return Context(texts, tuple(changes[:_MOST_ENTRIES]), max(0, len(changes) - _MOST_ENTRIES))


def _ended(result: Mapping[str, str] | None) -> dict[str, Any]:
    """Return the outcome of a run, and what else its result says; {} without a result."""
    outcome = outcome_of(result)
    if result is None or outcome is None:
        return {}
    return {**outcome.to_json(), **_open(other_entries(result))}


def _open(entries: Mapping[str, str]) -> dict[str, Any]:
    """Parse the entries that are JSON objects, and leave out those of the host."""
    found: dict[str, Any] = {}
    for key, text in entries.items():
        if not key.startswith(HOST_PREFIX):
            value = _parsed(text.encode()) if text.startswith("{") else text
            found[key] = text if value is None else value
    return found


def _parsed(data: bytes) -> Any:
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return None


def _json_changes(name: str, one: bytes, two: bytes) -> list[ChangedEntry]:
    found = list(_changes(name, _parsed(one), _parsed(two)))
    return found or [ChangedEntry(name, "bytes", f"{len(one)} bytes", f"{len(two)} other bytes")]


def _changes(where: str, a: Any, b: Any, path: str = "") -> Iterator[ChangedEntry]:
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(key for key in b if key not in a)]:
            inner = f"{path}.{key}" if path else str(key)
            yield from _changes(where, a.get(key), b.get(key), inner)
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, (x, y) in enumerate(zip(a, b, strict=True)):
            yield from _changes(where, x, y, f"{path}[{i}]")
    elif a != b:
        yield ChangedEntry(where, path, _short(a), _short(b))


def _short(value: Any) -> str | None:
    if value is None:
        return None
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def _lines(one: bytes, two: bytes) -> tuple[str, ...]:
    a, b = (data.decode("utf-8", "replace").splitlines() for data in (one, two))
    lines = list(difflib.unified_diff(a, b, "first", "second", lineterm="", n=1))
    more = len(lines) - _MOST_LINES
    return tuple(lines[:_MOST_LINES] + ([f"... {more} more lines"] if more > 0 else []))
