"""Behaviour of DelayedPlant, with the equations of `cosim.models.delayed_linear`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cosim.fmu.export import DelayPlant
from cosim.models import linear_derivatives, linear_output


class DelayedPlant(DelayPlant):
    """Eq. (7), with held inputs between communication points."""

    def __init__(self, constants: dict[str, Any]) -> None:
        self._shapes: dict[str, list[int]] = constants["shapes"]
        self.delays = constants["delays"]
        n, self._m = self._shapes["B"]
        q, p = self._shapes["C"][1], self._shapes["D"][0]
        self.inputs = [f"u[{j + 1}]" for j in range(self._m)] + [f"w[{k + 1}]" for k in range(q)]
        self.states = [f"x[{i + 1}]" for i in range(n)]
        self._performance = [f"z[{i + 1}]" for i in range(p)]
        self._uncertain = "E" in self._shapes

    def constants(self, v: Any) -> tuple[Any, Any]:
        """Return the matrices by letter; amplitude and angular frequency of F(t), if any."""
        matrices = {
            letter: [[v[f"{letter}[{i + 1},{j + 1}]"] for j in range(columns)] for i in range(rows)]
            for letter, (rows, columns) in self._shapes.items()
        }
        return matrices, (v["F.amplitude"], v["F.omega"]) if self._uncertain else None

    def rates(
        self, t: Any, x: Sequence[Any], late: list[Any], u: Sequence[Any], c: Any, ns: Any
    ) -> list[Any]:
        """Compute x' of Eq. (7)."""
        matrices, uncertainty = c
        m = self._m
        return linear_derivatives(t, x, late, u[:m], u[m:], matrices, uncertainty, ns)

    def outputs(self, x: Sequence[Any], u: Sequence[Any], c: Any) -> dict[str, Any]:
        """Compute the performance output z, with direct feedthrough of u and w."""
        m = self._m
        return dict(zip(self._performance, linear_output(x, u[:m], u[m:], c[0]), strict=True))
