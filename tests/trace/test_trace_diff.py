"""Two traces side by side: equal, within a tolerance, or where they part."""

from __future__ import annotations

import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from mcap.writer import Writer
from written import ETA, write

from cosim.core import InputError
from cosim.trace import Attachment, Rows, Signal, Tolerances, TraceWriter, diff
from cosim.trace.comparison import Tolerance, diff_json, diff_verdict, differences
from cosim.trace.rows import DROPPED_SIGNALS

S = 10**9


def one(path: Path, values: Any, times: Any = None, **more: Any) -> Path:
    """A trace of `plant.eta.x`, and the run's entries in `more`."""
    column = np.asarray(values, np.float64)
    stamps = np.arange(column.size) * S if times is None else np.asarray(times)
    attachments = more.pop("attachments", ())
    with TraceWriter(path, run=more, attachments=attachments) as writer:
        topic = writer.add_topic("/plant/output", [Signal("eta.x", unit="m")], schema_name="t.A")
        writer.write_rows([Rows(topic, stamps, column[:, None])])
        writer.finish({})
    return path


def test_the_same_content_is_identical(tmp_path: Path) -> None:
    a = one(tmp_path / "a.mcap", [1, 2, 3], **{"host.started": "now"})
    b = one(tmp_path / "b.mcap", [1, 2, 3], **{"host.started": "later"})
    found = diff(a, b)
    assert (found.identical, found.equal, diff_verdict(found)) == (True, True, "identical")


def test_tolerance_of_a_signal_is_that_of_the_longest_name() -> None:
    """A group's for its members, a signal's own before it; a part of a name is no group."""
    plant, eta, one_ = Tolerance(1.0), Tolerance(0.1), Tolerance(0.01)
    allowed = Tolerances(special={"plant.eta.x": one_, "plant": plant, "plant.eta": eta})
    expected = {"plant.eta.x": one_, "plant.eta.y": eta, "plant.eta[2]": eta, "plant.nu.u": plant}
    expected |= {"plant.etas": plant, "plants.eta": Tolerance()}
    assert {name: allowed.of(name) for name in expected} == expected


@pytest.mark.parametrize("value", [0, 0.0, False, ""])
def test_absent_value_differs_from_zero(tmp_path: Path, value: Any) -> None:
    """Rows as JSON, one of them without the key: unlike whatever stands there in the other."""

    def rows(name: str, *contents: dict[str, Any]) -> Path:
        with (tmp_path / name).open("wb") as stream:
            writer = Writer(stream)
            writer.start()
            channel = writer.register_channel("/plant/output", "json", 0)
            for k, content in enumerate(contents):
                writer.add_message(channel, k * S, json.dumps(content).encode(), k * S)
            writer.finish()
        return tmp_path / name

    whole = rows("a.mcap", {"y": 1, "x": value}, {"y": 1, "x": value}, {"y": 1, "x": value})
    gap = rows("b.mcap", {"y": 1, "x": value}, {"y": 1}, {"y": 1, "x": value})
    for found in (diff(whole, gap), diff(gap, whole)):
        assert [(s.name, s.differing, s.first_s) for s in found.parted] == [("plant.x", 1, 1.0)]
    other = rows("c.mcap", {"y": 1, "x": value}, {"y": 1}, {"x": value, "y": 1})
    assert diff(gap, other).equal


def test_diff_reports_first_and_largest_difference(tmp_path: Path) -> None:
    a = one(tmp_path / "a.mcap", [1.0, 2.0, 4.0, -8.0])
    b = one(tmp_path / "b.mcap", [1.0, 2.5, 4.0, -2.0])
    found = diff(a, b)
    (signal,) = found.signals
    assert (signal.name, signal.unit, signal.differing, signal.compared) == (
        "plant.eta.x",
        "m",
        2,
        4,
    )
    assert (signal.max_abs, signal.max_rel) == (6.0, 0.75)
    assert (signal.first_s, signal.max_at_s, signal.sample_and_hold) == (1.0, 3.0, False)
    assert not found.equal
    assert diff_verdict(found) == "the first to part is plant.eta.x at t = 1 s"
    assert next(differences(found)) == "/plant/output eta.x: from t = 1 s, at most 6 m"
    first = diff(a, b, Tolerances(Tolerance(0.5))).parted[0]
    assert (first.first_s, first.differing) == (3.0, 1)
    assert diff(a, b, Tolerances(Tolerance(0.1, 0.75))).equal
    assert diff(a, b, Tolerances(special={"plant.eta": Tolerance(6.0)})).equal
    assert not diff(a, b, Tolerances(Tolerance(6.0), {"plant.eta.x": Tolerance(1.0)})).equal
    with pytest.raises(InputError, match=r"plant\.eta"):
        diff(a, b, Tolerances(special={"plant.etta": Tolerance(6.0)}))


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.floats(), st.floats()), min_size=1, max_size=40),
    st.floats(0, 1e3),
    st.floats(0, 1),
)
def test_tolerance_equals_math_isclose(
    pairs: list[tuple[float, float]], absolute: float, relative: float
) -> None:
    """But NaN is close to NaN; of each pair of values by itself, one to a signal."""
    with TemporaryDirectory() as folder:
        paths = Path(folder, "a.mcap"), Path(folder, "b.mcap")
        for path, row in zip(paths, zip(*pairs, strict=True), strict=True):
            write(path, rows=[(0, 0, 0, row)], signals=[Signal(f"x[{i}]") for i in range(len(row))])
        found = diff(*paths, Tolerances(Tolerance(absolute, relative)))
    parted = {signal.name for signal in found.parted}
    for i, (x, y) in enumerate(pairs):
        far = f"plant.x[{i}]" in parted
        close = math.isclose(x, y, rel_tol=relative, abs_tol=absolute) or (
            math.isnan(x) and math.isnan(y)
        )
        if math.isfinite(x - y) or not (math.isfinite(x) and math.isfinite(y)):
            edge = abs(abs(x - y) - max(absolute, relative * max(abs(x), abs(y))))
            assert far != close or edge < 1e-12 * max(abs(x), abs(y))


def test_nan_infinity_and_large_integers(tmp_path: Path) -> None:
    a = one(tmp_path / "a.mcap", [math.nan, math.inf, 1.0, 2.0, math.nan])
    assert diff(a, one(tmp_path / "b.mcap", [math.nan, math.inf, 1.0, 2.0, math.nan], x="y")).equal
    other = one(tmp_path / "c.mcap", [0.0, -math.inf, 1.0, math.inf, math.nan])
    found = diff(a, other, Tolerances(Tolerance(1e9)))
    assert found.signals[0].differing == 3
    assert found.signals[0].max_abs is None
    json.dumps(diff_json(found), allow_nan=False)
    large = [
        write(tmp_path / f"{n}.mcap", rows=[(0, 0, 0, [n])], signals=[Signal("n", kind="int")])
        for n in (2**60, 2**60 + 1)
    ]
    assert [signal.name for signal in diff(*large).parted] == ["plant.n"]


def test_other_rates_are_compared_by_sample_and_hold(tmp_path: Path) -> None:
    """A step function sampled at other instants is the same function."""
    a = one(tmp_path / "a.mcap", [0, 0, 1, 1, 2], np.array([0, 1, 2, 3, 4]) * S)
    b = one(tmp_path / "b.mcap", [0, 1, 2], np.array([0, 2, 4]) * S)
    found = diff(a, b)
    assert found.equal
    assert not found.identical
    assert (found.signals[0].sample_and_hold, found.signals[0].compared) == (True, 5)
    late = one(tmp_path / "c.mcap", [0, 1, 2], np.array([0, 2.5 * S, 4 * S]).astype(np.int64))
    parted = diff(a, late).parted[0]
    assert (parted.first_s, parted.differing, parted.rows) == (2.0, 1, (5, 3))


def test_an_earlier_end_is_a_difference(tmp_path: Path) -> None:
    a, b = one(tmp_path / "a.mcap", [1, 2, 3]), one(tmp_path / "b.mcap", [1, 2])
    found = diff(a, b)
    assert not found.equal
    assert not found.parted
    assert found.ends_s == (2.0, 1.0)
    assert diff_verdict(found) == "the signals agree; something else differs"
    assert diff(b, a, prefix=True).equal
    assert not diff(one(tmp_path / "c.mcap", [1, 5]), a, prefix=True).equal


def test_topics_and_signals_of_one_trace_only_are_listed(tmp_path: Path) -> None:
    a = write(tmp_path / "a.mcap", rows=[(0, 0, 0, [1, 2])])
    b = write(tmp_path / "b.mcap", rows=[(0, 0, 0, [1, 2])], signals=[ETA[0], Signal("nu.u")])
    c = write(tmp_path / "c.mcap", rows=[(0, 0, 0, [1, 2])], topic="/other/output")
    assert diff(a, b).only == (("plant.eta.psi",), ("plant.nu.u",))
    assert diff(a, c).only == (("/plant/output",), ("/other/output",))
    assert not diff(a, b).equal


def test_texts_truth_values_and_gaps(tmp_path: Path) -> None:
    signals = [Signal("s", kind="string"), Signal("b", kind="bool"), Signal("x")]
    rows = [(k, k, k, ["a", True, None]) for k in range(3)]
    a = write(tmp_path / "a.mcap", signals=signals, rows=rows)
    other = [*rows[:2], (2, 2, 2, ["b", False, 0.0])]
    found = diff(a, write(tmp_path / "b.mcap", signals=signals, rows=other))
    assert [s.differing for s in found.signals] == [1, 1, 1]
    assert [s.max_abs for s in found.signals] == [None, 1.0, None]
    assert diff(a, write(tmp_path / "c.mcap", signals=signals, rows=rows, run={"k": "v"})).equal


def linked(path: Path, messages: list[tuple[int, int]], dropped: list[tuple[int, int]]) -> Path:
    """(sequence, delivered) and (sequence, due), each sent at 10 times its number."""
    with TraceWriter(path, run={}) as writer:
        link = writer.add_topic("/link/up", [Signal("x")], schema_name="t.L")
        drops = writer.add_topic("/link/up/dropped", DROPPED_SIGNALS, schema_name="t.D")
        for number, at in messages:
            writer.write(link, at * S, [0.0], publish_time_ns=10 * number * S, sequence=number)
        for number, at in dropped:
            writer.write(drops, at * S, ["lost"], publish_time_ns=10 * number * S, sequence=number)
        writer.finish({})
    return path


def test_links_are_compared_message_by_message(tmp_path: Path) -> None:
    a = linked(tmp_path / "a.mcap", [(0, 2), (1, 12), (2, 22), (2, 23)], [(3, 33)])
    b = linked(tmp_path / "b.mcap", [(0, 2), (2, 25), (2, 26), (3, 33)], [(1, 12)])
    (link,) = diff(a, b).links
    assert (link.delivered, link.dropped, link.only) == ((4, 4), (1, 1), (1, 1))
    assert (link.other_times, link.largest_shift_s, link.first_s) == (2, 3.0, 12.0)
    assert not diff(a, b).equal


def test_scenario_design_and_entries(tmp_path: Path) -> None:
    def attached(gain: float, seed: int) -> list[Attachment]:
        return [
            Attachment("scenario.toml", "application/toml", f"[run]\nseed = {seed}\n".encode()),
            Attachment("design.json", "application/json", json.dumps({"K": [[gain, 2]]}).encode()),
        ]

    a = one(tmp_path / "a.mcap", [1], seed="1", attachments=attached(0.5, 1))
    b = one(tmp_path / "b.mcap", [1], seed="2", attachments=attached(0.75, 2))
    found = diff(a, b)
    assert found.equal  # what was recorded is the same
    assert [(c.where, c.key, c.a, c.b) for c in found.context.entries] == [
        ("cosim.run", "seed", "1", "2"),
        ("design.json", "K[0][0]", "0.5", "0.75"),
    ]
    assert found.context.texts["scenario.toml"][-2:] == ("-seed = 1", "+seed = 2")


@pytest.mark.parametrize("value", [-1.0, math.nan, math.inf])
def test_invalid_tolerances_are_refused(value: float) -> None:
    with pytest.raises(InputError):
        Tolerance(value)
    with pytest.raises(InputError):
        Tolerance(relative=value)
