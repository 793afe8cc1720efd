"""Columns over a common time as pandas, Arrow and xarray take them (extras `tables`, `xarray`)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, Seconds, optional
from cosim.trace.tables.arrow import arrow_array, arrow_field, pyarrow
from cosim.trace.tables.column import Align, Between, Column, Index, Integers, Joined

_EXACT = 2**53


class Framed(ABC):
    """A recording that can be read as a data frame: a topic, a trace, or several traces.

    All three take the same arguments in `to_pandas`, `to_arrow` and `to_xarray`:

    what : one topic: its rows as recorded, with `sent_s` where messages were sent before they
        were delivered. Or topics, signals (`plant.eta.x`) and groups (`plant.eta`), one or more:
        columns named as `Trace.signal` takes them, on a common time base. None: outputs and
        inputs of all components. Of a `Table`: signals and groups by their names in the topic
        (`eta.x`, `eta`); None: its rows as recorded.
    align : the time base. "union": every instant of a row. A topic: the instants of its rows. A
        period [s], or a text with a unit: from the first row to the last. An array: these
        instants [s].
        Before its first row a column is missing, as the library marks it.
    between : "hold": the value in force, sample and hold, as in the run, whatever the signal's
        own `hold` is. "interpolate": on the line between its rows, where the signal is a real
        number and its `hold` is continuous; else the value in force.
    index : "seconds", or "timedelta": exact to the nanosecond, as `resample` needs it.
    start, end : as in `Trace.read`; a value delivered before `start` is not in force after it.

    They raise `InputError` where there is no such topic or signal, a time base is invalid, or the
    library is not installed, and `LossError` as `Trace.read`.
    """

    __slots__ = ()

    def to_pandas(
        self,
        what: str | Sequence[str] | None = None,
        *,
        align: Align = "union",
        between: Between = "hold",
        index: Index = "seconds",
        start: Seconds | None = None,
        end: Seconds | None = None,
    ) -> Any:
        """Return a pandas DataFrame over the time of delivery; arguments as of `Framed`.

        Its index is `time_s` [s] or `time`, after the levels of several traces; units are in
        `attrs["units"]`.
        """
        pd = optional("pandas", extra="tables", what="data frames need pandas")
        levels, parts = self._joined(what, align, between, start, end)
        frames = [
            pd.DataFrame(
                {column.name: _with_gaps(pd, column) for column in part.columns},
                index=_index_of(pd, part.time_ns, index),
            )
            for part in parts
        ]
        frame = frames[0]
        if levels:
            keys = list(zip(*levels.values(), strict=True))
            frame = pd.concat(frames, keys=keys, names=[*levels, frame.index.name])
        frame.attrs["units"] = {
            column.name: column.unit
            for part in parts
            for column in part.columns
            if column.unit is not None
        }
        return frame

    def to_arrow(
        self,
        what: str | Sequence[str] | None = None,
        *,
        align: Align = "union",
        between: Between = "hold",
        index: Index = "seconds",
        start: Seconds | None = None,
        end: Seconds | None = None,
    ) -> Any:
        """Return an Arrow table; arguments as of `Framed`.

        The levels of several traces and the time are its first columns; units and
        descriptions are in the metadata of the fields, and what is missing is null.
        """
        pa = pyarrow()
        levels, parts = self._joined(what, align, between, start, end)
        above = {name: _level(pa, values) for name, values in levels.items()}
        tables = []
        for number, part in enumerate(parts):
            mine = np.full(part.time_ns.size, number)
            arrays = [values.take(mine) for values in above.values()]
            fields = [pa.field(name, values.type) for name, values in above.items()]
            name, values = _times(part.time_ns, index)
            arrays.append(pa.array(values))
            fields.append(pa.field(name, arrays[-1].type))
            own = [arrow_field(pa, column) for column in part.columns]
            arrays += [arrow_array(pa, *each) for each in zip(part.columns, own, strict=True)]
            fields += own
            tables.append(pa.Table.from_arrays(arrays, schema=pa.schema(fields)))
        return pa.concat_tables(tables, promote_options="permissive")

    def to_xarray(
        self,
        what: str | Sequence[str] | None = None,
        *,
        align: Align = "union",
        between: Between = "hold",
        index: Index = "seconds",
        start: Seconds | None = None,
        end: Seconds | None = None,
    ) -> Any:
        """Return an xarray Dataset over the coordinate `time`; arguments as of `Framed`.

        Each signal is a variable with `units` and `long_name` in its attributes. Of several traces
        the levels are dimensions where there is one trace for every combination of their values;
        else they are coordinates along the dimension `run`.

        Raises
        ------
        InputError : also where the traces have other instants, or other signals.
        """
        xr = optional("xarray", extra="xarray", what="datasets need xarray")
        levels, parts = self._joined(what, align, between, start, end)
        first = parts[0]
        for part in parts[1:]:
            _check_alike(first, part)
        dims, shape, coords = _dimensions(levels, len(parts))
        _, times = _times(first.time_ns, index)
        about = {"units": "s", "long_name": "time of delivery"} if index == "seconds" else {}
        coords["time"] = ("time", times, about)
        variables = {}
        for number, column in enumerate(first.columns):
            stacked = np.stack([_filled(part.columns[number]) for part in parts])
            notes = {"units": column.unit, "long_name": column.description}
            variables[column.name] = (
                (*dims, "time"),
                stacked.reshape(*shape, -1),
                {key: text for key, text in notes.items() if text is not None},
            )
        return xr.Dataset(variables, coords)

    @abstractmethod
    def _joined(
        self,
        what: str | Sequence[str] | None,
        align: Align,
        between: Between,
        start: Seconds | None,
        end: Seconds | None,
    ) -> tuple[Mapping[str, Sequence[Any]], Sequence[Joined]]:
        """Return the levels ({} of one recording), and the columns of each recording."""


def _times(time_ns: Integers, index: Index) -> tuple[str, NDArray[Any]]:
    """Return the name and the values of the time; `InputError` for an index of another kind."""
    if index == "timedelta":
        return "time", time_ns.astype("timedelta64[ns]")
    if index != "seconds":
        raise InputError.unknown("index", str(index), ["seconds", "timedelta"], where="index")
    return "time_s", time_ns / 1e9


def _index_of(pd: Any, time_ns: Integers, index: Index) -> Any:
    name, values = _times(time_ns, index)
    return pd.Index(values, name=name)


def _level(pa: Any, values: Sequence[Any]) -> Any:
    """Return the values of a level as an array; as text where they are of several types."""
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):
        return pa.array([None if value is None else str(value) for value in values])


def _with_gaps(pd: Any, column: Column) -> Any:
    """Return values with the missing ones as pandas marks them: NaN, NA of integers, None."""
    values, there = column.values, column.present
    if there.all() or values.dtype.kind == "f":
        return values
    if values.dtype.kind in "iu":
        return pd.arrays.IntegerArray(values, ~there)
    return _with_none(values, there)


def _filled(column: Column) -> NDArray[Any]:
    """Return values with the missing ones as NumPy can mark them: NaN, or None."""
    values, there = column.values, column.present
    if there.all() or values.dtype.kind == "f":
        return values
    kind = values.dtype.kind
    if (kind == "i" and np.abs(values[there]).max(initial=0) <= _EXACT) or (
        kind == "u" and values[there].max(initial=0) <= _EXACT
    ):
        return np.where(there, values.astype(np.float64), np.nan)
    return _with_none(values, there)


def _with_none(values: NDArray[Any], there: NDArray[np.bool_]) -> NDArray[Any]:
    gaps = values.astype(object)
    gaps[~there] = None
    return gaps


def _check_alike(a: Joined, b: Joined) -> None:
    """Raise an `InputError` where two traces cannot stand in one dataset."""
    names = [[column.name for column in one.columns] for one in (a, b)]
    if names[0] != names[1]:
        other = set(names[0]) ^ set(names[1])
        raise InputError(
            "the traces have other signals",
            where=b.where,
            expected=f"those of {a.where}",
            got=f"only one of them has {', '.join(sorted(other))}" if other else "another order",
            hint="name the signals that all of them have",
        )
    if not np.array_equal(a.time_ns, b.time_ns):
        until = [
            f"{t.size} instants up to {t.max() / 1e9:g} s" if t.size else "none"
            for t in (a.time_ns, b.time_ns)
        ]
        raise InputError(
            "the traces have other instants",
            where=b.where,
            expected=f"those of {a.where}: {until[0]}",
            got=until[1],
            hint="give a common time base: align=0.1, or align=numpy.arange(0, 10, 0.1) where "
            "they begin or end at other times",
        )


def _dimensions(
    levels: Mapping[str, Sequence[Any]], count: int
) -> tuple[tuple[str, ...], tuple[int, ...], dict[str, Any]]:
    """Return dimensions before the time, their lengths, and the coordinates of the levels.

    Recordings are in the order of their levels, which is that of a grid.
    """
    if not levels:
        return (), (), {}
    unique = {name: list(dict.fromkeys(values)) for name, values in levels.items()}
    shape = tuple(len(values) for values in unique.values())
    rows = set(zip(*levels.values(), strict=True))
    if len(rows) == count == int(np.prod(shape)):
        return tuple(levels), shape, {name: (name, values) for name, values in unique.items()}
    return ("run",), (count,), {name: ("run", list(values)) for name, values in levels.items()}
