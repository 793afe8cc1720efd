"""What a recorded link was like: losses, their runs, delays, ages and outages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.network import Recording

OUTAGE = 3
"""Losses in a row that count as an outage: one or two may be lost at any time."""


@dataclass(frozen=True)
class Spread:
    """Least, middle, mean, 95th percentile and greatest of some values; all finite."""

    least: float
    median: float
    mean: float
    p95: float
    greatest: float

    @classmethod
    def of(cls, values: NDArray[Any]) -> Spread | None:
        """Return the spread of values; None of no values."""
        if not values.size:
            return None
        median, p95 = np.quantile(values, [0.5, 0.95]).tolist()
        return cls(float(values.min()), median, float(values.mean()), p95, float(values.max()))


@dataclass(frozen=True)
class LinkStatistics:
    """Statistics of a recording; what was in flight at its end counts in `messages` only.

    Attributes
    ----------
    messages, arrived, lost : how many.
    duration_s : from the first sending to the last [s].
    interval_s : from one sending to the next [s]; None of one message.
    loss : share of the messages that were lost; None if all were in flight.
    loss_after_loss, loss_after_arrival : the same of those sent right after one that was lost, or
        that was not; None if there are none.
    runs_of_losses, runs_of_arrivals : how many runs of each length, by length.
    delay_s : time from sending to arrival [s]; None without times of arrival.
    delay_correlation : of the delays of messages that arrived, one after another; None where
        they do not vary.
    mean_age_s, greatest_age_s : of the newest message that had arrived, from the first arrival to
        the last [s]; None where fewer than two came, or without times.
    outages_s : beginning (sending of the first message lost, by the recorder's clock) and length,
        to the next sending of one that was not lost or the last sending [s], of all runs of at
        least `OUTAGE` losses.
    """

    messages: int
    arrived: int
    lost: int
    duration_s: float
    interval_s: Spread | None
    loss: float | None
    loss_after_loss: float | None
    loss_after_arrival: float | None
    runs_of_losses: dict[int, int]
    runs_of_arrivals: dict[int, int]
    delay_s: Spread | None
    delay_correlation: float | None
    mean_age_s: float | None
    greatest_age_s: float | None
    outages_s: list[tuple[float, float]]


def statistics_of(recording: Recording) -> LinkStatistics:
    """Return the statistics of a recording.

        >>> from cosim.network import Recording
        >>> from cosim.recordings import statistics_of
        >>> second = 10**9
        >>> recording = Recording([0, second, 2 * second], [False, True, False], [second // 4] * 3)
        >>> statistics = statistics_of(recording)
        >>> statistics.lost, statistics.delay_s.greatest, statistics.greatest_age_s
        (1, 0.25, 2.25)

    Messages in flight at the end of the recording count in `messages` only.
    """
    ended = recording.ended
    lost, sent_ns = recording.lost[ended], recording.sent_ns[ended]
    after = {bool(k): lost[1:][lost[:-1] == k] for k in (True, False)}
    first, length = runs_of(lost)
    mean_age, greatest_age = _ages(recording)
    delays = delays_of(recording)
    return LinkStatistics(
        messages=len(recording),
        arrived=int(np.count_nonzero(recording.arrived)),
        lost=int(np.count_nonzero(lost)),
        duration_s=float(recording.sent_ns[-1]) / 1e9,
        interval_s=Spread.of(np.diff(recording.sent_ns) / 1e9),
        loss=float(lost.mean()) if lost.size else None,
        loss_after_loss=float(after[True].mean()) if after[True].size else None,
        loss_after_arrival=float(after[False].mean()) if after[False].size else None,
        runs_of_losses=_histogram(length[lost[first]]),
        runs_of_arrivals=_histogram(length[~lost[first]]),
        delay_s=Spread.of(delays),
        delay_correlation=correlation(delays),
        mean_age_s=mean_age,
        greatest_age_s=greatest_age,
        outages_s=_outages(lost, sent_ns, recording.start_ns),
    )


def runs_of(lost: NDArray[np.bool_]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return where each run of equal values begins, and its length, int (m,) each."""
    first = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=-1))
    return first, np.diff(first, append=lost.size)


def delays_of(recording: Recording) -> NDArray[np.float64]:
    """Return the delays of the messages that arrived, in order of sending [s], float64 (n,)."""
    if recording.delay_ns is None:
        return np.zeros(0)
    return recording.delay_ns[recording.arrived] / 1e9


def correlation(values: NDArray[np.float64]) -> float | None:
    """Return the correlation of each value with the one after it; None where they do not vary."""
    if not values.size or np.ptp(values) == 0.0:
        return None
    own = values - values.mean()
    return float(own[1:] @ own[:-1]) / float(own @ own)


def _histogram(lengths: NDArray[np.intp]) -> dict[int, int]:
    values, counts = np.unique(lengths, return_counts=True)
    return dict(zip(values.tolist(), counts.tolist(), strict=True))


def _ages(recording: Recording) -> tuple[float | None, float | None]:
    """Return mean and greatest age of the newest message that had arrived [s]."""
    if recording.delay_ns is None:
        return None, None
    sent = recording.sent_ns[recording.arrived]
    at = sent + recording.delay_ns[recording.arrived]
    order = np.argsort(at, kind="stable")
    at, newest = at[order], np.maximum.accumulate(sent[order])
    if at.size < 2 or at[-1] == at[0]:
        return None, None
    young, old = at[:-1] - newest[:-1], at[1:] - newest[:-1]
    mean = float(((young + old) / 2 * np.diff(at)).sum()) / float(at[-1] - at[0])
    return mean / 1e9, float(old.max()) / 1e9


def _outages(
    lost: NDArray[np.bool_], sent_ns: NDArray[np.int64], start_ns: int
) -> list[tuple[float, float]]:
    first, length = runs_of(lost)
    long = lost[first] & (length >= OUTAGE)
    begins = first[long]
    ends = np.minimum(begins + length[long], lost.size - 1)
    spans = zip(sent_ns[begins].tolist(), sent_ns[ends].tolist(), strict=True)
    return [((a + start_ns) / 1e9, (b - a) / 1e9) for a, b in spans]
