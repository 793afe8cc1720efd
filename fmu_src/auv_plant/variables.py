"""FMI variables of AuvPlant."""

from __future__ import annotations

from pathlib import Path

from cosim.fmu.export import ComponentSpec, Variable, solver_step
from cosim.models import STATE, TABLE_1

STATE_UNITS = ("m", "m", "m", "rad", "m/s", "m/s", "m/s", "rad/s")
_STATE_TEXT = (
    "position north, earth frame",
    "position east, earth frame",
    "depth, earth frame (down positive)",
    "heading",
    "surge speed, body frame",
    "sway speed, body frame",
    "heave speed, body frame (down positive)",
    "yaw rate",
)
_PHYSICAL = {
    "mass": ("kg", "dry mass m", 1e-3),
    "inertia.z": ("kg.m2", "moment of inertia I_z about the vertical axis", 1e-3),
    "density": ("kg/m3", "density of water", 1e-3),
    "length": ("m", "length L of the vehicle", 1e-3),
}


def _variables() -> list[Variable]:
    table = [
        Variable("force.x", "input", "thrust along the body's x axis", "N"),
        Variable("force.y", "input", "thrust along the body's y axis", "N"),
        Variable("force.z", "input", "thrust along the body's z axis", "N"),
        Variable("moment.z", "input", "thruster moment about the body's z axis", "N.m"),
        Variable("disturbance.u", "input", "surge acceleration by waves and current", "m/s2"),
        Variable("disturbance.v", "input", "sway acceleration by waves and current", "m/s2"),
        Variable("disturbance.w", "input", "heave acceleration by waves and current", "m/s2"),
        Variable("disturbance.r", "input", "yaw acceleration by waves and current", "rad/s2"),
    ]
    table += [
        Variable(name, "output", text, unit)
        for name, unit, text in zip(STATE, STATE_UNITS, _STATE_TEXT, strict=True)
    ]
    for name, start in TABLE_1.items():
        if name in _PHYSICAL:
            unit, text, minimum = _PHYSICAL[name]
            table.append(Variable(name, "parameter", text, unit, start, minimum=minimum))
        else:
            text = f"hydrodynamic derivative {name.removeprefix('hydro.')} (Table 1)"
            table.append(Variable(name, "parameter", text, None, start))
    for axis in "uvwr":
        text = f"gain of the onboard damping loop on nu.{axis}(t - delay.d)"
        table.append(Variable(f"damping.{axis}", "parameter", text, "1/s", 0.05, minimum=0.0))
    table.append(
        Variable("delay.d", "parameter", "age of the damping loop's data", "s", 0.5, minimum=0.0)
    )
    for name, unit, text in zip(STATE, STATE_UNITS, _STATE_TEXT, strict=True):
        table.append(Variable(f"initial.{name}", "parameter", f"{text}, for all t <= start", unit))
    return [*table, solver_step(0.05)]


_SEA = """
[components.sea]
fmu = "WaveField"

[[connections]]
from = "sea.disturbance"
to = "plant.disturbance"
"""


def vehicle_scenario(title: str, controller: str, sea: str = "") -> str:
    """Return the TOML of a run of the vehicle over a packet link; `sea` adds tables."""
    return f"""\
title = "{title}"

[run]
end = 60.0
step = 0.05

[components.plant]
fmu = "AuvPlant"
parameters = {{ "initial.eta.x" = 0.5 }}

[components.controller]
fmu = "{controller}"
parameters = {{ "eta.x" = 0.5 }}  # used until the first measurement arrives
{sea}
[[connections]]
from = "plant.eta"
to = "controller.eta"
link = "uplink"

[[connections]]
from = "plant.nu"
to = "controller.nu"
link = "uplink"

[[connections]]
from = "controller.force"
to = "plant.force"

[[connections]]
from = "controller.moment"
to = "plant.moment"

[links.uplink]
kind = "packet"
sample_time = 0.2
delay = 0.5
loss = 0.05
"""


SPEC = ComponentSpec(
    name="AuvPlant",
    description=(
        "Autonomous underwater vehicle in four degrees of freedom with an internal time delay, "
        "Eqs. (1)-(4) and (6)"
    ),
    variables=tuple(_variables()),
    behaviour="cosim.components.auv_plant.behaviour:AuvPlant",
    sources=(
        "cosim.models.auv",
        "cosim.models.delay_line",
        "cosim.fmu.export.python.delay_plant",
        "cosim.components.auv_plant.behaviour",
    ),
    readme=Path(__file__).with_name("readme.md"),
    stop_time=60.0,
    step_size=0.05,
    scenario=vehicle_scenario("Station keeping in a sea", "HinfController", _SEA),
)
