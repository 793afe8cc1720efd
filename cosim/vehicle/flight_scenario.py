"""Write the scenario of a flight: a file to be read, changed and run again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from cosim.vehicle.crossing import crossing_title, crossings
from cosim.vehicle.flight_plan import (
    FlightSettings,
    PlannedSensor,
    link_times,
    loss_in_runs,
)

PLANT, CONTROLLER, SHIP, SEA = "plant", "controller", "ship", "sea"
SET_POINTS = "set_points"
"""Names in the scenario."""

RECORDING = "recording.csv"
"""The recorded link in the folder of a flight."""

PATH_ENDS = 0.45
"""Share of the flight after which the set-points are at the trim."""

_RESERVED = {PLANT, CONTROLLER, SHIP, SEA, SET_POINTS}


@dataclass(frozen=True)
class Mission:
    """What happens to the vehicle of a flight.

        >>> from cosim.vehicle import Mission
        >>> mission = Mission(set_points={1: -8.0}, errors={1: 0.5}, wave_height=1.0)
        >>> mission.names(["eta.x", "nu.u"]), mission.calmer(0.5).set_points
        (('eta.x',), {1: -4.0})

    Attributes
    ----------
    set_points : number of the state from 1 -> its deviation from the trim at the start; the
        set-point goes back to the trim along a slow path.
    errors : number of the state -> error of the first estimate.
    wave_height : significant height of the sea [m]; 0: no sea.
    wave_period, wave_depth : peak period [s], and how far below the surface the vehicle is [m].
    """

    set_points: Mapping[int, float]
    errors: Mapping[int, float]
    wave_height: float
    wave_period: float = 8.0
    wave_depth: float = 30.0

    def names(self, states: Sequence[str]) -> tuple[str, ...]:
        """Return the names of the states that have a set-point."""
        return tuple(states[i - 1] for i in self.set_points)

    def calmer(self, share: float) -> Mission:
        """Return the same with a share of the set-points, of their errors and of the sea."""
        return replace(
            self,
            set_points={i: float(f"{share * x:.2g}") for i, x in self.set_points.items()},
            errors={i: float(f"{share * x:.2g}") for i, x in self.errors.items()},
            wave_height=float(f"{share * self.wave_height:.2g}"),
        )


def component_of(sensor: str) -> str:
    """Return the name of the component of a sensor."""
    return f"{sensor}_sensor" if sensor in _RESERVED else sensor


def scenario_text(
    vehicle: str,
    states: Sequence[str],
    disturbances: Sequence[str],
    commands: Sequence[str],
    initial: Mapping[str, float],
    sensors: Sequence[PlannedSensor],
    mission: Mission,
    settings: FlightSettings,
) -> str:
    """Return the scenario as TOML.

    Parameters
    ----------
    states : names of the state of the design.
    disturbances : inputs of the plant that the sea acts on.
    commands : inputs of the plant that the controller drives.
    initial : parameters `initial.*` of the plant at the trim.
    """
    start = dict(initial)
    for i, offset in mission.set_points.items():
        name = f"initial.{states[i - 1]}"
        start[name] = start.get(name, 0.0) + offset
    estimate = {
        f"initial.estimate[{i}]": mission.set_points.get(i, 0.0) + mission.errors.get(i, 0.0)
        for i in sorted({*mission.set_points, *mission.errors})
    }
    reference = {f"reference[{i}]": value for i, value in mission.set_points.items()}
    parts = [
        _head(vehicle, states, sensors, mission, settings),
        f'[components.{PLANT}]\nfmu = "plant.fmu"\n' + _parameters(PLANT, start),
        f'[components.{CONTROLLER}]\nfmu = "controller.fmu"\n'
        + _parameters(
            CONTROLLER,
            estimate | reference,
            "# the first estimate, and the set-points until the first message arrives",
        ),
        *(_sensor(sensor, settings.seed + k) for k, sensor in enumerate(sensors)),
        _sea(disturbances, mission, settings),
        _set_points(mission, sensors, settings),
        *(_of_sensor(sensor) for sensor in sensors),
        *(_wire(f"{CONTROLLER}.{name}", f"{PLANT}.{name}") for name in commands),
        *(_link(sensor, settings) for sensor in sensors if sensor.in_packets),
        _DESIGN,
        _MORE.format(state=_position(states)),
        _outage(sensors, settings),
    ]
    return "\n".join(text for text in parts if text)


def _head(
    vehicle: str,
    states: Sequence[str],
    sensors: Sequence[PlannedSensor],
    mission: Mission,
    settings: FlightSettings,
) -> str:
    crossed = crossings(sensors, mission.names(states), settings)
    listed = "\n".join(f"  {one.line}" for one in crossed)
    asked = "follows set-points that a ship sends" if mission.set_points else "holds its trim"
    return f'''\
# Made by `cosim vehicle fly`; change it as you like, and run it again: cosim run scenario.toml
#   cosim scenario check scenario.toml     list its errors
#   cosim vehicle show vehicle.toml        the vehicle
title = "{vehicle}: {crossing_title(crossed)}"
description = """
The vehicle {asked}. An observer on board estimates its state from
measurements that carry the time at which they were taken. What crosses which link, and the ages
that the proof allows:
{listed}
The gain and the injections of the observer are certified for these ages, however they vary, and
for the envelope of the vehicle.
"""

[run]
end = {settings.duration:g}
step = {settings.step:g}
seed = {settings.seed}
events = "align"
'''


def _parameters(component: str, values: Mapping[str, Any], remark: str = "") -> str:
    if not values:
        return ""
    lines = [f"[components.{component}.parameters]", *([remark] if remark else [])]
    lines += [f'"{name}" = {value!r}' for name, value in values.items()]
    return "\n".join(lines) + "\n"


def _sensor(sensor: PlannedSensor, seed: int) -> str:
    name = component_of(sensor.name)
    values: dict[str, Any] = {"sample_time": sensor.interval, "seed": seed}
    values |= {f"noise[{i}]": noise for i, noise in enumerate(sensor.noise, 1) if noise}
    return f'[components.{name}]\nfmu = "{sensor.name}.fmu"\n' + _parameters(name, values)


def _sea(disturbances: Sequence[str], mission: Mission, settings: FlightSettings) -> str:
    acting = [name for name in ("u", "v", "w", "r") if f"disturbance.{name}" in disturbances]
    if not mission.wave_height or not acting:
        return ""
    values = {
        "Hs": mission.wave_height,
        "Tp": mission.wave_period,
        "depth": mission.wave_depth,
        "seed": settings.seed,
    }
    wires = "\n".join(
        _wire(f"{SEA}.disturbance.{name}", f"{PLANT}.disturbance.{name}") for name in acting
    )
    return f'[components.{SEA}]\nfmu = "WaveField"\n{_parameters(SEA, values)}\n{wires}'


def _set_points(
    mission: Mission, sensors: Sequence[PlannedSensor], settings: FlightSettings
) -> str:
    if not mission.set_points:
        return ""
    interval = max((s.interval for s in sensors if s.over == "link"), default=1.0)
    transit, jitter = link_times(settings)
    axes = ", ".join(f'"[{k}]"' for k in range(1, 1 + len(mission.set_points)))
    values = [*mission.set_points.values()]
    half = round(PATH_ENDS * settings.duration, 3)
    link = _packet(SET_POINTS, interval, transit, jitter, settings.loss, settings)
    wires = "\n".join(
        _wire(f"{SHIP}.y[{k}]", f"{CONTROLLER}.reference[{i}]", SET_POINTS)
        for k, i in enumerate(mission.set_points, 1)
    )
    return f"""\
[components.{SHIP}] # sends the set-points
fmu = "ship.fmu"
{_parameters(SHIP, {"sample_time": interval})}
[reference] # of the set-points: from where the vehicle starts back to its trim
target = "{SHIP}.u"
axes = [{axes}]
points = [{[0.0, *values]}, {[half, *[0.0] * len(values)]}]

{wires}
{link}"""


def _of_sensor(sensor: PlannedSensor) -> str:
    name = component_of(sensor.name)
    link = sensor.name if sensor.in_packets else None
    wires = [
        _wire(f"{PLANT}.{measured}", f"{name}.u[{i}]")
        for i, measured in enumerate(sensor.measures, 1)
    ]
    wires.append(_wire(f"{name}.y", f"{CONTROLLER}.{sensor.name}", link))
    wires.append(_wire(f"{name}.stamp", f"{CONTROLLER}.stamp.{sensor.name}", link))
    return "\n".join(wires)


def _wire(source: str, target: str, link: str | None = None) -> str:
    over = f'link = "{link}"\n' if link else ""
    return f'[[connections]]\nfrom = "{source}"\nto = "{target}"\n{over}'


def _link(sensor: PlannedSensor, settings: FlightSettings) -> str:
    settings_of_link = sensor.interval, sensor.transit, sensor.jitter, sensor.loss
    recorded = sensor.over == "link"
    return _packet(sensor.name, *settings_of_link, settings, recorded=recorded)


def _packet(
    name: str,
    interval: float,
    transit: float,
    jitter: float,
    loss: float,
    settings: FlightSettings,
    *,
    recorded: bool = True,
) -> str:
    recording = settings.recording if recorded else None
    spread = f'jitter = {{ kind = "uniform", width = {jitter:g} }}\n' if jitter else ""
    way = f"delay = {round(transit - jitter, 9):g}\n{spread}"
    if recording is not None:
        again = f', replay = "{settings.replay}"' if settings.replay != "once" else ""
        way = way if recording.delay_ns is None else ""
        way += f'recording = {{ file = "{RECORDING}", rows = "time"{again} }}\n'
    else:
        way += f"loss = {_loss(loss)}\n"
    # what is measured at the beginning of a step is there, and sent, at its end
    return f"""\
[links.{name}]
kind = "packet"
sample_time = {interval:g}
offset = {settings.step:g}
{way}"""


def _loss(loss: float) -> str:
    chain = loss_in_runs(loss)
    if not isinstance(chain, dict):
        return str(chain)
    entries = ", ".join(f"{key} = {value:.6g}" for key, value in chain.items())
    return f"{{ {entries} }} # in runs: {100 * loss:g} % in all"


_DESIGN = """\
[design] # the certificate, and the plant that it is about
file = "design.json"

"""

_MORE = """\
# [[assertions]]
# name = "the station is held in the end"
# always = "t < 120 s or abs(plant.{state}) < 0.5"
"""


def _outage(sensors: Sequence[PlannedSensor], settings: FlightSettings) -> str:
    """Return an event to try: of a link that carries a measurement, whose age then is too great."""
    links = [sensor for sensor in sensors if sensor.in_packets]
    chosen = next((sensor for sensor in links if sensor.over == "link"), next(iter(links), None))
    if chosen is None:
        return ""
    lasts = max(2 * settings.link, 2 * chosen.age)
    return f"""\
# [[events]]
# at = "60 s"
# for = "{lasts:g} s"
# outage = ["{chosen.name}"] # the assumption about the age of {chosen.name} is then not met
"""


def _position(states: Sequence[str]) -> str:
    return next((name for name in states if name.startswith("eta.")), states[0])
