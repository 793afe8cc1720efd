"""The gallery: the assertions of every built-in scenario have their expected verdicts."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli.shell import BUILT_IN, cosim
from outcomes.ways import log_of
from shared import fmu_store, made_once

from cosim.scenario import builtin_names, load
from cosim.trace import Trace, describe, verify
from cosim.trace.outcome import CONCLUSION
from cosim.trace.report import write_report

GALLERY = sorted(set(builtin_names()) - set(BUILT_IN))


def executed(name: str) -> tuple[dict[str, object], Trace]:
    """JSON of a scenario's run, and its trace; run once per session."""

    def execute_run(folder: Path) -> None:
        words = ("run", name, "--json", "--flavour", "native", "--out", "t.mcap")
        result = cosim(*words, "--fmus", fmu_store("native"), cwd=folder)
        assert result.code == 0, result.out + result.err
        (folder / "said.json").write_text(result.out, "utf-8")

    folder = made_once(f"gallery/{name}", execute_run)
    message: dict[str, object] = json.loads((folder / "said.json").read_text("utf-8"))
    return message, Trace(folder / "t.mcap")


@pytest.mark.parametrize("name", GALLERY)
def test_gallery_assertions_are_as_expected(name: str) -> None:
    """Each has assertions with the expected verdicts, also in the trace; the run finishes."""
    data, trace = executed(name)
    verdicts = data["assertions"]
    assert isinstance(verdicts, list)
    assert len(verdicts) == len(load(name).scenario.assertions) >= 1
    assert all(v["as_expected"] and v["result"] == v["expected"] for v in verdicts)
    assert data["status"] in ("finished", "limit_cycle")
    result = trace.result
    assert result is not None
    assert '"as_expected": true' in result["assertions"]
    assert "Why these numbers" in load(name).scenario.description


@pytest.mark.parametrize("name", GALLERY)
def test_views_of_the_gallery_have_one_headline(name: str, tmp_path: Path) -> None:
    """Summary, report, info and the end of /log have one headline; the trace verifies."""
    data, trace = executed(name)
    headline = data["headline"]
    known = describe(trace.path)
    assert write_report(trace.path, tmp_path / "report.html").status == headline
    assert known["outcome"]["headline"] == headline
    assert known["outcome"]["events"] == data["events"]
    concluding = [line for line in log_of(trace.path) if line.name == CONCLUSION]
    assert concluding[0].message.partition(": ")[0] == headline
    metrics, kinds = known["outcome"]["metrics"], {e["kind"] for e in data["events"]}
    assert ("saturation" in kinds) == bool(metrics["saturated_fraction"])
    unmet = {name for name, met in metrics["assumptions"].items() if not met}
    assert ("age" in kinds) == any("age" in name for name in unmet)
    assert ("envelope" in kinds) == any(v > 1 for v in (metrics["envelope_use"] or {}).values())
    assert verify(trace.path).verdict == "ok"


def test_gallery_has_twelve_situations() -> None:
    """Twelve situations, by name."""
    assert set(builtin_names()) >= {
        *("station-keeping", "heading-step", "set-point-path", "acoustic-range", "burst-loss"),
        *("link-outage", "current-gust", "thruster-saturation", "auv-worst-case", "wrong-delay"),
        *("paper-example", "survey-outages"),
    }


def test_an_outage_suspends_gamma_and_is_made_up_for() -> None:
    """Recomputed from the trace: the mode of each step, the deficit, and when it is zero again."""
    data, trace = executed("survey-outages")
    metrics = data["metrics"]
    assert isinstance(metrics, dict)
    found = metrics["outages"]
    assert metrics["assumptions"]["message_age_within_design"] is False
    assert found["uncovered_at_s"] is None
    assert found["share_had"] > found["share_needed"] == pytest.approx(0.88244, abs=1e-4)
    commands, plant = trace.read("/link/commands"), trace.read("/plant/output")
    points = plant.log_time_ns[:-1]
    last = np.searchsorted(commands.log_time_ns, points, side="right") - 1
    young = points - commands.publish_time_ns[np.maximum(last, 0)] < 900_000_000
    touch = (last < 0) | young  # at first nothing is commanded, at the station: K x = 0
    h = np.diff(plant.log_time_ns) / 1e9
    assert found["share_had"] == pytest.approx(h[touch].sum() / h.sum(), abs=1e-9)
    deficit, at = 0.0, []
    for own, step in zip(touch, h, strict=True):
        deficit = max(deficit + step * 2 * (found["beta"], -found["alpha"])[int(own)], 0.0)
        at.append(deficit)
    assert found["greatest_exponent"] == pytest.approx(max(at))
    suspended = np.array(at) > 0
    assert 0.05 < suspended.mean() < 0.5
    assert found["guaranteed_share"] == pytest.approx(1 - suspended.mean(), abs=1e-3)
    begin, end = found["suspensions_s"][0]
    assert begin == pytest.approx(points[suspended][0] / 1e9, abs=1e-9)
    assert end == pytest.approx(points[suspended][-1] / 1e9, abs=0.1)
    assert found["weighted_gain"] < found["gamma"]
    assert found["plain_gain_bound"] > found["gamma"]


def test_delay_of_the_acoustic_link_is_range_over_speed_of_sound() -> None:
    """Recomputed from the trace: range at sending / 1500 m/s + 20 ms <= delay < that + jitter."""
    _, trace = executed("acoustic-range")
    plant, link = trace.read("/plant/output"), trace.read("/link/uplink")
    place = np.searchsorted(plant.log_time_ns, link.publish_time_ns)
    assert np.array_equal(plant.log_time_ns[place], link.publish_time_ns)
    x, y, z = (plant[f"eta.{a}"][place] for a in "xyz")
    way = np.sqrt((x + 330.0) ** 2 + y**2 + (z + 30.0) ** 2) / 1500.0 + 0.02
    took = (link.log_time_ns - link.publish_time_ns) / 1e9
    assert way.min() < 0.2415
    assert way.max() > 0.2535
    assert (took >= way - 1e-9).all()
    assert (took < way + 0.05 + 1e-9).all()


def test_light_takes_over_from_sound_at_the_dock() -> None:
    """What is sent from the point after the vehicle is within 6 m has another delay; it docks."""
    _, trace = executed("docking")
    plant, modes = trace.read("/plant/output"), trace.read("/modes/dock")
    near = plant.log_time_ns[np.flatnonzero(plant["eta.x"] > 6.0)[0] + 1]
    assert (plant["eta.x"][plant.log_time_ns > near] > 5.0).all()  # beyond 7 m it would end
    for name in ("uplink", "downlink"):
        rows = trace.read(f"/link/{name}")
        took = (rows.log_time_ns - rows.publish_time_ns) / 1e9
        by_light = rows.publish_time_ns >= near
        assert 0.005 <= took[by_light].min() < took[by_light].max() < 0.06
        assert took[~by_light].min() >= 0.25
        assert 200 < by_light.sum() < took.size - 200
    assert list(modes["state"]) == ["approach", "gate", "entry", "docked"]
