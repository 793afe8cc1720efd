"""Say what crosses which link of a flight, and up to which age of it the proof holds.

Only what the vehicle file measures `over = "link"`, of states that are controlled, crosses the slow
link as a measurement. Set-points cross it as well, where there are any: they move the station and
are in no term of the proof, so that their age matters to nothing that is proved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from cosim.models import Over
from cosim.vehicle.flight_plan import FlightSettings, PlannedSensor
from cosim.vehicle.vehicle import Sensor


@dataclass(frozen=True)
class Crossing:
    """What goes from one component to another, and by which way.

    Attributes
    ----------
    what : "usbl: eta.x, eta.y", "set-points: eta.z", "commands".
    over : the slow "link", or "onboard".
    greatest_age_s : the proof holds for any age up to this one [s]; None: it does not use the age.
    remark : how often, how long under way, what may be lost; "" where there is nothing to say.
    """

    what: str
    over: Over
    greatest_age_s: float | None
    remark: str = ""

    def to_json(self) -> dict[str, Any]:
        """Return the fields as JSON values."""
        return asdict(self)

    @property
    def line(self) -> str:
        """The crossing in one line."""
        way = "over the slow link" if self.over == "link" else "on board"
        age = self.greatest_age_s
        proof = "the proof does not use their age" if age is None else f"any age up to {age:g} s"
        return f"{way}: {self.what}; {proof}" + (f" ({self.remark})" if self.remark else "")


def crossings(
    sensors: Sequence[PlannedSensor], set_points: Sequence[str], settings: FlightSettings
) -> tuple[Crossing, ...]:
    """Return the crossings of a flight, those over the slow link first.

    Parameters
    ----------
    set_points : names of the states that have one.
    """
    each = []
    for sensor in sensors:
        way = [f"every {sensor.interval:g} s"]
        if sensor.over == "link" and settings.recording is not None:
            way += ["as recorded"]
        elif sensor.in_packets:
            way += [f"up to {sensor.transit:g} s under way"]
        way += [sensor.remark] if sensor.remark else []
        what = f"{sensor.name}: {', '.join(sensor.measures)}"
        each.append(Crossing(what, sensor.over, sensor.age, ", ".join(way)))
    if set_points:
        each.append(Crossing(f"set-points: {', '.join(set_points)}", "link", None))
    each.append(Crossing("commands", "onboard", settings.command_age))
    return tuple(sorted(each, key=lambda one: one.over != "link"))


def crossing_lines(
    crossed: Sequence[Crossing], sensors: Sequence[Sensor], states: Sequence[str]
) -> list[str]:
    """Return a line for each crossing, and for what one might expect to cross and does not.

    Parameters
    ----------
    sensors : of the vehicle file.
    states : that are controlled.
    """
    lines = [one.line for one in crossed]
    if not any(one.over == "link" and one.greatest_age_s is not None for one in crossed):
        lines.append("no measurement crosses the slow link: the loop does not depend on it")
    for sensor in sensors:
        if sensor.over == "link" and not {*sensor.measures} & {*states}:
            names = ", ".join(sensor.measures)
            lines.append(f"not used: {sensor.name}, since {names} are not controlled")
    return lines


def crossing_title(crossed: Sequence[Crossing]) -> str:
    """Return in a few words what crosses the slow link."""
    over_link = [one.what.partition(":")[0] for one in crossed if one.over == "link"]
    if not over_link:
        return "nothing crosses the slow link, loop closed on board"
    names = " and ".join(over_link)
    if all(one.greatest_age_s is None for one in crossed if one.over == "link"):
        return f"{names} over a slow link, every measurement on board"
    return f"{names} over a slow link, loop closed on board"
