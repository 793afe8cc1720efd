"""The table of a study as typed columns: axes and metrics as numbers, how each run ended.

True and false are 1 and 0, words are numbered, and what is missing or not finite is NaN, so that
every statistic and picture treats them alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from cosim.study.points import Points
from cosim.study.schema import Axis, GridAxis, Study

Reals = NDArray[np.float64]
Integers = NDArray[np.int64]
MOST_GROUPS = 24
"""Most values of an axis that are groups of their own; of more, neighbours are taken together."""
_MOST_PARTS, _PER_PART = 12, 8


@dataclass(frozen=True)
class Column:
    """One axis or metric over the runs.

    Attributes
    ----------
    kind : "number"; "truth", whose values are 1 and 0; "text", whose values count in `words`.
    values : (n,), NaN where a run has none.
    unit : "" where it is not known, as of a study of an earlier version.
    """

    name: str
    kind: Literal["number", "truth", "text"]
    values: Reals
    words: tuple[str, ...] = ()
    unit: str = ""

    @property
    def title(self) -> str:
        """Name and unit, for the axis of a chart."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    @cached_property
    def known(self) -> NDArray[np.bool_]:
        """Which runs have a value, (n,)."""
        return np.isfinite(self.values)

    def text(self, value: float) -> str:
        """Return a value in words."""
        if not np.isfinite(value):
            return "–"
        if self.kind == "text":
            return self.words[int(value)]
        return ("no", "yes")[int(value)] if self.kind == "truth" else f"{value:.5g}"

    @cached_property
    def ranks(self) -> Reals:
        """Ranks of the known values, equal ones with their mean rank."""
        found: Reals = rankdata(self.values[self.known])
        return found

    @cached_property
    def groups(self) -> tuple[Integers, tuple[str, ...], Reals]:
        """The group of each run, -1 without, (n,), and names and centres of the groups.

        Each value is a group; of an axis with many values, each of some parts with equally many.
        """
        distinct, inverse = np.unique(self.values[self.known], return_inverse=True)
        if distinct.size <= MOST_GROUPS or self.kind != "number":
            names = tuple(self.text(value) for value in distinct)
            centres = distinct
        else:
            parts = min(_MOST_PARTS, distinct.size // _PER_PART)
            part = np.arange(distinct.size) * parts // distinct.size
            inverse = part[inverse]
            centres = np.array([np.median(distinct[part == k]) for k in range(parts)])
            ends = [(distinct[part == k][0], distinct[part == k][-1]) for k in range(parts)]
            names = tuple(f"{low:.4g} to {high:.4g}" for low, high in ends)
        found = np.full(self.values.size, -1, np.int64)
        found[self.known] = inverse
        return found, names, centres


@dataclass(frozen=True)
class StudyColumns:
    """The runs of a study, finished or not.

    Attributes
    ----------
    study, points : what was varied, and the values of all its runs.
    count : number of runs of the whole study.
    runs : number of each run in the table, increasing, (n,).
    statuses, reasons : of each run.
    axes, metrics : by name, in the order of the study.
    draws : number of the draw of each run (`Points.draws`); None where nothing is drawn.
    """

    study: Study
    points: Points
    count: int
    runs: Integers
    statuses: tuple[str, ...]
    reasons: tuple[str | None, ...]
    axes: dict[str, Column]
    metrics: dict[str, Column]
    draws: Integers | None

    @property
    def grid(self) -> list[Column]:
        """The grid axes that have several values."""
        names = [axis.column for axis in self.study.vary if isinstance(axis, GridAxis)]
        return [self.axes[name] for name in names if np.unique(self.axes[name].values).size > 1]

    def varied_axis(self, name: str) -> Axis:
        """Return the axis of this name."""
        return next(axis for axis in self.study.vary if axis.column == name)


def columns_of(table: Any, manifest: dict[str, Any]) -> StudyColumns:
    """Return the columns of a table and its manifest (`read_table`)."""
    study = Study.model_validate(manifest["study"])
    points = Points(study)
    runs = np.array(table.column("run").to_pylist(), np.int64)
    units = manifest.get("units", {})

    def column(name: str, *, truths: bool = False) -> Column:
        found = column_of(name, _cells(table, name), truths=truths)
        return replace(found, unit=units.get(name, "")) if found.kind == "number" else found

    return StudyColumns(
        study=study,
        points=points,
        count=int(manifest["count"]),
        runs=runs,
        statuses=tuple(table.column("status").to_pylist()),
        reasons=tuple(table.column("reason").to_pylist()),
        axes={axis.column: column(axis.column) for axis in study.vary},
        metrics={
            name: column(name, truths=study.metrics[name].asks)
            for name in table.column_names  # in the order of the file; that of the manifest is lost
            if name in study.metrics
        },
        draws=points.draws(runs),
    )


def _cells(table: Any, name: str) -> Any:
    """Return the cells of a column of the table: numbers as an array, others as a list."""
    column = table.column(name)
    numbers = str(column.type) in ("double", "int64")
    return column.to_numpy().astype(np.float64) if numbers else column.to_pylist()


def column_of(name: str, cells: Sequence[Any] | Reals, *, truths: bool = False) -> Column:
    """Return a column of cells: numbers, truths or texts; None is missing.

    truths : whether a column without any value is one of truths.
    """
    if isinstance(cells, np.ndarray):
        unknown = truths and not np.isfinite(cells).any()
        values = np.where(np.isfinite(cells), cells, np.nan)
        return Column(name, "truth" if unknown else "number", values)
    kinds = {type(cell) for cell in cells if cell is not None}
    if str in kinds:
        words = tuple(sorted({str(cell) for cell in cells if cell is not None}))
        place = {word: float(k) for k, word in enumerate(words)}
        given = [np.nan if cell is None else place[str(cell)] for cell in cells]
        return Column(name, "text", np.array(given, np.float64), words)
    values = np.array([np.nan if cell is None else float(cell) for cell in cells], np.float64)
    values[~np.isfinite(values)] = np.nan
    return Column(name, "truth" if kinds == {bool} or (truths and not kinds) else "number", values)
