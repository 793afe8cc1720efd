"""The results as one Arrow table, with their provenance in its metadata."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from cosim.core import InputError, optional
from cosim.study.batch import Row
from cosim.study.folder import RESULTS, not_written, read_manifest, read_rows
from cosim.study.points import Points
from cosim.study.schema import Study
from cosim.study.varied import as_cell

KEY = b"cosim.study"
"""The metadata entry that holds the manifest."""


def pyarrow() -> Any:
    """Import pyarrow with its Parquet part; raise InputError if it is not installed."""
    return optional(
        "pyarrow", "pyarrow.parquet", extra="study", what="tables of results need pyarrow"
    )


def make_table(manifest: dict[str, Any], rows: Iterable[Row]) -> Any:
    """Return the table: a row per run, in order; columns run, axes, status, reason, metrics."""
    pa = pyarrow()
    study = Study.model_validate(manifest["study"])
    points = Points(study)
    ordered = sorted(rows)
    columns: dict[str, Any] = {"run": pa.array([r.run for r in ordered], pa.int64())}
    values = [points[r.run] for r in ordered]
    for i, axis in enumerate(study.vary):
        columns[axis.column] = _column([as_cell(v[i]) for v in values])
    columns["status"] = pa.array([r.status for r in ordered], pa.string())
    columns["reason"] = pa.array([r.reason for r in ordered], pa.string())
    for j, name in enumerate(study.metrics):
        columns[name] = _column([r.values[j] for r in ordered])
    about = {KEY: json.dumps(manifest, sort_keys=True).encode()}
    return pa.table(columns).replace_schema_metadata(about)


def _column(values: Sequence[Any]) -> Any:
    """Return a column of the type that fits all values; None is missing."""
    pa = pyarrow()
    kinds = {type(v) for v in values if v is not None}
    if kinds <= {bool} and kinds:
        return pa.array(values, pa.bool_())
    if kinds == {int}:
        return pa.array(values, pa.int64())
    if kinds <= {int, float}:
        return pa.array([None if v is None else float(v) for v in values], pa.float64())
    return pa.array([None if v is None else str(v) for v in values], pa.string())


def write_table(table: Any, path: Path) -> None:
    """Write a complete Parquet file or none; the same table gives the same bytes.

    Raises
    ------
    LossError : it cannot be written.
    """
    partial = path.with_name(path.name + ".partial")
    with not_written(path):
        pyarrow().parquet.write_table(table, partial, compression="zstd")
        partial.replace(path)


def read_table(path: str | Path) -> tuple[Any, dict[str, Any]]:
    """Read the table of a study and its manifest, from its folder or from `results.parquet`.

    For a study that is not finished, the table has the runs that are done.

    Raises
    ------
    InputError : it is neither, or the table was not written by a study.
    """
    path = Path(path)
    if path.is_dir():
        if (path / RESULTS).is_file():
            return read_table(path / RESULTS)
        manifest = read_manifest(path)
        return make_table(manifest, read_rows(path)), manifest
    pa = pyarrow()
    try:
        table = pa.parquet.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            "not the results of a study",
            where=str(path),
            expected="the folder of a study, or its results.parquet",
            got=str(error)[:300],
        ) from error
    manifest = json.loads((table.schema.metadata or {}).get(KEY, b"null"))
    if manifest is None:
        raise InputError(
            "this table was not written by a study", where=str(path), got="no entry cosim.study"
        )
    return table, manifest
