"""Events act at the right points and do what arithmetic on the rows says."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim
from master.coupled import rewritten
from master.scalar import scalar_fmu
from shared import sampled

from cosim.trace import Trace

LOOP = """\
title = "A vehicle and a controller"
connect = [
    "plant.eta -> controller.eta LINK",
    "plant.nu -> controller.nu",
    "controller.force -> plant.force",
]

[run]
end = 2.0
step = 0.1

[components.plant]
fmu = "AuvPlant"
parameters = { "initial.eta.x" = 1.0, "initial.nu.u" = 0.5 }

[components.controller]
fmu = "HinfController"
"""
PACKETS = '\n[links.up]\nkind = "packet"\nsample_time = 0.1\ndelay = 0.05\n'


def run(text: str, fmus: Path, folder: Path, *more: str, code: int = 0) -> tuple[Any, Trace]:
    link = ": up" if "[links.up]" in text else ""
    (folder / "s.toml").write_text(text.replace(" LINK", f" {link}"))
    result = cosim(
        *("run", "s.toml", "--json", "--fmus", fmus.parent, "--out", "t.mcap", *more), cwd=folder
    )
    assert result.code == code, result.out + result.err
    return result.json, Trace(folder / "t.mcap")


def seconds(table: Any) -> np.ndarray:
    found: np.ndarray = table.log_time_ns / 1e9
    return found


def test_time_becomes_a_point_and_acts_there(fmus: Path, tmp_path: Path) -> None:
    """An override from 0.55 s for 0.2 s: at the points of [0.55, 0.75), and at no other."""
    event = '\n[[events]]\nat = 0.55\nfor = "0.2 s"\noverride = { "plant.force.x" = "70 N" }\n'
    _, trace = run(LOOP + event, fmus, tmp_path)
    plant, sent = trace.read("/plant/input"), trace.read("/controller/output")
    t = seconds(plant)
    assert {0.55, 0.75} <= set(t.tolist())
    inside = (t >= 0.55) & (t < 0.75)
    assert (plant["force.x"][inside] == 70.0).all()
    assert np.array_equal(plant["force.x"][~inside], sent["force.x"][~inside])
    assert not (sent["force.x"] == 70.0).any()


def test_event_at_the_end_acts_at_the_last_point(fmus: Path, tmp_path: Path) -> None:
    """The end belongs to the run; what comes after it never happens."""
    event = '\n[[events]]\nat = 2.0\noverride = { "plant.force.x" = 70.0 }\n'
    _, trace = run(LOOP + event, fmus, tmp_path)
    assert np.flatnonzero(trace.read("/plant/input")["force.x"] == 70.0).tolist() == [20]


def test_condition_acts_at_the_next_point(fmus: Path, tmp_path: Path) -> None:
    """Seen in row k, in force from row k + 1 on; a bias is arithmetic to the last bit."""
    event = (
        '\n[[events]]\nwhen = "plant.eta.x > 1.12 m"\n'
        'bias = { "controller.eta.x" = { offset = "1 m", factor = 2.0 } }\n'
    )
    _, trace = run(LOOP + event, fmus, tmp_path)
    x, taken = trace.read("/plant/output")["eta.x"], trace.read("/controller/input")["eta.x"]
    k = int(np.argmax(x > 1.12))
    assert 0 < k < x.size - 3
    assert np.array_equal(taken[: k + 1], x[: k + 1])
    assert np.array_equal(taken[k + 1 :], 2.0 * x[k + 1 :] + 1.0)


WARM = """\
title = "Something warm, and who measures it"
connect = ["warm.x -> meter.u"]

[run]
end = 1.0
step = 0.1

[components.warm]
fmu = "warm.fmu"
parameters = { x0 = 20.0, a = 0.0 }

[components.meter]
fmu = "warm.fmu"
"""
DEFINED = '<UnitDefinitions><Unit name="{}"><BaseUnit K="1" {}/></Unit></UnitDefinitions>'


@pytest.mark.parametrize(
    ("unit", "definition", "point"),
    sampled(
        [
            ("degC", "", 25.0),
            ("mK", 'factor="0.001"', 298150.0),
            ("Celsius", 'offset="273.15"', 25.0),
            ("K", "", 298.15),
            ("degF", "", 77.0),
        ],
        2,
    ),
)
def test_bias_is_a_difference_and_an_override_a_point(
    unit: str, definition: str, point: float, fmus: Path, tmp_path: Path
) -> None:
    """5 degC more is 5 K, 9 degF; a reading of 25 degC is that on the scale of the variable."""
    units = DEFINED.format(unit, definition) if definition else ""
    rewritten(
        scalar_fmu(tmp_path),
        tmp_path / "warm.fmu",
        (r"(name=\"u\"[^>]*>)<Real", rf'\1<Real unit="{unit}"'),
        (r"(name=\"x\"[^>]*>)<Real", rf'\1<Real unit="{unit}"'),
        ("<ModelVariables>", f"{units}<ModelVariables>"),
    )
    more = {"degF": 9.0, "mK": 5000.0}.get(unit, 5.0)
    for offset in ('"5 degC"', '"9 degF"', '"5 K"', '"0.005 kK"', more):
        bias = f'bias = {{ "meter.u" = {{ offset = {offset}, factor = 2.0 }} }}'
        override = 'override = { "meter.u" = "25 degC" }'
        events = f"\n[[events]]\nat = 0.35\nfor = 0.2\n{bias}\n"
        events += f"\n[[events]]\nat = 0.75\n{override}\n"
        _, trace = run(WARM + events, fmus, tmp_path)
        taken = trace.read("/meter/input")
        t, u = seconds(taken), taken["u"]
        assert u[(t >= 0.35) & (t < 0.55)] == pytest.approx(40.0 + more, abs=1e-9)
        assert u[t >= 0.75] == pytest.approx(point, abs=1e-9)
        assert (u[(t < 0.35) | ((t >= 0.55) & (t < 0.75))] == 20.0).all()


@pytest.mark.parametrize(("trigger", "times"), [("once", 1), ("every-time", 3)])
def test_trigger_counts_the_first_or_every_time(
    trigger: str, times: int, fmus: Path, tmp_path: Path
) -> None:
    """A condition becomes true three times; with trigger once, only the first counts."""
    mark = "t > 0.25 and t < 0.45 or t > 0.75 and t < 0.95 or t > 1.25"
    event = (
        f'\n[[events]]\nwhen = "{mark}"\ntrigger = "{trigger}"\nfor = 0.1\n'
        'override = { "plant.force.y" = 9.0 }\n'
    )
    _, trace = run(LOOP + event, fmus, tmp_path)
    there = trace.read("/plant/input")["force.y"] == 9.0
    assert np.count_nonzero(there) == times
    message = [m for m in trace.read("/log")["message"] if "override plant.force.y" in m]
    assert len(message) == times


def test_set_for_a_time_restores_the_old_value(fmus: Path, tmp_path: Path) -> None:
    """A push of 0.2 m/s2 for a second adds 0.2 m/s less what drag and control take; then none."""
    event = '\n[[events]]\nat = 0.5\nfor = 1.0\nset = { "plant.disturbance.v" = "0.2 m/s2" }\n'
    _, with_disturbance = run(LOOP + event, fmus, tmp_path)
    v = with_disturbance.read("/plant/output")["nu.v"]
    t = seconds(with_disturbance.read("/plant/output"))
    assert abs(v[t <= 0.5]).max() < 1e-6
    rate = np.diff(v) / np.diff(t)
    assert rate[(t[:-1] >= 0.5) & (t[:-1] < 0.6)] == pytest.approx(0.2, rel=0.05)
    assert rate[t[:-1] >= 1.5].max() < 0.0


def test_outage_by_time_loses_what_is_sent_and_nothing_else(fmus: Path, tmp_path: Path) -> None:
    """From 0.5 s to 0.9 s: the messages sent at 0.5 ... 0.8 s; the one on its way arrives."""
    event = '\n[[events]]\nat = 0.5\nuntil = 0.9\noutage = ["up"]\n'
    data, trace = run(LOOP + PACKETS + event, fmus, tmp_path)
    sent = trace.read("/link/up").publish_time_ns / 1e9
    lost = trace.read("/link/up/dropped").publish_time_ns / 1e9
    assert lost.tolist() == pytest.approx([0.5, 0.6, 0.7, 0.8])
    expected = [k / 10 for k in range(20) if not 5 <= k <= 8]
    assert sent.tolist() == pytest.approx(expected)
    assert data["links"]["up"]["lost"] == 4
    assert data["links"]["up"]["max_age_s"] == pytest.approx(0.55)


def test_delay_at_a_time_applies_to_messages_sent_from_then_on(fmus: Path, tmp_path: Path) -> None:
    """0.05 s, from 1 s on 0.2 s."""
    event = '\n[[events]]\nat = 1.0\ndelay = { up = "0.2 s" }\n'
    _, trace = run(LOOP + PACKETS + event, fmus, tmp_path)
    table = trace.read("/link/up")
    took = (table.log_time_ns - table.publish_time_ns) / 1e9
    early = table.publish_time_ns < 1_000_000_000
    assert took[early] == pytest.approx(0.05)
    assert took[~early] == pytest.approx(0.2)
    assert early.sum() == 10


def test_outage_by_condition_holds_what_the_receiver_has(fmus: Path, tmp_path: Path) -> None:
    """From the point after 0.5 s for 0.4 s the inputs stand still; then the newest is in use."""
    event = '\n[[events]]\nwhen = "t >= 0.5 s"\nfor = 0.4\noutage = ["up"]\n'
    plain, trace = run(LOOP + PACKETS, fmus, tmp_path)
    free = trace.read("/controller/input")["eta.x"]
    data, trace = run(LOOP + PACKETS + event, fmus, tmp_path)
    taken, t = trace.read("/controller/input")["eta.x"], seconds(trace.read("/controller/input"))
    first = int(np.searchsorted(t, 0.5))
    overridden = (t > 0.5) & (t < 0.949)
    assert (taken[overridden] == taken[first]).all()
    assert np.array_equal(taken[: first + 1], free[: first + 1])
    assert np.unique(taken[t >= 0.96]).size > 5
    assert data["links"] == plain["links"]


def test_outage_of_a_continuous_link_holds_its_value(fmus: Path, tmp_path: Path) -> None:
    """u(t - 0.1) until 0.5 s, then u(0.4) until 0.9 s, then u(t - 0.1) again."""
    link = '\n[links.up]\nkind = "transport"\ndelay = 0.1\n'
    event = '\n[[events]]\nat = 0.5\nuntil = 0.9\noutage = ["up"]\n'
    _, trace = run(LOOP + link + event, fmus, tmp_path)
    x, taken = trace.read("/plant/output")["eta.x"], trace.read("/controller/input")["eta.x"]
    read = [max(k - 1, 0) if not 5 <= k < 9 else 4 for k in range(21)]
    assert taken == pytest.approx(x[read], abs=1e-8)


def test_stop_is_reported_and_can_be_run_again(fmus: Path, tmp_path: Path) -> None:
    """--until and --stop-when end the run, exit code 0, and the trace reruns bit for bit."""
    data, _ = run(LOOP, fmus, tmp_path, "--until", "0.5")
    assert (data["status"], data["simulated_s"]) == ("stopped", 0.5)
    data, trace = run(LOOP, fmus, tmp_path, "--stop-when", "plant.eta.x > 1.12 m")
    assert data["status"] == "stopped"
    assert "plant.eta.x > 1.12 m" in data["reason"]
    x = trace.read("/plant/output")["eta.x"]
    assert x[-1] > 1.12
    assert (x[:-1] <= 1.12).all()
    again = cosim("trace", "rerun", "t.mcap", "--json", "--fmus", fmus.parent, cwd=tmp_path)
    assert again.json["identical"] is True
    seen = cosim("run", "s.toml", "--until", "0.5", "--fmus", fmus.parent, cwd=tmp_path)
    assert seen.code == 0
    assert "stopped" in seen.out


def test_reset_brings_a_component_back_to_its_start(fmus: Path, tmp_path: Path) -> None:
    """At 1 s the plant is where it began, parameters and all, while the time goes on."""
    event = '\n[[events]]\nat = 1.0\nreset = ["plant"]\n'
    _, trace = run(LOOP + event, fmus, tmp_path)
    x, t = trace.read("/plant/output")["eta.x"], seconds(trace.read("/plant/output"))
    assert x[0] == 1.0
    assert x[int(np.searchsorted(t, 1.0))] == 1.0
    assert x[int(np.searchsorted(t, 0.9))] > 1.3


def test_assertion_that_fails_is_exit_code_1(fmus: Path, tmp_path: Path) -> None:
    """A verdict each, with where; a promise that is expected to fail must fail."""
    wrong = '\n[[assertions]]\nalways = "plant.eta.x < 1.12 m"\n'
    data, trace = run(LOOP + wrong, fmus, tmp_path, code=1)
    verdict = data["assertions"][0]
    x, t = trace.read("/plant/output")["eta.x"], seconds(trace.read("/plant/output"))
    assert verdict["at_s"] == t[int(np.argmax(x >= 1.12))]
    assert verdict["result"] == "fails"
    run(LOOP + wrong + 'expected = "fails"\n', fmus, tmp_path)
    run(LOOP + '\n[[assertions]]\nalways = "t >= 0"\nexpected = "fails"\n', fmus, tmp_path, code=1)
    within = '\n[[assertions]]\nwithin = { of = 0.3, when = "t > 0.5", holds = "t > LATE" }\n'
    run(LOOP + within.replace("LATE", "0.85"), fmus, tmp_path)
    run(LOOP + within.replace("LATE", "0.95"), fmus, tmp_path, code=1)
    never = '\n[[assertions]]\nwithin = { of = 0.5, holds = "t > 9" }\n'
    for until, code, result in (("0.4", 0, "undecided"), ("0.5", 1, "fails")):
        ended, _ = run(LOOP + never, fmus, tmp_path, "--until", until, code=code)
        assert ended["assertions"][0]["result"] == result
    ended, _ = run(
        LOOP + '\n[[assertions]]\neventually = "t > 1"\n', fmus, tmp_path, "--until", "1"
    )
    assert ended["assertions"][0]["result"] == "undecided"


def test_pace_and_log_level_are_as_asked(fmus: Path, tmp_path: Path) -> None:
    """The JSON has the overrun statistics; messages below the level are not recorded."""
    data, trace = run(LOOP, fmus, tmp_path, "--pace", "1000", "--log-level", "error")
    assert data["pace"]["factor"] == 1000.0
    assert data["pace"]["points"] == data["steps"] + 1
    assert data["pace"]["overruns"] >= 0
    assert trace.result is not None
    assert "host.pace" in trace.result


def test_frozen_signal_keeps_its_value(fmus: Path, tmp_path: Path) -> None:
    """From 0.55 s for 0.6 s the vehicle's place is that of the last row before; then it is not."""
    event = '\n[[events]]\nat = 0.55\nfor = "0.6 s"\nfreeze = ["plant.eta.x"]\n'
    _, trace = run(LOOP + event, fmus, tmp_path)
    (tmp_path / "free").mkdir()
    _, free = run(LOOP + event.replace("freeze", "release"), fmus, tmp_path / "free")
    table = trace.read("/plant/output")
    x, t = table["eta.x"], seconds(table)
    inside = (t >= 0.55) & (t < 1.15)
    assert (x[inside] == x[np.flatnonzero(inside)[0] - 1]).all()
    before = t < 0.55
    assert np.array_equal(x[before], free.read("/plant/output")["eta.x"][before])
    assert (np.diff(x[t >= 1.1]) > 0.0).all()
