"""Behaviour of a sensor: sampling, bias, noise and stamp; c/sensor.c does the same."""

from __future__ import annotations

import math
from typing import Any

from cosim.network import standard_normal

_MOST_SAMPLES = 2**53


class Sensor:
    """Inputs u[1], u[2], ... taken at start + offset + k sample_time, and held as y[1], y[2], ...

    What is taken at a communication point changes the outputs at the next one: no output has
    direct feedthrough. The noise of sample k is number k of its stream, whatever the steps.

    Attributes
    ----------
    name : of the sensor; its random streams depend on it.
    count : number of values.
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self.name: str = constants["sensor"]
        self.count: int = constants["lanes"]

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Begin without a sample: values of zero, taken a second before the run."""
        self._start = self._time = start
        self._samples = 0
        for i in range(1, self.count + 1):
            v[f"y[{i}]"] = 0.0
        v["stamp"] = start - 1.0

    def advance(self, v: dict[str, float], end: float) -> None:
        """Take the inputs if a sample instant is in [now, end); the outputs are then held.

        Raises
        ------
        ArithmeticError : more samples than can be counted, or a value that is not finite.
        """
        period, first = v["sample_time"], self._start + v["offset"]
        # an instant that is before `end` only by rounding belongs to the next step
        near = max(1e-9 * max(period, 1e-3), 16.0 * math.ulp(end))
        if period > 0.0:
            instants = (end - near - first) / period
            if not instants <= _MOST_SAMPLES:
                raise ArithmeticError(
                    f"samples {period!r} s apart cannot be counted up to t = {end!r} s"
                )
            taken = math.ceil(max(instants, 0.0))
        else:
            taken = self._samples + (self._time + near >= first)
        if taken > self._samples:
            v.update(self._sample(v, taken - 1))
            v["stamp"] = round(self._time * 1e9) / 1e9  # in whole nanoseconds, as masters count
            self._samples = taken
        self._time = end

    def _sample(self, v: dict[str, float], k: int) -> dict[str, float]:
        found = {}
        for i in range(1, self.count + 1):
            value, deviation = v[f"u[{i}]"] + v[f"bias[{i}]"], v[f"noise[{i}]"]
            if deviation > 0.0:
                value += deviation * standard_normal(int(v["seed"]), self.name, f"noise {i}", k)
            if not math.isfinite(value):
                raise ArithmeticError(f"y[{i}] is not finite")
            found[f"y[{i}]"] = value
        return found

    def refresh(self, v: dict[str, float]) -> None:
        """Do nothing: no output has direct feedthrough."""

    def snapshot(self) -> dict[str, Any]:
        """Return the sampling clock; the held outputs are variables."""
        return {"start": self._start, "time": self._time, "samples": self._samples}

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`."""
        self._start, self._time = saved["start"], saved["time"]
        self._samples = saved["samples"]
