"""Thinned curves draw the same: no extreme, no gap and no step is lost."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from report_pages import Curve, report_of, unpacked

from cosim.page import LARGEST, packed_times, packed_values
from cosim.trace import Rows, Signal, TraceWriter

SEGMENTS = 1500
"""Stretches of equal length of a curve on a page of few curves, each with up to four points."""


@pytest.fixture(autouse=True)
def light(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without their library, which takes longest and is always the same."""
    monkeypatch.setattr("cosim.page.render.plotly_js", lambda: "")


def drawn(
    folder: Path, times_ns: NDArray[np.int64], columns: dict[str, NDArray[np.float64]]
) -> dict[str, tuple[Curve, NDArray[np.intp]]]:
    """The curves of signals on a page, with the rows of the trace that their points are.

    A name that ends in `held` is that of a signal that is held, and drawn as steps.
    """
    signals = [
        Signal(name, hold="discrete" if name.endswith("held") else "continuous") for name in columns
    ]
    with TraceWriter(folder / "a.mcap", run={}) as writer:
        topic = writer.add_topic("/a/output", signals, schema_name="t.A")
        writer.write_rows([Rows(topic, times_ns, np.column_stack([*columns.values()]))])
        path = writer.finish({})
    found = {}
    t = times_ns / 1e9
    for chart in report_of(path, folder).charts.values():
        for curve in chart.curves:
            after = np.clip(np.searchsorted(t, curve.t), 1, t.size - 1)
            rows = after - (curve.t - t[after - 1] < t[after] - curve.t)
            assert curve.packed == (
                packed_times(t[rows]),
                packed_values(columns[curve.label][rows]),
            )
            found[curve.label] = curve, rows
    assert found.keys() == columns.keys()
    return found


@pytest.mark.parametrize("seed", range(4))
def test_every_extreme_of_every_segment_survives(tmp_path: Path, seed: int) -> None:
    """Least, greatest, first and last of each stretch; the gaps where they were."""
    choose = np.random.default_rng(seed)
    count = 12_000
    times = np.cumsum(choose.exponential(size=count) * 1e9).astype(np.int64)
    noise, few = choose.normal(size=(6, count)), choose.integers(0, 3, count) * 1.0
    gaps = np.where(choose.random(count) < 0.05, np.nan, noise[0])
    wide = np.where(np.arange(count) // 700 % 3 == 1, np.nan, noise[1])
    wild = np.select([few == 0, few == 1], [np.inf, -np.inf], noise[2])
    zeros = np.where(noise[3] > 3, noise[3], 0.0)
    columns = {"noise": noise[4], "few": few, "gaps": gaps, "wide": wide, "wild": wild}
    columns |= {"zeros": zeros, "gaps held": gaps, "few held": few, "noise held": noise[5]}
    t = times / 1e9
    span = t[-1] - t[0]
    segment = np.minimum(((t - t[0]) / span * SEGMENTS).astype(int), SEGMENTS - 1)
    starts = np.flatnonzero(np.diff(segment, prepend=-1))
    for name, (curve, rows) in drawn(tmp_path, times, columns).items():
        values = columns[name]
        assert curve.stepwise == name.endswith("held"), name
        assert np.all(np.diff(rows) > 0), name
        assert {0, count - 1} <= {*rows.tolist()}, name
        assert np.isnan(values[rows]).any() == np.isnan(values).any(), name
        if curve.stepwise:  # the steps between the first and the last are all the values there are
            assert [f(values[rows]) for f in (np.nanmin, np.nanmax)] == [
                f(values) for f in (np.nanmin, np.nanmax)
            ], name
            continue
        assert rows.size <= 4 * SEGMENTS + 2 * np.count_nonzero(np.diff(np.isnan(values))), name
        there = np.zeros(count, np.bool_)
        there[rows] = True
        for fill, best in ((-np.inf, np.maximum), (np.inf, np.minimum)):
            whole = np.where(np.isnan(values), fill, values)
            kept = np.where(there, whole, fill)
            assert np.array_equal(best.reduceat(kept, starts), best.reduceat(whole, starts)), name
        ends = np.append(starts[1:], count) - 1
        gap = np.flatnonzero(np.diff(np.isnan(values)))
        assert there[gap].all(), name
        assert there[gap + 1].all(), name
        assert there[starts].all(), name
        assert there[ends].all(), name


def test_one_spike_in_a_million_is_drawn(tmp_path: Path) -> None:
    """A single sample far out, in both directions; and few points remain."""
    t = np.arange(1_000_000) * 10**6
    values = np.sin(t / 1e9)
    values[123_456], values[777_777] = 50.0, -60.0
    _, rows = drawn(tmp_path, t, {"x": values})["x"]
    assert rows.size <= 4 * SEGMENTS
    assert {123_456, 777_777} <= {*rows.tolist()}


def test_rows_of_one_instant_keep_their_extremes(tmp_path: Path) -> None:
    """First, least, greatest, last: a curve without length is drawn too."""
    values = np.random.default_rng(1).normal(size=4 * SEGMENTS + 1)
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        topic = writer.add_topic("/a/output", [Signal("x", hold="continuous")], schema_name="t.A")
        for value in values.tolist():
            writer.write(topic, 10**9, [value])
        path = writer.finish({})
    ((curve,),) = (chart.curves for chart in report_of(path, tmp_path).charts.values())
    ends = [0, values.size - 1]
    chosen = sorted({*ends, int(values.argmin()), int(values.argmax())})
    assert curve.packed[1] == packed_values(values[chosen])


def test_only_the_changes_of_a_stepwise_value_are_kept(tmp_path: Path) -> None:
    """Steps drawn from what is kept are the same function of time."""
    t = np.arange(4000) * 10**7
    columns = {
        f"{k} held": np.repeat([1.0, second, second, -1.0], 1000)
        for k, second in enumerate((2.0, np.nan))
    }
    for name, (curve, rows) in drawn(tmp_path, t, columns).items():
        assert rows.tolist() == [0, 1000, 3000, 3999]
        again = curve.values[np.searchsorted(t[rows], t, side="right") - 1]
        assert np.array_equal(again, columns[name], equal_nan=True)


def test_a_gap_keeps_both_ends(tmp_path: Path) -> None:
    """Where numbers are missing the line is broken, and nowhere else."""
    values = np.sin(np.arange(100_000) / 7)
    values[40_007:50_003] = np.nan
    curve, rows = drawn(tmp_path, np.arange(100_000) * 10**9, {"x": values})["x"]
    assert {40_006, 40_007, 50_002, 50_003} <= {*rows.tolist()}
    assert curve.drawn["connectgaps"] is False
    missing = np.isnan(curve.values)
    assert np.array_equal(missing, (rows >= 40_007) & (rows < 50_003))


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
    found = unpacked(packed)
    wanted = np.clip(given_values, -LARGEST, LARGEST)
    span = np.ptp(wanted[np.isfinite(wanted)]) if np.isfinite(wanted).any() else 0.0
    assert np.allclose(found, wanted, rtol=0, atol=1e-5 * span, equal_nan=True)


def test_times_far_from_zero_stay_apart() -> None:
    """A millisecond after a day is still a millisecond."""
    t = 86_400 + np.arange(100) * 1e-3
    assert packed_times(t)["dtype"] == "f8"
    assert np.array_equal(unpacked(packed_times(t)), t)
    assert packed_times(np.arange(100) * 0.05)["dtype"] == "f4"
