"""Export a vehicle as a plant FMU."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cosim.core import VEHICLE_FILE, CosimError, InputError, kind_by_keys, parse_toml
from cosim.fmu.export import (
    FmuTarget,
    checked_name,
    model_name,
    write_fmu,
)
from cosim.hinf.problem import BUILT_IN_SYSTEMS
from cosim.vehicle.read import VEHICLES, load_vehicle
from cosim.vehicle.vehicle import Vehicle


@dataclass(frozen=True)
class VehicleFmu:
    """The plant FMU of a vehicle that was exported.

    Attributes
    ----------
    path, name : the file and its model name.
    kind : flavour and platforms.
    vehicle : the exported vehicle.
    """

    path: Path
    name: str
    kind: FmuTarget
    vehicle: Vehicle

    @cached_property
    def step(self) -> float:
        """Start value of `solver.step` [s]."""
        return self.vehicle.fmu_spec(self.name).variables[-1].start

    def to_json(self) -> dict[str, Any]:
        """Return what was exported, as `--json` prints it."""
        vehicle = self.vehicle
        return {
            "fmu": str(self.path),
            "model": self.name,
            "flavour": self.kind.flavour,
            "vehicle": vehicle.name,
            "degrees_of_freedom": vehicle.degrees_of_freedom,
            "inputs": list(vehicle.inputs),
            "outputs": list(vehicle.outputs),
            "parameters": dict(vehicle.parameters),
            "solver_step": self.step,
        }


def export_vehicle(
    vehicle: Vehicle, path: Path, *, kind: FmuTarget, name: str | None = None
) -> VehicleFmu:
    """Write the plant FMU of a vehicle.

    name : of the model; by default the stem of `path`.

    Raises
    ------
    InputError : no model name, no compiler, or a file that cannot be written.
    """
    chosen = model_name(path) if name is None else checked_name(name)
    write_fmu(vehicle.fmu_spec(chosen), path, kind)
    return VehicleFmu(path, chosen, kind, vehicle)


def named_vehicle(name_or_path: str) -> Vehicle | None:
    """Return a vehicle of the gallery or of a vehicle file; None for the name of a system.

        >>> from cosim.vehicle import named_vehicle
        >>> named_vehicle("remus100").degrees_of_freedom
        6
        >>> named_vehicle("paper") is None  # a system, not a vehicle
        True

    Raises
    ------
    InputError : a name of neither; for a file with the keys of a vehicle, as `load_vehicle`.
    """
    if name_or_path in VEHICLES:
        return load_vehicle(name_or_path)
    if not Path(name_or_path).suffix and name_or_path not in BUILT_IN_SYSTEMS:
        known = (*BUILT_IN_SYSTEMS, *VEHICLES, "FILE.toml")
        hint = "a system or a vehicle of your own is a TOML file"
        raise InputError.unknown("system or vehicle", name_or_path, known, hint=hint)
    return load_vehicle(name_or_path) if _is_vehicle(Path(name_or_path)) else None


def _is_vehicle(path: Path) -> bool:
    try:
        data: Mapping[str, Any] = parse_toml(path.read_text("utf-8"), str(path))
    except (OSError, UnicodeDecodeError, CosimError):
        return False
    return kind_by_keys(data) is VEHICLE_FILE
