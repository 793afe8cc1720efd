"""Read two columns of seconds from a CSV file as whole nanoseconds."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from decimal import ROUND_HALF_EVEN, Context, Decimal, InvalidOperation
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.network.checks import MAX_NS

_LONGEST = 64
"""Most characters of a number."""
_EXACTLY = Context(prec=2 * _LONGEST, rounding=ROUND_HALF_EVEN)
_LARGEST = Decimal(MAX_NS).scaleb(-9)


def read_columns(
    path: str | PathLike[str], time: str, delay: str
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Read the columns of times and delays [ns], int64 (n,) each; times increase.

    Raises
    ------
    InputError : as `DelayProfile.from_csv`.
    """
    lines = _lines(Path(path))
    number, header = next(lines, (1, []))
    names = [name.strip() for name in header]
    for name in (time, delay):
        if names.count(name) != 1:
            raise _missing(path, number, name, names)
    at = (names.index(time), names.index(delay))
    times: list[int] = []
    delays: list[int] = []
    for number, row in lines:
        found = [
            _nanoseconds(row[i] if i < len(row) else "", f"{path}, line {number}, column {name}")
            for i, name in zip(at, (time, delay), strict=True)
        ]
        if times and found[0] <= times[-1]:
            raise InputError(
                "the times of a delay profile do not increase",
                where=f"{path}, line {number}, column {time}",
                expected=f"more than {Decimal(times[-1]).scaleb(-9)} s",
                got=f"{row[at[0]].strip()} s",
            )
        if found[1] < 0:
            raise InputError(
                "a delay cannot be negative",
                where=f"{path}, line {number}, column {delay}",
                expected="0 s or more",
                got=f"{row[at[1]].strip()} s",
            )
        times.append(found[0])
        delays.append(found[1])
    if not times:
        raise InputError(
            "the file contains no sample",
            where=str(path),
            expected=f"below the header, lines of {time} and {delay} in seconds",
            got="none",
        )
    return np.array(times, np.int64), np.array(delays, np.int64)


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines that are neither empty nor comments, with their numbers."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file, strict=True)
            for row in reader:
                if any(cell.strip() for cell in row) and not row[0].lstrip().startswith("#"):
                    yield reader.line_num, row
    except OSError as error:
        raise InputError(
            "the file cannot be read", where=str(path), got=error.strerror or str(error)
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            "the file is not text", where=str(path), expected="UTF-8", got=error.reason
        ) from error
    except csv.Error as error:
        raise InputError(
            "the file is not CSV", where=f"{path}, line {reader.line_num}", got=str(error)
        ) from error


def _missing(path: str | PathLike[str], line: int, name: str, names: list[str]) -> InputError:
    where = f"{path}, line {line}"
    if name in names:
        return InputError(f"there are several columns {name!r}", where=where, expected="one")
    if not names:
        return InputError("the file is empty", where=where, expected=f"a column {name!r}")
    return InputError.unknown("column", name, names, where=where)


def _nanoseconds(text: str, where: str) -> int:
    """Convert a decimal number of seconds to nanoseconds, to the nearest, ties to even."""
    text = text.strip()
    try:
        seconds = Decimal(text if len(text) <= _LONGEST else "")
    except InvalidOperation as error:
        raise InputError(
            "this is not a number",
            where=where,
            expected="seconds, as a decimal number",
            got=repr(text[:_LONGEST]) if text else "nothing",
        ) from error
    if not seconds.is_finite() or seconds.copy_abs() > _LARGEST:
        raise InputError(
            "the time is out of range",
            where=where,
            expected=f"up to {MAX_NS / 1e9:g} s",
            got=text,
            hint="times are in seconds and count from the start of the run",
        )
    # far below a nanosecond the result is 0, but scaling would need many digits
    if seconds.adjusted() < -_LONGEST:
        return 0
    return int(_EXACTLY.to_integral_exact(_EXACTLY.scaleb(seconds, 9)))
