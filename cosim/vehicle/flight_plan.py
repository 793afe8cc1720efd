"""Plan a flight over a slow link: how old each measurement may be, and what the link is like.

The age of a measurement where it acts is made of the sampling, the transit over the link, the wait
for a communication point, and the hold until the next one comes; a lost message adds an interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.core import InputError

if TYPE_CHECKING:
    from cosim.vehicle.vehicle import Vehicle

LOSSES_IN_A_ROW = 6
"""Messages over the link that may be lost one after the other within the age designed for."""

_TRANSIT = 0.25  # of the age designed for
_RUN = 1.5  # mean length of a run of losses, in messages


@dataclass(frozen=True)
class FlightSettings:
    """What is asked of a flight.

    Attributes
    ----------
    link : greatest age of what comes over the link, where it acts [s].
    loss : share of its messages that are lost, in runs.
    duration : of the flight [s].
    step : communication step [s].
    seed : of the sea, the losses and the noise.
    use : share of envelope and limits that set-points and sea may take of the linear model.
    """

    link: float = 2.0
    loss: float = 0.1
    duration: float = 180.0
    step: float = 0.05
    seed: int = 7
    use: float = 0.5

    def __post_init__(self) -> None:
        for name, good, expected in (
            ("link", self.link >= 8 * self.step, f"at least 8 steps of {self.step:g} s"),
            ("loss", 0 <= self.loss < 1, "a share from 0 to less than 1"),
            ("duration", self.duration >= 10 * self.link, "at least ten times the age of the link"),
            ("use", 0 < self.use <= 1, "a share from 0 to 1"),
        ):
            value = getattr(self, name)
            if not (good and math.isfinite(value)):
                raise InputError(
                    f"this {name} does not go with a flight",
                    where=f"--{name}",
                    expected=expected,
                    got=repr(value),
                )


@dataclass(frozen=True)
class PlannedSensor:
    """A sensor of a flight.

    Attributes
    ----------
    name, measures, noise : as in the vehicle file; `noise` per value.
    interval : between measurements [s].
    transit : time that a message takes [s]; 0: a wire.
    age : greatest age where it acts, which is designed for [s].
    loss : share of messages that are lost.
    remark : what differs from the vehicle file; "" where nothing does.
    """

    name: str
    measures: tuple[str, ...]
    noise: tuple[float, ...]
    interval: float
    transit: float
    age: float
    loss: float
    remark: str = ""

    @property
    def over_link(self) -> bool:
        """Whether its values come in messages."""
        return self.transit > 0


def planned_sensors(
    sensors: Sequence[Any], states: Sequence[str], settings: FlightSettings
) -> tuple[PlannedSensor, ...]:
    """Return the sensors that measure controlled states, with intervals and ages that go together.

    Raises
    ------
    InputError : no sensor measures any of these states.
    """
    found = []
    for sensor in sensors:
        pairs = list(zip(sensor.measures, sensor.noise, strict=True))
        used = [(name, noise) for name, noise in pairs if name in states]
        if used:
            over = _over_link if sensor.over == "link" else _on_board
            measures, noise = zip(*used, strict=True)
            found.append(over(sensor, measures, noise, settings))
    if not found:
        raise InputError(
            "no sensor measures a controlled state",
            where="sensors",
            expected=f"one that measures some of {', '.join(states)}",
            got=", ".join(name for sensor in sensors for name in sensor.measures) or "no sensors",
        )
    return tuple(found)


def _on_board(
    sensor: Any, measures: tuple[str, ...], noise: tuple[float, ...], settings: FlightSettings
) -> PlannedSensor:
    step = settings.step
    interval = _steps(max(sensor.interval, step), step) * step
    # measured at the beginning of a step, there at its end, held until the next one is there
    least = interval + step
    age, remark = sensor.age, ""
    if age < least:
        age = least
        remark = f"designed for {age:g} s: an interval and a step, not {sensor.age:g} s"
    transit = _steps(age - least, step, math.floor) * step
    return PlannedSensor(sensor.name, measures, noise, interval, transit, age, 0.0, remark)


def _over_link(
    sensor: Any, measures: tuple[str, ...], noise: tuple[float, ...], settings: FlightSettings
) -> PlannedSensor:
    step, age = settings.step, settings.link
    transit = max(1, _steps(_TRANSIT * age, step, math.floor)) * step
    longest = (age - transit - step) / (1 + LOSSES_IN_A_ROW)
    interval = max(sensor.interval, step)
    remark = ""
    if interval > longest:
        interval = longest
        remark = (
            f"every {_steps(interval, step, math.floor) * step:g} s, not {sensor.interval:g} s: "
            f"{LOSSES_IN_A_ROW} in a row may then be lost"
        )
    interval = max(1, _steps(interval, step, math.floor)) * step
    return PlannedSensor(
        sensor.name, measures, noise, interval, transit, age, settings.loss, remark
    )


def _steps(seconds: float, step: float, rounded: Any = round) -> int:
    """Return a time in steps; what is a whole number but for rounding is that number."""
    number = seconds / step
    return round(number) if abs(number - round(number)) < 1e-6 else int(rounded(number))


def loss_in_runs(loss: float) -> dict[str, float] | float:
    """Return the Gilbert-Elliott chain of a share of lost messages, 1.5 in a row on average."""
    if loss == 0.0:
        return 0.0
    leave = 1.0 / _RUN
    return {"p_enter": loss * leave / (1.0 - loss), "p_exit": leave}


def describe(vehicle: Vehicle, sensors: Sequence[PlannedSensor]) -> list[str]:
    """Return a line for each sensor: what it measures, how often, and how old it may be."""
    del vehicle
    return [
        f"{s.name}: {', '.join(s.measures)} every {s.interval:g} s, "
        f"{f'{s.transit:g} s under way' if s.over_link else 'on board'}, at most {s.age:g} s old"
        + (f" ({s.remark})" if s.remark else "")
        for s in sensors
    ]
