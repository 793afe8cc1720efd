"""The demo: fly a delay-aware and a naive design over the same late link and compare them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.core import InputError, Progress, check_output_folder, pyplot, silent
from cosim.scenario.execute import execute_run
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.outcome import Outcome
from cosim.scenario.preparation import prepare
from cosim.scenario.read import load
from cosim.trace import LabelledTrace, compare_runs

DEMO_RUNS = (("auv-survey", "delay-aware"), ("auv-survey-naive", "naive"))
"""Scenario and label; the first is designed for the link."""


@dataclass(frozen=True)
class Demo:
    """Outcomes by label, and the picture.

    picture : None without matplotlib; then `no_picture` says what to install.
    """

    outcomes: dict[str, Outcome]
    picture: Path | None
    no_picture: str | None = None

    def to_json(self) -> dict[str, Any]:
        """Return everything, for `--json`."""
        return {
            "runs": {label: outcome.to_json() for label, outcome in self.outcomes.items()},
            "picture": None if self.picture is None else str(self.picture),
        }


def demonstrate(fmu_cache: FmuCache, folder: Path, progress: Progress | None = None) -> Demo:
    """Run both scenarios and draw their comparison; traces and picture go to `folder`.

    Without matplotlib they fly all the same, and there is no picture.
    """
    no_picture = None
    try:
        pyplot()
    except InputError as error:
        no_picture = error.hint
    check_output_folder(folder)
    report = progress or silent
    outcomes, drawn = {}, []
    for name, label in DEMO_RUNS:

        def report_progress(what: str, share: float, label: str = label) -> None:
            report(f"{label}: {what}", share)

        prepared = prepare(load(name), fmu_cache, progress=report_progress)
        path = folder / f"{name}.mcap"
        outcomes[label] = outcome = execute_run(prepared, path, progress=report_progress)
        plant = None if prepared.problem is None else prepared.problem.plant
        states = () if plant is None else plant.state.names
        drawn.append(LabelledTrace(label, path, _designed_age_s(outcome), states))
    if no_picture is not None:
        return Demo(outcomes, None, no_picture)
    return Demo(outcomes, compare_runs(drawn, folder / "demo.png"))


def _designed_age_s(outcome: Outcome) -> float | None:
    """Return the greatest age of a measurement that a design is for [s]."""
    ages = (outcome.metrics.get("measurement_ages") or {}).values()
    age: float | None = max((age["greatest_s"] for age in ages), default=None)
    return outcome.metrics["designed_age_s"] if age is None else age
