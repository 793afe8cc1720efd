"""The vehicle along its path in a report: pose and links at a time, by mouse and by keyboard."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from cli.shell import trace_of
from outcomes.ways import found
from report_browser import Page, browser, needs_chromium

from cosim.trace import Trace
from cosim.trace.report import write_report

pytestmark = needs_chromium

POSE = "document.getElementById('pose').textContent"
STATES = "[...document.querySelectorAll('#link-states b')].map((state) => state.textContent)"
AT = """(() => {{ const moment = document.getElementById('moment'); moment.value = {};
    moment.dispatchEvent(new Event('input')); }})()"""
TIME = "Number(document.getElementById('moment').value)"
MOTION = "prefers-reduced-motion"


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """One browser for all tests of this file."""
    with browser(tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture(scope="module")
def outage(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a run whose links are gone from 2 s to 4 s."""
    return write_report(
        found("outage").trace, tmp_path_factory.mktemp("outage") / "outage.html"
    ).output


def pressed(page: Page, key: str, code: int) -> None:
    """Press a key."""
    for kind in ("rawKeyDown", "keyUp"):
        page.call(
            "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code
        )


def test_the_pose_is_the_recorded_one(page: Page, outage: Path) -> None:
    """At instants of the trace the page says where the vehicle is, to half of the last digit."""
    page.errors.clear()
    page.asked.clear()
    page.open(outage)
    rows = Trace(found("outage").trace).read("/plant/output")
    for k in np.linspace(0, len(rows) - 1, 7).astype(int):
        page.ask(AT.format(rows.log_time_ns[k] / 1e9))
        numbers = [float(n) for n in re.findall(r"(-?[0-9.]+) ?[m\u00b0]", page.ask(POSE))]
        exact = [float(rows[f"eta.{axis}"][k]) for axis in "xyz"]
        assert numbers[:3] == pytest.approx(exact, abs=0.006)
        assert numbers[3] == pytest.approx(math.degrees(float(rows["eta.psi"][k])), abs=0.06)
    assert page.errors == []
    assert page.asked == []


def test_links_say_what_they_deliver(page: Page, outage: Path) -> None:
    """Nothing yet, an outage while it lasts, else whether the last message came or was dropped."""
    trace = Trace(found("outage").trace)
    page.open(outage)
    assert page.ask(STATES) == ["waiting"] * 2
    for t in (1.0, 3.0, 5.0, 7.7):
        page.ask(AT.format(t))
        now = page.ask(TIME)  # the slider has steps
        wanted = []
        for link in trace.link_names:
            times = [
                trace.read(topic).log_time_ns / 1e9
                for topic in (f"/link/{link}", f"/link/{link}/dropped")
            ]
            came, lost = (max(each[each <= now], default=-1.0) for each in times)
            wanted.append("delivered" if came >= lost else "dropped")
        assert page.ask(STATES) == (["outage"] * 2 if t == 3.0 else wanted)


def test_the_hull_points_to_the_heading(page: Page, outage: Path) -> None:
    """It is drawn where the pose is, its bow towards north and east as the heading says."""
    page.open(outage)
    page.ask(AT.format(4.5))
    shape = page.ask("document.getElementById('plan').layout.shapes[0]")
    rows = Trace(found("outage").trace).read("/plant/output")
    k = int(np.searchsorted(rows.log_time_ns, 4_500_000_000))
    assert shape["yanchor"] == pytest.approx(float(rows["eta.x"][k]), abs=0.01)
    assert shape["xanchor"] == pytest.approx(float(rows["eta.y"][k]), abs=0.01)
    east, north = map(float, re.findall(r"-?[0-9.]+", shape["path"])[:2])
    assert math.atan2(east, north) == pytest.approx(float(rows["eta.psi"][k]), abs=0.02)


def test_it_plays_and_pauses_by_keyboard(page: Page, outage: Path) -> None:
    """Tab and space play and pause; arrows move in time; nothing moves before it is asked to."""
    page.open(outage)
    page.ask("new Promise((done) => setTimeout(done, 300))")
    assert page.ask(TIME) == 0.0
    page.ask("document.getElementById('play').focus()")
    pressed(page, " ", 32)
    page.ask("new Promise((done) => setTimeout(done, 600))")
    assert page.ask("document.getElementById('play').textContent") == "Pause"
    pressed(page, " ", 32)
    stopped = page.ask(TIME)
    assert 0.0 < stopped < 4.0
    page.ask("document.getElementById('moment').focus()")
    pressed(page, "ArrowRight", 39)
    assert page.ask(TIME) > stopped
    pressed(page, "Home", 36)
    assert page.ask(TIME) == 0.0
    spoken = page.ask("document.getElementById('moment').getAttribute('aria-valuetext')")
    assert "heading" in spoken
    assert "uplink: waiting" in spoken


def test_less_motion_is_respected(page: Page, outage: Path) -> None:
    """Who wants less motion goes on step by step, and nothing moves between."""
    page.open(outage)
    page.call("Emulation.setEmulatedMedia", features=[{"name": MOTION, "value": "reduce"}])
    page.ask("new Promise((done) => setTimeout(done, 300))")
    try:
        assert page.ask("document.getElementById('play').textContent") == "Step"
        page.ask("document.getElementById('play').click()")
        at = page.ask(TIME)
        assert at == pytest.approx(8.0 / 24, abs=0.01)
        page.ask("new Promise((done) => setTimeout(done, 300))")
        assert page.ask(TIME) == at
    finally:
        page.call("Emulation.setEmulatedMedia", features=[])


@pytest.mark.parametrize("name", ["not-started", "refused", "paper"])
def test_without_positions_nothing_is_animated(name: str, page: Page, tmp_path: Path) -> None:
    """A run that failed at its start, one of a pump, one of two states: no controls, no error."""
    trace = trace_of("paper-example") if name == "paper" else found(name).trace
    page.errors.clear()
    page.open(write_report(trace, tmp_path / "page.html").output)
    assert page.ask("document.getElementById('motion')") is None
    assert page.errors == []


@pytest.mark.slow
def test_a_run_cut_short_is_animated_to_where_it_ended(page: Page, tmp_path: Path) -> None:
    """Half of a file: the path ends with the last recorded pose."""
    data = trace_of("auv-acoustic").read_bytes()
    cut = tmp_path / "run.mcap.partial"
    cut.write_bytes(data[: len(data) // 2])
    page.errors.clear()
    page.open(write_report(cut).output)
    end = Trace(cut, incomplete=True).read("/plant/output").log_time_ns[-1] / 1e9
    assert 0 < end < 100
    assert page.ask("Number(document.getElementById('moment').max)") == pytest.approx(end)
    assert page.errors == []
