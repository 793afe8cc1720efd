"""Ecos, a co-simulation engine in C++, through ecospy.

Its library needs the one of the package `tbb`, which stands outside the loader's path; once
loaded, it is found by its name.
"""

from __future__ import annotations

import ctypes
import importlib.metadata

from toolchains.peer_run import PeerRun, Rows, label, serve

for _file in importlib.metadata.files("tbb") or ():
    if _file.name == "libtbb.so.12":
        ctypes.CDLL(str(_file.locate()), mode=ctypes.RTLD_GLOBAL)

from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure  # noqa: E402 - needs tbb


def run_tool(peer_run: PeerRun) -> Rows:
    """Its fixed-step algorithm."""
    EcosLib.set_log_level("warn")
    parameters = {
        f"{name}::{variable}": value
        for name, part in peer_run.parts.items()
        for variable, value in part.parameters.items()
    }
    with EcosSimulationStructure() as structure:
        for name, part in peer_run.parts.items():
            structure.add_model(name, part.fmu)
        for a, output, b, variable in peer_run.wires:
            structure.make_real_connection(f"{a}::{output}", f"{b}::{variable}")
        structure.add_parameter_set("flight", parameters)
        with EcosSimulation(peer_run.step, structure=structure) as simulation:
            rows = _stepped(simulation, peer_run)
            if peer_run.again:
                simulation.reset()
                rows = _stepped(simulation, peer_run)
            simulation.terminate()
    return rows


def _stepped(simulation: EcosSimulation, peer_run: PeerRun) -> Rows:
    """Initialise, step, and read after each step."""
    rows: dict[str, list[float]] = {label(*watched): [] for watched in peer_run.watch}
    assert simulation.init(parameter_set="flight"), EcosLib.get_last_error()
    for _ in range(peer_run.steps):
        simulation.step()
        for part, variable in peer_run.watch:
            rows[label(part, variable)].append(simulation.get_real(f"{part}::{variable}"))
    return rows


if __name__ == "__main__":
    serve(run_tool)
