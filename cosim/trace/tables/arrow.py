"""Columns as Arrow takes them: types, units, what is missing (extra `tables`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.core import optional
from cosim.trace.tables.column import Column


def pyarrow(what: str = "Arrow tables need pyarrow", *, otherwise: str | None = None) -> Any:
    """Import pyarrow and its Parquet; `InputError` with what to do if it is not installed."""
    return optional("pyarrow", "pyarrow.parquet", extra="tables", what=what, otherwise=otherwise)


def arrow_field(pa: Any, column: Column) -> Any:
    """Return name, type, unit and description of a column; what is no number is a text."""
    kinds = {"f": pa.float64(), "i": pa.int64(), "u": pa.uint64(), "b": pa.bool_()}
    kind = kinds.get(column.values.dtype.kind, pa.string())
    notes = {"unit": column.unit, "description": column.description}
    known = {key: text for key, text in notes.items() if text is not None}
    return pa.field(column.name, kind, metadata=known)


def arrow_array(pa: Any, column: Column, field: Any) -> Any:
    """Return the values of a column as `field` has them; null where there is none."""
    mask = None if column.present.all() else ~column.present
    values = column.values
    if field.type == pa.string():
        values = np.array([str(value) for value in values], object)
    return pa.array(values, type=field.type, mask=mask)
