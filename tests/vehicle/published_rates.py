"""Rates of the vehicles of the gallery against those of their published models.

published/NAME.json has, for random states, actuators and currents, the rates of the model as its
repository computes them ("published"), and with the lines under "changed" ("modelled").
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cosim.vehicle import Vehicle, load_vehicle, vehicle_from_toml, vehicle_text

FOLDER = Path(__file__).with_name("published")
NAMES = ("nps-auv2-6dof", "remus100", "bluerov2-heavy")
_ETA = ("x", "y", "z", "phi", "theta", "psi")

Rates = NDArray[np.float64]


class Difference(NamedTuple):
    """Greatest relative differences over cases.

    speed, position : of the vector of nu' and of eta', against its norm.
    entry : of an entry that is at least a thousandth of its vector, against itself.
    """

    cases: int
    speed: float
    position: float
    entry: float


def published(name: str) -> dict[str, Any]:
    """Return what is known of a published model."""
    found: dict[str, Any] = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    return found


def rotation(phi: float, theta: float, psi: float) -> Rates:
    """Return R from body to earth axes."""
    (cf, ct, cp), (sf, st, sp) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    return np.array(
        [
            [cp * ct, -sp * cf + cp * st * sf, sp * sf + cp * cf * st],
            [sp * ct, cp * cf + sf * st * sp, -cp * sf + st * sp * cf],
            [-st, ct * sf, ct * cf],
        ]
    )


def actuators(name: str, case: Mapping[str, Any], surge: float) -> list[float]:
    """Return what the actuators do in a case, thrust in newtons from the published rpm.

    surge : through the water, as the model takes it [m/s].
    """
    if name == "bluerov2-heavy":
        return [float(thrust) for thrust in case["thrust"]]
    if name == "remus100":
        n, speed = case["n"] / 60, math.hypot(*case["nu"][:3])
        slope = (0.1798 - 0.4566) / 0.6632 * (0.944 * speed / 0.14)
        return [0.9 * 1026 * 0.14**4 * (0.4566 * n * n + slope * n), *case["delta"]]
    prop = 0.012 * (case["n"] / 60 * 2 * math.pi) / case["nu"][0]
    return [1025 / 2 * 5.3**2 * 0.00385 * surge**2 * prop * abs(prop), *case["delta"]]


def rates_of(vehicle: Vehicle, name: str, case: Mapping[str, Any], **parameters: float) -> Rates:
    """Return nu' and eta' of a vehicle in a case."""
    current = list(case["current"])
    if name != "bluerov2-heavy":
        speed, direction, down = current
        current = [speed * math.cos(direction), speed * math.sin(direction), down]
    turned = (
        [0.0, 0.0, case["eta"][5]] if vehicle.terms["current"] == "heading" else case["eta"][3:]
    )
    surge = case["nu"][0] - float((rotation(*turned).T @ current)[0])
    done = actuators(name, case, surge)
    x = [*case["eta"], *case["nu"], *done]
    u = [*done, *current, *[0.0] * 6]
    own = {**vehicle.parameters, **parameters} if parameters else None
    rates = vehicle.rates(x, [], u, parameters=own)
    return np.array([*rates[6:12], *rates[:6]])


def difference(pairs: list[tuple[Rates, Rates]]) -> Difference:
    """Compare rates (12,) with those of a model."""
    speed = position = entry = 0.0
    for ours, theirs in pairs:
        for part in (slice(0, 6), slice(6, 12)):
            a, b = ours[part], theirs[part]
            size = float(np.linalg.norm(b))
            off = float(np.linalg.norm(a - b)) / size
            if part.start == 0:
                speed = max(speed, off)
            else:
                position = max(position, off)
            large = np.abs(b) > 1e-3 * size
            entry = max(entry, float(np.max(np.abs(a - b)[large] / np.abs(b)[large])))
    return Difference(len(pairs), speed, position, entry)


def against_model(name: str) -> Difference:
    """Compare a vehicle of the gallery with its model, errors of the published form corrected."""
    vehicle = load_vehicle(name)
    cases = published(name)["cases"]
    return difference([(rates_of(vehicle, name, c), np.array(c["modelled"])) for c in cases])


def against_published(name: str) -> Difference:
    """Compare the published form of a vehicle with the published rates, where a file has it."""
    form = published_form(name)
    cases = [c for c in published(name)["cases"] if expressible(name, c)]
    return difference([(rates_of(form, name, c), np.array(c["published"])) for c in cases])


def expressible(name: str, case: Mapping[str, Any]) -> bool:
    """Whether a vehicle file has all that the published model has in this case."""
    if name == "bluerov2-heavy":  # Eq. (23) mixes velocities with and without the current
        return not any(case["current"])
    if name == "remus100":  # torque at the advance number of the file
        speed = math.hypot(*case["nu"][:3])
        torque = math.isclose(case["n"] / 60 * 0.14 * 0.6632, 0.944 * speed, rel_tol=1e-12)
        return torque and case["current"][2] == 0.0
    # at self-propulsion the slipstream has no effect
    self_propelled = 0.012 * case["n"] / 60 * 2 * math.pi
    return math.isclose(self_propelled, case["nu"][0], rel_tol=1e-12)


def published_form(name: str) -> Vehicle:
    """Return a vehicle with the errors of its published model, where a file can have them."""
    text = vehicle_text(name)
    if name != "bluerov2-heavy":
        text = text.replace("[hydro]\n", '[hydro]\ncurrent = "heading"\n')
    if name == "nps-auv2-6dof":
        text = text.replace("coupled = true\n", 'coupled = true\npitch = "opposite"\n')
        # sign of m (v p - u q - z_G (p^2 + q^2)) in heave, and of (I_z - I_x) p r in pitch
        m = 53400 / 9.81 / (1025 / 2 * 5.3**3)
        gyroscopic = (13587 - 2038) / (1025 / 2 * 5.3**5)
        for old, new in (
            ("Z_vp = -4.8e-2", f"Z_vp = {-4.8e-2 + 2 * m!r}"),
            ("Z_uq = -1.4e-1", f"Z_uq = {-1.4e-1 - 2 * m!r}"),
            ("Z_pp = 1.3e-4", f"Z_pp = {1.3e-4 - 2 * m * 0.061 / 5.3!r}"),
            ("Z_pr = 6.7e-3", f"Z_pr = 6.7e-3\nZ_qq = {-2 * m * 0.061 / 5.3!r}"),
            ("M_pr = 5.0e-3", f"M_pr = {5.0e-3 - 2 * gyroscopic!r}"),
        ):
            text = text.replace(f"{old}\n", f"{new}\n")
    return vehicle_from_toml(text, where=f"{name}, as published")
