"""The kinds with vehicles: built-in scenarios, shortened, with one connection per value."""

from __future__ import annotations

import tomllib
from copy import deepcopy
from typing import Any

from falsifier.loop import MS, Age, Data, Loop

from cosim.scenario import load

AXES = ("x", "y", "z", "psi")
RATES = ("u", "v", "w", "r")
FORCES = ("force.x", "force.y", "force.z", "moment.z")


def _builtin(name: str, end: float) -> Data:
    """The tables of a built-in scenario that ends earlier."""
    data: Data = tomllib.loads(load(name).scenario.to_toml())
    data["run"]["end"] = end
    data.pop("assertions", None)
    return data


def _by_value(data: Data, groups: dict[str, tuple[str, ...]]) -> None:
    """Replace connections of a group by one for each value, so that faults find them."""
    wires: list[Data] = []
    for each in data["connections"]:
        source, target = each["from"], each["to"]
        group = groups.get(source)
        if group is None:
            wires.append(each)
            continue
        ends = [name if name.startswith("[") else f".{name}" for name in group]
        wires += [each | {"from": source + end, "to": target + end} for end in ends]
    data["connections"] = wires


def _quiet(data: Data) -> Data:
    """Without the sea: a flight from an offset."""
    found = deepcopy(data)
    found["components"].pop("sea", None)
    kept = [each for each in found["connections"] if not each["from"].startswith("sea.")]
    found["connections"] = kept
    return found


def _states() -> tuple[str, ...]:
    return tuple(f"eta.{a}" for a in AXES) + tuple(f"nu.{a}" for a in RATES)


def _keep_place() -> Loop:
    data = _builtin("auv-acoustic", 60.0)
    groups = {"plant.eta": AXES, "plant.nu": RATES, "controller.force": ("x", "y", "z")}
    groups |= {"controller.moment": ("z",), "sea.disturbance": RATES}
    _by_value(data, groups)
    return Loop(
        "station",
        "AuvPlant and HinfController",
        _quiet(data),
        data,
        (Age("x", _states(), "uplink", 1250 * MS),),
        states=_states(),
        controls=FORCES,
        disturbances=tuple(f"disturbance.{a}" for a in RATES),
        initial=tuple(f"initial.{x}" for x in _states()),
        plant_delay="up to",
        parameters=("mass", "inertia.z", "damping.u", "delay.d"),
    )


def _observed(name: str, end: float, ages: tuple[Age, ...], **more: Any) -> Loop:
    data = _builtin(name, end)
    numbers = {
        f"{part}.y": tuple(f"[{j}]" for j in range(1, size + 1))
        for part, size in {"onboard": 6, "telemetry": 6, "usbl": 2}.items()
    }
    _by_value(data, numbers | {"sea.disturbance": RATES})
    return Loop(
        name,
        f"the vehicle of {name}",
        _quiet(data),
        data,
        ages,
        states=_states(),
        controls=("thruster",),
        disturbances=tuple(f"disturbance.{a}" for a in RATES),
        initial=tuple(f"initial.{x}" for x in _states()),
        parameters=("mass",),
        **more,
    )


def vehicles() -> tuple[Loop, ...]:
    """Vehicle and controller of four degrees of freedom, and two vehicles with an observer."""
    fixes = Age("usbl", ("stamp.usbl",), "fixes", 13_100 * MS)
    onboard = Age("onboard", ("stamp.onboard",), "onboard", 300 * MS)
    remote = (
        Age("telemetry", ("stamp.telemetry",), "uplink", 1500 * MS),
        Age("usbl", ("stamp.usbl",), "fixes", 3100 * MS),
    )
    return (
        _keep_place(),
        _observed("auv-survey", 30.0, (onboard, fixes)),
        _observed("auv-remote", 30.0, remote),
    )
