"""The base of every delay equation in an FMU: held inputs, history, outputs, saved state.

A component derives from `DelayPlant`, names its variables and gives its equations over scalars,
so that the C of the native FMU is made from the same lines. The variables are the states, an
`initial.` parameter for each, `solver.step`, and the delays. Standard library only: a copy of
this file is in the FMU.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cosim.models import DelayLine


class DelayPlant:
    """A delay equation between two communication points.

    Attributes
    ----------
    inputs, states : names of the variables u and x; every state is an output.
    delays : names of the parameters d_1, ..., d_m [s].
    """

    inputs: Sequence[str]
    states: Sequence[str]
    delays: Sequence[str] = ("delay.d",)

    def conditions(self, v: Any) -> list[tuple[Any, str]]:
        """Return the quantities that must be positive, each with the message if it is not."""
        del v
        return []

    def constants(self, v: Any) -> Any:
        """Compute what depends on parameters alone and is passed to `rates` and `outputs`."""
        raise NotImplementedError

    def rates(
        self, t: Any, x: Sequence[Any], late: list[Any], u: Sequence[Any], c: Any, ns: Any
    ) -> list[Any]:
        """Compute x'(t) from x(t), late = [x(t-d_1), ...], held inputs u and `constants` c."""
        raise NotImplementedError

    def outputs(self, x: Sequence[Any], u: Sequence[Any], c: Any) -> dict[str, Any]:
        """Compute by name the outputs other than the state."""
        del x, u, c
        return {}

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Read parameters and initial state from `v` and write the outputs to it.

        Raises
        ------
        ValueError : invalid parameters.
        """
        for quantity, message in self.conditions(v):
            if not quantity > 0:
                raise ValueError(message)
        self._constants = self.constants(v)
        self._last_inputs: list[float] | None = None
        initial = [v[f"initial.{name}"] for name in self.states]
        self._line = DelayLine(initial, [v[name] for name in self.delays], v["solver.step"], start)
        self._publish(v)

    def advance(self, v: dict[str, float], end: float) -> None:
        """Integrate to `end` with the inputs in `v` held, and write the outputs to `v`.

        Raises
        ------
        ArithmeticError : the state is no longer finite.
        """
        inputs = [v[name] for name in self.inputs]
        constants, rates = self._constants, self.rates

        def f(t: float, x: list[float], late: list[list[float]]) -> list[float]:
            return rates(t, x, late, inputs, constants, math)

        self._line.advance(end, f, jump=inputs != self._last_inputs)
        self._last_inputs = inputs
        self._publish(v)

    def refresh(self, v: dict[str, float]) -> None:
        """Update the outputs with direct feedthrough from the present inputs."""
        v.update(self.outputs(self._line.x, [v[name] for name in self.inputs], self._constants))

    def _publish(self, v: dict[str, float]) -> None:
        v.update(zip(self.states, self._line.x, strict=True))
        self.refresh(v)

    def snapshot(self) -> dict[str, Any]:
        """Return the whole state, delay line included."""
        return {"line": self._line.snapshot(), "inputs": self._last_inputs}

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`; the parameters are restored with the variables."""
        self._line.restore(saved["line"])
        self._last_inputs = saved["inputs"]
