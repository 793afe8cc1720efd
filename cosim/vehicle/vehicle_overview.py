"""What a vehicle is, in figures: mass, trim, poles, drag at the envelope, actuators, sensors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cosim.core import CosimError, pyplot, save_picture
from cosim.vehicle.diagnosis import drag_shares, greatest_power, mass_matrix, poles
from cosim.vehicle.trim import Trim, find_trim
from cosim.vehicle.vehicle import Vehicle

Matrix = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Overview:
    """A vehicle in figures.

    Attributes
    ----------
    mass : (k, k) mass with added mass, by `velocities`.
    trim : None where there is none: `no_trim` says why.
    poles : at the trim, without control [1/s]; empty without a trim.
    drag : velocity -> share of the limits that holds it at the bound of the envelope.
    power : greatest power of the water's forces on the vehicle within twice the envelope [W].
    """

    vehicle: Vehicle
    velocities: tuple[str, ...]
    mass: Matrix
    trim: Trim | None
    no_trim: str | None
    poles: tuple[complex, ...]
    drag: dict[str, float]
    power: float

    def to_json(self) -> dict[str, Any]:
        """Return JSON values."""
        vehicle = self.vehicle
        trim = self.trim
        return {
            "name": vehicle.name,
            "description": vehicle.description,
            "source": " ".join(vehicle.source.split()),
            "degrees_of_freedom": vehicle.degrees_of_freedom,
            "attitude": vehicle.attitude,
            "states": list(vehicle.states),
            "inputs": list(vehicle.inputs),
            "parameters": {
                p.name: {"value": p.value, "unit": p.unit, "text": p.text}
                for p in vehicle.parameter_table
            },
            "velocities": list(self.velocities),
            "mass_matrix": self.mass.tolist(),
            "trim": None
            if trim is None
            else {"state": dict(trim.state), "commands": dict(trim.commands)},
            "no_trim": self.no_trim,
            "poles": [[s.real, s.imag] for s in self.poles],
            "envelope": dict(vehicle.envelope),
            "drag_share": self.drag,
            "greatest_power_W": self.power,
            "controlled": list(vehicle.control.states),
            "actuators": [
                {
                    "command": a.command,
                    "limit": a.limit,
                    "unit": a.unit,
                    "lag_s": a.lag,
                    "at_trim": None if trim is None else trim.commands[a.command],
                }
                for a in vehicle.actuators
            ],
            "sensors": [
                {
                    "name": s.name,
                    "measures": list(s.measures),
                    "interval_s": s.interval,
                    "noise": list(s.noise),
                    "age_s": s.age,
                    "over": s.over,
                }
                for s in vehicle.sensors
            ],
        }


def overview(vehicle: Vehicle) -> Overview:
    """Return a vehicle in figures; without a trim those that need none."""
    trim, why = None, None
    try:
        trim = find_trim(vehicle)
    except CosimError as error:
        why = error.text()
    return Overview(
        vehicle,
        vehicle.velocities,
        mass_matrix(vehicle),
        trim,
        why,
        () if trim is None else tuple(complex(s) for s in poles(vehicle, trim)),
        {} if trim is None else drag_shares(vehicle, trim),
        greatest_power(vehicle)[0],
    )


_BLUE, _RED, _GREY = "#0b6e99", "#d1495b", "#666666"


def draw_overview(overview: Overview, target: Path) -> Path:
    """Draw where the actuators are, the poles at the trim, and drag and limits by velocity.

    Raises
    ------
    InputError : matplotlib is not installed, or the picture cannot be written.
    """
    plt = pyplot()
    vehicle = overview.vehicle
    with plt.rc_context({"font.size": 9, "axes.grid": True, "grid.alpha": 0.25}):
        figure, (left, middle, right) = plt.subplots(1, 3, figsize=(13, 4.4), layout="constrained")
        figure.suptitle(f"{vehicle.name}: {vehicle.description}", fontweight="bold")
        _layout(left, vehicle)
        real, imag = [s.real for s in overview.poles], [s.imag for s in overview.poles]
        middle.axvline(0, color=_GREY, lw=0.8)
        middle.plot(real, imag, "x", color=_BLUE, mew=2, ms=8)
        title = "Poles at the trim, without control" if overview.poles else "No trim, no poles"
        middle.set(title=title, xlabel="real part [1/s]", ylabel="imaginary part [1/s]")
        names = list(overview.drag)[::-1]
        shares = [100 * overview.drag[name] for name in names]
        colours = [_RED if share > 100 else _BLUE for share in shares]
        labels = [f"{name} = {vehicle.envelope[name]:g}" for name in names]
        right.barh(labels, shares, color=colours, height=0.6)
        right.axvline(100, color=_GREY, ls=":", lw=1.2)
        right.set(title="Limits that hold the bounds of the envelope [%]")
        right.grid(axis="y", visible=False)
        save_picture(figure, target, 120)
        plt.close(figure)
    return target


def _layout(axis: Any, vehicle: Vehicle) -> None:
    """Draw the actuators from above: an arrow along each force, a dot where it is vertical."""
    values = vehicle.parameters
    size = 0.3
    for actuator in vehicle.actuators:
        effect = {
            letter: values.get(f"effect.{actuator.name}.{letter}", 0.0) for letter in "XYZKMN"
        }
        x, y = _place(actuator.name, effect, values)
        size = max(size, 1.3 * abs(x), 1.3 * abs(y))
        force = effect["Y"], effect["X"]
        if any(force):
            arrow = {"arrowstyle": "->", "color": _BLUE, "lw": 1.6}
            end = (y + 0.25 * size * force[0], x + 0.25 * size * force[1])
            axis.annotate("", xy=end, xytext=(y, x), arrowprops=arrow)
        axis.plot(y, x, "o", color=_BLUE if any(force) else _RED, ms=5)
        axis.annotate(f" {actuator.name}", (y, x), fontsize=8)
    axis.plot(0, 0, "k+", ms=12)
    axis.set(title="Actuators from above (red: vertical, or a fin)")
    axis.set(
        xlabel="starboard y [m]", ylabel="forward x [m]", xlim=(-size, size), ylim=(-size, size)
    )
    axis.set_aspect("equal")


def _place(name: str, effect: dict[str, float], values: Any) -> tuple[float, float]:
    """Return where an actuator is, from its effects: the smallest vector with its moments."""
    if f"position.{name}.x" in values or f"area.{name}" in values:
        return values.get(f"position.{name}.x", 0.0), values.get(f"position.{name}.y", 0.0)
    force = np.array([effect[letter] for letter in "XYZ"])
    moment = np.array([effect[letter] for letter in "KMN"])
    square = float(force @ force)
    if not square:
        return 0.0, 0.0
    x, y, _ = np.cross(force, moment) / square
    return float(x), float(y)
