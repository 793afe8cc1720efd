"""Bring a file to the newest version of its keys, and keep its comments where that is possible."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from cosim.core.errors import InputError
from cosim.core.file_kinds import SCHEMA, FileKind, kind_by_keys
from cosim.core.files import unreadable, write_whole
from cosim.core.toml_text import parse_toml

_STATEMENT = re.compile(r"^(?![ \t]*(?:#|\r?$))", re.MULTILINE)
_STATED = re.compile(rf"^[ \t]*{SCHEMA}[ \t]*=[ \t]*[0-9_]+", re.MULTILINE)


class Migration(NamedTuple):
    """A file as it is to be written.

    Attributes
    ----------
    kind : scenario, system, study or design.
    before, after : its versions; `before` None where it does not say one.
    text : its new text.
    comments_kept : whether all comments are still there.
    """

    kind: str
    before: int | None
    after: int
    text: str
    comments_kept: bool

    @property
    def changes(self) -> bool:
        """Whether there is anything to write."""
        return self.before != self.after


def migrate(path: Path, kind: FileKind | None = None) -> Migration:
    """Return a file with the newest version of its keys; write nothing.

    kind : by default the one that its keys show.

    Raises
    ------
    InputError : it cannot be read, is malformed, or has a newer version.
    """
    where, is_json = str(path), path.suffix == ".json"
    try:
        text = path.read_bytes().decode("utf-8")
    except (OSError, ValueError) as error:
        raise unreadable(path, error) from error
    data = _json(text, where) if is_json else parse_toml(text, where)
    kind = kind or kind_by_keys(data)
    if kind is None:
        raise InputError(
            "not a file whose keys have a version",
            where=where,
            expected="a scenario, a system, a study or a design",
            got=f"the keys {', '.join(map(str, data))}"[:200],
        )
    before = kind.version_of(data, where) if SCHEMA in data else None
    if before == kind.version:
        return Migration(kind.name, before, kind.version, text, comments_kept=True)
    content = kind.current(data, where)
    stamped = kind.stamped(content)
    if is_json:
        new = json.dumps(stamped, indent=1, allow_nan=False) + "\n"
        return Migration(kind.name, before, kind.version, new, comments_kept=True)
    # a step may give back what it was given: then only the version is new
    same = content == {key: value for key, value in data.items() if key != SCHEMA}
    new = _with_version(text, kind.version) if same else _dumps(stamped)
    if tomllib.loads(new) != stamped:
        new, same = _dumps(stamped), False
    return Migration(kind.name, before, kind.version, new, comments_kept=same)


def write_migrated(path: Path, made: Migration) -> Path | None:
    """Write a file's new text; keep the old file beside it where comments are lost, and say where.

    Raises
    ------
    InputError : it cannot be written.
    """
    kept = None if made.comments_kept else path.with_name(f"{path.name}.v{made.before or 1}")
    try:
        if kept is not None:
            write_whole(kept, path.read_bytes())
        write_whole(path, made.text.encode())
    except OSError as error:
        raise InputError("the file cannot be written", where=str(path), got=str(error)) from error
    return kept


def _with_version(text: str, version: int) -> str:
    """Return a TOML text with its version replaced, or put before its first statement."""
    line = f"{SCHEMA} = {version}"
    if SCHEMA in tomllib.loads(text):
        return _STATED.sub(line, text, count=1)
    end = "\r\n" if "\r\n" in text else "\n"
    first = _STATEMENT.search(text)
    at = len(text) if first is None else first.start()
    gap = end if text[at:].lstrip().startswith("[") else ""
    return f"{text[:at]}{line}{end}{gap}{text[at:]}"


def _dumps(data: dict[str, Any]) -> str:
    import tomli_w  # noqa: PLC0415 - only where comments cannot be kept

    write: Callable[..., str] = tomli_w.dumps
    return write(data)


def _json(text: str, where: str) -> dict[str, Any]:
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError("not JSON", where=where, got=str(error)) from error
    if not isinstance(data, dict):
        raise InputError(
            "not a design", where=where, expected="an object of keys", got=type(data).__name__
        )
    return data
