"""Read topics and signals as pandas DataFrames (the extra `tables`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError
from cosim.trace.hold import interpolated, rows_in_force, sample_and_hold
from cosim.trace.table import Index, Table, index_of, pandas, rows_frame, with_gaps
from cosim.trace.topic_info import Readable

Align = str | float | NDArray[np.float64]
"""A common time base: "union", a topic, a period [s], or instants [s]."""

Between = Literal["hold", "interpolate"]
"""Values between rows: the last one, or on a line where the signal's own `hold` is continuous."""

_MOST_POINTS = 100_000_000


def to_pandas(
    trace: Readable,
    what: str | Sequence[str],
    *,
    align: Align = "union",
    between: Between = "hold",
    index: Index = "seconds",
    start: float | None = None,
    end: float | None = None,
) -> Any:
    """Return a DataFrame over the time of delivery, index `time_s` [s]; units in `attrs["units"]`.

    Parameters
    ----------
    what : one topic: its rows as recorded, with `sent_s` where messages were sent before they
        were delivered. Or topics, signals (`plant.eta.x`) and groups (`plant.eta`), one or more:
        columns named as `Trace.signal` takes them, on a common time base.
    align : the time base. "union": every instant of a row. A topic: the instants of its rows. A
        number: that period [s], from the first row to the last. An array: these instants [s].
        Before its first row a column is missing, as pandas marks it.
    between : "hold": the value in force, sample and hold, as in the run, whatever the signal's
        own `hold` is. "interpolate": on the line between its rows, where the signal is a real
        number and its `hold` is continuous; else the value in force.
    index : "seconds", or "timedelta": `time`, exact to the nanosecond, as `resample` needs it.
    start, end : as in `Trace.read`; a value delivered before `start` is not in force after it.

    Raises
    ------
    InputError : no such topic or signal, an invalid time base, pandas is not installed.
    LossError : as in `Trace.read`.
    """
    if isinstance(what, str) and what in trace.topics:
        return rows_frame(trace.read(what, start=start, end=end), index)
    if between not in ("hold", "interpolate"):
        raise InputError.unknown("way", str(between), ["hold", "interpolate"], where="between")
    pd = pandas()
    wanted: list[tuple[str, str | None]] = []
    for name in [what] if isinstance(what, str) else what:
        if name in trace.topics:
            wanted.append((name, None))
        else:
            wanted += map(trace.place, trace.members(name))
    needed = dict.fromkeys(topic for topic, _ in wanted)
    if isinstance(align, str) and align in trace.topics:
        needed[align] = None
    tables = trace.read_all(list(needed), start=start, end=end)
    chosen = [
        (tables[topic], own)
        for topic, name in wanted
        for own in ([name] if name is not None else tables[topic].columns)
    ]
    base = _base(align, tables, [tables[topic] for topic, _ in wanted])
    full = {(topic, signal.name): name for name, (topic, signal) in trace.signals.items()}
    columns, units = {}, {}
    for table, own in chosen:
        there, signal = table.present[own], table.signals[own]
        values, times = table[own][there], table.log_time_ns[there]
        name = full.get((table.topic, own), f"{table.topic}:{own}")
        if between == "interpolate" and signal.hold == "continuous" and values.dtype.kind == "f":
            columns[name] = with_gaps(*interpolated(values, times, base))
        else:
            columns[name] = with_gaps(*sample_and_hold(values, rows_in_force(times, base)))
        if (unit := signal.unit) is not None:
            units[name] = unit
    frame = pd.DataFrame(columns, index=index_of(base, index))
    frame.attrs["units"] = units
    return frame


def _base(align: Align, tables: dict[str, Table], chosen: Sequence[Table]) -> NDArray[np.int64]:
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
