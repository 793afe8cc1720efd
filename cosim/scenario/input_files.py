"""Time series that inputs follow: read from CSV or Parquet, and made into signals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, QuantityError, parse_quantity
from cosim.fmu import FmuDescription, Port
from cosim.master import CommunicationSchedule, Endpoint
from cosim.network import no_rows, read_rows
from cosim.scenario.matching import endpoint
from cosim.scenario.signal_parts import InputsPart
from cosim.scenario.units import unit_of

Reals = NDArray[np.float64]


def with_values(part: InputsPart, folder: Path) -> InputsPart:
    """Read the file of a time series: it then needs no other file.

    Raises
    ------
    InputError : no such file or column, a cell that is no finite number, times that do not
        increase, or a Parquet file without pyarrow.
    """
    if part.file is None or part.columns is None:
        return part
    path = folder / part.file
    wanted = list(dict.fromkeys(part.columns.values()))
    found = _series(path, part.time, wanted)
    rest = {k: getattr(part, k) for k in part.model_fields_set - {"file", "time", "columns"}}
    values = {name: found[1][column] for name, column in part.columns.items()}
    return InputsPart(**rest, times=found[0], values=values)


def _series(path: Path, time: str, columns: Sequence[str]) -> tuple[list[float], dict[str, Any]]:
    times: list[float] = []
    values: dict[str, list[float]] = {name: [] for name in columns}
    for row in read_rows(path, [*dict.fromkeys((time, *columns))], whole=True):
        times.append(row.nanoseconds(time) / 1e9)
        if len(times) > 1 and times[-1] <= times[-2]:
            raise _not_increasing(row.where(time), times)
        for name in columns:
            values[name].append(row.number(name, "a finite number"))
    if not times:
        raise no_rows(path, f"lines of {', '.join((time, *columns))}")
    return times, values


def _not_increasing(where: str, times: Sequence[float]) -> InputError:
    return InputError(
        "the times of a series do not increase",
        where=where,
        expected=f"more than {times[-2]:g} s",
        got=f"{times[-1]:g} s",
    )


def series_inputs(
    part: InputsPart,
    fmus: Mapping[str, FmuDescription],
    schedule: CommunicationSchedule,
    *,
    at_rest: bool = False,
) -> dict[Endpoint, Any]:
    """Return the inputs that follow a time series; zero for a run `at_rest`.

    Raises
    ------
    InputError : no such component or input, a unit of another dimension, or a run that goes beyond
        a series whose ends refuse that.
    """
    times = np.array(part.times, np.float64)
    first, last = schedule.start_ns / 1e9, (schedule.start_ns + schedule.end_ns) / 1e9
    if part.beyond == "refuse" and (times[0] > first or times[-1] < last):
        raise InputError(
            "the run goes beyond the time series",
            where="beyond",
            expected=f"times from {first:g} s to the end of the run, {last:g} s",
            got=f"{times[0]:g} to {times[-1]:g} s",
            hint='beyond = "hold", "zero" or "repeat"',
        )
    driven: dict[Endpoint, Any] = {}
    for name, column in (part.values or {}).items():
        target = endpoint(name)
        if target.component not in fmus:
            raise InputError.unknown("component", target.component, fmus, where=f"values.{name}")
        fmu = fmus[target.component]
        port = fmu.port(target.variable, where=f"component {target.component!r}")
        values = np.array(column, np.float64)
        if name in part.units:
            values = _in_unit_of(fmu, port, values, part.units[name], f"units.{name}")
        driven[target] = (
            np.zeros_like
            if at_rest
            else partial(_along, times, values, part.interpolation, part.beyond)
        )
    return driven


def _in_unit_of(fmu: FmuDescription, port: Port, values: Reals, unit: str, where: str) -> Reals:
    declared = unit_of(fmu, port)
    try:
        one, none = parse_quantity(f"1 {unit}"), parse_quantity(f"0 {unit}")
    except QuantityError as error:
        raise InputError(
            "this is not a unit", where=where, expected=str(error), got=unit
        ) from error
    wanted = None if declared is None else declared.dimension
    if (
        declared is None
        or wanted is None
        or one.dimension.without_angle() != (wanted.without_angle())
    ):
        raise InputError(
            f"{port.name} is measured in {port.unit or 'no unit'}",
            where=where,
            expected=f"a unit of {wanted}" if wanted is not None else "no unit",
            got=f"{unit}, of {one.dimension}",
        )
    factor = (one.si - none.si) / declared.factor
    moved: Reals = values * factor
    offset = declared.from_si(none.si)
    return moved if offset == 0.0 else moved + offset


def _along(times: Reals, values: Reals, interpolation: str, beyond: str, seconds: Reals) -> Reals:
    outside = (seconds < times[0]) | (seconds > times[-1])
    if beyond == "repeat":
        length = times[-1] - times[0]
        turns = np.floor((seconds - times[0]) / length)
        seconds = np.where(outside, seconds - turns * length, seconds)
    place = np.clip(np.searchsorted(times, seconds, side="right") - 1, 0, times.size - 1)
    found: Reals = values[place]
    if interpolation == "linear" and times.size > 1:
        low = np.minimum(place, times.size - 2)
        share = np.clip((seconds - times[low]) / (times[low + 1] - times[low]), 0.0, 1.0)
        found = values[low] + share * (values[low + 1] - values[low])
    return np.where(outside, 0.0, found) if beyond == "zero" else found
