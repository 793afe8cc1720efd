"""Thrusters and fins of a vehicle: commands, limits, first-order lags, forces.

    T' = (clamped(command) - T)/lag     with a lag, T is a state; else T = clamped(command)
    thruster   (X, Y, Z, K, M, N) = effect T,  effect = (direction, position x direction + moment)
    fin        lift rho/2 A U^2 CL delta along `direction`, drag rho/2 A U^2 CD delta^2 aft,
               U^2 = u^2 + (speed along direction)^2, at `position`;
               and derivatives, products of velocities with delta or delta^2

Standard library only: this file is also part of the FMU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cosim.models.vehicle_attitude import cross
from cosim.models.vehicle_forces import Force, add_force, derivative_named, factor_product
from cosim.models.vehicle_inertia import FORCES


def thruster_force(
    thrust: Any, effects: Mapping[str, Any], axes: Sequence[int], total: Force
) -> None:
    """Add the force of a thruster; effects: force or moment per thrust by letter."""
    for letter, effect in effects.items():
        row = FORCES.index(letter)
        if row in axes:
            add_force(total, row, effect * thrust)


def fin_lift_and_drag(
    angle: Any,
    fin: Mapping[str, Any],
    nu: Mapping[int, Any],
    axes: Sequence[int],
    total: Force,
) -> None:
    """Add lift and drag of a fin.

    fin : `pressure` (rho/2 times area), `lift`, `drag` (coefficients; None for no drag),
        `direction` and `position` (component by axis 0 to 2, those that may not be zero).
    """
    direction, position = fin["direction"], fin["position"]
    across: Any = None
    for axis, part in direction.items():
        speed = part * nu[axis]
        across = speed if across is None else across + speed
    pressure = fin["pressure"] * (nu[0] * nu[0] + across * across)
    lift = pressure * fin["lift"] * angle
    force: Force = {axis: lift * part for axis, part in direction.items()}
    if fin["drag"] is not None:
        force[0] = -(pressure * fin["drag"] * (angle * angle))
    for axis, value in sorted(force.items()):
        add_force(total, axis, value)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if 3 + i not in axes:
            continue
        if j in position and k in force:
            add_force(total, 3 + i, position[j] * force[k])
        if k in position and j in force:
            add_force(total, 3 + i, -(position[k] * force[j]))


def fin_derivatives(
    angle: Any, coefficients: Mapping[str, Any], nu: Mapping[int, Any], total: Force
) -> None:
    """Add the derivatives of a fin; coefficients: dimensional ones by name, such as Y_uud."""
    for name, coefficient in coefficients.items():
        derivative = derivative_named(name)
        product = None if derivative is None else factor_product(derivative, nu)
        if derivative is None or product is None:
            raise ValueError(f"no derivative of a fin of this vehicle: {name}")
        term = coefficient * product * angle
        add_force(total, derivative.row, term * angle if derivative.angles == 2 else term)


def effect_of(
    direction: Sequence[float], position: Sequence[float], moment: Sequence[float]
) -> dict[str, float]:
    """Return force and moment per thrust by letter, without those that are zero."""
    turning = [a + b for a, b in zip(cross(position, direction), moment, strict=True)]
    pairs = zip(FORCES, [*direction, *turning], strict=True)
    return {letter: value for letter, value in pairs if value != 0.0}
