"""Loops of FMUs that do not declare dependencies, as a user of scenarios meets and cuts them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cli.shell import Result, cosim
from master.scalar import scalar_fmu

from cosim.scenario import ScenarioPart, run
from cosim.trace import Trace

LOOP = """\
title = "Two scalars that do not say what depends on what"
[run]
end = 1.0
step = 0.1
[components.p]
fmu = "unknown.fmu"
parameters = { x0 = 1.0, e = 0.3 }
[components.q]
fmu = "unknown.fmu"
parameters = { x0 = -0.5, e = 0.2 }
[[connections]]
from = "p.y"
to = "q.u"
[[connections]]
from = "q.y"
to = "p.u"
"""
PREVIOUS = ("--set", "run.unknown_feedthrough='previous'")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    scalar_fmu(tmp_path, declared=False).rename(tmp_path / "unknown.fmu")
    (tmp_path / "loop.toml").write_text(LOOP)
    return tmp_path


def ran(folder: Path, *words: str) -> Result:
    return cosim("run", "loop.toml", "--fmus", folder, "--out", "t.mcap", *words, cwd=folder)


def metrics(folder: Path, *words: str) -> Any:
    done = ran(folder, *words, "--json")
    assert done.code == 0, done.err
    return done.json["metrics"]


def test_refusal_stands_at_a_connection_and_names_every_key(folder: Path) -> None:
    """In `run` and in `scenario check`; each cure that it names lets the scenario run."""
    for done in (
        ran(folder),
        cosim("scenario", "check", "loop.toml", "--fmus", folder, cwd=folder),
    ):
        assert done.code in (1, 2)
        words = " ".join((done.out + done.err).split())
        assert "loop.toml:14: connections[1]: p -> q -> p: the connections form" in words
        assert "q.y -> p.u (dependencies not declared)" in words
        for key in ('components.p.feedthrough = "none"', 'run.unknown_feedthrough = "previous"'):
            assert key in words
    assert ran(folder, *PREVIOUS).code == 0
    assert ran(folder, "--set", "components.p.feedthrough='none'").code == 0
    assert ran(folder, "--set", "connections[1].policy='previous'").code == 0


def test_summary_and_trace_name_what_is_cut(folder: Path) -> None:
    """Connection and delay; the coupling delay is that of the exchange and one step more."""
    cut = [{"from": "q.y", "to": "p.u", "delay_s": 0.1}]
    found = metrics(folder, *PREVIOUS)
    assert found["cut_connections"] == cut
    assert found["coupling_delay_s"] == pytest.approx(0.2)
    assert found["coupling_delays_s"] == pytest.approx({"p -> q": 0.1, "q -> p": 0.2})
    trace = Trace(folder / "t.mcap")
    named = json.loads(trace.run["cut_connections"])
    assert named == [{"from": "q.y", "to": "p.u"}]
    people = ran(folder, *PREVIOUS).out
    assert "q.y -> p.u is delayed by one step (0.1 s)" in people
    report = cosim("trace", "report", "t.mcap", cwd=folder)
    assert report.code == 0, report.err
    page = next(folder.glob("*.html")).read_text("utf-8")
    assert "delay added to q.y -&gt; p.u" in page
    assert cosim("trace", "verify", "t.mcap", cwd=folder).code == 0


def test_without_a_cut_nothing_is_reported(folder: Path) -> None:
    """Also where it is allowed and not needed."""
    for words in (
        ("--set", "components.p.feedthrough='none'"),
        (*PREVIOUS, "--set", "components.q.feedthrough=['x']"),
    ):
        found = metrics(folder, *words)
        assert "cut_connections" not in found
        assert found["coupling_delay_s"] == pytest.approx(0.1)
        assert "cut_connections" not in Trace(folder / "t.mcap").run


def test_policy_previous_counts_in_the_coupling_delay(folder: Path) -> None:
    """On a wire, with a slow sender or receiver, and over each kind of link."""
    policy = ("--set", "connections[1].policy='previous'")
    found = metrics(folder, *policy)
    assert "cut_connections" not in found
    assert found["coupling_delays_s"] == pytest.approx({"p -> q": 0.1, "q -> p": 0.2})
    slow = metrics(folder, *policy, "--set", "components.q.step=0.2")
    assert slow["coupling_delays_s"]["q -> p"] == pytest.approx(0.3)
    slow = metrics(folder, *policy, "--set", "components.p.step=0.2")
    assert slow["coupling_delays_s"]["q -> p"] == pytest.approx(0.3)
    over = ("--set", "connections[1].link='l'")
    transport = ("--set", "links.l={kind='transport', delay=0.25}")
    found = metrics(folder, *over, *transport)
    assert found["coupling_delay_s"] == pytest.approx(0.1)
    found = metrics(folder, *policy, *over, *transport)
    assert found["coupling_delays_s"]["q -> p over l"] == pytest.approx(0.2)
    packet = ("--set", "links.l={kind='packet', sample_time=0.2, delay=0.1}")
    assert metrics(folder, *over, *packet)["coupling_delay_s"] == pytest.approx(0.1)
    found = metrics(folder, *policy, *over, *packet)
    assert found["coupling_delays_s"]["q -> p over l"] == pytest.approx(0.1)


def test_slow_components_of_a_cut_loop(folder: Path) -> None:
    """The delay that a cut adds is that of the slow sender, or one step of the run."""
    for slow, delay in (("q", 0.2), ("p", 0.1)):
        found = metrics(folder, *PREVIOUS, "--set", f"components.{slow}.step=0.2")
        expected = 0.2 if slow == "q" else delay
        assert found["cut_connections"][0]["delay_s"] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("components.p.feedthrough=['yy']", "there is no output 'yy'"),
        ("components.p.feedthrough=['u']", "there is no output 'u'"),
        ("components.p.feedthrough='y'", "components.p.feedthrough"),
        ("components.p.feedthrough=true", "components.p.feedthrough"),
        ("run.unknown_feedthrough='previus'", "run.unknown_feedthrough"),
        ("run.solve_tolerance=0.0", "run.solve_tolerance"),
        ("run.solve_limit=0", "run.solve_limit"),
        ("run.solve='yes'", "run.solve"),
        ("connections[1].policy='before'", "connections[1].policy"),
    ],
)
def test_invalid_value_is_refused_where_it_stands(folder: Path, setting: str, message: str) -> None:
    done = ran(folder, "--set", setting)
    assert done.code == 2
    assert message in done.err
    assert "--set" in done.err


def test_the_same_in_python(folder: Path, tmp_path: Path) -> None:
    """A scenario that was built there, with every key; it reads back from its TOML."""
    parts: dict[str, Any] = {
        "title": "In Python",
        "run": {"end": 1.0, "step": 0.1, "unknown_feedthrough": "previous"},
        "components": {
            "p": {"fmu": str(folder / "unknown.fmu"), "parameters": {"x0": 1.0}},
            "q": {"fmu": str(folder / "unknown.fmu"), "feedthrough": ["y"]},
        },
        "connections": [{"from": "p.y", "to": "q.u"}, {"from": "q.y", "to": "p.u"}],
    }
    scenario = ScenarioPart.model_validate(parts)
    outcome = run(scenario, tmp_path / "t.mcap", fmus=folder)
    # what q declares is not cut
    cut = [{"from": "p.y", "to": "q.u", "delay_s": pytest.approx(0.1)}]
    assert outcome.metrics["cut_connections"] == cut
    assert ScenarioPart.model_validate(scenario.to_data()) == scenario
