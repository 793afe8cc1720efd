"""The scenario of a trace, to change it and fly it again."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from cosim.hinf import Result
from cosim.replay.trace_attachments import design_in, scenario_in
from cosim.scenario import Scenario
from cosim.trace import Trace
from cosim.trace.rows import DESIGN_ATTACHMENT


def scenario_of(trace: str | PathLike[str]) -> Scenario:
    """Return the scenario of a trace, with the design that it flew.

        heavier = scenario_of("r.mcap").set("components.plant.parameters.mass", 260)
        run(heavier, "heavier.mcap").diff("r.mcap")

    FMUs are those of the scenario's references, which may have changed since: `rerun` repeats a run
    with the FMUs of their hashes, and compares.

    Raises
    ------
    InputError : no trace of a run of this project.
    """
    path = Path(trace)
    recorded = Trace(path)
    loaded = scenario_in(recorded, path.parent)
    scenario = Scenario.of_data(loaded.scenario.to_data(), name=loaded.name, folder=path.parent)
    if loaded.scenario.design is None:
        return scenario
    design = Result.from_json(design_in(recorded), where=f"{path}: {DESIGN_ATTACHMENT}")
    return scenario.with_design(design)
