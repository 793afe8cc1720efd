"""Say of each binary of a run whether it is prebuilt, or where it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cosim.fmu import FmuDescription
from cosim.fmu.compiled import is_prebuilt, library_source, prebuilt_folder
from cosim.master import EngineChoice


def binary_origins(fmus: Mapping[str, FmuDescription], engine: EngineChoice) -> dict[str, str]:
    """Return component, and "the kernel" if it is the engine -> origin of its binary in words."""
    found = {name: _origin(fmu.path) for name, fmu in fmus.items()}
    if engine.name == "kernel":
        ready = is_prebuilt("kernel", library_source("kernel"))
        found["the kernel"] = "prebuilt" if ready else "compiled on this machine"
    return found


def _origin(path: Path) -> str:
    return "prebuilt" if path.is_relative_to(prebuilt_folder()) else f"from {path.parent}"
