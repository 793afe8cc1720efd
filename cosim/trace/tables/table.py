"""The rows of a topic as columns, and one signal over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, Seconds, is_inside
from cosim.trace.rows.hold import interpolated, rows_in_force, sample_and_hold
from cosim.trace.rows.layout import Signal
from cosim.trace.tables.column import Align, Between, Column, Joined
from cosim.trace.tables.frames import Framed
from cosim.trace.tables.series_plot import draw_series
from cosim.trace.tables.time_base import time_base, window_ns

Integers = NDArray[np.int64]
_NAMED = 6


@dataclass(frozen=True, slots=True, repr=False)
class Table(Framed):
    """The rows of a topic in file order.

        >>> from cosim import DelaySystem, Scenario, run
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> rows = run(lag).read("/lag/output")
        >>> len(rows), list(rows.columns), float(rows.delivered[-1])
        (11, ['x[1]'], 1.0)
        >>> bool((rows["x[1]"] > 0.3).all())
        True

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
        start: Seconds | None,
        end: Seconds | None,
    ) -> tuple[Mapping[str, Sequence[Any]], Sequence[Joined]]:
        """See `Framed`."""
        rows, names = self.within(start, end), self._members(what)
        _check(between)
        if not (isinstance(align, str) and align == "union"):
            base = time_base(align, {rows.topic: rows.log_time_ns}, [rows.log_time_ns])
            columns = [rows.column(name, base, between) for name in names]
            return {}, [Joined(f"topic {rows.topic}", base, columns)]
        columns = [rows.column(name) for name in names]
        if what is None and (rows.log_time_ns != rows.publish_time_ns).any():
            everywhere = np.ones(len(rows), np.bool_)
            columns.insert(0, Column("sent_s", "s", "time of sending", rows.sent, everywhere))
        return {}, [Joined(f"topic {rows.topic}", rows.log_time_ns, columns)]

    def _members(self, what: str | Sequence[str] | None) -> list[str]:
        """Return the columns wanted: by name, or all of a group."""
        if what is None:
            return list(self.columns)
        found: dict[str, None] = {}
        for name in [what] if isinstance(what, str) else what:
            inside = [c for c in self.columns if c == name or is_inside(c, name)]
            if not inside:
                raise InputError.unknown("signal", name, self.columns, where=f"topic {self.topic}")
            found |= dict.fromkeys(inside)
        return list(found)

    def column(
        self,
        name: str,
        base: Integers | None = None,
        between: Between = "hold",
        *,
        full_name: str | None = None,
    ) -> Column:
        """Return a column, under another name if given: its rows, or its values at instants [ns].

        Raises
        ------
        InputError : no such column, or no such way between rows.
        """
        _check(between)
        values, there, signal = self[name], self.present[name], self.signals[name]
        if base is not None:
            values, times = values[there], self.log_time_ns[there]
            continuous = signal.hold == "continuous" and values.dtype.kind == "f"
            if between == "interpolate" and continuous:
                values, there = interpolated(values, times, base)
            else:
                values, there = sample_and_hold(values, rows_in_force(times, base))
        return Column(full_name or name, signal.unit, signal.description, values, there)

    def within(self, start: Seconds | None, end: Seconds | None) -> Table:
        """Return the rows delivered in a window [s], both ends included; None is no bound."""
        low, high = window_ns(start, end)
        if start is None and end is None:
            return self
        return self.part((self.log_time_ns >= low) & (self.log_time_ns <= high))

    def in_force(self) -> Table:
        """Return the last row, and those before it in which a column has its last value."""
        order = np.argsort(self.log_time_ns, kind="stable")
        last = {*order[-1:].tolist()}
        for there in self.present.values():
            last.update(order[there[order]][-1:].tolist())
        return self.part(np.array(sorted(last), np.int64))

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

    def after(self, before: Table | None) -> Table:
        """Return these rows behind those of another table of the same columns, if there is one."""
        if before is None:
            return self

        def joined(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
            return np.concatenate([first, second])

        return Table(
            self.topic,
            joined(before.log_time_ns, self.log_time_ns),
            joined(before.publish_time_ns, self.publish_time_ns),
            joined(before.sequence, self.sequence),
            {name: joined(before.columns[name], column) for name, column in self.columns.items()},
            {name: joined(before.present[name], there) for name, there in self.present.items()},
            self.signals,
        )


@dataclass(frozen=True, slots=True, repr=False)
class Series:
    """One signal over time, or a group of them at the same instants.

        >>> from cosim import DelaySystem, Scenario, run
        >>> lag = Scenario(step=0.1, until=1).add("lag", DelaySystem([[-1]]), initial=[1.0])
        >>> x = run(lag)["lag.x[1]"]
        >>> len(x), float(x.delivered[-1]), float(x.values[0])
        (11, 1.0, 1.0)
        >>> round(float(x.values[-1]), 3)
        0.368

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

    def plot(self, ax: Any = None) -> Any:
        """Draw it over time with matplotlib (the extra `plot`); return the axes.

        Raises
        ------
        InputError : texts, or matplotlib is not installed.
        """
        labels = [self.name] if self.values.ndim == 1 else str(self.description).split(", ")
        ylabel = f"{self.name} [{self.unit}]" if self.unit else self.name
        stepwise = self.hold != "continuous"
        return draw_series(self.delivered, self.values, labels, ylabel, stepwise=stepwise, ax=ax)

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


def _check(between: Between) -> None:
    if between not in ("hold", "interpolate"):
        raise InputError.unknown("way", str(between), ["hold", "interpolate"], where="between")
