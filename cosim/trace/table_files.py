"""Write tables as files: CSV, and Parquet (the extra `tables`)."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import optional
from cosim.trace.content import CONTENT_HASH_VERSION
from cosim.trace.reader import Trace

_ROWS = 20_000


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table to be written: values, and where they are present."""

    name: str
    unit: str | None
    description: str | None
    values: NDArray[Any]
    present: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table to be written; `topic` is None for the wide form."""

    topic: str | None
    columns: list[Column]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.columns[0].values.size)


def write_csv(path: Path, sheet: Sheet) -> None:
    """Write CSV (RFC 4180): a header, numbers that read back to the same bits, empty if absent."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([column.name for column in sheet.columns])
        for begin in range(0, sheet.rows, _ROWS):
            texts = [_texts(column, begin, begin + _ROWS) for column in sheet.columns]
            writer.writerows(zip(*texts, strict=True))


def _texts(column: Column, begin: int, end: int) -> Iterator[Any]:
    values, present = column.values[begin:end], column.present[begin:end]
    # csv writes the str of a float: the shortest text that reads back to the same double
    texts = values.tolist()
    if column.values.dtype.kind == "b":
        texts = ["true" if value else "false" for value in texts]
    if present.all():
        return iter(texts)
    return iter([t if there else "" for t, there in zip(texts, present.tolist(), strict=True)])


def pyarrow() -> Any:
    """Import pyarrow; `InputError` if it is not installed."""
    return optional(
        "pyarrow",
        "pyarrow.parquet",
        extra="tables",
        what="Parquet needs pyarrow",
        otherwise="--to csv",
    )


def write_parquet(pa: Any, path: Path, sheet: Sheet, trace: Trace, content_hash: str) -> None:
    """Write Parquet, with units and descriptions in the fields and the origin in the schema."""
    arrays, fields = [], []
    for column in sheet.columns:
        mask = None if column.present.all() else ~column.present
        kind = {"f": pa.float64(), "i": pa.int64(), "b": pa.bool_()}.get(
            column.values.dtype.kind, pa.string()
        )
        values = column.values if kind != pa.string() else [str(v) for v in column.values]
        arrays.append(pa.array(values, type=kind, mask=mask))
        notes = {"unit": column.unit, "description": column.description}
        fields.append(
            pa.field(column.name, kind, metadata={k: v for k, v in notes.items() if v is not None})
        )
    origin = {
        "cosim.trace": trace.path.name,
        "cosim.content_hash": content_hash,
        "cosim.content_hash_version": str(CONTENT_HASH_VERSION),
        "cosim.run": json.dumps(trace.run, sort_keys=True),
        "cosim.units": json.dumps({c.name: c.unit for c in sheet.columns if c.unit is not None}),
    }
    if sheet.topic is not None:
        origin["cosim.topic"] = sheet.topic
    schema = pa.schema(fields, metadata=origin)
    pa.parquet.write_table(pa.Table.from_arrays(arrays, schema=schema), path, compression="zstd")
