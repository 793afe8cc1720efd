"""Resample recorded signals at the communication points of a new run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cosim.core import InputError, distinct
from cosim.network import SUBSTITUTE, PacketLink, TransportLink, deliver
from cosim.replay.mapping import Source
from cosim.trace import Table, Trace
from cosim.trace.rows import component_of, rows_in_force
from cosim.trace.tables import series_of

Integers = NDArray[np.int64]
Link = PacketLink | TransportLink
_MOST_POINTS = 20_000_000


@dataclass(frozen=True, slots=True)
class InputValues:
    """Values of the inputs.

    Attributes
    ----------
    points_ns : communication points from 0 [ns].
    values : by input, one per point.
    shift_ns : first recorded instant, which becomes 0.
    """

    points_ns: Integers
    values: Mapping[str, NDArray[np.float64]]
    shift_ns: int


def resampled_inputs(
    trace: Trace,
    direct: Mapping[str, Source],
    linked: Mapping[str, Source],
    link: Link | None,
    starts: Mapping[str, float],
    step_ns: int | None,
) -> InputValues:
    """Resample the sources of the inputs at every communication point.

    Parameters
    ----------
    direct, linked : sources by input; the linked ones go over `link`.
    starts : values of inputs before the first recorded value.
    step_ns : step of the points; None: the instants of the recorded rows and of the link.

    Raises
    ------
    InputError : fewer than two recorded instants, text, or too many points.
    """
    sources = {**direct, **linked}
    tables = trace.read_all(sorted(_topics(trace, sources.values())))
    times = np.unique(np.concatenate([table.log_time_ns for table in tables.values()]))
    if times.size < 2:
        raise InputError(
            "too little was recorded to run on",
            where=str(trace.path),
            expected="rows at two instants or more",
            got=f"{times.size} in {', '.join(tables)}",
        )
    shift = int(times[0])
    points = _points(times - shift, step_ns)
    in_use: Integers | None = None
    if linked and isinstance(link, PacketLink):
        end = int(points[-1])
        delivery = deliver(link, end, step_ns)
        if step_ns is None:
            crossings = delivery.sendings(-1, end), delivery.changes(-1, end)[0]
            points = distinct(np.concatenate([points, *crossings]))
        in_use = delivery.sent_in_use(points)
    values = {}
    for name, source in sources.items():
        received = in_use if name in linked else None
        at = points if received is None else np.maximum(received, 0)
        sent = _values_in_force(tables, source, at + shift, starts[name])
        if isinstance(link, PacketLink) and received is not None:
            values[name] = _received(link, received, sent, starts[name])
        else:
            values[name] = _transported(link, sent, points) if name in linked else sent
    return InputValues(points, values, shift)


def _topics(trace: Trace, sources: Iterable[Source]) -> set[str]:
    """Return the topics of the sources, and of the senders of what links delivered.

    The receiver also steps at the instants of the sender, not at deliveries alone.
    """
    found = set()
    for source in sources:
        found.add(source.topic)
        sender = trace.signals.get(source.column)
        if component_of(source.topic) is None and sender is not None:
            found.add(sender[0])
    return found


def _points(times: Integers, step_ns: int | None) -> Integers:
    if step_ns is None:
        return times
    end = int(times[-1])
    if not 1 <= step_ns <= end or end // step_ns > _MOST_POINTS:
        raise InputError(
            "the step does not fit the recording",
            where="`step`",
            expected=f"{end / _MOST_POINTS / 1e9:.3g} s to {end / 1e9:g} s",
            got=f"{step_ns / 1e9:g} s",
        )
    return np.append(np.arange(0, end, step_ns, dtype=np.int64), np.int64(end))


def _values_in_force(
    tables: Mapping[str, Table], source: Source, at_ns: Integers, start: float
) -> NDArray[np.float64]:
    """Return the values in force at some instants; the start value before the first row."""
    series = series_of(tables[source.topic], source.column)
    if series.values.dtype.kind not in "fib":
        raise InputError(
            "an input takes numbers and truth values only", where=source.name, got="text"
        )
    rows = rows_in_force(series.delivered_ns, at_ns)
    values = np.append(series.values.astype(np.float64), start)
    return values[np.where(rows >= 0, rows, values.size - 1)]


def _received(
    link: PacketLink, in_use: Integers, sent: NDArray[np.float64], start: float
) -> NDArray[np.float64]:
    """Return the values that a receiver has; `in_use`, `sent` : when they were sent, and were."""
    received = np.where(in_use >= 0, link.quantize(sent), start)
    if link.substitute is not None:
        received[in_use == SUBSTITUTE] = link.substitute
    return received


def _transported(
    link: Link | None, sent: NDArray[np.float64], points: Integers
) -> NDArray[np.float64]:
    """Return the delayed signal at the points, interpolated like a transport link of the master."""
    if not isinstance(link, TransportLink):
        return sent
    index, weight = link.rows(points)
    following = sent[np.minimum(index + 1, sent.size - 1)]
    delayed: NDArray[np.float64] = (1.0 - weight) * sent[index] + weight * following
    return np.where(weight > 0.0, delayed, sent[index])
