"""DelayedPlant between its FMI variables and the equations of `cosim.models.delayed_linear`."""

from __future__ import annotations

import math
from typing import Any

from cosim.models.delay_line import DelayLine
from cosim.models.delayed_linear import derivatives, output


class DelayedPlant:
    """Eq. (7) between two communication points, inputs held."""

    def __init__(self, constants: dict[str, Any]) -> None:
        self._shapes: dict[str, list[int]] = constants["shapes"]
        self._n, self._m = self._shapes["B"]
        self._q = self._shapes["C"][1]
        self._p = self._shapes["D"][0]

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Take matrices, delay and initial state from `v`; fills the outputs."""
        self._matrices = {
            letter: [[v[f"{letter}[{i + 1},{j + 1}]"] for j in range(columns)] for i in range(rows)]
            for letter, (rows, columns) in self._shapes.items()
        }
        self._uncertainty = (v["F.amplitude"], v["F.omega"])
        self._held: list[float] | None = None
        initial = [v[f"initial.x[{i + 1}]"] for i in range(self._n)]
        self._line = DelayLine(initial, [v["delay.d"]], v["solver.step"], start)
        self._publish(v)

    def advance(self, v: dict[str, float], end: float) -> None:
        """Integrate to `end` with the inputs in `v` held; fills the outputs.

        Raises
        ------
        ArithmeticError : the state left the range of finite numbers.
        """
        u, w = self._inputs(v)
        held = u + w
        matrices, uncertainty = self._matrices, self._uncertainty

        def f(t: float, x: list[float], lagged: list[list[float]]) -> list[float]:
            return derivatives(t, x, lagged[0], u, w, matrices, uncertainty, math)

        self._line.advance(end, f, jump=held != self._held)
        self._held = held
        self._publish(v)

    def refresh(self, v: dict[str, float]) -> None:
        """z depends on u and w without delay: computed from the inputs as they are now."""
        u, w = self._inputs(v)
        for i, value in enumerate(output(self._line.x, u, w, self._matrices), 1):
            v[f"z[{i}]"] = value

    def _inputs(self, v: dict[str, float]) -> tuple[list[float], list[float]]:
        u = [v[f"u[{j + 1}]"] for j in range(self._m)]
        w = [v[f"w[{k + 1}]"] for k in range(self._q)]
        return u, w

    def _publish(self, v: dict[str, float]) -> None:
        for i, value in enumerate(self._line.x, 1):
            v[f"x[{i}]"] = value
        self.refresh(v)

    def snapshot(self) -> dict[str, Any]:
        """Everything that determines the future, delay line included."""
        return {"line": self._line.snapshot(), "held": self._held}

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`; parameters are in the variables already."""
        self._line.restore(saved["line"])
        self._held = saved["held"]
