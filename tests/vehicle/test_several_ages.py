"""A run judges each measurement of an observer by its own age: one fault at a time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from cli.shell import cosim
from vehicle import axis_flight as axis

from cosim.core import InputError
from cosim.hinf import check_certificate
from cosim.scenario import FmuCache, Outcome, execute_run, execute_unrecorded, parse, prepare
from cosim.trace import Trace
from cosim.trace.outcome import assumptions_of, outcome_of

UNMET = {"limits_not_reached"}
"""Of the usual run, which starts far away."""


def unmet(outcome: Outcome) -> set[str]:
    return {name for name, met in outcome.metrics["assumptions"].items() if not met}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The FMUs and the design of the axis."""
    return axis.write_axis(tmp_path_factory.mktemp("axis"))


def outcome_of_axis(
    folder: Path, trace: Path | None = None, **changed: object
) -> tuple[Outcome, Any]:
    """Outcome and rows of the axis' scenario with these parts changed."""
    text = axis.scenario(**changed)
    loaded = parse(text, name="axis", where="axis.toml", folder=folder)
    prepared = prepare(loaded, FmuCache(folder / "fmus", folder))
    if trace is not None:
        return execute_run(prepared, trace), None
    return execute_unrecorded(prepared)


@pytest.mark.slow
def test_each_measurement_has_its_own_age(folder: Path) -> None:
    """From stamp to use, holds included: the figures that the settings give."""
    outcome, run = outcome_of_axis(folder)
    assert unmet(outcome) == UNMET
    ages = outcome.metrics["measurement_ages"]
    assert ages["fix"]["measured"] == {
        "least_s": 0.6,
        "greatest_s": pytest.approx(1.0),
        "in_use_s": [0.6, 0.6],
    }
    assert ages["speed"]["measured"]["greatest_s"] == pytest.approx(0.15)
    assert ages["commands"]["measured"]["greatest_s"] == pytest.approx(0.05)
    most = max(run.signal("controller", "message_age.fix").tolist())
    assert most == pytest.approx(1.0)  # as the controller itself says


@pytest.mark.parametrize(
    ("name", "changed"),
    [
        ("age_of_fix_within_design", {"transit": 0.8}),
        ("age_of_fix_within_design", {"loss": 0.9}),
        ("plant_as_designed", {"plant": '"A[2,1]" = -8.1, "w[1]" = 0.01'}),
        ("nothing_set_or_overridden", {"override": "plant.u[1]"}),
    ],
)
def test_one_fault_fails_one_assumption(folder: Path, name: str, changed: dict[str, Any]) -> None:
    """Each alone; a command that is overridden is also one that the observer did not know."""
    also = set()
    if "override" in changed:
        events = '[[events]]\nat = 1.0\nfor = 0.2\noverride = { "plant.u[1]" = 0.1 }\n'
        changed = {"more": f"{axis.USUAL['more']}{events}"}
        also = {"observer_knows_commands", "values_delivered"}
    if name.startswith("age_of_fix"):
        also = {"controller_follows_law"}  # it commands safe values where a fix is too old
    outcome, _ = outcome_of_axis(folder, **changed)
    assert unmet(outcome) == UNMET | {name} | also
    assert outcome.tone == "open"


def test_the_gain_counts_the_noise_as_a_disturbance(folder: Path) -> None:
    """From w and the noise to z it is below gamma; a noise that the design has not gives none."""
    quiet, _ = outcome_of_axis(folder)
    noisy, _ = outcome_of_axis(folder, noise=0.05)
    assert 0 < noisy.metrics["gain"] < quiet.metrics["gain"] < quiet.metrics["gamma"]
    loud, _ = outcome_of_axis(folder, speed=0.1)
    assert loud.metrics["gain"] is None


def test_what_is_wrong_with_the_design_is_refused(folder: Path) -> None:
    """A key that the design knows itself; and a controller that is none for it."""
    for more, words in (
        ('[design]\nfile = "design.json"\nsampled = true\n', "beside the design of an observer"),
        ('[design]\nfile = "design.json"\ncontroller = "fix"\n', "does not fit the controller"),
    ):
        with pytest.raises(InputError, match=words):
            outcome_of_axis(folder, more=more)


def test_without_a_design_the_certificate_in_the_controller_counts(folder: Path) -> None:
    """The same verdict, by the FMU alone."""
    outcome, _ = outcome_of_axis(folder, more="")
    assert unmet(outcome) == UNMET
    assert outcome.design is not None
    assert "controller.fmu" in outcome.design.words


def test_views_of_a_trace_show_each_age(folder: Path, tmp_path: Path) -> None:
    """Of a run that met its assumptions, and of one whose fixes were too old."""
    for name, transit, tone in (("good", 0.55, "good"), ("late", 0.8, "bad")):
        file = tmp_path / f"{name}.mcap"
        outcome_of_axis(folder, file, transit=transit)
        trace = Trace(file)
        outcome = outcome_of(trace.result)
        assert outcome is not None
        checks = {each.what: each for each in assumptions_of(outcome)}
        fix = checks["Measurements of fix were no older than designed for"]
        assert fix.tone == tone
        assert "any age up to 1.2 s" in fix.why
        assert check_certificate(json.loads(trace.attachments["certificate.json"])).valid
        info = cosim("trace", "info", file, "--details", cwd=tmp_path).out
        assert "age of fix" in info
        page = tmp_path / f"{name}.html"
        cosim("trace", "report", file, "--out", page, cwd=tmp_path)
        assert "Measurements of fix were no older" in page.read_text("utf-8")
        again = cosim("trace", "rerun", file, "--fmus", folder, cwd=tmp_path)
        assert again.code == 0, again.err
