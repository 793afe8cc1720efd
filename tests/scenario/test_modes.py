"""Mode machines, and links that conditions change: against what the rows of the trace say."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.shell import cosim

from cosim import open_session
from cosim.core import InputError
from cosim.scenario import FmuCache, RunSeries, execute_unrecorded, load, parse, prepare
from cosim.trace import Trace

MISSION = """\
title = "A mission in phases"
connect = [
    "plant.eta -> controller.eta : up",
    "plant.nu -> controller.nu",
    "controller.force -> plant.force",
]

[run]
end = 12.0
step = 0.1

[components.plant]
fmu = "AuvPlant"
parameters = { "initial.eta.x" = 1.0, "initial.nu.u" = 0.5 }

[components.controller]
fmu = "HinfController"

[links.up]
kind = "packet"
sample_time = "500 ms"
delay = "130 ms"
jitter = { kind = "uniform", width = "50 ms" }
loss = 0.1
"""
PHASES = """
[modes.mission]
initial = "transit"

[modes.mission.states.survey]
during = { loss = { up = 1.0 }, bias = { "controller.eta.y" = { offset = 2.0 } } }

[modes.mission.states.transit]
enter = { override = { "plant.force.y" = 7.0 } }
exit = { release = ["plant.force.y"] }

[modes.mission.states.abort]

[[modes.mission.transitions]]
from = "transit"
to = "survey"
after = "2.05 s"

[[modes.mission.transitions]]
from = ["transit", "survey"]
to = "abort"
when = "up.age > 2.2 s"

[[modes.mission.transitions]]
to = "transit"
when = "mission.abort"
after = 1.0

[[assertions]]
name = "reached"
eventually = "mission.abort and mission.time > 0.4 s"

[[assertions]]
name = "never"
always = "not mission.abort"

[[assertions]]
name = "in time"
always = "mission.time < 5 s"
"""


def run(text: str, fmus: Path, folder: Path, *more: str, code: int = 0) -> tuple[Any, Trace]:
    (folder / "s.toml").write_text(text)
    result = cosim(
        *("run", "s.toml", "--json", "--fmus", fmus.parent, "--out", "t.mcap", *more), cwd=folder
    )
    assert result.code == code, result.out + result.err
    return result.json, Trace(folder / "t.mcap")


def mode_at(trace: Trace, t: np.ndarray) -> np.ndarray:
    """The state of the machine at each time."""
    rows = trace.read("/modes/mission")
    place = np.searchsorted(rows.log_time_ns / 1e9, t, side="right") - 1
    return np.array(list(rows["state"]))[place]


def test_machine_goes_through_its_states_as_the_rows_say(fmus: Path, tmp_path: Path) -> None:
    """Each transition where a walk along the recorded rows takes it, and its actions there."""
    outcome, trace = run(MISSION + PHASES, fmus, tmp_path, code=1)
    plant, taken = trace.read("/plant/input"), trace.read("/controller/input")
    t = plant.log_time_ns / 1e9
    link = trace.read("/link/up")
    newest = np.searchsorted(link.log_time_ns, plant.log_time_ns, side="right") - 1
    sent = np.where(newest < 0, 0, link.publish_time_ns[newest]) / 1e9
    state, since, expected = "transit", 0.0, ["transit"]
    for k in range(1, t.size):
        over = round((t[k] - since) * 1e9)
        if state == "transit" and over >= 2_050_000_000:
            state, since = "survey", t[k]
        elif state in ("transit", "survey") and t[k - 1] - sent[k - 1] > 2.2:
            state, since = "abort", t[k]
        elif state == "abort" and over >= 1_000_000_000:
            state, since = "transit", t[k]
        expected.append(state)
    found = mode_at(trace, t)
    assert found.tolist() == expected
    assert {"transit", "survey", "abort"} <= set(expected[len(expected) // 2 :])
    # actions: an override on entry that the exit releases; what lasts as long as the state
    assert np.array_equal(plant["force.y"] == 7.0, found == "transit")
    output = trace.read("/plant/output")
    lateral = np.where(newest < 0, 0.0, output["eta.y"][np.searchsorted(t, sent)])
    assert taken["eta.y"] == pytest.approx(lateral + 2.0 * (found == "survey"), abs=1e-12)
    lost = set(trace.read("/link/up/dropped").publish_time_ns.tolist())
    in_survey = [s for s in np.arange(0, 12.1, 0.5) if mode_at(trace, np.array([s]))[0] == "survey"]
    assert in_survey
    assert {round(1e9 * s) for s in in_survey if s < 11.5} <= lost
    spent = dict.fromkeys(("survey", "transit", "abort"), 0.0)
    for k in range(1, t.size):
        spent[expected[k - 1]] += t[k] - t[k - 1]
    modes = outcome["metrics"]["modes"]["mission"]
    assert modes["time_s"] == pytest.approx(spent, abs=1e-9)
    changes = sum(a != b for a, b in pairwise(expected))
    assert (modes["state"], modes["changes"]) == (expected[-1], changes)
    verdict = {a["name"]: a["result"] for a in outcome["assertions"]}
    assert verdict == {"reached": "holds", "never": "fails", "in time": "holds"}


def test_engines_supervision_and_rerun_give_the_same_bits(fmus: Path, tmp_path: Path) -> None:
    hashes = {
        run(MISSION + PHASES, fmus, tmp_path, *more, code=1)[0]["content_hash"]
        for more in (("--engine", "python"), ("--set", "run.supervise=false"), ())
    }
    assert len(hashes) == 1
    again = cosim("trace", "rerun", "t.mcap", "--fmus", fmus.parent, cwd=tmp_path)
    assert "identical" in again.out, again.out + again.err


def test_restored_session_goes_on_in_its_mode(fmus: Path, tmp_path: Path) -> None:
    """Also in another session, with the settings of the link; a snapshot without modes does not."""
    path = tmp_path / "s.toml"
    path.write_text(MISSION + PHASES)
    with open_session(path, fmus=fmus.parent) as session:
        session.run(3.3)
        before = session.save(portable=True)
        before.save(tmp_path / "s.npz")
        session.run()
        rows, modes = (
            session.result().signal("plant", "eta.x").copy(),
            session.save(portable=True).events,
        )
        session.restore(before)
        session.run()
        assert np.array_equal(session.result().signal("plant", "eta.x"), rows)
        found = session.save(portable=True).events
        assert repr(found) == repr(modes)  # NaN is not equal to itself
    with open_session(path, fmus=fmus.parent) as other:
        other.restore(type(before).load(tmp_path / "s.npz"))
        other.run()
        assert np.array_equal(other.result().signal("plant", "eta.x"), rows)
        assert repr(other.save(portable=True).events) == repr(modes)
        with pytest.raises(InputError, match="other events"):
            other.restore(replace(before, events={**before.events, "events": []}))


def test_runs_of_a_series_begin_without_the_modes_of_the_one_before(
    fmus: Path, tmp_path: Path
) -> None:
    loaded = parse(MISSION + PHASES, name="s", where="s.toml", folder=tmp_path)
    with closing(RunSeries()) as series:
        found = []
        for delay in (0.1, 0.6, 0.1):
            links = {"up": loaded.scenario.links["up"].model_copy(update={"delay": delay})}
            scenario = loaded.scenario.model_copy(update={"links": links})
            prepared = prepare(replace(loaded, scenario=scenario), FmuCache(fmus.parent, tmp_path))
            outcome, _ = execute_unrecorded(prepared, series=series)
            found.append((outcome.final, [a.result for a in outcome.assertions]))
            alone, _ = execute_unrecorded(prepared)
            assert (alone.final, [a.result for a in alone.assertions]) == found[-1]
    assert found[0] == found[2] != found[1]


@pytest.mark.parametrize("events", ["align", "grid"])
def test_condition_changes_delay_and_loss_of_what_is_sent(
    fmus: Path, tmp_path: Path, events: str
) -> None:
    """With hysteresis: messages sent in between take 570 ms more; draws stay those of the link."""
    text = MISSION.replace("step = 0.1", f'step = 0.1\nevents = "{events}"')
    change = (
        '\n[[events]]\nwhen = "plant.eta.x > 1.1 m"\nends = "plant.eta.x > 1.5 m"\n'
        'trigger = "every-time"\ndelay = { up = "700 ms" }\nloss = { up = 0.0 }\n'
    )
    (tmp_path / "plain").mkdir()
    _, plain = run(text, fmus, tmp_path / "plain")
    _, trace = run(text + change, fmus, tmp_path)
    x, t = trace.read("/plant/output")["eta.x"], trace.read("/plant/output").log_time_ns
    begins = t[np.flatnonzero(x > 1.1)[0] + 1]
    ends = t[np.flatnonzero((x > 1.5) & (t > begins))[0] + 1]
    assert ends > begins + 5e8
    before = plain.read("/link/up")
    took = dict(zip(before.publish_time_ns, before.log_time_ns, strict=True))
    longer = 0
    after = trace.read("/link/up")
    for sent, arrived in zip(after.publish_time_ns, after.log_time_ns, strict=True):
        within = begins <= sent < ends
        if sent in took:
            assert arrived - took[sent] == (570_000_000 if within else 0) or events == "grid"
            assert (arrived - took[sent] > 4e8) == within
            longer += within
        else:
            assert within
    assert longer
    dropped = trace.read("/link/up/dropped")  # the last one is overtaken by one sent after it
    lost = [*zip(dropped.publish_time_ns, dropped["reason"], strict=True)]
    assert not [s for s, why in lost if begins <= s < ends and why == "lost"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ('from = "transit"\nto = "survy"\nafter = 1.0', "'survy' is none of them"),
        ('from = "transit"\nto = "survey"', "a condition (when), or the time in the state"),
        ('from = "transit"\nto = "survey"\nwhen = "mission.survy"', "did you mean survey"),
        ('from = "transit"\nto = "survey"\nwhen = "missoin.survey"', "did you mean mission"),
    ],
)
def test_transition_without_a_meaning_is_refused(
    fmus: Path, tmp_path: Path, change: str, words: str
) -> None:
    modes = '\n[modes.mission]\nstates = ["transit", "survey"]\n\n[[modes.mission.transitions]]\n'
    (tmp_path / "s.toml").write_text(MISSION + modes + change + "\n")
    found = cosim("scenario", "check", "s.toml", "--fmus", fmus.parent, cwd=tmp_path)
    assert found.code == 2
    assert words in found.out + found.err
    assert "s.toml:2" in found.out + found.err or "s.toml:3" in found.out + found.err


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("[modes.plant]\nstates = ['a']", "'plant' is the name of something else"),
        ("[modes.m]\nstates = ['time']", "a state cannot be called time"),
        ("[modes.m]\nstates = ['number']", "a state cannot be called number"),
        ("[modes.m]\nstates = []", "at least 1"),
        (
            '[[events]]\nwhen = "t > 1 s"\nends = "t > 2 s"\nfor = "1 s"\nloss = { up = 1.0 }',
            "in place of for",
        ),
        ('[[events]]\nwhen = "t > 1 s"\nloss = { upp = 1.0 }', "did you mean up"),
    ],
)
def test_what_cannot_be_is_refused(fmus: Path, tmp_path: Path, change: str, words: str) -> None:
    (tmp_path / "s.toml").write_text(f"{MISSION}\n{change}\n")
    found = cosim("scenario", "check", "s.toml", "--fmus", fmus.parent, cwd=tmp_path)
    assert found.code == 2
    assert words in found.out + found.err


def test_mode_is_a_signal_for_inputs(fmus: Path, tmp_path: Path) -> None:
    """Its number and whether it is one state, in the row in which the machine is in it."""
    text = MISSION.replace(
        "connect = [",
        'connect = [\n    "m.number -> controller.reference.x",\n'
        '    "m.b -> controller.reference.y",',
    )
    text += """
[modes.m]
states = ["a", "b", "c"]
initial = "b"

[[modes.m.transitions]]
from = "b"
to = "c"
when = "m.number == 1 and plant.eta.x > 1.2 m"

[[modes.m.transitions]]
from = "c"
to = "a"
after = "1 s"
"""
    hashes = set()
    for more in ((), ("--engine", "python"), ("--set", "run.algorithm=gauss-seidel")):
        outcome, trace = run(text, fmus, tmp_path, *more)
        hashes.add(outcome["content_hash"])
        rows, taken = trace.read("/modes/m"), trace.read("/controller/input")
        place = np.searchsorted(rows.log_time_ns, taken.log_time_ns, side="right") - 1
        number = np.array(list(rows["number"]))[place]
        assert list(rows["state"]) == ["b", "c", "a"]
        assert np.array_equal(taken["reference.x"], number)
        assert np.array_equal(taken["reference.y"], number == 1)
    assert len(hashes) == 2  # one of the engines, one of the other algorithm
    for wrong, words in (
        ("m.d -> controller.reference.z", "there is no state of m 'd'"),
        ("m.a -> controller.reference.z : up", "a mode is known at once"),
    ):
        (tmp_path / "s.toml").write_text(text.replace("m.b -> controller.reference.y", wrong))
        found = cosim("scenario", "check", "s.toml", "--fmus", fmus.parent, cwd=tmp_path)
        assert words in found.out + found.err


def test_scenario_with_modes_reads_back(tmp_path: Path) -> None:
    (tmp_path / "s.toml").write_text(MISSION + PHASES)
    scenario = load(str(tmp_path / "s.toml")).scenario
    again = parse(scenario.to_toml(), name="s", where="s.toml", folder=tmp_path).scenario
    assert again == scenario
