"""Each component with an input that moves and parameters that are not the default."""

from __future__ import annotations

import importlib
import json
import math
from typing import TYPE_CHECKING, Any

from raw_fmu import RawFmu

if TYPE_CHECKING:
    from pathlib import Path

    from cosim.fmu.export import ComponentSpec

DRIVE = {
    "AuvPlant": ("force.x", lambda t: 400 * math.sin(t), {"initial.nu.r": 0.05}),
    "HinfController": ("eta.y", lambda t: math.cos(3 * t), {"sample_time": 0.07}),
    "DelayedPlant": ("u[1]", lambda t: math.sin(2 * t), {"delay.d": 0.23}),
    "PaperController": ("x[2]", lambda t: math.sin(2 * t), {}),
    "WaveField": (None, lambda _t: 0.0, {"Hs": 2.5}),
    "Sensor": ("u[2]", lambda t: math.sin(2 * t), {"sample_time": 0.07, "offset": 0.1}),
}
"""For each FMU an input, how it moves, and parameters that are not the default."""


def behaviour_of(spec: ComponentSpec) -> Any:
    """The equations of a component in Python, with its constants as they are in an FMU: JSON."""
    module, name = spec.behaviour.split(":")
    constants = json.loads(json.dumps(dict(spec.constants)))
    return getattr(importlib.import_module(module), name)(constants)


def started(path: Path, name: str, instance: str = "it", beside: RawFmu | None = None) -> RawFmu:
    return RawFmu(path / f"{name}.fmu", instance, beside).initialise(dict(DRIVE[name][2]))


def drive(raw: RawFmu, name: str, first: int, last: int, h: float = 0.05) -> list[list[float]]:
    """Steps first to last - 1; every output after each."""
    port, wave, _ = DRIVE[name]
    rows = []
    for k in range(first, last):
        if port is not None:
            raw.put({port: wave(k * h)})
        raw.step(k * h, h)
        rows.append(raw.get(*raw.outputs()))
    return rows
