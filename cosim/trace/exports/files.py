"""Write tables as files: CSV, and Parquet (the extra `tables`)."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.trace.reader import Trace
from cosim.trace.tables.arrow import arrow_array, arrow_field
from cosim.trace.tables.column import Column

_ROWS = 20_000


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table to be written; `topic` is None for the wide form."""

    topic: str | None
    columns: list[Column]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.columns[0].values.size)


class CsvFile:
    """A CSV file (RFC 4180) of which rows are written bit by bit.

    A header, numbers that read back to the same bits, empty if absent.
    """

    def __init__(self, path: Path, sheet: Sheet) -> None:
        self._stream = path.open("w", encoding="utf-8", newline="")
        self._writer = csv.writer(self._stream)
        self._writer.writerow([column.name for column in sheet.columns])

    def append(self, sheet: Sheet) -> None:
        """Write further rows of the same columns."""
        for begin in range(0, sheet.rows, _ROWS):
            texts = [_texts(column, begin, begin + _ROWS) for column in sheet.columns]
            self._writer.writerows(zip(*texts, strict=True))

    def close(self) -> None:
        """Finish the file."""
        self._stream.close()


def _texts(column: Column, begin: int, end: int) -> Iterator[Any]:
    values, present = column.values[begin:end], column.present[begin:end]
    # csv writes the str of a float: the shortest text that reads back to the same double
    texts = values.tolist()
    if column.values.dtype.kind == "b":
        texts = ["true" if value else "false" for value in texts]
    if present.all():
        return iter(texts)
    return iter([t if there else "" for t, there in zip(texts, present.tolist(), strict=True)])


class ParquetFile:
    """A Parquet file of which rows are written bit by bit.

    Units and descriptions are in the fields, the origin is in the schema.

    Parameters
    ----------
    sheet : its columns; rows in it are not written.
    """

    def __init__(self, pa: Any, path: Path, sheet: Sheet, trace: Trace, content_hash: str) -> None:
        self._pa = pa
        self._schema = _schema(pa, sheet, trace, content_hash)
        self._writer = pa.parquet.ParquetWriter(path, self._schema, compression="zstd")

    def append(self, sheet: Sheet) -> None:
        """Write further rows of the same columns."""
        pa, both = self._pa, zip(sheet.columns, self._schema, strict=True)
        arrays = [arrow_array(pa, column, field) for column, field in both]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()


def _schema(pa: Any, sheet: Sheet, trace: Trace, content_hash: str) -> Any:
    origin = {
        "cosim.trace": trace.path.name,
        "cosim.content_hash": content_hash,
        "cosim.content_hash_version": str(trace.content_hash_version),
        "cosim.run": json.dumps(trace.run, sort_keys=True),
        "cosim.units": json.dumps({c.name: c.unit for c in sheet.columns if c.unit is not None}),
    }
    if sheet.topic is not None:
        origin["cosim.topic"] = sheet.topic
    return pa.schema([arrow_field(pa, column) for column in sheet.columns], metadata=origin)
