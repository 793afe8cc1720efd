"""Behaviour of the sampled state feedback, with the equations of `cosim.models.feedback`.

Integrals of the measurement are outputs `xi[l]`: they are held between samples as the commands
are, and a saved state contains them.
"""

from __future__ import annotations

import builtins
import math
from typing import Any

from cosim.models import clamped_command, feedback_command, integrals_after


class StateFeedback:
    """u = map K (x - reference), limited, taken at t = k sample_time and held.

    A sample taken at a communication point changes the outputs at the next one: no output has
    direct feedthrough. A sample time of 0 samples at every communication point.
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self._measured: list[str] = constants["measured"]
        self._reference: list[str | None] = constants["reference"]
        self._outputs: list[str] = constants["outputs"]
        self._limits: list[str] = constants["limits"]  # a parameter per output, or empty
        self._mapped: bool = constants["mapped"]
        self.integrals: list[str] = constants.get("integrals", [])
        self._columns: list[int] = constants.get("columns", list(range(1, len(self._measured) + 1)))
        self._S: list[list[float]] = constants.get("integrated", [])
        self._kept: list[str] = [*self._outputs, *self.integrals]

    def constants(self, v: Any) -> tuple[Any, Any]:
        """Return the gain K, and the map from commanded accelerations to forces or None."""
        rows = range(len(self._outputs))
        gain = [[v[f"K[{i + 1},{j}]"] for j in self._columns] for i in rows]
        if not self._mapped:
            return gain, None
        return gain, [[v[f"thrust_map[{i + 1},{j + 1}]"] for j in rows] for i in rows]

    def law(self, v: Any, c: tuple[Any, Any], ns: Any, elapsed: Any = 0.0) -> dict[str, Any]:
        """Compute the outputs for the inputs in `v`; `ns` provides `min` and `max`.

        `elapsed` is the time [s] for which the sample is held: integrals go on for it.
        """
        x = [v[name] for name in self._measured]
        reference = [0.0 if name is None else v[name] for name in self._reference]
        xi = [v[name] for name in self.integrals]
        free = feedback_command(c[0], x, reference, c[1], xi)
        values = free
        if self._limits:
            values = clamped_command(values, [v[name] for name in self._limits], ns)
        if self.integrals:
            error = [a - b for a, b in zip(x, reference, strict=True)]
            # without limits nothing is taken off
            excess = [a - b for a, b in zip(values, free, strict=True)] if self._limits else []
            across, down = range(1, len(excess) + 1), range(1, len(xi) + 1)
            back = [[v[f"anti_windup[{k},{i}]"] for i in across] for k in down]
            values = [*values, *integrals_after(xi, error, self._S, back, excess, elapsed)]
        return dict(zip(self._kept, values, strict=True))

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Read gain, map, limits and sample time from `v`; the outputs start at zero."""
        self._constants = self.constants(v)
        self._sample_time = v["sample_time"]
        self._time = self._start = start
        self._samples = 0
        for name in self._kept:
            v[name] = 0.0

    def advance(self, v: dict[str, float], end: float) -> None:
        """Sample if a sample instant is in [now, end); the outputs are then held."""
        if self._sample_time > 0.0:
            # an instant that is before `end` only by rounding belongs to the next step
            near = max(1e-9 * max(self._sample_time, 1e-3), 16.0 * math.ulp(end))
            taken = math.ceil((end - near - self._start) / self._sample_time)
            due = taken > self._samples
            elapsed = (taken - self._samples) * self._sample_time
            self._samples = max(taken, self._samples)
        else:
            due, elapsed = True, end - self._time
        if due:
            v.update(self.law(v, self._constants, builtins, elapsed))
        self._time = end

    def refresh(self, v: dict[str, float]) -> None:
        """Do nothing: no output has direct feedthrough."""

    def snapshot(self) -> dict[str, Any]:
        """Return the sampling clock; the held outputs are variables."""
        return {"time": self._time, "start": self._start, "samples": self._samples}

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`."""
        self._time, self._start = saved["time"], saved["start"]
        self._samples = saved["samples"]
