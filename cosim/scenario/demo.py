"""The demo: run the delay-aware and the naive gain over the same link and compare them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.core import InputError, Progress, silent
from cosim.scenario.execute import check_writable, execute_run
from cosim.scenario.fmu_cache import FmuCache
from cosim.scenario.outcome import Outcome
from cosim.scenario.preparation import prepare
from cosim.scenario.read import load
from cosim.trace import LabelledTrace, compare_runs, pyplot

DEMO_RUNS = (("auv-acoustic", "delay-aware"), ("auv-acoustic-naive", "naive"))
"""Scenario and label; the gain of the first is designed for the link."""


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
    check_writable(folder / "demo.png")
    report = progress or silent
    outcomes = {}
    for name, label in DEMO_RUNS:

        def report_progress(what: str, share: float, label: str = label) -> None:
            report(f"{label}: {what}", share)

        prepared = prepare(load(name), fmu_cache, progress=report_progress)
        outcomes[label] = execute_run(prepared, folder / f"{name}.mcap", progress=report_progress)
    if no_picture is not None:
        return Demo(outcomes, None, no_picture)
    picture = compare_runs(
        [LabelledTrace(label, folder / f"{name}.mcap") for name, label in DEMO_RUNS],
        folder / "demo.png",
        age_limit_s=outcomes[DEMO_RUNS[0][1]].metrics["designed_age_s"],
    )
    return Demo(outcomes, picture)
