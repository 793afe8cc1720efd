"""The main job in one go: both gains, both flights over the same link, one picture."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cosim.core import Progress
from cosim.scenario.execute import check_room, fly, prepare
from cosim.scenario.hangar import Hangar
from cosim.scenario.outcome import Outcome
from cosim.scenario.read import load
from cosim.trace import Labelled, compare_flights, pyplot

FLIGHTS = (("auv-acoustic", "delay-aware"), ("auv-acoustic-naive", "naive"))
"""Scenario and label, the first with the gain that is designed for the link."""


@dataclass(frozen=True)
class Demo:
    """Outcomes by label, and the picture."""

    outcomes: dict[str, Outcome]
    picture: Path

    def to_json(self) -> dict[str, Any]:
        """Everything, for `--json`."""
        return {
            "runs": {label: outcome.to_json() for label, outcome in self.outcomes.items()},
            "picture": str(self.picture),
        }


def demonstrate(hangar: Hangar, folder: Path, progress: Progress | None = None) -> Demo:
    """Design, fly and draw; traces and picture go to `folder`."""
    # what would fail at the end is said at the beginning
    pyplot()
    check_room(folder / "demo.png")
    outcomes = {}
    for name, label in FLIGHTS:
        tell: Progress | None = None
        if progress is not None:

            def tell(what: str, share: float, label: str = label) -> None:
                progress(f"{label}: {what}", share)

        prepared = prepare(load(name), hangar, progress=tell)
        outcomes[label] = fly(prepared, folder / f"{name}.mcap", progress=tell)
    picture = compare_flights(
        [Labelled(label, folder / f"{name}.mcap") for name, label in FLIGHTS],
        folder / "demo.png",
        age_limit_s=outcomes[FLIGHTS[0][1]].metrics["designed_age_s"],
    )
    return Demo(outcomes, picture)
