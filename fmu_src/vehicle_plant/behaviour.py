"""Behaviour of the plant of a vehicle file, with the equations of `cosim.models.vehicle`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cosim.fmu.export import DelayPlant
from cosim.models import DelayLine, FloatFunctions, VehicleEquations

LEAST_COSINE = 0.05
"""Least cosine of the pitch angle with Euler angles: 2.9 degrees from +-90; as in c/vehicle.c."""


class PitchLine(DelayLine):
    """A delay line whose pitch angle must stay away from +-90 degrees."""

    pitch: int

    def _runge_kutta(self, t0: float, t1: float, k1: list[float], f: Any) -> list[float]:
        slope = super()._runge_kutta(t0, t1, k1, f)
        refuse_pitch(self.x[self.pitch], t1)
        return slope


def refuse_pitch(theta: float, t: float) -> None:
    """Refuse a pitch angle where Euler angles have no rates.

    Raises
    ------
    ArithmeticError : cos theta is too small.
    """
    if not math.cos(theta) > LEAST_COSINE:
        raise ArithmeticError(
            f"the pitch angle eta.theta is {theta!r} rad at t = {t!r} s: near +-90 degrees Euler "
            'angles have no rates; set attitude = "quaternion" in the vehicle file'
        )


class VehiclePlant(DelayPlant):
    """A vehicle, with held inputs between communication points."""

    functions: Any = FloatFunctions
    """Namespace of functions beside `rates`: floats, or what records the C."""

    def __init__(self, constants: dict[str, Any]) -> None:
        self._equations = VehicleEquations(constants["terms"])
        self.inputs = self._equations.inputs
        self.states = self._equations.states
        self.delays = self._equations.delays
        self.pitch = self.states.index("eta.theta") if "eta.theta" in self.states else None

    def conditions(self, v: Any) -> list[tuple[Any, str]]:
        """Require a positive definite mass matrix, and a quaternion of length 1."""
        return self._equations.conditions(v)

    def constants(self, v: Any) -> Any:
        """Return what depends on the parameters alone."""
        return self._equations.constants(v, self.functions)

    def rates(
        self, t: Any, x: Sequence[Any], late: list[Any], u: Sequence[Any], c: Any, ns: Any
    ) -> list[Any]:
        """Compute x' of the vehicle."""
        del t
        functions = FloatFunctions if ns is math else ns
        return self._equations.rates(x, late[0] if late else (), u, c, functions)

    def outputs(self, x: Sequence[Any], u: Sequence[Any], c: Any) -> dict[str, Any]:
        """Compute the Euler angles beside a quaternion."""
        del u, c
        return self._equations.euler(x, self.functions)

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Read parameters and initial state, as `DelayPlant`.

        Raises
        ------
        ValueError : invalid parameters.
        ArithmeticError : a pitch angle near +-90 degrees.
        """
        try:
            super().initialise(v, start)
        except ZeroDivisionError as error:
            raise ValueError("the parameters give a coefficient that is not finite") from error
        if self.pitch is not None:
            initial = [v[f"initial.{name}"] for name in self.states]
            refuse_pitch(initial[self.pitch], start)
            delays = [v[name] for name in self.delays]
            self._line = PitchLine(initial, delays, v["solver.step"], start)
            self._line.pitch = self.pitch
