"""The run log of a study: a line per finished run, in the order of completion.

In memory is only where the line of each run begins, 8 bytes per run; the rows stay in the file.
A line is a row and its checksum, over the row and the hash of what the study's results depend on: a
changed line, or one of another study, is no row. Logs of earlier releases have rows alone.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Self

from cosim.core import LossError
from cosim.study.batch import TIMED_OUT, Row
from cosim.study.measurement import Value
from cosim.study.schema import MAX_RUNS

_NOWHERE = -1
_CELL = bool | int | float | str | None


class RunLog:
    """The rows of a study, in a file; iterating gives them in the order of their numbers.

    The first line of a run counts. An incomplete last line does not.

    Parameters
    ----------
    path : the file.
    digest : hash of what the study's results depend on; None: the checksums are not compared.
    bare : whether rows without a checksum are read, as earlier releases wrote them.
    append : open it for appending too; an incomplete last line is removed.
    fits : whether a row may be one of the study; None: any may.

    Attributes
    ----------
    unread : number of lines that are no rows of the study.
    statuses : status -> number of runs.
    types : types of the values of each metric.
    seconds : wall time of all runs together.
    longest : wall time of the longest run that did not exceed its limit [s].

    Raises
    ------
    OSError : it cannot be read.
    """

    def __init__(
        self,
        path: Path,
        digest: str | None,
        *,
        bare: bool = False,
        append: bool = False,
        fits: Callable[[Row], bool] | None = None,
    ) -> None:
        self.path, self.unread = path, 0
        self._digest, self._bare = digest, bare
        self.statuses: Counter[str] = Counter()
        self.types: list[set[type]] = []
        self.seconds = self.longest = 0.0
        self._places = array("q")
        self._count = self._end = 0
        self._file = path.open("a+b" if append else "rb")
        self._file.seek(0)
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            row = self._row(line)
            if row is not None and (fits is None or fits(row)):
                self._enter(row)
            else:
                self.unread += 1
            self._end += len(line)
        if append:
            self._file.truncate(self._end)

    def append(self, rows: Iterable[Row]) -> None:
        """Append rows; they survive the end of this process.

        Raises
        ------
        OSError : they cannot be written, as on a full disk.
        """
        self._file.seek(0, os.SEEK_END)
        for row in rows:
            line = line_of(row, self._digest or "")
            self._file.write(line)
            self._enter(row)
            self._end += len(line)
        self._file.flush()

    def _enter(self, row: Row) -> None:
        if row.run >= len(self._places):
            more = max(row.run + 1, 2 * len(self._places)) - len(self._places)
            self._places.extend(array("q", [_NOWHERE]) * more)
        if self._places[row.run] != _NOWHERE:
            return
        self._places[row.run] = self._end
        self._count += 1
        self.statuses[row.status] += 1
        self.types = self.types or [set() for _ in row.values]
        for types, value in zip(self.types, row.values, strict=False):
            types.add(type(value))
        self.seconds += row.seconds
        if row.status != TIMED_OUT:
            self.longest = max(self.longest, row.seconds)

    def __len__(self) -> int:
        return self._count

    def __contains__(self, run: int) -> bool:
        return run < len(self._places) and self._places[run] != _NOWHERE

    def __getitem__(self, run: int) -> Row:
        """Return the row of a run, which is there.

        Raises
        ------
        LossError : somebody has changed its line since it was read.
        """
        self._file.seek(self._places[run])
        row = self._row(self._file.readline())
        if row is None or row.run != run:
            raise LossError(
                "the run log was changed while it was read",
                where=f"{self.path}: run {run}",
                hint="the command that runs the study executes this run again",
            )
        return row

    def _row(self, line: bytes) -> Row | None:
        """Return the row of a line; None for one that is damaged, changed, or of another study."""
        try:
            found = json.loads(line)
        except ValueError:
            return None
        if isinstance(found, list):
            return _checked(found) if self._bare else None
        if not isinstance(found, dict) or not isinstance(found.get("row"), list):
            return None
        row = _checked(found["row"])
        if row is None or self._digest is None:
            return row
        return row if found.get("check") == _check(row, self._digest) else None

    def __iter__(self) -> Iterator[Row]:
        return (self[run] for run in range(len(self._places)) if run in self)

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):  # what could not be written was reported
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def line_of(row: Row, digest: str) -> bytes:
    """Return the line of a row in the run log of the study with this `digest`."""
    return f"{json.dumps({'row': _cells(row), 'check': _check(row, digest)})}\n".encode()


def _cells(row: Row) -> list[Value]:
    return [row.run, row.status, row.reason, row.seconds, *row.values]


def _check(row: Row, digest: str) -> str:
    return hashlib.sha256(json.dumps([digest, *_cells(row)]).encode()).hexdigest()[:16]


def _checked(cells: list[Any]) -> Row | None:
    """Return the row with these cells; None if they are none."""
    try:
        run, status, reason, seconds, *values = cells
    except ValueError:
        return None
    row = Row(run, status, reason, seconds, tuple(values))
    whole = (
        isinstance(run, int)
        and 0 <= run < MAX_RUNS
        and isinstance(status, str)
        and isinstance(reason, str | None)
        and isinstance(seconds, int | float)
        and all(isinstance(value, _CELL) for value in values)
    )
    return row if whole else None
