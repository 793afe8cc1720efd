"""The rows of a topic as columns, and one signal over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, optional
from cosim.trace.layout import Signal

Integers = NDArray[np.int64]

Index = Literal["seconds", "timedelta"]
"""The time of a data frame: seconds as doubles, or exact nanoseconds."""


@dataclass(frozen=True, slots=True, repr=False)
class Table:
    """The rows of a topic in file order.

    Attributes
    ----------
    log_time_ns : instants of delivery [ns], int64 (m,).
    publish_time_ns : instants of sending [ns], int64 (m,); equal to `log_time_ns` but on links.
    sequence : sequence numbers, int64 (m,).
    columns : by FMI name: float64, int64, bool, or object (str).
    present : where each column has a value; elsewhere it has NaN, 0, False or "".
    signals : unit, description and hold of each column, by name.
    """

    topic: str
    log_time_ns: Integers
    publish_time_ns: Integers
    sequence: Integers
    columns: dict[str, NDArray[Any]]
    present: dict[str, NDArray[np.bool_]]
    signals: dict[str, Signal]

    def __len__(self) -> int:
        return int(self.log_time_ns.size)

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return the column of a signal; `InputError` if there is none of this name."""
        if name not in self.columns:
            raise InputError.unknown("signal", name, self.columns, where=f"topic {self.topic}")
        return self.columns[name]

    @property
    def delivered(self) -> NDArray[np.float64]:
        """Instants of delivery [s]."""
        return self.log_time_ns / 1e9

    @property
    def sent(self) -> NDArray[np.float64]:
        """Instants of sending [s]."""
        return self.publish_time_ns / 1e9

    def __repr__(self) -> str:
        return f"<Table {self.topic}: {len(self)} rows, {', '.join(self.columns) or 'no columns'}>"

    def to_pandas(self, *, index: Index = "seconds") -> Any:
        """Return a pandas DataFrame of the rows, index `time_s` [s]; see `cosim.trace.frames`."""
        return rows_frame(self, index)

    def part(self, which: NDArray[Any]) -> Table:
        """Return the rows that a mask or indices select."""
        return Table(
            self.topic,
            self.log_time_ns[which],
            self.publish_time_ns[which],
            self.sequence[which],
            {name: column[which] for name, column in self.columns.items()},
            {name: present[which] for name, present in self.present.items()},
            self.signals,
        )

    def followed_by(self, other: Table) -> Table:
        """Return these rows and then those of another table with the same columns."""

        def joined(mine: NDArray[Any], theirs: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate([mine, theirs])

        return Table(
            self.topic,
            joined(self.log_time_ns, other.log_time_ns),
            joined(self.publish_time_ns, other.publish_time_ns),
            joined(self.sequence, other.sequence),
            {name: joined(column, other.columns[name]) for name, column in self.columns.items()},
            {name: joined(there, other.present[name]) for name, there in self.present.items()},
            self.signals,
        )


@dataclass(frozen=True, slots=True, repr=False)
class Series:
    """One signal over time.

    Attributes
    ----------
    name : FMI name, `eta.x`.
    topic : the topic it was recorded on.
    unit, description : as in the model description; None if there is none.
    hold : the value between two messages, "continuous" or "discrete" (FMI's variability).
    values : float64, int64, bool, or object (str), (m,).
    delivered_ns, sent_ns : log and publish times [ns], int64 (m,).
    """

    name: str
    topic: str
    unit: str | None
    description: str | None
    hold: str
    values: NDArray[Any]
    delivered_ns: Integers
    sent_ns: Integers

    @property
    def delivered(self) -> NDArray[np.float64]:
        """Instants of delivery [s]."""
        return self.delivered_ns / 1e9

    @property
    def sent(self) -> NDArray[np.float64]:
        """Instants of sending [s]."""
        return self.sent_ns / 1e9

    def __len__(self) -> int:
        return int(self.delivered_ns.size)

    def __repr__(self) -> str:
        unit = f" [{self.unit}]" if self.unit else ""
        if not len(self):
            return f"<Series {self.name}{unit}: no values>"
        first, last = self.values[0], self.values[-1]
        times = f"{self.delivered[0]:g} to {self.delivered[-1]:g} s"
        return f"<Series {self.name}{unit}: {len(self)} values, {times}, {first} to {last}>"

    def __array__(self, dtype: Any = None, copy: Any = None) -> NDArray[Any]:
        """Return the values, so that NumPy's functions take the series itself."""
        if copy is False:
            return np.asarray(self.values, dtype)
        return np.array(self.values, dtype)


def series_of(table: Table, name: str) -> Series:
    """Take one column of a table, where it has values; `InputError` if there is no such column."""
    values, signal, there = table[name], table.signals[name], table.present[name]
    log, sent = table.log_time_ns, table.publish_time_ns
    if not there.all():
        values, log, sent = values[there], log[there], sent[there]
    return Series(
        name, table.topic, signal.unit, signal.description, signal.hold, values, log, sent
    )


def pandas() -> Any:
    """Import pandas; `InputError` if it is not installed."""
    return optional("pandas", extra="tables", what="data frames need pandas")


def index_of(times_ns: Integers, index: Index) -> Any:
    """Return the index of a data frame: `time_s` [s], or `time`.

    Raises
    ------
    InputError : an index of another kind, or pandas is not installed.
    """
    pd = pandas()
    if index == "timedelta":
        return pd.to_timedelta(pd.Index(times_ns, name="time"), unit="ns")
    if index != "seconds":
        raise InputError.unknown("index", str(index), ["seconds", "timedelta"], where="index")
    return pd.Index(times_ns / 1e9, name="time_s")


def rows_frame(table: Table, index: Index = "seconds") -> Any:
    """Return the rows of one topic as a DataFrame; `InputError` without pandas."""
    pd = pandas()
    columns: dict[str, Any] = {}
    if (table.log_time_ns != table.publish_time_ns).any():
        columns["sent_s"] = table.sent
    for name, values in table.columns.items():
        columns[name] = with_gaps(values, table.present[name])
    frame = pd.DataFrame(columns, index=index_of(table.log_time_ns, index))
    frame.attrs["units"] = {n: s.unit for n, s in table.signals.items() if s.unit is not None}
    return frame


def with_gaps(values: NDArray[Any], there: NDArray[np.bool_]) -> NDArray[Any]:
    """Return values with the missing ones as pandas marks them: NaN or None."""
    if there.all() or values.dtype.kind == "f":
        return values
    if values.dtype.kind == "i":
        return np.where(there, values.astype(np.float64), np.nan)
    gaps = values.astype(object)
    gaps[~there] = None
    return gaps
