"""The folder of a study: manifest, run log, table and traces.

    study.json        what the results depend on, and their provenance
    journal.jsonl     the run log: a line per finished run, in the order of completion
                      (journal-N.jsonl in a study that was extended to N runs)
    results.parquet   the table of all runs by number, once all are done: a file, or a folder of
                      parts if there are many
    traces/           the traces of chosen runs

An incomplete last line of the run log is removed, and its run is repeated; so is the run of a line
that was changed: each has a checksum. A log of an earlier release, without, gets them when its
study is continued.
"""

from __future__ import annotations

import contextlib
import json
import math
import shutil
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Self

from cosim.core import (
    InputError,
    LossError,
    counted,
    lock_file,
    not_written,
    say_once,
    write_whole,
    written_beside,
)
from cosim.study.batch import Row
from cosim.study.run_log import RunLog, line_of
from cosim.study.schema import Study

MANIFEST, RUN_LOG, RESULTS, TRACES = "study.json", "journal.jsonl", "results.parquet", "traces"
LOCK = ".lock"
CHECKED = "run_log_checked"
"""Key of a manifest whose run log has a checksum in every line."""


class Folder:
    """The folder of one study, which one process at a time may use.

    Attributes
    ----------
    rows : the run log, while the folder is open.
    """

    rows: RunLog

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock: Any = None

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
                hint="another folder: `out`",
            ) from error
        try:
            _lock(self._lock, self.path)
            before = read_manifest(self.path) if (self.path / MANIFEST).exists() else None
            if fresh:
                self._forget()
                before = None
            name = RUN_LOG if before is None else _run_log_of(before)
            if before is not None:
                name = self._continued(name, before, manifest, extended)
            manifest = manifest | {"run_log": name, CHECKED: True}
            # the same study may have another title, or keep other traces
            self._write(manifest)
            for old in self.path.glob("journal*.jsonl"):
                if old.name != manifest["run_log"]:
                    old.unlink()
            run_log = self.path / manifest["run_log"]
            if before is None:
                run_log.unlink(missing_ok=True)
            self.rows = RunLog(run_log, manifest["digest"], append=True, fits=_fits(manifest))
            if self.rows.unread:
                lines = counted(self.rows.unread, "line")
                say_once(f"{run_log}: {lines} not as written; what they were about is run again")
        except BaseException:
            self.close()
            raise

    def _continued(
        self,
        name: str,
        before: dict[str, Any],
        manifest: dict[str, Any],
        extended: Callable[[dict[str, Any]], Callable[[int], int] | None],
    ) -> str:
        """Return the run log to continue with: the one of the folder, or written again from it."""
        log = self.path / name
        number: Callable[[int], int] = int
        if before["digest"] != manifest["digest"]:
            found = extended(before)
            if found is None:
                raise _another(self.path, before, manifest)
            self._forget_results()  # they have the former numbers
            name, number = f"journal-{manifest['count']}.jsonl", found
        elif CHECKED in before or not log.exists():
            return name
        # it counts once the manifest names it
        path, digest = self.path / name, manifest["digest"]
        with (
            _open_log(log, before) as rows,
            not_kept(path),
            written_beside(path) as partial,
            partial.open("wb") as file,
        ):
            file.writelines(line_of(row._replace(run=number(row.run)), digest) for row in rows)
        return name

    def describe(self, manifest: dict[str, Any]) -> None:
        """Write the manifest again, of which more is known now.

        Raises
        ------
        LossError : it cannot be written.
        """
        self._write(manifest | {"run_log": self.rows.path.name, CHECKED: True})

    def _write(self, manifest: dict[str, Any]) -> None:
        with not_kept(self.path / MANIFEST):
            write_whole(self.path / MANIFEST, json.dumps(manifest, indent=1).encode())

    def append(self, rows: Iterable[Row]) -> None:
        """Append rows to the run log; they survive the end of this process.

        Raises
        ------
        LossError : they cannot be written, as on a full disk.
        """
        with not_kept(self.rows.path):
            self.rows.append(rows)

    def close(self) -> None:
        """Release the folder."""
        if hasattr(self, "rows"):
            self.rows.close()
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _forget(self) -> None:
        (self.path / MANIFEST).unlink(missing_ok=True)
        self._forget_results()

    def _forget_results(self) -> None:
        remove(self.results)
        shutil.rmtree(self.traces, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def not_kept(path: Path) -> contextlib.AbstractContextManager[None]:
    """Say which file of a study could not be written: a `LossError` for an `OSError` within."""
    hint = "make room; the same command continues, and runs that are done are kept"
    return not_written("the study's results", path, LossError, hint=hint)


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
            "not the folder of a study",
            where=str(path),
            expected=str(file),
            got=str(error),
            hint="the folder that cosim study run wrote: studies/NAME",
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


def read_rows(path: Path) -> RunLog:
    """Open the run log in a folder, without changing it: its rows, each run once, by number.

    Raises
    ------
    InputError : there is none, it cannot be read, or none of its lines can.
    """
    manifest = read_manifest(path) if (path / MANIFEST).exists() else {}
    file = path / _run_log_of(manifest)
    log = _open_log(file, manifest)
    if log.unread and not len(log):
        log.close()
        raise InputError(
            "the run log is damaged",
            where=str(file),
            expected="a line per run, with its checksum, of the study in this folder",
            got=f"{counted(log.unread, 'line')} that cannot be believed",
            hint="the command that runs the study executes all runs again",
        )
    return log


def _open_log(file: Path, manifest: dict[str, Any]) -> RunLog:
    digest, bare = manifest.get("digest"), CHECKED not in manifest
    try:
        return RunLog(file, digest, bare=bare, fits=_fits(manifest))
    except OSError as error:
        raise InputError("the run log cannot be read", where=str(file), got=str(error)) from error


def _fits(manifest: dict[str, Any]) -> Callable[[Row], bool] | None:
    """Return whether a row may be one of the study with this manifest; None without one."""
    if not manifest:
        return None
    study, metrics = manifest["study"], len(manifest["study"]["metrics"])
    # the number of runs of a rare event is known at its end alone
    count = math.inf if study.get("rare") is not None else manifest["count"]
    return lambda row: row.run < count and len(row.values) == metrics


def remove(path: Path) -> None:
    """Remove a table, which is a file or a folder, if there is one."""
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _run_log_of(manifest: dict[str, Any]) -> str:
    return str(manifest.get("run_log", RUN_LOG))


def _lock(run_log: Any, path: Path) -> None:
    if not lock_file(run_log):
        raise InputError(
            "another process is running this study", where=str(path), hint="another folder: `out`"
        )


def _another(path: Path, before: dict[str, Any], manifest: dict[str, Any]) -> InputError:
    old, new = before.get("parts", {}), manifest["parts"]
    changed: Sequence[str] = [key for key in new if old.get(key) != new[key]]
    return InputError(
        "this folder has the results of another study",
        where=str(path),
        expected=f"the same {', '.join(changed) or 'study'} as when the study was started",
        got=f"{before['study'].get('title')!r}, {before['count']} runs",
        hint="another folder: `out`; or `fresh`, which deletes the results here",
    )
