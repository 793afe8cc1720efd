"""Put signals of several topics on a common time; windows of time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, is_inside
from cosim.trace.file.records import LATEST_NS
from cosim.trace.rows.hold import interpolated, rows_in_force, sample_and_hold
from cosim.trace.rows.layout import Signal
from cosim.trace.tables.frames import Align, Between, Column, Joined

_MOST_POINTS = 100_000_000


class Joinable(Protocol):
    """The part of a `Table` that is joined."""

    @property
    def topic(self) -> str:
        """See `Table`."""

    @property
    def log_time_ns(self) -> NDArray[np.int64]:
        """See `Table`."""

    @property
    def publish_time_ns(self) -> NDArray[np.int64]:
        """See `Table`."""

    @property
    def sent(self) -> NDArray[np.float64]:
        """See `Table`."""

    @property
    def columns(self) -> Mapping[str, NDArray[Any]]:
        """See `Table`."""

    @property
    def present(self) -> Mapping[str, NDArray[np.bool_]]:
        """See `Table`."""

    @property
    def signals(self) -> Mapping[str, Signal]:
        """See `Table`."""

    def __len__(self) -> int: ...

    def part(self, which: NDArray[Any]) -> Joinable:
        """See `Table`."""


def joined(
    where: str,
    wanted: Sequence[tuple[str, str | None]],
    names: Mapping[str, tuple[str, Signal]],
    tables: Mapping[str, Joinable],
    align: Align,
    between: Between,
) -> Joined:
    """Join columns of several topics.

    wanted : topics and their columns, None for all.
    names : topic and signal by the name of its column; `TOPIC:name` of others.
    align, between : as of `Framed`; of a topic in `tables`.
    """
    full = {(topic, signal.name): name for name, (topic, signal) in names.items()}
    chosen = [
        (full.get((topic, own), f"{topic}:{own}"), tables[topic], own)
        for topic, name in wanted
        for own in ([name] if name is not None else tables[topic].columns)
    ]
    base = _base(align, tables, [tables[topic] for topic, _ in wanted])
    columns = [_on(base, name, table, own, between) for name, table, own in chosen]
    return Joined(where, base, list({column.name: column for column in columns}.values()))


def joined_table(
    table: Joinable,
    what: str | Sequence[str] | None,
    align: Align,
    between: Between,
    start: float | None,
    end: float | None,
) -> Joined:
    """Join signals and groups of one topic; its rows as recorded by default."""
    low, high = window_ns(start, end)
    if start is not None or end is not None:
        table = table.part((table.log_time_ns >= low) & (table.log_time_ns <= high))
    where = f"topic {table.topic}"
    if isinstance(align, str) and align == "union":
        base, columns = table.log_time_ns, list(_recorded(table, what))
        _check(between)
    else:
        base = _base(align, {table.topic: table}, [table])
        columns = [_on(base, name, table, name, between) for name in _members(table, what)]
    return Joined(where, base, columns)


def _recorded(table: Joinable, what: str | Sequence[str] | None) -> Iterator[Column]:
    everywhere = np.ones(len(table), np.bool_)
    if what is None and (table.log_time_ns != table.publish_time_ns).any():
        yield Column("sent_s", "s", "time of sending", table.sent, everywhere)
    for name in _members(table, what):
        signal = table.signals[name]
        yield Column(
            name, signal.unit, signal.description, table.columns[name], table.present[name]
        )


def _members(table: Joinable, what: str | Sequence[str] | None) -> list[str]:
    """Return the columns wanted: by name, or all of a group."""
    if what is None:
        return list(table.columns)
    found: dict[str, None] = {}
    for name in [what] if isinstance(what, str) else what:
        inside = [c for c in table.columns if c == name or is_inside(c, name)]
        if not inside:
            raise InputError.unknown("signal", name, table.columns, where=f"topic {table.topic}")
        found |= dict.fromkeys(inside)
    return list(found)


def _on(base: NDArray[np.int64], name: str, table: Joinable, own: str, between: Between) -> Column:
    """Return the values of a column at instants [ns]."""
    _check(between)
    if own not in table.columns:
        raise InputError.unknown("signal", own, table.columns, where=f"topic {table.topic}")
    there, signal = table.present[own], table.signals[own]
    values, times = table.columns[own][there], table.log_time_ns[there]
    if between == "interpolate" and signal.hold == "continuous" and values.dtype.kind == "f":
        found = interpolated(values, times, base)
    else:
        found = sample_and_hold(values, rows_in_force(times, base))
    return Column(name, signal.unit, signal.description, *found)


def _check(between: Between) -> None:
    if between not in ("hold", "interpolate"):
        raise InputError.unknown("way", str(between), ["hold", "interpolate"], where="between")


def _base(
    align: Align, tables: Mapping[str, Joinable], chosen: Sequence[Joinable]
) -> NDArray[np.int64]:
    """Return the instants of the time base [ns], increasing."""
    every = np.unique(np.concatenate([t.log_time_ns for t in chosen] or [np.zeros(0, np.int64)]))
    if isinstance(align, str):
        if align == "union":
            return every
        if align in tables:
            return np.unique(tables[align].log_time_ns)
        raise InputError.unknown("topic to align with", align, ["union", *tables], where="align")
    if isinstance(align, int | float):
        period = round(align * 1e9) if np.isfinite(align) else 0
        if period < 1:
            raise InputError(
                "not a period", where="align", expected="at least a nanosecond", got=f"{align:g} s"
            )
        if every.size and (every[-1] - every[0]) // period > _MOST_POINTS:
            raise InputError("too many instants", where="align", expected=f"at most {_MOST_POINTS}")
        return np.arange(every[0], every[-1] + 1, period) if every.size else every
    given = np.asarray(align, np.float64)
    if given.ndim != 1 or not np.isfinite(given).all() or (np.diff(given) < 0).any():
        raise InputError("not instants", where="align", expected="finite, increasing seconds")
    return np.rint(given * 1e9).astype(np.int64)


def window_ns(start: float | None, end: float | None) -> tuple[int, int]:
    """Return a time window in nanoseconds, both ends included; None is no bound."""
    bounds = []
    for name, seconds, default in (("start", start, 0), ("end", end, LATEST_NS)):
        if seconds is None:
            bounds.append(default)
        elif math.isfinite(seconds):
            bounds.append(min(max(round(seconds * 1e9), -1), LATEST_NS))
        else:
            raise InputError("not a time", where=name, expected="finite seconds", got=repr(seconds))
    low, high = bounds
    if start is not None and end is not None and end < start:
        raise InputError(
            "the window ends before it starts", expected="start <= end", got=f"{start:g}, {end:g}"
        )
    return max(low, 0), high
