"""Thinned curves draw the same: no extreme, no gap and no step is lost."""

from __future__ import annotations

import base64

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from cosim.page import LARGEST, packed_times, packed_values
from cosim.trace.report.decimation import decimated

VALUES = arrays(
    np.float64,
    st.integers(1, 400),
    elements=st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.just(0.0)),
)


@given(VALUES, st.integers(1, 20), st.booleans())
def test_every_extreme_of_every_segment_survives(
    values: NDArray[np.float64],
    segments: int,
    stepwise: bool,  # noqa: FBT001 - hypothesis draws it
) -> None:
    """Least, greatest, first and last of each stretch; the gaps where they were."""
    t = np.cumsum(np.random.default_rng(values.size).exponential(size=values.size))
    kept = decimated(t, values, segments, stepwise=stepwise)
    assert np.all(np.diff(kept) > 0)
    assert {0, values.size - 1} <= set(kept.tolist())
    span = t[-1] - t[0] or 1.0
    segment = np.minimum(((t - t[0]) / span * segments).astype(int), segments - 1)
    for number in np.unique(segment):
        there = values[segment == number]
        drawn = values[kept][segment[kept] == number]
        for extreme in (np.min, np.max):
            finite = there[~np.isnan(there)]
            if finite.size and not stepwise:
                assert extreme(drawn[~np.isnan(drawn)]) == extreme(finite)
    assert np.isnan(values[kept]).any() == np.isnan(values).any()
    if stepwise:  # the steps between the first and the last are all the values there are
        ends = (np.nanmin, np.nanmax)
        if not np.isnan(values).all():
            assert [f(values[kept]) for f in ends] == [f(values) for f in ends]


def test_one_spike_in_a_million_is_drawn() -> None:
    """A single sample far out, in both directions; and few points remain."""
    t = np.arange(1_000_000) / 1000
    values = np.sin(t)
    values[123_456], values[777_777] = 50.0, -60.0
    kept = decimated(t, values, 300)
    assert kept.size <= 1200
    assert {123_456, 777_777} <= set(kept.tolist())


def test_only_the_changes_of_a_stepwise_value_are_kept() -> None:
    """Steps drawn from what is kept are the same function of time."""
    values = np.repeat([1.0, 2.0, 2.0, -1.0], 1000)
    t = np.arange(values.size) * 0.01
    kept = decimated(t, values, 100, stepwise=True)
    assert kept.tolist() == [0, 1000, 3000, 3999]
    again = values[kept][np.searchsorted(t[kept], t, side="right") - 1]
    assert np.array_equal(again, values)


def test_a_gap_keeps_both_ends() -> None:
    """Where numbers are missing the line is broken, and nowhere else."""
    values = np.sin(np.arange(10_000) / 7)
    values[4_000:5_000] = np.nan
    kept = set(decimated(np.arange(10_000.0), values, 10).tolist())
    assert {3_999, 4_000, 4_999, 5_000} <= kept


def unpacked(packed: dict[str, str]) -> NDArray[np.float64]:
    kind = {"f4": "<f4", "f8": "<f8"}[packed["dtype"]]
    return np.frombuffer(base64.b64decode(packed["bdata"]), kind).astype(np.float64)


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        ([0.0, 0.5, np.nan, 3.25], "f4"),
        ([1e6, 1e6 + 1e-3, 1e6 + 2e-3], "f8"),
        ([0.0, 1e300, -np.inf], "f8"),
        ([np.nan, np.nan], "f4"),
        ([5.0], "f4"),
        ([0.1], "f8"),
    ],
)
def test_numbers_are_drawn_as_they_are(values: list[float], kind: str) -> None:
    """Four bytes only where they are close enough for any zoom out of one screen."""
    given_values = np.array(values)
    packed = packed_values(given_values)
    assert packed["dtype"] == kind
    drawn = unpacked(packed)
    wanted = np.clip(given_values, -LARGEST, LARGEST)
    span = np.ptp(wanted[np.isfinite(wanted)]) if np.isfinite(wanted).any() else 0.0
    assert np.allclose(drawn, wanted, rtol=0, atol=1e-5 * span, equal_nan=True)


def test_times_far_from_zero_stay_apart() -> None:
    """A millisecond after a day is still a millisecond."""
    t = 86_400 + np.arange(100) * 1e-3
    assert packed_times(t)["dtype"] == "f8"
    assert np.array_equal(unpacked(packed_times(t)), t)
    assert packed_times(np.arange(100) * 0.05)["dtype"] == "f4"
