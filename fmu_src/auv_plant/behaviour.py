"""AuvPlant between its FMI variables and the equations of `cosim.models.auv`."""

from __future__ import annotations

import math
from typing import Any

from cosim.models.auv import STATE, derivatives, inertia, thrust_map
from cosim.models.delay_line import DelayLine

_FORCE = ("force.x", "force.y", "force.z", "moment.z")
_DISTURBANCE = ("disturbance.u", "disturbance.v", "disturbance.w", "disturbance.r")


class AuvPlant:
    """The vehicle between two communication points, inputs held."""

    def __init__(self, constants: dict[str, Any]) -> None:
        del constants  # nothing of the vehicle is fixed when the FMU is built

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Take parameters and initial state from `v`; fills the outputs.

        Raises
        ------
        ValueError : parameters without a meaning (an inertia that is not positive definite).
        """
        m = inertia(v)
        if not (m[0][0] > 0 and m[2][2] > 0 and m[1][1] > 0):
            raise ValueError("mass plus added mass must be positive in surge, sway and heave")
        if not m[1][1] * m[3][3] > m[1][3] * m[3][1]:
            raise ValueError("the sway-yaw block of the mass matrix must be positive definite")
        self._parameters = v
        self._map = thrust_map(v)
        self._held: list[float] | None = None
        initial = [v[f"initial.{name}"] for name in STATE]
        self._line = DelayLine(initial, [v["delay.d"]], v["solver.step"], start)
        self._publish(v)

    def advance(self, v: dict[str, float], end: float) -> None:
        """Integrate to `end` with the inputs in `v` held; fills the outputs.

        Raises
        ------
        ArithmeticError : the state left the range of finite numbers.
        """
        tau = [v[name] for name in _FORCE]
        disturbance = [v[name] for name in _DISTURBANCE]
        held = tau + disturbance
        p, b = self._parameters, self._map

        def f(_t: float, x: list[float], lagged: list[list[float]]) -> list[float]:
            return derivatives(x, lagged[0][4:], tau, disturbance, p, b, math)

        self._line.advance(end, f, jump=held != self._held)
        self._held = held
        self._publish(v)

    def refresh(self, v: dict[str, float]) -> None:
        """No output depends on an input without delay: nothing to do."""

    def _publish(self, v: dict[str, float]) -> None:
        v.update(zip(STATE, self._line.x, strict=True))

    def snapshot(self) -> dict[str, Any]:
        """Everything that determines the future, delay line included."""
        return {"line": self._line.snapshot(), "held": self._held}

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`; parameters are in the variables already."""
        self._line.restore(saved["line"])
        self._held = saved["held"]
