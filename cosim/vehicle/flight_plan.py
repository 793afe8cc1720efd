"""Plan a flight over a slow link: how old each measurement may be, and what the link is like.

The age of a measurement where it acts is made of the sampling, the transit over the link, the wait
for a communication point, and the hold until the next one comes; a lost message adds an interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from cosim.core import InputError, counted
from cosim.models import Over
from cosim.network import Recording
from cosim.recordings import statistics_of
from cosim.vehicle.vehicle import Sensor

LOSSES_IN_A_ROW = 3
"""Messages over the link that may be lost one after the other within the age designed for."""

ONBOARD = "onboard"
"""Name of the packet of all that is measured on board."""

_JITTER = 0.1  # of the time that a message takes
_HOLD = 1.2  # steps that a command is old at most, with some to spare
_RUN = 1.25  # mean length of a run of losses, in messages


@dataclass(frozen=True)
class FlightSettings:
    """The settings of a flight.

        >>> from cosim.vehicle import FlightSettings
        >>> slow = FlightSettings(link=10.0, loss=0.2, duration=600.0)
        >>> slow.losses >= 1, slow.seed
        (True, 2)

    Attributes
    ----------
    link : greatest time that a message over the link takes [s].
    losses : number of messages lost in a row that the age designed for allows.
    loss : share of the link's messages that are lost, in runs.
    duration : of the flight [s].
    step : communication step [s].
    seed : of the sea, the losses and the noise.
    use : share of the envelope and the limits that set-points and sea may use in the linear model.
    recording : the losses of the link in place of `loss` and, if it has times of arrival, its
        delays in place of delays up to `link`; the design is made for `link` in any case.
    """

    link: float = 2.0
    loss: float = 0.05
    losses: int = LOSSES_IN_A_ROW
    duration: float = 180.0
    step: float = 0.05
    seed: int = 2
    use: float = 0.7
    recording: Recording | None = None

    @classmethod
    def over(cls, recording: Recording, **given: Any) -> FlightSettings:
        """Return settings for a flight over a recorded link.

            >>> from cosim.network import Recording
            >>> from cosim.vehicle import FlightSettings
            >>> second = 10**9
            >>> modem = Recording([0, 4 * second], [False, False], [second, 1_230_000_000])
            >>> FlightSettings.over(modem, duration=60.0).link
            1.25

        If `link` is not given, the design is for the greatest recorded delay, in whole steps.
        """
        settings = cls(**{"link": 1.0, "loss": 0.0, **given, "recording": recording})
        if "link" in given or recording.delay_ns is None:
            return replace(settings, link=given.get("link", cls.link))
        greatest = _whole(recording.greatest_ns / 1e9, settings.step)
        return replace(settings, link=max(settings.step, greatest))

    @property
    def replay(self) -> str:
        """How the recording is replayed: once, or in a loop if the flight lasts longer."""
        long_enough = self.recording is None or self.recording.sent_ns[-1] >= 1e9 * self.duration
        return "once" if long_enough else "loop"

    @property
    def command_age(self) -> float:
        """Greatest age of a command that the design allows for [s].

        The controller is on board and commands at every step, without feedthrough: the estimate at
        the beginning of a step acts until its end. A fifth of a step is a reserve.
        """
        return round(_HOLD * self.step, 9)

    def __post_init__(self) -> None:
        for name, good, expected in (
            ("link", self.link >= self.step, f"at least a step of {self.step:g} s"),
            ("loss", 0 <= self.loss < 1, "a share from 0 to less than 1"),
            (
                "duration",
                self.duration >= 10 * self.link,
                "at least ten times the time that a message takes",
            ),
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
    transit : greatest time that a message takes [s]; 0: a wire.
    jitter : by how much less it may be [s].
    age : greatest age where it acts, which is designed for [s].
    loss : share of messages that are lost.
    over : whether it is taken on board, or comes over the slow link.
    remark : what differs from the vehicle file; "" where nothing does.
    """

    name: str
    measures: tuple[str, ...]
    noise: tuple[float, ...]
    interval: float
    transit: float
    jitter: float
    age: float
    loss: float
    over: Over
    remark: str = ""

    @property
    def in_packets(self) -> bool:
        """Whether its values come in packets; otherwise they come by wire."""
        return self.transit > 0


def planned_sensors(
    sensors: Sequence[Sensor], states: Sequence[str], settings: FlightSettings
) -> tuple[PlannedSensor, ...]:
    """Return the sensors that measure controlled states, with intervals and ages that go together.

    What is measured on board goes to the observer in one packet with one stamp, as a navigation
    computer hands it on: at the longest interval and for the greatest age of its sensors. A design
    then has one age on board, and one for each sensor over the link.

    Raises
    ------
    InputError : no sensor measures any of these states.
    """
    used = []
    for sensor in sensors:
        pairs = zip(sensor.measures, sensor.noise, strict=True)
        noises = {name: noise for name, noise in pairs if name in states}
        if noises:
            used.append(replace(sensor, measures=tuple(noises), noise=tuple(noises.values())))
    planned = [_over_link(sensor, settings) for sensor in used if sensor.over == "link"]
    aboard = [sensor for sensor in used if sensor.over == "onboard"]
    if aboard:
        planned.insert(0, _on_board(aboard, settings))
    if not planned:
        raise InputError(
            "no sensor measures a controlled state",
            where="sensors",
            expected=f"one that measures some of {', '.join(states)}",
            got=", ".join(name for sensor in sensors for name in sensor.measures) or "no sensors",
        )
    return tuple(planned)


def _on_board(sensors: Sequence[Sensor], settings: FlightSettings) -> PlannedSensor:
    """Return one sensor for all on board; of two that measure the same, the less noisy counts."""
    step = settings.step
    best: dict[str, float] = {}
    for sensor in sensors:
        for name, noise in zip(sensor.measures, sensor.noise, strict=True):
            best[name] = min(noise, best.get(name, noise))
    interval = _whole(max(step, *(sensor.interval for sensor in sensors)), step)
    # measured at the beginning of a step, there at its end, held until the next one is there
    least, given = round(interval + step, 9), max(sensor.age for sensor in sensors)
    age = max(given, least)
    names = ", ".join(sensor.name for sensor in sensors)
    remark = "" if names == ONBOARD else f"{names} in one packet"
    if given < least:
        remark += f"; an interval and a step make it so old, not {given:g} s"
    transit = _whole(age - least, step, math.floor)
    return PlannedSensor(
        *(ONBOARD, tuple(best), tuple(best.values()), interval, transit, 0.0, age, 0.0, "onboard"),
        remark,
    )


def _over_link(sensor: Sensor, settings: FlightSettings) -> PlannedSensor:
    step = settings.step
    interval = _whole(max(sensor.interval, step), step)
    transit, jitter = link_times(settings)
    age = round(transit + interval * (1 + settings.losses) + 2 * step, 9)
    remark = f"{settings.losses} in a row may be lost" if settings.losses else ""
    name = sensor.name if sensor.name != ONBOARD else f"{ONBOARD}_link"
    return PlannedSensor(
        *(
            name,
            sensor.measures,
            sensor.noise,
            interval,
            transit,
            jitter,
            age,
            settings.loss,
            "link",
        ),
        remark,
    )


def link_times(settings: FlightSettings) -> tuple[float, float]:
    """Return the greatest time that a message takes, and by how much less it may be [s]."""
    transit = _whole(settings.link, settings.step, math.floor)
    return transit, _whole(_JITTER * transit, settings.step, math.floor)


def _whole(seconds: float, step: float, rounded: Any = math.ceil) -> float:
    """Return a time as a multiple of a step; what is one but for rounding is that one."""
    number = seconds / step
    rounded_number = round(number) if abs(number - round(number)) < 1e-6 else rounded(number)
    return round(rounded_number * step, 9)


def recorded_lines(sensors: Sequence[PlannedSensor], settings: FlightSettings) -> list[str]:
    """Return lines about the recording of the link beside what the design allows for."""
    if settings.recording is None:
        return []
    statistics = statistics_of(settings.recording)
    age, longest = statistics.greatest_age_s, max(statistics.runs_of_losses, default=0)
    lines = [f"the link as recorded: up to {counted(longest, 'message')} lost in a row"]
    if settings.replay == "loop":
        lasts = f"{statistics.duration_s:.4g} s, the flight {settings.duration:g} s"
        lines.append(f"the recording lasts {lasts}: it begins again when it is over")
    for sensor in sensors:
        if sensor.over == "link" and age is not None:
            was = f"{sensor.name}: the newest message was up to {age:.4g} s old"
            allowed = " (more losses in a row: --losses; a longer way: --link)"
            more = allowed if age > sensor.age else ""
            lines.append(f"{was}; the design is for up to {sensor.age:g} s{more}")
    return lines


def loss_in_runs(loss: float) -> dict[str, float] | float:
    """Return the Gilbert-Elliott chain of a share of lost messages, 1.25 in a row on average."""
    if loss == 0.0:
        return 0.0
    leave = 1.0 / _RUN
    return {"p_enter": loss * leave / (1.0 - loss), "p_exit": leave}
