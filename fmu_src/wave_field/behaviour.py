"""Behaviour of WaveField, with the equations of `cosim.models.waves`."""

from __future__ import annotations

import math
from typing import Any

from cosim.models import Component, Gains, accelerations, at_depth, gains, sea

SPECTRA = {1: "jonswap", 2: "pierson-moskowitz"}
_EXPLICIT = 0
OUTPUTS = ("disturbance.u", "disturbance.v", "disturbance.w", "disturbance.r")


class WaveField:
    """Accelerations of the water at the present time, independent of any step size."""

    def __init__(self, constants: dict[str, Any]) -> None:
        self.slots: int = constants["slots"]

    @staticmethod
    def factors(v: Any) -> Gains:
        """Return the factors on u, v, w, r of explicit components."""
        return Gains(*(v[f"gain.{axis}"] for axis in "uvwr"))

    @classmethod
    def gains(cls, v: Any, ns: Any) -> Gains:
        """Return the factors of a sea that travels in one direction; `ns` provides `sin`, `cos`."""
        by_direction = gains(v["direction"], v["yaw_gain"], ns)
        return Gains(*(a * b for a, b in zip(cls.factors(v), by_direction, strict=True)))

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Draw the sea or take the explicit components, and write the outputs.

        Raises
        ------
        ValueError : a wave height, period, spectrum or number of components out of range.
        """
        self._components: list[Component] = []
        if v["spectrum"] == _EXPLICIT:
            for k in range(1, self.slots + 1):
                if v[f"amplitude[{k}]"] != 0.0:
                    self._components.append(
                        Component(v[f"omega[{k}]"], v[f"amplitude[{k}]"], v[f"phase[{k}]"])
                    )
            self._gains = self.factors(v)
        else:
            spectrum = SPECTRA[int(v["spectrum"])]
            elevation = sea(
                v["Hs"],
                v["Tp"],
                spectrum=spectrum,
                peak_factor=v["peak_factor"] if spectrum == "jonswap" else None,
                count=int(v["components"]),
                seed=int(v["seed"]),
            )
            self._components = at_depth(elevation, v["depth"])
            self._gains = self.gains(v, math)
        self._publish(v, start)

    def advance(self, v: dict[str, float], end: float) -> None:
        """Write the accelerations at `end`."""
        self._publish(v, end)

    def refresh(self, v: dict[str, float]) -> None:
        """Do nothing: there are no inputs."""

    def _publish(self, v: dict[str, float], t: float) -> None:
        values = accelerations(t, self._components, self._gains)
        for name, value in zip(OUTPUTS, values, strict=True):
            v[name] = float(value)

    def snapshot(self) -> dict[str, Any]:
        """Return an empty state: parameters and time determine everything."""
        return {}

    def restore(self, saved: dict[str, Any]) -> None:
        """Do nothing: the outputs are restored with the variables."""
