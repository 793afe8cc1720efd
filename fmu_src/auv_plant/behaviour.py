"""Behaviour of AuvPlant: connects its FMI variables to the equations of `cosim.models.auv`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cosim.fmu.export import DelayPlant
from cosim.models import STATE, thrust_map, vehicle_conditions, vehicle_derivatives


class AuvPlant(DelayPlant):
    """The vehicle, with held inputs between communication points."""

    inputs = (
        *("force.x", "force.y", "force.z", "moment.z"),
        *("disturbance.u", "disturbance.v", "disturbance.w", "disturbance.r"),
    )
    states = STATE

    def __init__(self, constants: dict[str, Any]) -> None:
        del constants  # nothing of the vehicle is fixed when the FMU is built

    def conditions(self, v: Any) -> list[tuple[Any, str]]:
        """Require a positive definite mass matrix."""
        return vehicle_conditions(v)

    def constants(self, v: Any) -> tuple[Any, Any]:
        """Return the parameters and M^-1."""
        return v, thrust_map(v)

    def rates(
        self, t: Any, x: Sequence[Any], late: list[Any], u: Sequence[Any], c: Any, ns: Any
    ) -> list[Any]:
        """Compute x' of the vehicle; only nu is delayed."""
        del t
        parameters, b = c
        return vehicle_derivatives(x, late[0][4:], u[:4], u[4:], parameters, b, ns)
