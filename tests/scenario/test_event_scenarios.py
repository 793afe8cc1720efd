"""Scenarios whose components have events: one trace, however they are executed."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from master.events import event_fmu
from shared import fmu_store

from cosim.core import InputError
from cosim.master import Limits
from cosim.scenario import FmuCache, Outcome, Supervision, execute_run, load, prepare
from cosim.trace import Trace, diff, verify

TEXT = """
title = "A sampler, and what makes it sample"
connect = [
    "cause.y -> sampler.u",
    "ramp.ramp -> sampler.x",
    "sampler.echo -> ramp.message",
]

[run]
end = 1.0
step = 0.25

[components.cause]
fmu = "e0.fmu"
parameters = { event_at = 0.3, stop_early = 0.4 }

[components.sampler]
fmu = "e1.fmu"
parameters = { alarm_after = 0.125, message = "00ff" }
clocks = { tick = "100 ms", trigger = [0.55, 0.6] }

[components.ramp]
fmu = "e2.fmu"
event_mode = false
"""


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    """The scenario with its FMUs beside it."""
    event_fmu(tmp_path, ["y", "event_at", "stop_early"])
    names = ["u", "x", "ticks", "sampled", "alarm", "alarms", "alarm_after", "trigger", "triggers"]
    fixed = 'intervalVariability="fixed" intervalDecimal="0.3"'
    event_fmu(tmp_path, [*names, "message", "echo"], fixed)
    event_fmu(tmp_path, ["ramp", "message", "echo"])
    path = tmp_path / "sampler.toml"
    path.write_text(TEXT)
    return path


def executed(path: Path, trace: str, supervision: Supervision | None, *settings: str) -> Outcome:
    """A run with its trace."""
    loaded = load(str(path), settings)
    prepared = prepare(loaded, FmuCache(path.parent, loaded.folder))
    return execute_run(prepared, path.with_name(trace), supervision=supervision)


def test_trace_has_the_points_of_events(scenario: Path) -> None:
    """All of them, (t, 0), (t, 1), ..., in one process, in a child and with isolated slaves."""
    here = executed(scenario, "here.mcap", None)
    supervised = executed(scenario, "child.mcap", Supervision(Limits(), supervised=True))
    assert (supervised.status, supervised.content_hash) == ("finished", here.content_hash)
    isolated = [f"components.{name}.isolate=true" for name in ("cause", "sampler")]
    assert executed(scenario, "isolated.mcap", None, *isolated).status == "finished"
    path = scenario.with_name("here.mcap")
    assert diff(path, path.with_name("isolated.mcap")).equal
    assert verify(path).verdict == "ok"
    trace = Trace(path)
    assert trace.run["event_mode"] == "cause, sampler"
    sent, received = trace.read("/sampler/output"), trace.read("/sampler/input")
    assert (sent.log_time_ns == received.log_time_ns).all()
    tenths = [k * 100_000_000 for k in range(11)]
    assert sent.log_time_ns[received["tick"]].tolist() == tenths
    assert sent.log_time_ns[received["trigger"]].tolist() == [550_000_000, 600_000_000]
    # the second change of y, at 0.4, comes before the countdown of the first is over
    assert sent.log_time_ns[received["alarm"]].tolist() == [525_000_000]
    assert sent.superdense.max() >= 2
    first = np.flatnonzero(sent.superdense == 0)
    assert (np.diff(sent.log_time_ns[first]) > 0).all()
    assert trace.read("/ramp/input")["message"][-1] == "ff00"


def test_run_of_an_event_fmu_by_steps_alone(scenario: Path) -> None:
    """Events stay in the FMU: the points are those of the grid, in another trace."""
    off = [f"components.{name}.event_mode=false" for name in ("cause", "sampler")]
    found = executed(scenario, "off.mcap", None, *off, "components.sampler.clocks={}")
    assert found.steps == 4
    with pytest.raises(InputError, match="only an input Clock of a component in event mode"):
        executed(scenario, "wrong.mcap", None, *off)


def test_builtin_run_with_fmus_of_fmi_3(tmp_path: Path) -> None:
    """The built-in FMUs of FMI 3.0 give the trace of those of FMI 2.0, but for their names."""
    rows = {}
    flavours: tuple[Literal["native", "native-fmi3"], ...] = ("native", "native-fmi3")
    for flavour in flavours:
        loaded = load("paper-example", ["run.end=2.0"])
        prepared = prepare(loaded, FmuCache(fmu_store(flavour), loaded.folder, flavour))
        trace = tmp_path / f"{flavour}.mcap"
        assert execute_run(prepared, trace).status == "finished"
        rows[flavour] = Trace(trace).read("/plant/output")
    one, other = rows.values()
    assert {n: c.tolist() for n, c in one.columns.items()} == {
        n: c.tolist() for n, c in other.columns.items()
    }
