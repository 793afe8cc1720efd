"""Read a vehicle from the gallery, a file or a text, and check that it can be."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from cosim.core import VEHICLE_FILE, AnyPath, InputError, unreadable, validated
from cosim.vehicle.check import Faults, motion_names
from cosim.vehicle.computable import computable
from cosim.vehicle.defaults import with_defaults
from cosim.vehicle.parameters import parameters_of, terms_of
from cosim.vehicle.schema import VehicleFile
from cosim.vehicle.vehicle import Actuator, Control, OnboardDamping, Sensor, Vehicle

_GALLERY = files("cosim.vehicle") / "gallery"
VEHICLES: Final = tuple(sorted(p.name[:-5] for p in _GALLERY.iterdir() if p.name[-5:] == ".toml"))
"""Names of the vehicles of the gallery, which need no file."""
_BOUNDS: Final = {
    **dict.fromkeys(("nu.u", "nu.v", "nu.w"), 0.15),
    **dict.fromkeys(("nu.p", "nu.q", "nu.r", "eta.phi", "eta.theta"), 0.1),
    "eta.psi": 0.175,
}
"""Bounds of states that a file gives none for, as the text of its key says."""


def vehicle_text(name: str) -> str:
    """Return the file of a vehicle of the gallery.

    Raises
    ------
    InputError : there is no such vehicle.
    """
    if name not in VEHICLES:
        hint = "a vehicle of your own is a TOML file"
        raise InputError.unknown("vehicle", name, (*VEHICLES, "FILE.toml"), hint=hint)
    return (_GALLERY / f"{name}.toml").read_text("utf-8")


def load_vehicle(name_or_path: AnyPath) -> Vehicle:
    """Return a vehicle of the gallery by name, or the one in a `.toml` file.

        >>> from pathlib import Path
        >>> from cosim.vehicle import load_vehicle
        >>> gallery = load_vehicle("nps-auv2")
        >>> _ = Path("mine.toml").write_text(gallery.text.replace("mass = 5454.0", "mass = 5600.0"))
        >>> gallery.parameters["mass"], load_vehicle("mine.toml").parameters["mass"]
        (5454.0, 5600.0)

    Raises
    ------
    InputError : there is no such vehicle, or `vehicle_from_toml` refuses its file.
    """
    if not str(name_or_path).endswith(".toml"):
        return vehicle_from_toml(vehicle_text(str(name_or_path)), where=str(name_or_path))
    path = Path(name_or_path)
    try:
        text = path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise unreadable(path, error) from error
    return vehicle_from_toml(text, where=str(path))


def vehicle_from_toml(text: str, *, where: str = "vehicle") -> Vehicle:
    """Return the vehicle of a TOML text; messages name `where` and the line.

    Raises
    ------
    InputError : malformed TOML, a key that does not exist or is missing, a value of the wrong kind,
        a term that the degrees of freedom do not have, or numbers that no vehicle has.
    """
    data = vehicle_data(text, where)
    file = validated(VehicleFile, text, data, where)
    with computable(where):
        Faults(file, text, where).check()
        return _vehicle(file, text)


def vehicle_data(text: str, where: str) -> dict[str, Any]:
    """Return the TOML text of a vehicle file as data.

    Raises
    ------
    InputError : malformed TOML, or a schema that is not known.
    """
    data = VEHICLE_FILE.from_toml(text, where)
    bounds = data.get("envelope")
    return {**data, "envelope": _flattened(bounds)} if isinstance(bounds, dict) else data


def _flattened(table: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return a table whose names with dots may be written without quotes: nu.u = 0.3."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{before}{key}"
        flat |= _flattened(value, f"{name}.") if isinstance(value, dict) else {name: value}
    return flat


def _vehicle(file: VehicleFile, text: str) -> Vehicle:
    terms = terms_of(file)
    thrusters = [
        Actuator(t.name, "thruster", t.limit, t.lag, "N" if any(t.direction) else "N.m")
        for t in file.thrusters
    ]
    fins = [Actuator(fin.name, "fin", fin.limit, fin.lag, "rad") for fin in file.fins]
    loop = file.onboard_damping
    bounds = {name: _BOUNDS[name] for name in motion_names(file) if name in _BOUNDS}
    missing = {name: bound for name, bound in bounds.items() if name not in file.envelope}
    vehicle = Vehicle(
        name=file.name,
        description=file.description,
        source=file.source,
        degrees_of_freedom=file.degrees_of_freedom,
        attitude=file.attitude,
        actuators=(*thrusters, *fins),
        parameter_table=tuple(parameters_of(file)),
        terms=MappingProxyType(terms),
        damping=None if loop is None else OnboardDamping(dict(loop.rates.items()), loop.delay),
        sensors=tuple(_sensor(s) for s in file.sensors),
        trim=MappingProxyType({"nu.u": file.trim.u} if file.trim.u else {}),
        envelope=MappingProxyType(bounds | file.envelope),
        default_bounds=tuple(missing),
        control=Control(tuple(file.control.states or ()), MappingProxyType(file.control.weights)),
        text=text,
        defaults={"envelope": ", ".join(f'"{n}" = {b:g}' for n, b in missing.items())}
        if missing
        else {},
    )
    return with_defaults(vehicle, speed_given="u" in file.trim.model_fields_set)


def _sensor(part: Any) -> Sensor:
    noise = part.noise if isinstance(part.noise, list) else [part.noise] * len(part.measures)
    return Sensor(part.name, tuple(part.measures), part.interval, tuple(noise), part.age, part.over)
