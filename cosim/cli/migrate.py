"""The command that brings files to the newest schema version: migrate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from cosim.cli.common import JsonOption, answer
from cosim.core import CheckFailedError, counted, migrate as migrated, write_migrated


def migrate(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...", help="Scenarios, systems, studies (.toml) and designs (.json)."
        ),
    ],
    check: Annotated[
        bool, typer.Option("--check", help="Write nothing; exit code 1 if a file is out of date.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Bring files to the newest version of their keys, and write that version into them.

    A file names the version of its keys at the top: schema = 1. Older versions can still be read;
    docs/schema-versions.md says for how long. Comments stay where they are; where keys have to
    move, the old file is kept beside the new one.

    Exit code 0: done; 1: --check found a file to migrate; 2: a file that cannot be read.

    \b
    cosim migrate --check my-system.toml mine.toml
    cosim migrate my-system.toml mine.toml gain.json
    """
    made = {path: migrated(path) for path in files}  # all are readable before one is written
    rows: list[dict[str, Any]] = []
    for path, found in made.items():
        write = found.changes and not check
        kept = write_migrated(path, found) if write else None
        rows.append(
            {
                "file": str(path),
                "kind": found.kind,
                "before": found.before,
                "after": found.after,
                "written": write,
                "old_file": None if kept is None else str(kept),
            }
        )
    done = counted(sum(bool(found.changes) for found in made.values()), "file")
    older = (
        f"{done} of {len(made)} {'can be brought' if check else 'brought'} to the newest version"
    )
    several = len(rows) > 1
    answer(
        as_json,
        lambda: {"files": rows},
        (lambda: "\n".join(map(_line, rows))) if several else None,
        line=older if several else _line(rows[0]),
    )
    if check and any(found.changes for found in made.values()):
        raise typer.Exit(CheckFailedError.exit_code)


def _line(row: dict[str, Any]) -> str:
    if row["before"] == row["after"]:
        return f"{row['file']}: {row['kind']}, already of schema version {row['after']}"
    before = "no version" if row["before"] is None else f"version {row['before']}"
    done = "now" if row["written"] else "can be"
    old = "" if row["old_file"] is None else f"; without its comments, which {row['old_file']} has"
    return f"{row['file']}: {row['kind']}, had {before}, {done} schema version {row['after']}{old}"
