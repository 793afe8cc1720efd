"""The folder of a study: manifest, run log, table and traces.

    study.json        what the results depend on, and their provenance
    journal.jsonl     the run log: a line per finished run, in the order of completion
                      (journal-N.jsonl in a study that was extended to N runs)
    results.parquet   the table of all runs by number, once all are done
    traces/           the traces of chosen runs

An incomplete last line of the run log is removed, and its run is repeated.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

from cosim.core import InputError, LossError, lock_file, write_whole
from cosim.study.batch import Row
from cosim.study.schema import Study

MANIFEST, RUN_LOG, RESULTS, TRACES = "study.json", "journal.jsonl", "results.parquet", "traces"
LOCK = ".lock"


class Folder:
    """The folder of one study, which one process at a time may use."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._run_log: Any = None
        self._lock: Any = None
        self._manifest: dict[str, Any] = {}

    @property
    def results(self) -> Path:
        """Path of the table."""
        return self.path / RESULTS

    @property
    def traces(self) -> Path:
        """Folder of the traces."""
        return self.path / TRACES

    def begin(
        self,
        manifest: dict[str, Any],
        *,
        fresh: bool = False,
        extended: Callable[[dict[str, Any]], Callable[[int], int] | None] = lambda _: None,
    ) -> None:
        """Open the folder for the study of this manifest, new or to continue.

        fresh : delete the results of any study in the folder.
        extended : returns, for the manifest of a study with fewer samples that is the same else,
            what gives the numbers of its runs in this one; None for any other study.

        Raises
        ------
        InputError : the folder has another study, or another process uses it, or it cannot be
            written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._lock = (self.path / LOCK).open("a+b")
        except OSError as error:
            raise InputError(
                "the folder of the study cannot be written",
                where=str(self.path),
                got=str(error),
                hint="another folder: --out",
            ) from error
        try:
            _lock(self._lock, self.path)
            before = read_manifest(self.path) if (self.path / MANIFEST).exists() else None
            if fresh:
                self._forget()
                before = None
            manifest = manifest | {"run_log": RUN_LOG if before is None else _run_log_of(before)}
            if before is not None and before["digest"] != manifest["digest"]:
                number = extended(before)
                if number is None:
                    raise _another(self.path, before, manifest)  # noqa: TRY301
                manifest |= {"run_log": self._extend(manifest["count"], number)}
            # the same study may have another title, or keep other traces
            with not_written(self.path / MANIFEST):
                write_whole(self.path / MANIFEST, json.dumps(manifest, indent=1).encode())
            self._manifest = manifest
            for old in self.path.glob("journal*.jsonl"):
                if old.name != manifest["run_log"]:
                    old.unlink()
            self._run_log = (self.path / manifest["run_log"]).open("a+b")
            if before is None:
                self._run_log.truncate(0)
        except BaseException:
            self.close()
            raise

    def _extend(self, count: int, number: Callable[[int], int]) -> str:
        """Write the runs of a study with fewer samples under their new numbers; return the file.

        It counts once the manifest names it. Traces and table have the former numbers: they go.
        """
        self._forget_results()
        rows = [row._replace(run=number(row.run)) for row in read_rows(self.path)]
        path = self.path / f"journal-{count}.jsonl"
        with not_written(path):
            write_whole(path, _lines(rows))
        return path.name

    def rows(self) -> list[Row]:
        """Return the rows of the run log, each run once; remove an incomplete last line."""
        self._run_log.seek(0)
        text = self._run_log.read()
        whole = text.rfind(b"\n") + 1
        if whole < len(text):
            self._run_log.truncate(whole)
        self._run_log.seek(0, os.SEEK_END)
        return _each_once(_row_of(line, self._manifest) for line in text[:whole].splitlines())

    def append(self, rows: Iterable[Row]) -> None:
        """Append rows to the run log; they survive the end of this process.

        Raises
        ------
        LossError : they cannot be written, as on a full disk.
        """
        with not_written(Path(self._run_log.name)):
            self._run_log.write(_lines(rows))
            self._run_log.flush()

    def close(self) -> None:
        """Release the folder."""
        if self._run_log is not None:
            with contextlib.suppress(OSError):  # what could not be written was reported
                self._run_log.close()
            self._run_log = None
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _forget(self) -> None:
        (self.path / MANIFEST).unlink(missing_ok=True)
        self._forget_results()

    def _forget_results(self) -> None:
        self.results.unlink(missing_ok=True)
        shutil.rmtree(self.traces, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@contextlib.contextmanager
def not_written(path: Path) -> Iterator[None]:
    """Say which file of a study could not be written.

    Raises
    ------
    LossError : for an `OSError` within.
    """
    try:
        yield
    except OSError as error:
        raise LossError(
            "the study's results cannot be written",
            where=str(path),
            got=error.strerror or str(error),
            hint="make room; the same command continues, and runs that are done are kept",
        ) from error


def read_manifest(path: Path) -> dict[str, Any]:
    """Read `study.json` in a folder.

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
    try:
        Study.model_validate(found["study"])
    except ValueError as error:
        raise InputError(
            "not the manifest of a study, or of another release",
            where=str(file),
            expected="the keys of a study",
            got=str(error).splitlines()[0],
        ) from error
    return found


class RunLog(NamedTuple):
    """The run log in a folder: its rows, each run once, and how many lines cannot be read."""

    rows: list[Row]
    unread: int


def read_rows(path: Path) -> list[Row]:
    """Read the run log in a folder, each run once, without changing it."""
    return read_run_log(path).rows


def read_run_log(path: Path) -> RunLog:
    """Read the run log in a folder, without changing it; an incomplete last line is left out.

    Raises
    ------
    InputError : it cannot be read, or none of its lines can.
    """
    manifest = read_manifest(path) if (path / MANIFEST).exists() else {}
    file = path / _run_log_of(manifest)
    try:
        text = file.read_bytes()
    except OSError as error:
        raise InputError("the run log cannot be read", where=str(path), got=str(error)) from error
    found = [_row_of(line, manifest) for line in text[: text.rfind(b"\n") + 1].splitlines()]
    rows, unread = _each_once(found), found.count(None)
    if unread and not rows:
        raise InputError(
            "the run log is damaged",
            where=str(file),
            expected="a line per run: [run, status, reason, seconds, metrics ...]",
            got=f"{unread} lines that cannot be read",
            hint="the command that runs the study executes all runs again",
        )
    return RunLog(rows, unread)


def _run_log_of(manifest: dict[str, Any]) -> str:
    return str(manifest.get("run_log", RUN_LOG))


def _lines(rows: Iterable[Row]) -> bytes:
    lines = [json.dumps([r.run, r.status, r.reason, r.seconds, *r.values]) for r in rows]
    return "".join(f"{line}\n" for line in lines).encode()


def _each_once(rows: Iterable[Row | None]) -> list[Row]:
    """Return the first row of each run."""
    found: dict[int, Row] = {}
    for row in rows:
        if row is not None:
            found.setdefault(row.run, row)
    return list(found.values())


def _row_of(line: bytes, manifest: dict[str, Any]) -> Row | None:
    """Return the row of a line; None if it is none, or not of this study."""
    try:
        row = Row(*(fields := json.loads(line))[:4], tuple(fields[4:]))
    except (ValueError, TypeError, KeyError):
        return None
    known = (
        isinstance(row.run, int)
        and isinstance(row.status, str)
        and isinstance(row.reason, str | None)
        and isinstance(row.seconds, int | float)
        and all(isinstance(value, _CELL) for value in row.values)
    )
    if known and manifest:
        known = 0 <= row.run < manifest["count"]
        known = known and len(row.values) == len(manifest["study"]["metrics"])
    return row if known else None


_CELL = bool | int | float | str | None


def _lock(run_log: Any, path: Path) -> None:
    if not lock_file(run_log):
        raise InputError(
            "another process is running this study", where=str(path), hint="another folder: --out"
        )


def _another(path: Path, before: dict[str, Any], manifest: dict[str, Any]) -> InputError:
    old, new = before.get("parts", {}), manifest["parts"]
    changed: Sequence[str] = [key for key in new if old.get(key) != new[key]]
    return InputError(
        "this folder has the results of another study",
        where=str(path),
        expected=f"the same {', '.join(changed) or 'study'} as when the study was started",
        got=f"{before['study'].get('title')!r}, {before['count']} runs",
        hint="another folder: --out; or --fresh, which deletes the results here",
    )
