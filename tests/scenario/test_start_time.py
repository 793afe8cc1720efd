"""A run that begins at another time than 0: the components' clock, and every time that is said."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim

from cosim import open_session
from cosim.trace import Trace

TEXT = """\
title = "A run that begins later"
connect = [
    "plant.eta -> controller.eta : up",
    "plant.nu -> controller.nu : slow",
    "controller.force -> plant.force",
    "waves.disturbance -> plant.disturbance",
]

[run]
start = {start}
end = {end}
step = "100 ms"

[components.plant]
fmu = "AuvPlant"
parameters = {{ "initial.eta.x" = 1.0, "initial.nu.u" = 0.5 }}

[components.waves]
fmu = "WaveField"

[components.controller]
fmu = "HinfController"

[links.up]
kind = "packet"
sample_time = "500 ms"
offset = "200 ms"
loss = 0.2
delay = {{ times = [{start}, {late}], delays = [0.13, 0.33], interpolation = "linear" }}

[links.slow]
kind = "transport"
delay = 0.25

[reference]
target = "controller.reference"
axes = ["x"]
points = [[{point}, 0.0], [{late}, 1.0]]

[[events]]
at = {at}
for = "1 s"
override = {{ "plant.force.y" = 3.0 }}

[[events]]
when = "t > {late} s"
loss = {{ up = 0.9 }}

[modes.m]
states = ["a", "b"]

[[modes.m.transitions]]
from = "a"
to = "b"
after = "3 s"

[[assertions]]
name = "fails later"
always = "t < {late} s"
after = {at}
"""


def run(start: float, fmus: Path, folder: Path, *more: str) -> tuple[Any, Trace]:
    folder.mkdir()
    times = {"end": 6.0, "point": 1.0, "at": 2.05, "late": 4.0}
    text = TEXT.format(start=start, **{name: start + t for name, t in times.items()})
    (folder / "s.toml").write_text(text)
    result = cosim(
        *("run", "s.toml", "--json", "--fmus", fmus.parent, "--out", "t.mcap", *more), cwd=folder
    )
    assert result.code == 1, result.out + result.err
    return result.json, Trace(folder / "t.mcap")


def test_everything_is_later_by_the_start_and_nothing_else_differs(
    fmus: Path, tmp_path: Path
) -> None:
    """But for the sea, which is a function of the components' time."""
    (first, at_0), (later, at_100) = (
        run(start, fmus, tmp_path / f"{start:g}") for start in (0.0, 100.0)
    )
    for topic in ("/link/up", "/link/up/dropped", "/modes/m", "/controller/input"):
        a, b = at_0.read(topic), at_100.read(topic)
        assert (b.log_time_ns - a.log_time_ns == 100_000_000_000).all(), topic
        assert (b.publish_time_ns - a.publish_time_ns == 100_000_000_000).all(), topic
    path = [trace.read("/controller/input")["reference.x"] for trace in (at_0, at_100)]
    assert path[1] == pytest.approx(path[0], abs=1e-12)  # of t, which is rounded elsewhere
    assert 0.1 < np.median(path[0]) < 1.0
    one, two = (next(e for e in x["events"] if e["kind"] == "assertion") for x in (first, later))
    assert two["first_s"] == one["first_s"] + 100.0
    assert later["assertions"][0]["at_s"] == first["assertions"][0]["at_s"] + 100.0
    assert later["simulated_s"] == first["simulated_s"] == 6.0
    assert "after 102.05 s" in str(later["assertions"])
    assert "event 1 (at 102.05 s)" in str(later)


def test_components_have_the_time_of_the_run(fmus: Path, tmp_path: Path) -> None:
    """The sea is that of a run from 0 to there, but for the rounding of t + step."""
    _, trace = run(100.0, fmus, tmp_path / "a")
    (tmp_path / "b.toml").write_text(
        'title = "sea"\n[run]\nend = 106.0\nstep = 0.1\n[components.waves]\nfmu = "WaveField"\n'
    )
    found = cosim("run", "b.toml", "--out", "b.mcap", "--fmus", fmus.parent, cwd=tmp_path)
    assert found.code == 0, found.err
    sea, whole = trace.read("/waves/output"), Trace(tmp_path / "b.mcap").read("/waves/output")
    place = np.searchsorted(whole.log_time_ns, sea.log_time_ns)
    there = whole.log_time_ns[np.minimum(place, whole.log_time_ns.size - 1)] == sea.log_time_ns
    assert there.sum() >= 60
    for name in ("disturbance.u", "disturbance.r"):
        assert sea[name][there] == pytest.approx(whole[name][place[there]], abs=1e-12)


def test_views_checks_engines_and_sessions_agree_on_the_time(fmus: Path, tmp_path: Path) -> None:
    outcome, _ = run(100.0, fmus, tmp_path / "a")
    python, _ = run(100.0, fmus, tmp_path / "b", "--engine", "python")
    alone, _ = run(100.0, fmus, tmp_path / "c", "--set", "run.supervise=false")
    assert outcome["content_hash"] == python["content_hash"] == alone["content_hash"]
    for command, words in (
        (("trace", "info", "t.mcap"), "100 s to 106 s"),
        (("trace", "verify", "t.mcap"), "all checks passed"),
        (("trace", "rerun", "t.mcap", "--fmus", fmus.parent), "identical"),
        (("trace", "cite", "t.mcap"), "for 6 s"),
    ):
        found = cosim(*command, cwd=tmp_path / "a")
        assert words in " ".join(found.out.split()), found.out + found.err
    with open_session(tmp_path / "a" / "s.toml", fmus=fmus.parent) as session:
        assert session.time == 100.0
        session.run(102.2)
        assert session.time == 102.2
        before = session.save()
        session.run()
        x = session["plant.eta.x"]
        session.restore(before)
        session.run()
        assert session["plant.eta.x"] == x


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"start": 107.0}, "an end after the start: 106 s is not after 107 s"),
        ({"at": 99.0}, "this event is before the start of the run"),
        ({"start": -1.0}, "greater than or equal to 0"),
    ],
)
def test_times_before_the_start_are_refused(
    fmus: Path, tmp_path: Path, change: dict[str, float], words: str
) -> None:
    times = {"start": 100.0, "end": 106.0, "point": 101.0, "at": 102.0, "late": 104.0}
    (tmp_path / "s.toml").write_text(TEXT.format(**{**times, **change}))
    found = cosim("scenario", "check", "s.toml", "--fmus", fmus.parent, cwd=tmp_path)
    assert found.code == 2
    assert words in found.out + found.err
