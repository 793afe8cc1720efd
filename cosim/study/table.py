"""The results as one Arrow table, with their provenance in its metadata.

Beyond `PART_RUNS` runs the file of the table is a folder with a file for each so many runs: who
writes it needs memory for one of them. Arrow, pandas, DuckDB and Dask read such a folder as one.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from cosim.core import AnyPath, InputError, optional
from cosim.study.batch import Row
from cosim.study.folder import RESULTS, not_kept, read_manifest, read_rows, remove
from cosim.study.rare_study import RarePoints
from cosim.study.run_log import RunLog
from cosim.study.schema import RESERVED, Study
from cosim.study.stages import points_of_rows
from cosim.study.varied import as_cell

KEY = b"cosim.study"
"""The metadata entry that holds the manifest."""
PART_RUNS = 100_000
"""Runs in each file of a table."""
_AT_ONCE = 10_000  # rows of Python objects in memory
_CELLS = (bool, int, float, str)  # types of an axis' values; others are written as JSON


def pyarrow() -> Any:
    """Import pyarrow with its Parquet part; raise InputError if it is not installed."""
    return optional(
        "pyarrow", "pyarrow.parquet", extra="study", what="tables of results need pyarrow"
    )


Rows = RunLog | Sequence[Row]


def make_table(manifest: dict[str, Any], rows: RunLog | Iterable[Row]) -> Any:
    """Return the table: a row per run, in order; columns run, axes, status, reason, metrics."""
    ordered = rows if isinstance(rows, RunLog) else sorted(rows)
    return pyarrow().concat_tables(_parts(manifest, ordered))


def _parts(manifest: dict[str, Any], rows: Rows) -> Iterator[Any]:
    """Yield the table in parts of `PART_RUNS` runs, at least one."""
    pa = pyarrow()
    cells = _Cells(Study.model_validate(manifest["study"]), rows)
    about = {KEY: json.dumps(manifest, sort_keys=True).encode()}
    schema = pa.schema(cells.types(rows), metadata=about)
    given = iter(rows)
    for _ in range(0, max(len(rows), 1), PART_RUNS):
        part = itertools.islice(given, PART_RUNS)
        pieces = [cells.batch(piece, schema) for piece in _pieces(part, _AT_ONCE)]
        yield pa.Table.from_batches(pieces, schema).combine_chunks()


class _Cells:
    """The cells of a study's table."""

    def __init__(self, study: Study, rows: Rows) -> None:
        self._study, self._points = study, points_of_rows(study, rows)
        self._levels = ["level"] if isinstance(self._points, RarePoints) else []
        self.names = (
            "run",
            *(axis.column for axis in study.vary),
            *self._levels,
            *RESERVED[1:],
            *study.metrics,
        )

    def of(self, row: Row) -> tuple[Any, ...]:
        """Return the cells of a run."""
        values = map(as_cell, self._points[row.run])
        level = [self._points.level(row.run)] if isinstance(self._points, RarePoints) else []
        return row.run, *values, *level, row.status, row.reason, *row.values

    def types(self, rows: Rows) -> list[tuple[str, Any]]:
        """Return the name of each column and the type that fits all its values."""
        metrics: list[set[type]] = [set() for _ in self._study.metrics]
        if isinstance(rows, RunLog):
            metrics = rows.types or metrics
        else:
            for row in rows:
                for found, value in zip(metrics, row.values, strict=True):
                    found.add(type(value))
        of_axes = self._points.types()
        axes: list[set[type]] = [{t if t in _CELLS else str for t in ts} for ts in of_axes]
        levels: list[set[type]] = [{int} for _ in self._levels]
        kinds: list[set[type]] = [{int}, *axes, *levels, {str}, {str}, *metrics]
        return [(name, _type_of(found)) for name, found in zip(self.names, kinds, strict=True)]

    def batch(self, rows: Sequence[Row], schema: Any) -> Any:
        """Return rows as a record batch."""
        columns = zip(*map(self.of, rows), strict=True)
        arrays = [_column(c, field.type) for c, field in zip(columns, schema, strict=True)]
        return pyarrow().record_batch(arrays, schema=schema)


def _pieces(rows: Iterator[Row], size: int) -> Iterator[list[Row]]:
    while piece := list(itertools.islice(rows, size)):
        yield piece


def _type_of(kinds: set[type]) -> Any:
    """Return the type that fits all values; None is missing."""
    pa = pyarrow()
    kinds = kinds - {type(None)}
    if kinds == {bool}:
        return pa.bool_()
    if kinds == {int}:
        return pa.int64()
    return pa.float64() if kinds <= {int, float} else pa.string()


def _column(values: Sequence[Any], kind: Any) -> Any:
    pa = pyarrow()
    if kind == pa.string():
        values = [None if v is None else str(v) for v in values]
    elif kind == pa.float64():
        values = [None if v is None else float(v) for v in values]
    return pa.array(values, kind)


def write_table(manifest: dict[str, Any], rows: Rows, path: Path) -> None:
    """Write a complete table or none; the same rows give the same bytes.

    Raises
    ------
    LossError : it cannot be written.
    """
    partial = path.with_name(path.name + ".partial")
    with not_kept(path):
        remove(partial)
        write = pyarrow().parquet.write_table
        for i, part in enumerate(_parts(manifest, rows)):
            file = partial
            if len(rows) > PART_RUNS:
                partial.mkdir(exist_ok=True)
                file = partial / f"part-{i:04}.parquet"
            write(part, file, compression="zstd")
        if partial.is_dir() or path.is_dir():
            remove(path)
        partial.replace(path)


def read_table(path: AnyPath) -> tuple[Any, dict[str, Any]]:
    """Read the table of a study and its manifest, from its folder or from `results.parquet`.

        >>> from cosim import DelaySystem, Scenario, sweep
        >>> from cosim.study import read_table
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1.0]]))
        >>> runs = sweep(lag, {"run.seed": [1, 2]}, out="seeds")
        >>> table, manifest = read_table("seeds")
        >>> table.num_rows, manifest["count"]
        (2, 2)

    For a study that is not finished, the table has the runs that are done.

    Raises
    ------
    InputError : it is neither, or the table was not written by a study.
    """
    path = Path(path)
    if path.is_dir():
        if (path / RESULTS).exists():
            return read_table(path / RESULTS)
        if not any(path.glob("*.parquet")):
            manifest = read_manifest(path)
            with read_rows(path) as rows:
                return make_table(manifest, rows), manifest
    pa = pyarrow()
    try:
        table = pa.parquet.read_table(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            "not the results of a study",
            where=str(path),
            expected="the folder of a study, or its results.parquet",
            got=str(error)[:300],
            hint="the folder that cosim study run wrote: studies/NAME",
        ) from error
    manifest = json.loads((table.schema.metadata or {}).get(KEY, b"null"))
    if manifest is None:
        raise InputError(
            "this table was not written by a study", where=str(path), got="no entry cosim.study"
        )
    return table, manifest
