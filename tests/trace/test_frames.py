"""Topics side by side: the value in force, the age of messages, what was dropped."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, strategies as st
from network.fates import entries

from cosim.core import InputError
from cosim.network import GilbertElliott, Jitter, PacketLink, deliver
from cosim.trace import Rows, Signal, Table, Trace, Traces, TraceWriter
from cosim.trace.rows import DROPPED_SIGNALS, rows_in_force

S = 10**9


def recorded(path: Path) -> Trace:
    """Positions each second, an integer and a text now and then, a link of half a second."""
    with TraceWriter(path, run={}) as writer:
        plant = writer.add_topic(
            "/plant/output",
            [Signal("eta.x", unit="m"), Signal("eta.y", unit="m")],
            schema_name="t.P",
        )
        mode = writer.add_topic(
            "/pilot/output",
            [Signal("mode", kind="int"), Signal("word", kind="string"), Signal("on", kind="bool")],
            schema_name="t.M",
        )
        link = writer.add_topic("/link/up", [Signal("plant.eta.x", unit="m")], schema_name="t.L")
        times = np.arange(5) * S
        writer.write_rows([Rows(plant, times, np.column_stack([times / S, -times / S]))])
        for t, row in ((int(1.5 * S), [7, "a", True]), (3 * S, [8, "b", False])):
            writer.write(mode, t, row)
        for k in range(3):
            writer.write(link, k * S + S // 2, [float(k)], publish_time_ns=k * S, sequence=k)
        writer.finish({})
    return Trace(path)


def test_a_topic_is_a_frame_over_time(tmp_path: Path) -> None:
    trace = recorded(tmp_path / "a.mcap")
    frame = trace.to_pandas("/plant/output")
    assert frame.index.name == "time_s"
    assert frame["eta.y"].to_dict() == {float(t): -float(t) for t in range(5)}
    assert frame.attrs["units"] == {"eta.x": "m", "eta.y": "m"}
    assert trace.to_pandas("/link/up")["sent_s"].tolist() == [0.0, 1.0, 2.0]
    assert list(trace.to_pandas("/plant/output", start=3.0).index) == [3.0, 4.0]
    assert trace.read("/plant/output").to_pandas().equals(frame)
    assert list(trace.to_pandas().columns) == [
        "plant.eta.x", "plant.eta.y", "pilot.mode", "pilot.word", "pilot.on",
    ]  # fmt: skip


def test_signals_are_joined_by_sample_and_hold(tmp_path: Path) -> None:
    trace = recorded(tmp_path / "a.mcap")
    frame = trace.to_pandas(["plant.eta.x", "/pilot/output", "/link/up:plant.eta.x"])
    assert list(frame.columns) == [
        "plant.eta.x", "pilot.mode", "pilot.word", "pilot.on", "/link/up:plant.eta.x",
    ]  # fmt: skip
    assert list(frame.index) == [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0]
    assert frame["plant.eta.x"].tolist() == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 4.0]
    assert frame["pilot.mode"].tolist()[3:] == [7.0] * 3 + [8.0] * 2
    assert frame["pilot.mode"].isna().tolist() == [True] * 3 + [False] * 5
    assert frame["pilot.word"].isna().tolist() == [True] * 3 + [False] * 5
    assert frame["pilot.word"].tolist()[3:] == ["a"] * 3 + ["b"] * 2
    assert frame["pilot.on"].tolist()[:4] == [None] * 3 + [True]
    late = frame["/link/up:plant.eta.x"]
    assert np.isnan(late.iloc[0])
    assert late.tolist()[1:] == [0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0]


def test_align_takes_topic_period_and_instants(tmp_path: Path) -> None:
    trace = recorded(tmp_path / "a.mcap")
    names = ["plant.eta.x", "pilot.mode"]
    assert list(trace.to_pandas(names, align="/link/up").index) == [0.5, 1.5, 2.5]
    assert list(trace.to_pandas(names, align=2.0).index) == [0.0, 2.0, 4.0]
    frame = trace.to_pandas(names, align=np.array([2.9, 3.0, 9.0]))
    assert frame["plant.eta.x"].tolist() == [2.0, 3.0, 4.0]
    assert frame["pilot.mode"].tolist() == [7.0, 8.0, 8.0]
    for wrong in ("nonsense", 0.0, float("nan"), np.array([2.0, 1.0])):
        with pytest.raises(InputError):
            trace.to_pandas(names, align=wrong)
    with pytest.raises(InputError):
        trace.to_pandas(["plant.eta.z"])


def test_a_topic_a_trace_and_traces_take_the_same_arguments(tmp_path: Path) -> None:
    """Groups, a time base, interpolation and windows, in every way of reading."""
    trace = recorded(tmp_path / "a.mcap")
    for name in ("to_pandas", "to_arrow", "to_xarray"):
        takes = [inspect.signature(getattr(kind, name)) for kind in (Table, Trace, Traces)]
        assert takes[0] == takes[1] == takes[2]
    rows, several = trace.read("/plant/output"), Traces(trace.path)
    given: dict[str, Any] = {"align": 0.5, "index": "timedelta", "start": 1.0, "end": 3.0}
    frame = rows.to_pandas("eta", **given)
    assert frame["eta.x"].tolist() == [1.0, 1.0, 2.0, 2.0, 3.0]
    for other in (trace.to_pandas("plant.eta", **given), trace.to_pandas("/plant/output", **given)):
        assert other.set_axis(frame.columns, axis=1).equals(frame)
    assert several.to_pandas("plant.eta", **given).droplevel(0)["plant.eta.y"].tolist() == (
        frame["eta.y"].tolist()
    )
    late = trace.to_pandas("/plant/output", align="/link/up")
    assert late["plant.eta.x"].to_dict() == {0.5: 0.0, 1.5: 1.0, 2.5: 2.0}
    table = trace.to_arrow("plant.eta", **given)
    assert table.column_names == ["time", "plant.eta.x", "plant.eta.y"]
    assert table["plant.eta.y"].to_pylist() == frame["eta.y"].tolist()
    assert rows.to_arrow("eta", **given)["eta.y"] == table["plant.eta.y"]
    assert table.schema.field("plant.eta.y").metadata == {b"unit": b"m"}
    with pytest.raises(InputError, match=r"one of plant.eta.x, plant.eta.y"):
        trace.signal("plant.eta")
    for kind in (rows, trace, several):
        with pytest.raises(InputError, match=r"zeta"):
            kind.to_pandas("plant.zeta")
        with pytest.raises(InputError, match="hold, interpolate"):
            kind.to_arrow(between="spline")  # type: ignore[arg-type]


def test_integers_with_gaps_stay_exact(tmp_path: Path) -> None:
    """Beyond 2^53 a double has another value; what is missing is missing, and nothing else."""
    large = 2**62 + 1
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        topic = writer.add_topic("/a/output", [Signal("n", kind="int")], schema_name="t.A")
        writer.write(topic, 0, [None])
        writer.write(topic, S, [large])
        writer.finish({})
    trace = Trace(tmp_path / "a.mcap")
    assert trace.to_pandas("a.n")["a.n"].tolist() == [pd.NA, large]
    assert trace.to_arrow("a.n")["a.n"].to_pylist() == [None, large]


@given(st.lists(st.integers(0, 20), max_size=30), st.lists(st.integers(-3, 25), max_size=30))
def test_rows_in_force_as_pandas_has_them(times: list[int], at: list[int]) -> None:
    """The last row up to an instant; of several at once the last; in any order of rows."""
    stamps = np.array(times, np.int64)
    values = np.arange(len(times), dtype=np.float64)
    rows = rows_in_force(stamps, np.array(at, np.int64))
    series = pd.Series(values, index=times, dtype=float).sort_index(kind="stable")
    for row, t in zip(rows.tolist(), at, strict=True):
        before = series[series.index <= t]
        assert (row >= 0) == (len(before) > 0)
        assert row < 0 or values[row] == before.iloc[-1]


LINKS: dict[str, dict[str, Any]] = {
    "plain": {},
    "jittery": {"jitter": Jitter("uniform", width_ns=700)},
    "lossy": {"loss": 0.4, "jitter": Jitter("uniform", width_ns=300), "order": "fifo"},
    "zeroed": {"loss": GilbertElliott(0.2, 0.3), "on_loss": "zero"},
    "as-arrived": {"jitter": Jitter("uniform", width_ns=900), "order": "as-arrived"},
}


@pytest.mark.parametrize("kind", LINKS)
def test_age_is_that_of_the_delivery(tmp_path: Path, kind: str) -> None:
    """Against the link's own delivery, at every instant from before the first to the end."""
    link = PacketLink("up", sample_time_ns=200, delay_ns=150, seed=4, **LINKS[kind])
    truth = deliver(link, 20_000)
    with TraceWriter(tmp_path / "a.mcap", run={}) as writer:
        topic = writer.add_topic(
            "/link/up", [Signal("x")], schema_name="t.L", metadata={"on_loss": str(link.on_loss)}
        )
        drops = writer.add_topic("/link/up/dropped", DROPPED_SIGNALS, schema_name="t.D")
        for at, sent, number, fate in entries(truth):
            if fate == "delivered":
                writer.write(topic, at, [1.0], publish_time_ns=sent, sequence=number)
            else:
                writer.write(drops, at, [fate], publish_time_ns=sent, sequence=number)
        writer.finish({})
    trace = Trace(tmp_path / "a.mcap")
    at = np.arange(0, 20_000, 7)
    used = truth.sent_in_use(at)
    expected = np.where(used >= 0, at - used, np.nan)
    times, ages = trace.age("up", at / 1e9)
    assert np.array_equal(np.rint(ages * 1e9), expected, equal_nan=True)
    assert times == pytest.approx(at / 1e9)
    lost = [entry for entry in entries(truth) if entry.fate != "delivered"]
    assert len(trace.dropped("up")) == len(lost)


def test_age_has_the_corners_of_the_sawtooth(tmp_path: Path) -> None:
    times, ages = recorded(tmp_path / "a.mcap").age("up")
    assert times.tolist() == [0.5, 1.5, 1.5, 2.5, 2.5]
    assert ages.tolist() == [0.5, 1.5, 0.5, 1.5, 0.5]
    with pytest.raises(InputError, match="up"):
        recorded(tmp_path / "b.mcap").age("down")
