"""A study on disk: what it is, a line per finished run, and the table when all are there.

    study.json        what the results depend on, and their provenance
    journal.jsonl     a line per run, in the order in which they were done
    results.parquet   all of them, by number, when all are there
    traces/           of chosen runs

A line that was not finished is as if it had never been begun: its run is flown again.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Self

from cosim.core import InputError
from cosim.study.batch import Row

MANIFEST, RUN_LOG, RESULTS, TRACES = "study.json", "journal.jsonl", "results.parquet", "traces"


class Folder:
    """The folder of one study, open for one process at a time."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._run_log: Any = None

    @property
    def results(self) -> Path:
        """The table."""
        return self.path / RESULTS

    @property
    def traces(self) -> Path:
        """Where traces go."""
        return self.path / TRACES

    def begin(self, manifest: dict[str, Any], *, fresh: bool = False) -> None:
        """Take the folder for the study of this manifest, or go on with it.

        fresh : throw away what is there of a study, this or another.

        Raises
        ------
        InputError : another study is there, or another process works on it, or it cannot be
            written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._run_log = (self.path / RUN_LOG).open("a+b")
        except OSError as error:
            raise InputError(
                "the folder of the study cannot be written",
                where=str(self.path),
                got=str(error),
                hint="another place: --out",
            ) from error
        try:
            _lock(self._run_log, self.path)
            before = read_manifest(self.path) if (self.path / MANIFEST).exists() else None
            if fresh:
                self._forget()
            elif before is not None and before["digest"] != manifest["digest"]:
                raise _another(self.path, before, manifest)  # noqa: TRY301
            if fresh or before is None:
                self._run_log.truncate(0)
            # the same study may have another title, or ask for other traces
            _write_whole(self.path / MANIFEST, json.dumps(manifest, indent=1).encode())
        except BaseException:
            self.close()
            raise

    def rows(self) -> list[Row]:
        """What is done, each run once; a line that was cut off is cut away."""
        self._run_log.seek(0)
        text = self._run_log.read()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            self._run_log.truncate(whole)
        self._run_log.seek(0, os.SEEK_END)
        return list(_rows(text[:whole]))

    def append(self, rows: Iterable[Row]) -> None:
        """Write rows down; when this returns, the end of this process does not lose them."""
        lines = [json.dumps([r.run, r.status, r.reason, r.seconds, *r.values]) for r in rows]
        self._run_log.write("".join(f"{line}\n" for line in lines).encode())
        self._run_log.flush()

    def close(self) -> None:
        """Let others at it."""
        if self._run_log is not None:
            self._run_log.close()
            self._run_log = None

    def _forget(self) -> None:
        for name in (MANIFEST, RESULTS):
            (self.path / name).unlink(missing_ok=True)
        shutil.rmtree(self.traces, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_manifest(path: Path) -> dict[str, Any]:
    """What `study.json` in a folder says.

    Raises
    ------
    InputError : there is none, or it cannot be read.
    """
    file = path / MANIFEST
    try:
        found = json.loads(file.read_text("utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(
            "not the folder of a study", where=str(path), expected=str(file), got=str(error)
        ) from error
    if not isinstance(found, dict) or not {"digest", "study", "count"} <= set(found):
        raise InputError("not the manifest of a study", where=str(file))
    return found


def read_rows(path: Path) -> list[Row]:
    """The runs that the journal in a folder holds, each once, without opening it for more."""
    try:
        text = (path / RUN_LOG).read_bytes()
    except OSError as error:
        raise InputError("the journal cannot be read", where=str(path), got=str(error)) from error
    return list(_rows(text[: text.rfind(b"\n") + 1]))


def _rows(text: bytes) -> Iterator[Row]:
    seen = set()
    for line in text.splitlines():
        with contextlib.suppress(ValueError, TypeError):
            run, status, reason, seconds, *values = json.loads(line)
            if run not in seen:
                seen.add(run)
                yield Row(run, status, reason, seconds, tuple(values))


def _lock(run_log: Any, path: Path) -> None:
    try:
        import fcntl  # noqa: PLC0415 - where there is none, two processes at once stay possible
    except ImportError:
        return
    try:
        fcntl.flock(run_log, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise InputError(
            "another process works on this study", where=str(path), hint="another place: --out"
        ) from error


def _another(path: Path, before: dict[str, Any], manifest: dict[str, Any]) -> InputError:
    old, new = before.get("parts", {}), manifest["parts"]
    changed: Sequence[str] = [key for key in new if old.get(key) != new[key]]
    return InputError(
        "another study is here",
        where=str(path),
        expected=f"the same {', '.join(changed) or 'study'} as when it was begun",
        got=f"{before['study'].get('title')!r}, {before['count']} runs",
        hint="another place: --out; or --fresh, which throws away what is here",
    )


def _write_whole(path: Path, content: bytes) -> None:
    """A file that is there whole, or not at all."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    partial.replace(path)
