"""The rows of a topic as columns, and one signal over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.rows.layout import Signal
from cosim.trace.tables.frames import Align, Between, Framed, Joined
from cosim.trace.tables.join import joined_table

Integers = NDArray[np.int64]
_NAMED = 6


@dataclass(frozen=True, slots=True, repr=False)
class Table(Framed):
    """The rows of a topic in file order.

    As a data frame, an Arrow table or a dataset: see `cosim.trace.tables.frames.Framed`.

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

    @property
    def superdense(self) -> Integers:
        """The n of the super-dense instant (t, n) of each row of a component, int64 (m,).

        A component has a row at each of the points (t, 0), (t, 1), ... of an instant at which
        something happens in event mode; elsewhere n is 0.
        """
        first = np.flatnonzero(np.diff(self.log_time_ns, prepend=-1))
        here = np.arange(len(self))
        return here - first[np.searchsorted(first, here, side="right") - 1] if len(self) else here

    def __repr__(self) -> str:
        names = list(self.columns)
        more = f", and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
        listed = ", ".join(names[:_NAMED]) or "no columns"
        return f"<Table {self.topic}: {len(self)} rows, {listed}{more}>"

    def _joined(
        self,
        what: str | Sequence[str] | None,
        align: Align,
        between: Between,
        start: float | None,
        end: float | None,
    ) -> tuple[Mapping[str, Sequence[Any]], Sequence[Joined]]:
        """See `Framed`."""
        return {}, [joined_table(self, what, align, between, start, end)]

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
    """One signal over time, or a group of them at the same instants.

    Attributes
    ----------
    name : FMI name, `eta.x`; of a group the name as it was asked for.
    topic : the topic it was recorded on.
    unit, description : as in the model description; None if there is none.
    hold : the value between two messages, "continuous" or "discrete" (FMI's variability).
    values : float64, int64, bool, or object (str), (m,); of a group doubles, (m, signals), with
        NaN where there is none.
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


def group_of(table: Table, group: str, names: Sequence[str]) -> Series:
    """Take several columns of numbers of a table as one series, in this order.

    Raises
    ------
    InputError : a column of texts.
    """
    texts = [name for name in names if table[name].dtype.kind == "O"]
    if texts:
        raise InputError(
            "texts and numbers have no common series",
            where=f"topic {table.topic}, {group}",
            expected="a group of numbers",
            got=f"{texts[0]} is a text",
        )
    columns = [np.where(table.present[name], table[name], np.nan) for name in names]
    units = {table.signals[name].unit for name in names}
    holds = {table.signals[name].hold for name in names}
    return Series(
        group,
        table.topic,
        units.pop() if len(units) == 1 else None,
        ", ".join(names),
        holds.pop() if len(holds) == 1 else "discrete",
        np.column_stack(columns),
        table.log_time_ns,
        table.publish_time_ns,
    )
