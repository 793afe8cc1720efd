"""Tell a run that diverges from a component that fails, where a value leaves its range.

A value that grows step by step until it leaves a bound, or is no longer finite, diverges: the
model did what it says. Infinity or NaN out of finite, moderate values is a failure of the component
that gave it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cosim.core import ComponentError
from cosim.master.component_instance import ComponentInstance
from cosim.master.wiring import HISTORY, Wiring

_WITHOUT_MEASURE = 1e100
_ROWS, _GROWTH = 3, 100.0
"""Growth in each of so many rows, by this factor in all, is growth step by step."""


def has_grown(instance: ComponentInstance, count: int) -> bool:
    """Whether the values of a component grew step by step over its last rows before row `count`."""
    own = _own_rows(instance, count)
    values = [
        np.abs(rows[own]) / [abs(column.port.nominal or 1.0) for column in columns]
        for rows, columns in (
            (instance.outputs, instance.output_columns),
            (instance.inputs, instance.input_columns),
        )
        if columns
    ]
    if not values or not own.size:
        return False
    sizes = np.max(np.hstack(values), axis=1)
    finite = sizes[np.isfinite(sizes)]
    largest = np.maximum.accumulate(finite)
    if largest.size and largest[-1] >= _WITHOUT_MEASURE:
        return True
    last = largest[-_ROWS - 1 :]
    grows = last.size > _ROWS and bool((np.diff(last) > 0.0).all())
    return grows and bool(last[-1] >= _GROWTH * last[0])


def out_of_range(wiring: Wiring, k: int, column: int) -> tuple[bool, str]:
    """Return whether the run diverges with an output out of range in row k, and the reason.

    `column` : of the first such output.
    """
    row, seconds = wiring.rows[k], wiring.comm_points.at_s(wiring.comm_points.points_ns[k])
    if np.isfinite(row[column]):
        bound = wiring.bounds[column]
        name = wiring.signal(column)
        return True, f"{name} left the range of +-{bound:g} at t = {seconds:g} s"
    origin = origin_of(wiring, k, column)
    name, value = wiring.signal(origin), row[origin]
    instance = wiring.instance(name.component)
    if has_grown(instance, k):
        return True, f"{name} grew step by step and is {value:g} at t = {seconds:g} s"
    error = ComponentError(
        f"{name} is {value:g} at t = {seconds:g} s",
        where=f"component {instance.name!r} ({instance.component.description.path.name})",
        expected="a finite number: its inputs were finite, and nothing grew step by step before",
        got=f"{value:g}; before, {_largest(instance, k)}",
        hint="look at its log and parameters, or take a shorter communication step",
    )
    return False, error.text()


def origin_of(wiring: Wiring, k: int, first: int) -> int:
    """Return the column of the output that is not finite though all it is computed from is."""
    row = wiring.rows[k]
    for instance in wiring.instances:
        a, b = instance.output_column, instance.input_column
        outputs = row[a : a + len(instance.output_columns)]
        inputs = row[b : b + len(instance.input_columns)]
        wrong = np.flatnonzero(~np.isfinite(outputs))
        if wrong.size and np.isfinite(inputs).all():
            return a + int(wrong[0])
    return first


def _own_rows(instance: ComponentInstance, count: int) -> NDArray[np.int64]:
    """Return the last rows of a component before row `count`, of those that are always there."""
    return instance.own_points.own_between(max(count - HISTORY, 0), count)


def _largest(instance: ComponentInstance, k: int) -> str:
    own = _own_rows(instance, k)
    if not own.size:
        return "it gave no value"
    values = instance.outputs[own[-1]]
    place = int(np.argmax(np.abs(values)))
    name = instance.output_columns[place].name
    return f"the largest of its outputs was {name} = {values[place]:g}"
