"""What a study varies, in words: each axis, what it changes, how its values are chosen."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from cosim.study.association import rank_correlations
from cosim.study.columns import StudyColumns
from cosim.study.schema import Axis, GridAxis, ReplicatesAxis, SampledAxis

_DISTRIBUTIONS = {
    "uniform": "uniform from {0:g} to {1:g}",
    "loguniform": "log-uniform from {0:g} to {1:g}",
    "normal": "normal, mean {0:g}, deviation {1:g}",
    "lognormal": "log-normal, median {0:g}, deviation of the logarithm {1:g}",
    "triangular": "triangular from {0:g} over {1:g} to {2:g}",
    "integers": "integers from {0:g} to {1:g}",
}
_KINDS = {
    "random": "independent draws",
    "sobol": "Sobol' sequence",
    "latin": "Latin hypercube",
    "saltelli": "Saltelli's points",
}
_LONG = 160
_MOST_VALUES = 6


@dataclass(frozen=True)
class VariedAxis:
    """One axis in words; `values` are those of the runs in the table."""

    name: str
    changes: tuple[str, ...]
    how: str
    distinct: int
    values: str


def varied_axes(columns: StudyColumns) -> list[VariedAxis]:
    """Return every axis in words."""
    found = []
    for axis in columns.study.vary:
        column = columns.axes[axis.column]
        values = column.values[column.known]
        distinct = np.unique(values)
        many = distinct.size > _MOST_VALUES
        few = [_cut(column.text(v)) for v in distinct[:_MOST_VALUES]]
        words = ", ".join(few) + (", …" if many else "")
        if many and column.kind == "number":
            words = f"{few[0]} to {column.text(distinct[-1])}"
        changes = tuple(f"{p} = {e}" for p, e in axis.apply.items()) if axis.apply else axis.places
        found.append(VariedAxis(axis.column, changes, _how(axis), int(distinct.size), words))
    return found


def set_everywhere(columns: StudyColumns) -> list[tuple[str, str]]:
    """Return the places of the scenario that have other values in every run, and the values."""
    return [
        (place, _cut(json.dumps(value, sort_keys=True)))
        for place, value in columns.study.set.items()
    ]


def correlations_asked(columns: StudyColumns) -> list[tuple[str, str]]:
    """Return the correlations of the study in words, beside those of the runs."""
    found = []
    for one in columns.study.correlations:
        a, b = (columns.axes[name] for name in one.axes)
        here = rank_correlations([a], [b])[0, 0]
        words = f"{one.value:g} of the normal values behind them"
        measured = "" if np.isnan(here) else f"; rank correlation of the runs {here:.3f}"
        found.append((f"{a.name} and {b.name}", words + measured))
    return found


def _how(axis: Axis) -> str:
    if isinstance(axis, ReplicatesAxis):
        return f"{axis.count} seeds from {axis.first}"
    if isinstance(axis, GridAxis):
        if spaced := axis.linspace or axis.logspace:
            return f"{spaced[2]:g} values, {'even steps' if axis.linspace else 'even ratios'}"
        given = axis.values if axis.values is not None else axis.rows
        return _cut(f"given: {json.dumps(given, sort_keys=True)}")
    assert isinstance(axis, SampledAxis)  # noqa: S101 - there are no other axes
    how = _KINDS[axis.kind]
    for key, words in _DISTRIBUTIONS.items():
        if (given := getattr(axis, key)) is not None:
            return f"{words.format(*given)}; {how}"
    if axis.empirical is not None:
        return f"{len(axis.empirical)} measured values; {how}"
    weights = "" if axis.weights is None else f", weights {axis.weights}"
    return _cut(f"one of {json.dumps(axis.choice, sort_keys=True)}{weights}; {how}")


def _cut(text: str) -> str:
    return text if len(text) <= _LONG else f"{text[: _LONG - 1]}…"
