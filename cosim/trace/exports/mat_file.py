"""Write tables as a MATLAB file of format 5, which `scipy.io.loadmat`, MATLAB and Octave read.

Each table is a struct of columns; what one table needs is in memory at a time.
"""

from __future__ import annotations

import importlib
import re
import struct
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from cosim.core import InputError
from cosim.trace.tables.column import Column

LONGEST_NAME = 63
"""Characters of a name, of a variable and of a field: MATLAB's `namelengthmax`."""
LARGEST = 2**31 - 1
"""Bytes of a variable in format 5."""

_ABOUT = ("topic", "names", "units", "descriptions", "present")
"""Fields of a table beside its columns."""
_KEYWORDS = frozenset(
    [
        "break",
        "case",
        "catch",
        "classdef",
        "continue",
        "else",
        "elseif",
        "end",
        "for",
        "function",
        "global",
        "if",
        "otherwise",
        "parfor",
        "persistent",
        "return",
        "spmd",
        "switch",
        "try",
        "while",
    ]
)
# the text has no date, so that the same tables give the same bytes
_HEADER = struct.pack("=116sqHH", b"MATLAB 5.0 MAT-file, cosim".ljust(116), 0, 0x0100, 0x4D49)


class MatFile:
    """A MATLAB file to which tables are written one by one.

    A table is a struct with a field for each column (m, 1), and `names`, `units` and
    `descriptions`: structs with a text for each of these fields. `present` has a logical column
    for each field with missing values, which are NaN, 0, false or ''.

    Parameters
    ----------
    about : texts of the struct `trace`, by field.
    tables : the names of the tables to come, for those of their variables.
    """

    def __init__(self, path: Path, about: Mapping[str, str], tables: Iterable[str]) -> None:
        # scipy.io takes long to load
        self._savemat: Any = importlib.import_module("scipy.io").savemat
        tables = list(tables)
        self._variables = dict(zip(tables, matlab_names(tables, taken=("trace",)), strict=True))
        self._stream = path.open("wb")
        self._stream.write(_HEADER)
        self._save("trace", dict(about))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stream.close()

    def add(self, table: str, parts: Sequence[list[Column]]) -> None:
        """Write a table, given by the columns of each of its parts, which are taken out of them."""
        names = [column.name for column in parts[0]]
        columns: dict[str, Any] = {}
        about: dict[str, dict[str, Any]] = {name: {} for name in _ABOUT if name != "topic"}
        for name, field in zip(names, matlab_names(names, taken=_ABOUT), strict=True):
            pieces = [part.pop(0) for part in parts]
            columns[field] = np.concatenate([piece.values for piece in pieces])
            there = np.concatenate([piece.present for piece in pieces])
            if not there.all():
                about["present"][field] = there
            about["names"][field] = name
            about["units"][field] = pieces[0].unit or ""
            about["descriptions"][field] = pieces[0].description or ""
        self._save(self._variables[table], {"topic": table, **columns, **about})

    def _save(self, variable: str, fields: dict[str, Any]) -> None:
        # beyond the beginning of a file, savemat writes no header of its own
        self._savemat(self._stream, {variable: fields}, long_field_names=True, oned_as="column")


def bytes_of(columns: Iterable[Column]) -> int:
    """Return about how many bytes columns have in a file: at least theirs, and a cell per text."""
    size = 0
    for column in columns:
        values = column.values
        texts = sum(64 + 4 * len(str(v)) for v in values) if values.dtype.kind == "O" else 0
        size += (texts or values.nbytes) + values.size
    return size


def check_size(table: str, size: int, where: Path) -> None:
    """Raise an `InputError` if a table of so many bytes is too large for format 5."""
    if size > LARGEST:
        raise InputError(
            f"{table} is too large for a MATLAB file of format 5",
            where=str(where),
            expected=f"at most {LARGEST} bytes in a table",
            got=f"{size} bytes so far",
            hint="fewer signals (`signal`), a part of the time (`start`, `end`), or `to` parquet",
        )


def matlab_names(names: Iterable[str], taken: Collection[str] = ()) -> list[str]:
    """Turn names into those of MATLAB: `eta.x` to `eta_x`, `K[1,3]` to `K_1_3`.

    Every character outside [A-Za-z0-9_] becomes `_`; what does not begin with a letter, or is a
    keyword, gets the prefix `x_`. Of more than 63 characters the first ones are kept. A name that
    is taken gets `_2`, `_3`, ...
    """
    found: list[str] = []
    used = set(taken)
    for name in names:
        base = re.sub(r"[^A-Za-z0-9_]", "_", name).strip("_")
        if not re.match(r"[A-Za-z]", base) or base in _KEYWORDS:
            base = f"x_{base}"
        candidate, number = base[:LONGEST_NAME], 1
        while candidate in used:
            number += 1
            end = f"_{number}"
            candidate = base[: LONGEST_NAME - len(end)] + end
        used.add(candidate)
        found.append(candidate)
    return found
