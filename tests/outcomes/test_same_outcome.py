"""Every view of a run tells the same story, however the run ended."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from cli.shell import cosim
from outcomes.ways import WAYS, departures, found

from cosim.trace import RunOutcome, Trace, verify
from cosim.trace.outcome import outcome_of

_WAYS = [
    pytest.param(name, marks=() if way.sent is None else pytest.mark.slow)
    for name, way in WAYS.items()
]
"""Those that a signal ends take a process of their own, and are slow."""


@pytest.mark.parametrize("name", _WAYS)
def test_every_view_has_the_same_headline(name: str) -> None:
    """Exit code, summary, badge, state and /log: one headline; events at their instants."""
    assert departures(name, found(name)) == []


@pytest.mark.parametrize("name", _WAYS)
def test_trace_of_every_run_verifies(name: str) -> None:
    """Lines of the log are in order with all other messages; the killed one is incomplete."""
    verdict = verify(found(name).trace).verdict
    assert verdict == ("incomplete" if name == "killed" else "ok")


@pytest.mark.parametrize("name", _WAYS)
def test_outcome_is_one_record(name: str) -> None:
    """What is read from the trace is what `info --json` prints, and reads as itself again.

    Without one, as of a run that was killed, there is none.
    """
    path = found(name).trace
    if name == "killed":
        assert outcome_of(Trace(path, incomplete=True).result) is None
        return
    outcome = outcome_of(Trace(path).result)
    assert outcome is not None
    printed = cosim("trace", "info", path, "--json", cwd=path.parent).json["outcome"]
    assert printed.pop("tone") == outcome.tone
    assert printed == outcome.to_json()
    assert RunOutcome.from_json(printed) == outcome
    assert outcome_of(outcome.entries(engine="any")) == outcome


def test_events_are_counted_in_the_outcome() -> None:
    """As often as /log has them, and as long as the metrics say."""
    views = found("saturated")
    outcome = outcome_of(Trace(views.trace).result)
    assert outcome is not None
    for event in outcome.events:
        lines = [x for x in views.log if (x.name, x.message) == (event.subject, event.message)]
        assert len(lines) == event.count
        assert lines[0].time_s == event.first_s
        assert (lines[0].level, event.level) == ("warning", "warning")
    longest = max(e.total_s or 0.0 for e in outcome.events if e.kind == "saturation")
    fraction = outcome.metrics["saturated_fraction"]
    assert longest / 10.0 <= fraction <= 1.0
    assert {e.kind for e in outcome.events} == {"saturation", "envelope"}


def test_departures_are_noticed() -> None:
    """Each view that said something else would be named."""
    printed = found("assertion")
    other = {
        "code": 0,
        "summary": "assertion: finished; no design was named\nnext:\n",
        "badge": "finished",
        "tone": "good",
        "state": "finished",
        "log": printed.log[:1],
    }
    for field, value in other.items():
        assert departures("assertion", replace(printed, **{field: value})), field


def test_an_outcome_of_an_older_version_is_read() -> None:
    """Without a version, events and causes, as traces/reference has it."""
    path = Path(__file__).parents[2] / "traces" / "reference" / "auv-acoustic-naive.mcap"
    outcome = outcome_of(Trace(path).result)
    assert outcome is not None
    assert "version" not in (Trace(path).result or {})
    assert (outcome.status, outcome.steps, outcome.simulated_s) == ("finished", 260, 8.0)
    assert outcome.headline == "finished, 2 of 5 assumptions not met"
    assert outcome.links["uplink"]["sent"] > 0
    assert (outcome.version, outcome.events) == (1, ())


@pytest.mark.parametrize("text", ["x", "[1]", '{"kind": 1}', "NaN", "1e999", "null", '[{"a": 1}]'])
def test_entries_of_any_form_are_read(text: str) -> None:
    """What another tool wrote in their place has its default."""
    keys = ("metrics", "final", "cause", "assertions", "events", "steps", "simulated_s")
    outcome = outcome_of({**dict.fromkeys(keys, text), "link.up.sent": text, "status": text})
    assert outcome is not None
    assert outcome.cause is None
    assert (outcome.assertions, outcome.events) == ((), ())
    json.dumps(outcome.to_json(), allow_nan=False)


def test_diff_names_other_outcomes_of_equal_signals() -> None:
    """A run whose assertion failed has the signals of one that went well, and another outcome."""
    one, two = found("finished").trace, found("assertion").trace
    done = cosim("trace", "diff", one, two, cwd=one.parent)
    assert done.code == 0
    assert "outcome: finished | finished, 1 of 3 assertions failed" in done.out
