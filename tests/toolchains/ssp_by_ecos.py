"""Ecos loads the archive itself; parameters are those of the set called parameters."""

from __future__ import annotations

import ctypes
import importlib.metadata

from toolchains.ssp_peer_run import Archive, Rows, label, serve

for _file in importlib.metadata.files("tbb") or ():
    if _file.name == "libtbb.so.12":
        ctypes.CDLL(str(_file.locate()), mode=ctypes.RTLD_GLOBAL)

from ecospy import EcosLib, EcosSimulation  # noqa: E402 - needs tbb


def run_tool(archive: Archive) -> Rows:
    """Its fixed-step algorithm."""
    EcosLib.set_log_level("warn")
    rows: dict[str, list[float]] = {label(*watched): [] for watched in archive.watch}
    with EcosSimulation(archive.step, ssp_path=archive.ssp) as simulation:
        assert simulation.init(parameter_set="parameters"), EcosLib.get_last_error()
        for _ in range(archive.steps):
            simulation.step()
            for element, variable in archive.watch:
                value = simulation.get_real(f"{element}::{variable}")
                rows[label(element, variable)].append(value)
        simulation.terminate()
    return rows


if __name__ == "__main__":
    serve(run_tool)
