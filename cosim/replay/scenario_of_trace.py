"""The scenario of a trace, to change it and fly it again."""

from __future__ import annotations

from pathlib import Path

from cosim.core import AnyPath
from cosim.hinf import Result
from cosim.replay.trace_attachments import design_in, scenario_in
from cosim.scenario import Scenario
from cosim.trace import Trace
from cosim.trace.rows import DESIGN_ATTACHMENT


def scenario_of(trace: AnyPath) -> Scenario:
    """Return the scenario of a trace, with the design that it flew.

        >>> from cosim import DelaySystem, Scenario, run, scenario_of
        >>> system = DelaySystem(A=[[-0.5]], B=[[1]])
        >>> tank = Scenario(step=0.1, until=2).add("tank", system, initial=[1.0])
        >>> first = run(tank, "first.mcap")
        >>> faster = scenario_of("first.mcap").set("components.tank.parameters.A[1,1]", -0.7)
        >>> run(faster, "faster.mcap").diff(first).equal
        False
        >>> run(scenario_of("first.mcap"), "again.mcap").diff(first).identical
        True

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
