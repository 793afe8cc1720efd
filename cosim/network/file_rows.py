"""Read columns of a CSV or Parquet file, cell by cell, with the place of each for messages."""

from __future__ import annotations

import csv
import re
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from decimal import ROUND_HALF_EVEN, Context, Decimal, InvalidOperation
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.core import AnyPath, InputError, optional as optional_package, unreadable
from cosim.network.checks import MAX_NS
from cosim.network.log_format import DELIMITERS, DIGITS, UNIT_WORDS, Delimiter, LogFormat, Unit

_MAGIC = b"PAR1"
_LONGEST = 64
"""Most characters of a number."""
_EXACTLY = Context(prec=2 * _LONGEST, rounding=ROUND_HALF_EVEN)
_LARGEST = Decimal(MAX_NS).scaleb(-9)
_COMMAS = LogFormat(delimiter=",", decimal=".")
"""How files are written that are no logs."""
_BETWEEN = {"tab": "\t", "space": " "}
"""Delimiters that are named -> what they are."""
_ISO = re.compile(
    r"(?P<day>\d{4}-?\d{2}-?\d{2})[T ]"
    r"(?P<time>\d{2}:?\d{2}(?::?\d{2}(?:[.,](?P<part>\d+))?)?)\s*(?P<zone>Z|[+-][\d:]{2,6})?",
    re.IGNORECASE,
)
"""A time of a day in ISO 8601."""
_BEGIN = datetime(1970, 1, 1, tzinfo=UTC)


class Header(NamedTuple):
    """The names of the columns of a file, their place, and what is between them."""

    place: str
    names: list[str]
    delimiter: Delimiter


class Row(NamedTuple):
    """A row of a file: its place, and its cells in the columns wanted ("" where none).

    `beyond` : cells that are not empty behind the last column. `decimal` : of numbers; None: "."
    or ",", but one of them in the whole file. `seen` : what was seen of the file, and where.
    """

    path: AnyPath
    place: str
    cells: dict[str, str]
    beyond: int
    decimal: str | None
    seen: dict[str, str]

    def where(self, column: str) -> str:
        """Return the place of a cell, for messages."""
        return f"{self.path}, {self.place}, column {column}"

    def nanoseconds(
        self,
        column: str,
        largest: Decimal = _LARGEST,
        unit: Unit = "s",
    ) -> int:
        """Return a cell of a decimal time in nanoseconds, to the nearest, ties to even.

        Raises
        ------
        InputError : no finite number, or one beyond `largest` seconds.
        """
        text = self.cells[column]
        time = self._decimal(column, f"{UNIT_WORDS[unit]}, as a decimal number")
        if not time.is_finite() or time.copy_abs() > largest.scaleb(9 - DIGITS[unit]):
            raise InputError(
                "the time is out of range",
                where=self.where(column),
                expected=f"up to {largest:g} s",
                got=text if unit == "s" else f"{text} {unit}",
                hint="times are in seconds and count from the start of the run",
            )
        # far below a nanosecond the result is 0, but scaling would need many digits
        if time.adjusted() < -_LONGEST:
            return 0
        return int(_EXACTLY.to_integral_exact(_EXACTLY.scaleb(time, DIGITS[unit])))

    def iso_ns(self, column: str) -> int | None:
        """Return a cell of a time in ISO 8601 [ns since 1970]; None where it is none.

        Raises
        ------
        InputError : a time that does not exist, or with a zone where others have none.
        """
        text = self.cells[column]
        found = _ISO.fullmatch(text)
        if found is None or len(text) > _LONGEST:
            return None
        part, zone = found["part"] or "", found["zone"] or ""
        clock = found["time"][: -1 - len(part)] if part else found["time"]
        try:
            instant = datetime.fromisoformat(f"{found['day']}T{clock}{zone.upper() or 'Z'}")
        except ValueError as error:
            raise InputError(
                "this time does not exist",
                where=self.where(column),
                expected="a time in ISO 8601, as 2024-05-01T12:00:00.250+02:00",
                got=text,
            ) from error
        self._only("times with a zone", "times without a zone", column, bool(zone))
        whole = (instant - _BEGIN) // timedelta(microseconds=1) * 1000
        fraction = _EXACTLY.scaleb(Decimal(f"0.{part or 0}"), 9)
        return whole + int(_EXACTLY.to_integral_exact(fraction))

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
        plain = text if len(text) <= _LONGEST else ""
        comma = "," in plain and self.decimal != "."
        if comma or self.decimal == ",":
            plain = plain.replace(",", ".", 1) if "." not in plain else ""
        try:
            found = Decimal(plain)
        except InvalidOperation as error:
            raise InputError(
                "this is not a number",
                where=self.where(column),
                expected=expected + (", with a decimal comma" if self.decimal == "," else ""),
                got=repr(text[:_LONGEST]) if text else "nothing",
            ) from error
        if self.decimal is None and "." in plain:
            self._only("decimal commas", "decimal points", column, comma)
        return found

    def _only(self, one: str, other: str, column: str, is_one: bool) -> None:  # noqa: FBT001
        """Raise `InputError` where a file has both of two ways to write a thing."""
        now, before = (one, other) if is_one else (other, one)
        self.seen.setdefault(now, f"{self.place}, column {column}")
        if before in self.seen:
            raise InputError(
                f"the file has {one} and {other}",
                where=self.where(column),
                expected=f"{before}, as in {self.seen[before]}",
                got=self.cells[column],
                hint="write all of them in one way",
            )


def read_header(
    path: AnyPath, fitness: Callable[[list[str]], float], delimiter: Delimiter | None = None
) -> Header:
    """Return the header of a file, and the delimiter by which its names have the most `fitness`.

    Of two that are as fit, that of more names; a space, which names have in them, is the last.

    Raises
    ------
    InputError : a file that cannot be read, or has no line.
    """
    if _is_parquet(Path(path)):
        place, names = next(_rows(Path(path), ()))
        return Header(place, names, ",")
    best: tuple[tuple[float, bool, int], Header] | None = None
    refused: InputError | None = None
    for tried in (delimiter,) if delimiter is not None else DELIMITERS:
        try:
            place, cells = next(_lines(Path(path), tried), ("line 1", []))
        except InputError as error:
            refused = refused or error
            continue
        names = [cell.strip() for cell in cells]
        rank = fitness(names), tried != "space" and len(names) > 1, len(names)
        if best is None or rank > best[0]:
            best = rank, Header(place, names, tried)
    if best is None:
        raise refused or _missing(path, "line 1", "sent", [])
    return best[1]


def read_rows(
    path: AnyPath,
    required: Sequence[str],
    optional: Sequence[str] = (),
    *,
    whole: bool = False,
    written: LogFormat = _COMMAS,
) -> Iterator[Row]:
    """Read a file: a header line, then a row for each line; `optional` may be absent.

    CSV is UTF-8. Empty lines, and lines that begin with #, are skipped. In Parquet the columns
    have the names of the header; null and NaN are empty cells. Each `Row` has a cell for each
    wanted column that the file has.

    whole : each line has to have as many cells as the header.
    written : its delimiter (None: by which the header has the required columns) and its decimal.

    Raises
    ------
    InputError : a file that cannot be read, a column that is missing or there twice, or a Parquet
        file without pyarrow.
    """
    wanted = (*required, *optional)
    delimiter = written.delimiter or _delimiter(path, required)
    is_parquet = _is_parquet(Path(path))
    lines = _rows(Path(path), wanted) if is_parquet else _lines(Path(path), delimiter)
    decimal = "." if written.decimal is None and delimiter == "," else written.decimal
    place, first = next(lines, ("line 1", []))
    names = [name.strip() for name in first]
    for name in required:
        if names.count(name) != 1:
            raise _missing(path, place, name, names)
    for name in optional:
        if names.count(name) > 1:
            raise _missing(path, place, name, names)
    at = {name: names.index(name) for name in wanted if name in names}
    seen: dict[str, str] = {}
    for place, cells in lines:
        beyond = 0 if is_parquet else sum(map(bool, cells[len(names) :]))
        if (whole and len(cells) != len(names)) or (beyond and delimiter != ","):
            raise InputError(
                "this line has not as many cells as the header",
                where=f"{path}, {place}",
                expected=str(len(names)),
                got=str(len(cells)),
            )
        found = {n: cells[i].strip() if i < len(cells) else "" for n, i in at.items()}
        yield Row(path, place, found, beyond, decimal, seen)


def _delimiter(path: AnyPath, required: Sequence[str]) -> Delimiter:
    """Return the delimiter by which the header has the most of these columns."""
    header = read_header(path, lambda names: len({*names} & {*required}))
    return header.delimiter if {*header.names} & {*required} else ","


def read_columns(
    path: AnyPath, time: str, delay: str, written: LogFormat
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Read the columns of times and delays [ns], int64 (n,) each; times increase.

    Raises
    ------
    InputError : as `DelayProfile.from_csv`.
    """
    times: list[int] = []
    delays: list[int] = []
    for row in read_rows(path, (time, delay), written=written):
        found = [row.nanoseconds(name, unit=written.unit or "s") for name in (time, delay)]
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


def _lines(path: Path, delimiter: Delimiter) -> Iterator[tuple[str, list[str]]]:
    """Yield the lines that are neither empty nor comments, with their numbers."""
    between = _BETWEEN.get(delimiter, delimiter)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            lines = (" ".join(line.split()) for line in file) if between == " " else file
            reader = csv.reader(lines, strict=True, delimiter=between)
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
