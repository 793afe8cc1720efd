"""Assumptions of a guarantee are reported as met only if they were: one fault at a time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.master import Run
from cosim.scenario import FmuCache, LoadedScenario, execute_unrecorded, parse, prepare

SCENARIO = """\
title = "Pushed for two seconds"
connect = [
    "plant.eta -> controller.eta : up",
    "plant.nu -> controller.nu : up",
    "controller.force -> plant.force",
    "controller.moment -> plant.moment",
]

[run]
end = 2.0
step = 0.05

[components.plant]
fmu = "AuvPlant"
parameters = {{ "delay.d" = 0.5, "initial.nu.u" = {start}, "disturbance.u" = {push} }}

[components.controller]
fmu = "HinfController"
parameters = {{ "limit.force" = {limit} }}

[links.up]
kind = "packet"
sample_time = 0.15
delay = 0.25
loss = {loss}
on_loss = "{on_loss}"

[design]
system = "auv"
file = "auv-1.25s"

{events}
"""
MET = {
    "certificate_verified": True,
    "loop_as_designed": True,
    "plant_as_designed": True,
    "controller_as_designed": True,
    "message_age_within_design": True,
    "values_delivered": True,
    "plant_follows_law": True,
    "controller_follows_law": True,
    "state_inside_envelope": True,
    "limits_not_reached": True,
    "nothing_set_or_overridden": True,
}


class StudyRunner:
    """Runs the scenario, with one design for all."""

    def __init__(self, fmus: Path, folder: Path) -> None:
        self._folder = folder
        self._fmu_cache = FmuCache(fmus.parent, folder, flavour="native")
        first = prepare(self._loaded({}), self._fmu_cache)
        assert first.problem is not None
        assert first.design is not None
        self._made = first.problem, first.design

    def __call__(self, **more: Any) -> tuple[Any, Any, Run]:
        """Metrics, links and rows."""
        prepared = prepare(self._loaded(more), self._fmu_cache, saved=self._made)
        outcome, run = execute_unrecorded(prepared)
        return outcome.metrics, outcome.links["up"], run

    def _loaded(self, more: Mapping[str, Any]) -> LoadedScenario:
        usual = {"start": 0.0, "push": 0.05, "limit": 2500.0, "loss": 0.0, "on_loss": "hold"}
        text = SCENARIO.format(**usual | {"events": ""} | dict(more))
        return parse(text, name="s", where="s.toml", folder=self._folder)


@pytest.fixture(scope="module")
def execute_run(native_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> StudyRunner:
    return StudyRunner(native_fmus, tmp_path_factory.mktemp("flights"))


def test_all_assumptions_are_met_in_a_normal_run(execute_run: StudyRunner) -> None:
    """Losses that are held make measurements older, not wrong."""
    metrics, link, _ = execute_run(loss=0.2)
    assert metrics["assumptions"] == MET
    assert link["lost"] > 0


def test_substituted_measurement_fails_the_age_assumption(execute_run: StudyRunner) -> None:
    """A substitute is no measurement, however recent it is."""
    metrics, link, _ = execute_run(loss=0.2, on_loss="zero")
    assert metrics["assumptions"] == MET | {"message_age_within_design": False}
    assert metrics["message_age_s"] <= metrics["designed_age_s"]
    assert link["substitutions"] > 0


def test_what_an_event_changes_is_reported(execute_run: StudyRunner) -> None:
    """What is set or overridden; the traffic of a link is no assumption."""
    outage = '[[events]]\nat = 1.0\nfor = 0.3\noutage = ["up"]\n'
    override = '[[events]]\nat = 1.0\nfor = 0.1\noverride = { "plant.force.y" = 1.0 }\n'
    gust = '[[events]]\nat = 1.0\nset = { "plant.disturbance.u" = 0.01 }\n'
    for events, wrong in (
        (outage, set()),
        (gust, set()),
        (override, {"nothing_set_or_overridden", "values_delivered"}),
    ):
        metrics, _, _ = execute_run(events=events)
        assert {name for name, met in metrics["assumptions"].items() if not met} == wrong


def largest(run: Run, component: str, variable: str) -> float:
    return float(np.abs(run.signal(component, variable)).max())


def test_zero_state_run_counts_for_envelope_and_limits(execute_run: StudyRunner) -> None:
    """It leaves the envelope, or reaches a limit, where the run itself does not."""
    _, _, rest = execute_run(push=0.25)
    most = largest(rest, "controller", "force.x")
    metrics, _, own = execute_run(push=0.25, start=-0.28, limit=0.98 * most)
    assert largest(own, "controller", "force.x") < 0.95 * most
    assert largest(own, "plant", "nu.u") < 0.3 < largest(rest, "plant", "nu.u")
    assert metrics["saturated_fraction"] == 0.0
    assert metrics["envelope_use"]["u"] == pytest.approx(largest(rest, "plant", "nu.u") / 0.3, 0.02)
    wrong = {"state_inside_envelope": False, "limits_not_reached": False}
    assert metrics["assumptions"] == MET | wrong
