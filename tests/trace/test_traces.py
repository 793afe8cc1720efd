"""Several runs side by side: what differs between them, their signals and their outcomes."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from cosim.core import InputError
from cosim.scenario import run
from cosim.trace import Trace, Traces, diff

DELAYS, SEEDS = ("200 ms", "400 ms"), (1, 2)


@pytest.fixture(scope="module")
def runs(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of a vehicle over its links, at two delays and two seeds."""
    folder = tmp_path_factory.mktemp("runs")
    for delay in DELAYS:
        for seed in SEEDS:
            run(
                "auv-acoustic",
                folder / f"{delay[:3]}-{seed}.mcap",
                settings=[f"links.uplink.delay='{delay}'", f"run.seed={seed}", "run.end=3"],
                fmus=native_fmus.parent,
                flavour="native",
                supervise=False,
            )
    return folder


def test_what_differs_between_runs_are_the_levels(runs: Path) -> None:
    """The seed and the key that was set; a pattern, a folder and the files give the same."""
    traces = Traces(runs)
    assert traces.levels == {
        "seed": [1, 1, 2, 2],
        "links.uplink.delay": [0.2, 0.4, 0.2, 0.4],
    }
    for other in (Traces(f"{runs}/*.mcap"), Traces(*runs.iterdir())):
        assert [trace.path for trace in other] == [trace.path for trace in traces]
    assert repr(traces) == "<Traces: 4, which differ in seed, links.uplink.delay>"


def test_one_frame_has_the_rows_of_every_run(runs: Path) -> None:
    """Level by level what each trace alone says; units are kept, in Arrow as well."""
    traces = Traces(runs)
    frame = traces.to_pandas(["plant.eta"], align=0.5, index="timedelta")
    assert frame.index.names == ["seed", "links.uplink.delay", "time"]
    assert frame.attrs["units"]["plant.eta.psi"] == "rad"
    for trace, seed, delay in zip(traces, *traces.levels.values(), strict=True):
        alone = trace.to_pandas(["plant.eta"], align=0.5, index="timedelta")
        assert frame.loc[seed, delay].equals(alone)
    table = traces.to_arrow("plant.eta.x", align=0.5)
    assert table.column_names == ["seed", "links.uplink.delay", "time_s", "plant.eta.x"]
    assert table.num_rows == len(frame)
    assert table.schema.field("plant.eta.x").metadata[b"unit"] == b"m"


def test_one_dataset_has_the_levels_as_dimensions(runs: Path) -> None:
    """Where every combination is there; else they are coordinates along the runs."""
    pytest.importorskip("xarray", reason="the extra xarray")
    traces = Traces(runs)
    found = traces.to_xarray(["plant.eta"], align=0.5)
    assert dict(found.sizes) == {"seed": 2, "links.uplink.delay": 2, "time": 7}
    assert found["plant.eta.psi"].attrs["units"] == "rad"
    assert found["time"].attrs["units"] == "s"
    for trace, seed, delay in zip(traces, *traces.levels.values(), strict=True):
        one = found["plant.eta.x"].sel({"seed": seed, "links.uplink.delay": delay})
        assert (
            one.values.tolist() == trace.to_pandas("plant.eta.x", align=0.5)["plant.eta.x"].tolist()
        )
    three = Traces(*[trace.path for trace in traces][:3]).to_xarray("plant.eta.x", align=0.5)
    assert dict(three.sizes) == {"run": 3, "time": 7}
    assert three["seed"].values.tolist() == [1, 1, 2]
    single = traces[0].to_xarray("plant.eta.x", index="timedelta")
    assert single["time"].values.tolist() == traces[0]["plant.eta.x"].delivered_ns.tolist()
    assert single["plant.eta.x"].values.tolist() == traces[0]["plant.eta.x"].values.tolist()


def test_a_dataset_of_other_instants_is_refused(runs: Path) -> None:
    """With the trace, what it has, and how to give all of them one time base."""
    pytest.importorskip("xarray", reason="the extra xarray")
    with pytest.raises(InputError, match=r"other instants(.|\n)*align=0\.1"):
        Traces(runs).to_xarray("plant.eta")
    with pytest.raises(
        InputError, match=r"other signals(.|\n)*only one of them has controller\.reference"
    ):
        Traces("traces/reference/*.mcap").to_xarray(align=np.arange(3.0))


def test_without_xarray_the_extra_is_named(runs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As for pandas and pyarrow, whichever class is asked."""
    trace = Trace(next(runs.iterdir()))
    for name, way in (("xarray", "to_xarray"), ("pandas", "to_pandas"), ("pyarrow", "to_arrow")):
        monkeypatch.setitem(sys.modules, name, None)
        extra = "xarray" if name == "xarray" else "tables"
        for kind in (trace, Traces(trace.path), trace.read("/plant/output")):
            with pytest.raises(InputError, match=rf"auv-cosim\[{extra}\]"):
                getattr(kind, way)()


def test_outcomes_are_a_row_per_run(runs: Path) -> None:
    """Status and every metric, tables of metrics by dotted names."""
    found = Traces(runs).outcomes()
    assert found["status"].tolist() == ["finished"] * 4
    assert found["headline"].str.startswith("finished").all()
    assert found.loc[(1, 0.4), "message_age_s"] > found.loc[(1, 0.2), "message_age_s"]
    assert found["assumptions.certificate_verified"].all()


def test_runs_that_differ_in_nothing_have_their_names(runs: Path, tmp_path: Path) -> None:
    """And of two scenarios the scenario alone, not every key of one that the other lacks."""
    one = next(runs.iterdir())
    (tmp_path / "again.mcap").write_bytes(one.read_bytes())
    assert [*Traces(one, tmp_path).levels] == ["trace"]
    assert [*Traces("traces/reference/auv-*.mcap").levels] == ["scenario", "seed"]


def test_a_place_without_traces_is_refused(tmp_path: Path) -> None:
    """An empty folder, a pattern that fits nothing."""
    for where in (tmp_path, tmp_path / "*.mcap"):
        with pytest.raises(InputError, match="there is no trace"):
            Traces(where)


def test_a_value_between_rows_is_on_their_line_where_the_signal_is_continuous(runs: Path) -> None:
    """The controller's output is held, as it flew; halfway between rows the plant's is the mean."""
    trace = next(iter(Traces(runs)))
    rows = trace.read("/plant/output")
    middle = (rows.delivered[:-1] + rows.delivered[1:]) / 2
    names = ["plant.eta.x", "controller.force.x"]
    lines = trace.to_pandas(names, align=middle, between="interpolate")
    values = trace.to_pandas(names, align=middle)
    x = rows["eta.x"]
    np.testing.assert_allclose(lines["plant.eta.x"], (x[:-1] + x[1:]) / 2, rtol=1e-9)
    assert values["plant.eta.x"].tolist() == x[:-1].tolist()
    assert trace.signals["controller.force.x"][1].hold == "discrete"
    assert lines["controller.force.x"].equals(values["controller.force.x"])


def test_frames_with_exact_time_can_be_resampled(runs: Path) -> None:
    """Pandas wants a time, not a float."""
    trace = next(iter(Traces(runs)))
    found = trace.to_pandas("plant.eta.x", index="timedelta").resample("1s").mean()
    x = trace["plant.eta.x"]
    first = x.values[(x.delivered_ns < 10**9)].mean()
    assert found["plant.eta.x"].iloc[0] == pytest.approx(first, rel=1e-12)


def test_ways_that_do_not_exist_are_refused(runs: Path) -> None:
    """With the ones that do."""
    trace = next(iter(Traces(runs)))
    with pytest.raises(InputError, match="hold, interpolate"):
        trace.to_pandas(["plant.eta.x"], between="spline")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="seconds, timedelta"):
        trace.to_pandas(["plant.eta.x"], index="dates")  # type: ignore[arg-type]


def test_a_trace_says_what_it_is_in_one_line(runs: Path) -> None:
    """Not its address in memory, and not all that is in it."""
    path = next(iter(Traces(runs))).path
    trace = Trace(path)
    assert repr(trace).startswith(f"<Trace {path}: auv-acoustic, finished, ")
    assert repr(trace["plant.eta.x"]).startswith("<Series eta.x [m]: 97 values, 0 to 3 s, 3.0 to ")
    assert trace.outcome is not None
    assert trace.outcome.headline in repr(trace)
    assert trace.metrics["assumptions"]["certificate_verified"]
    assert trace.links["uplink"]["sent"] > 0
    page = trace._repr_html_()
    assert "<td>/plant/output</td><td>97</td><td>eta.x [m], eta.y [m]" in page
    assert repr(trace.read("/plant/output")) == (
        "<Table /plant/output: 97 rows, eta.x, eta.y, eta.z, eta.psi, nu.u, nu.v, and 2 more>"
    )
    assert repr(trace.outcome).startswith("<RunOutcome finished")
    assert repr(trace.topics["/plant/output"]) == (
        "<TopicInfo /plant/output: 97 messages, 8 signals, cosim.plant.Output (protobuf)>"
    )
    traces = Traces(runs)
    assert repr(diff(traces[0].path, traces[1].path)).endswith("signals differ>")
    for each in (trace.outcome, diff(path, path), *trace.topics.values()):
        assert len(repr(each)) < 200
    page = traces._repr_html_()
    assert page.count("<tr>") == 5
    assert f"<td>2</td><td>0.4</td><td>{traces[3].outcome.headline}</td>" in page  # type: ignore[union-attr]
