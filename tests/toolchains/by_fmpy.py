"""FMPy: its loader under a plain exchange loop, and for a single FMU its own simulation."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from typing import Any

from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from toolchains.peer_run import Part, PeerRun, Rows, label, serve


def run_tool(peer_run: PeerRun) -> Rows:
    """Couple the parts; or simulate the only one."""
    if len(peer_run.parts) == 1 and not peer_run.again:
        return _simulated(peer_run)
    members = {name: _Member(name, part, peer_run) for name, part in peer_run.parts.items()}
    rows = _exchanged(members, peer_run)
    if peer_run.again:
        for member in members.values():
            member.fmu.reset()
            member.begin()
        rows = _exchanged(members, peer_run)
    for member in members.values():
        member.end()
    return rows


def _exchanged(members: Mapping[str, _Member], peer_run: PeerRun) -> Rows:
    """Step the members from the start, and hand over their outputs before each step."""
    rows: dict[str, list[float]] = {label(*watched): [] for watched in peer_run.watch}
    for k in range(peer_run.steps):
        handed = [members[a].get(output) for a, output, _, _ in peer_run.wires]
        for (_, _, b, name), value in zip(peer_run.wires, handed, strict=True):
            members[b].set(name, value)
        for member in members.values():
            member.fmu.doStep(k * peer_run.step_ns / 1e9, peer_run.step)
        for part, variable in peer_run.watch:
            rows[label(part, variable)].append(members[part].get(variable))
    return rows


def _simulated(peer_run: PeerRun) -> Rows:
    """FMPy's own loop over one FMU."""
    ((name, part),) = peer_run.parts.items()
    outputs = [variable for _, variable in peer_run.watch]
    result: Any = simulate_fmu(
        part.fmu,
        stop_time=peer_run.steps * peer_run.step_ns / 1e9,
        output_interval=peer_run.step,
        start_values=dict(part.parameters),
        output=outputs,
        fmi_type="CoSimulation",
    )
    return {label(name, v): [float(x) for x in result[v][1:]] for v in outputs}


class _Member:
    """One FMU of FMI 2 or 3 through FMPy."""

    def __init__(self, name: str, part: Part, peer_run: PeerRun) -> None:
        model: Any = read_model_description(part.fmu)
        self.references = peer_run.references(name)
        self.folder = extract(part.fmu)
        self.three = model.fmiVersion.startswith("3")
        self.fmu: Any = (FMU3Slave if self.three else FMU2Slave)(
            guid=model.guid,
            unzipDirectory=self.folder,
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.parameters = part.parameters
        self.fmu.instantiate()
        self.begin()

    def begin(self) -> None:
        """Set the parameters and initialise."""
        if not self.three:
            self.fmu.setupExperiment(startTime=0.0)
        for variable, value in self.parameters.items():
            self.set(variable, value)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, variable: str) -> float:
        """A Real output."""
        read = self.fmu.getFloat64 if self.three else self.fmu.getReal
        return float(read([self.references[variable]])[0])

    def set(self, variable: str, value: float) -> None:
        """An input or a parameter, by the type of the value."""
        kind = "Integer" if isinstance(value, int) else "Real"
        if self.three:
            kind = "Int32" if kind == "Integer" else "Float64"
        getattr(self.fmu, f"set{kind}")([self.references[variable]], [value])

    def end(self) -> None:
        """Terminate, free, remove."""
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)


if __name__ == "__main__":
    serve(run_tool)
