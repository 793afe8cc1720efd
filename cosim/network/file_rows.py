"""Read columns of a CSV or Parquet file, cell by cell, with the place of each for messages."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from decimal import ROUND_HALF_EVEN, Context, Decimal, InvalidOperation
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import AnyPath, InputError, optional as optional_package, unreadable
from cosim.network.checks import MAX_NS

_MAGIC = b"PAR1"
_LONGEST = 64
"""Most characters of a number."""
_EXACTLY = Context(prec=2 * _LONGEST, rounding=ROUND_HALF_EVEN)
_LARGEST = Decimal(MAX_NS).scaleb(-9)


class Row(NamedTuple):
    """A row of a file: its place, and its cells in the columns wanted ("" where none)."""

    path: AnyPath
    place: str
    cells: dict[str, str]

    def where(self, column: str) -> str:
        """Return the place of a cell, for messages."""
        return f"{self.path}, {self.place}, column {column}"

    def nanoseconds(self, column: str, largest: Decimal = _LARGEST) -> int:
        """Return a cell of decimal seconds in nanoseconds, to the nearest, ties to even.

        Raises
        ------
        InputError : no finite number, or one beyond `largest` seconds.
        """
        seconds, text = self._decimal(column, "seconds, as a decimal number"), self.cells[column]
        if not seconds.is_finite() or seconds.copy_abs() > largest:
            raise InputError(
                "the time is out of range",
                where=self.where(column),
                expected=f"up to {largest:g} s",
                got=text,
                hint="times are in seconds and count from the start of the run",
            )
        # far below a nanosecond the result is 0, but scaling would need many digits
        if seconds.adjusted() < -_LONGEST:
            return 0
        return int(_EXACTLY.to_integral_exact(_EXACTLY.scaleb(seconds, 9)))

    def number(self, column: str, what: str) -> float:
        """Return a cell as a number; `InputError` if it is none, or not finite."""
        found = float(self._decimal(column, what))
        if not np.isfinite(found):
            raise InputError(
                "this is not a finite number",
                where=self.where(column),
                expected=what,
                got=self.cells[column],
            )
        return found

    def _decimal(self, column: str, expected: str) -> Decimal:
        text = self.cells[column]
        try:
            return Decimal(text if len(text) <= _LONGEST else "")
        except InvalidOperation as error:
            raise InputError(
                "this is not a number",
                where=self.where(column),
                expected=expected,
                got=repr(text[:_LONGEST]) if text else "nothing",
            ) from error


def read_rows(
    path: AnyPath,
    required: Sequence[str],
    optional: Sequence[str] = (),
    *,
    whole: bool = False,
) -> Iterator[Row]:
    """Read a file: a header line, then a row for each line; `optional` may be absent.

    CSV is UTF-8, separated by commas. Empty lines, and lines that begin with #, are skipped. In
    Parquet the columns have the names of the header; null and NaN are empty cells. Each `Row` has
    a cell for each wanted column that the file has.

    whole : each line has to have as many cells as the header.

    Raises
    ------
    InputError : a file that cannot be read, a column that is missing or there twice, or a Parquet
        file without pyarrow.
    """
    wanted = (*required, *optional)
    lines = _rows(Path(path), wanted) if _is_parquet(Path(path)) else _lines(Path(path))
    place, header = next(lines, ("line 1", []))
    names = [name.strip() for name in header]
    for name in required:
        if names.count(name) != 1:
            raise _missing(path, place, name, names)
    for name in optional:
        if names.count(name) > 1:
            raise _missing(path, place, name, names)
    at = {name: names.index(name) for name in wanted if name in names}
    for place, cells in lines:
        if whole and len(cells) != len(names):
            raise InputError(
                "this line has not as many cells as the header",
                where=f"{path}, {place}",
                expected=str(len(names)),
                got=str(len(cells)),
            )
        found = {n: cells[i].strip() if i < len(cells) else "" for n, i in at.items()}
        yield Row(path, place, found)


def read_columns(
    path: AnyPath, time: str, delay: str
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Read the columns of times and delays [ns], int64 (n,) each; times increase.

    Raises
    ------
    InputError : as `DelayProfile.from_csv`.
    """
    times: list[int] = []
    delays: list[int] = []
    for row in read_rows(path, (time, delay)):
        found = [row.nanoseconds(name) for name in (time, delay)]
        if times and found[0] <= times[-1]:
            raise InputError(
                "the times of a delay profile do not increase",
                where=row.where(time),
                expected=f"more than {Decimal(times[-1]).scaleb(-9)} s",
                got=f"{row.cells[time]} s",
            )
        if found[1] < 0:
            raise InputError(
                "a delay cannot be negative",
                where=row.where(delay),
                expected="0 s or more",
                got=f"{row.cells[delay]} s",
            )
        times.append(found[0])
        delays.append(found[1])
    if not times:
        raise no_rows(path, f"lines of {time} and {delay} in seconds")
    return np.array(times, np.int64), np.array(delays, np.int64)


def no_rows(path: AnyPath, expected: str) -> InputError:
    """Return the error for a file with a header and nothing else."""
    return InputError(
        "the file contains no sample",
        where=str(path),
        expected=f"below the header, {expected}",
        got="none",
    )


def _is_parquet(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return path.suffix == ".parquet" or file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False  # the reader of CSV says why


def _rows(path: Path, wanted: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Yield the header of a Parquet file, then its rows, with their numbers."""
    arrow = optional_package(
        "pyarrow",
        "pyarrow.parquet",
        extra="tables",
        what="Parquet files need pyarrow",
        otherwise="write the rows as CSV",
    )
    try:
        with arrow.parquet.ParquetFile(path) as file:
            names = [str(name) for name in file.schema_arrow.names]
            yield "the names of its columns", names
            count = 0
            for batch in file.iter_batches(
                columns=[n for n in dict.fromkeys(wanted) if n in names]
            ):
                read = dict(zip(batch.schema.names, map(_cells, batch.columns), strict=True))
                columns = [read.get(name, [""] * batch.num_rows) for name in names]
                for cells in zip(*columns, strict=True):
                    count += 1
                    yield f"row {count}", list(cells)
    except (OSError, arrow.ArrowException) as error:
        raise InputError("the file cannot be read", where=str(path), got=str(error)) from error


def _cells(column: Any) -> list[str]:
    return ["" if v is None or v != v else str(v) for v in column.to_pylist()]  # noqa: PLR0124


def _lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the lines that are neither empty nor comments, with their numbers."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            for row in reader:
                if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#"):
                    yield f"line {reader.line_num}", row
    except OSError as error:
        raise unreadable(path, error) from error
    except UnicodeDecodeError as error:
        raise unreadable(path, error, what="the file is not text", expected="UTF-8") from error
    except csv.Error as error:
        raise InputError(
            "the file is not CSV", where=f"{path}, line {reader.line_num}", got=str(error)
        ) from error


def _missing(path: AnyPath, place: str, name: str, names: list[str]) -> InputError:
    where = f"{path}, {place}"
    if name in names:
        return InputError(f"there are several columns {name!r}", where=where, expected="one")
    if not names:
        wanted = f"a column {name!r}"
        hint = "a first line with the names of the columns"
        return InputError("the file is empty", where=where, expected=wanted, hint=hint)
    return InputError.unknown("column", name, names, where=where)
