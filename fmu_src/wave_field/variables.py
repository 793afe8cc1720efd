"""FMI variables of WaveField."""

from __future__ import annotations

from pathlib import Path

from cosim.fmu.export import ComponentSpec, Variable
from cosim.models import GRAVITY, accelerations, at_depth, gains, sea

SLOTS = 8
"""Number of explicit components in an FMU."""

_MOST = 200
_SEA = {"Hs": 1.0, "Tp": 8.0, "depth": 30.0, "direction": 0.6, "yaw_gain": 0.02}
_COUNT, _SEED = 20, 1


def _real(
    name: str,
    text: str,
    unit: str | None,
    start: float = 0.0,
    low: float | None = None,
    high: float | None = None,
) -> Variable:
    return Variable(name, "parameter", text, unit, start, minimum=low, maximum=high)


def _variables() -> list[Variable]:
    drawn = at_depth(sea(_SEA["Hs"], _SEA["Tp"], count=_COUNT, seed=_SEED), _SEA["depth"])
    start = accelerations(0.0, drawn, gains(_SEA["direction"], _SEA["yaw_gain"]))
    table = [
        Variable(
            f"disturbance.{axis}",
            "output",
            f"acceleration of {text} by the water around the vehicle",
            "rad/s2" if axis == "r" else "m/s2",
            float(value),
        )
        for axis, text, value in zip("uvwr", ("surge", "sway", "heave", "yaw"), start, strict=True)
    ]
    integer = [
        ("spectrum", "1: JONSWAP, 2: Pierson-Moskowitz, 0: the explicit components", 1, 0, 2),
        ("components", "number of harmonics of the spectrum", _COUNT, 1, _MOST),
        ("seed", "draws frequencies and phases", _SEED, 0, 2**31 - 1),
    ]
    table += [
        Variable(n, "parameter", text, None, value, "Integer", minimum=low, maximum=high)
        for n, text, value, low, high in integer
    ]
    heading = "towards which the waves travel, from the bow, starboard positive"
    table += [
        _real("Hs", "significant wave height", "m", _SEA["Hs"], 0.0),
        _real("Tp", "peak period", "s", _SEA["Tp"], 0.1),
        _real("peak_factor", "peak factor of JONSWAP", None, 3.3, 1.0, 10.0),
        _real("depth", "depth below the surface", "m", _SEA["depth"], 0.0),
        _real("direction", heading, "rad", _SEA["direction"]),
        _real("yaw_gain", "yaw acceleration per sway acceleration", "rad/m", _SEA["yaw_gain"]),
        *(_real(f"gain.{axis}", f"factor on disturbance.{axis}", None, 1.0) for axis in "uvwr"),
    ]
    for k in range(1, SLOTS + 1):
        table += [
            _real(f"omega[{k}]", f"frequency of component {k}", "rad/s", 1.0),
            _real(f"amplitude[{k}]", f"acceleration amplitude of component {k}", "m/s2"),
            _real(f"phase[{k}]", f"phase of component {k} at t = 0", "rad"),
        ]
    return table


_SCENARIO = """\
title = "The vehicle adrift in a sea"

[run]
end = 60.0
step = 0.05

[components.plant]
fmu = "AuvPlant"

[components.sea]
fmu = "WaveField"
parameters = { Hs = 2.0, Tp = 7.0, depth = 20.0, seed = 3 }

[[connections]]
from = "sea.disturbance"
to = "plant.disturbance"
"""

SPEC = ComponentSpec(
    name="WaveField",
    description=(
        "Irregular sea as an exosystem: accelerations of the water at the vehicle's depth "
        f"(deep water, g = {GRAVITY} m/s2)"
    ),
    variables=tuple(_variables()),
    behaviour="cosim.components.wave_field.behaviour:WaveField",
    sources=(
        "cosim.models.products",
        "cosim.models.waves",
        "cosim.components.wave_field.behaviour",
    ),
    readme=Path(__file__).with_name("readme.md"),
    stop_time=60.0,
    step_size=0.05,
    scenario=_SCENARIO,
    constants={"slots": SLOTS},
)
