"""Behaviour of a sensor on a plain connection: what is wrong with it; c/plain_sensor.c is the same.

The value of an instant is seen at that instant, unlike that of `sensor.behaviour`, which has a
stamp and travels.
"""

from __future__ import annotations

import math
from typing import Any

from cosim.network import single_uniform, standard_normal

_MOST_SAMPLES = 2.0**53


def _whole(t: float) -> float:
    """Return a time in whole nanoseconds, as masters count: sums of steps are rounded."""
    return float(round(t * 1e9)) / 1e9


class PlainSensor:
    """Each value is that of its input, sampled, with bias, drift and noise, in steps, in a range.

    Sample k is taken at start + k sample_time, at the first communication point from there on; the
    first at the start. A frozen sensor keeps the value before.

    Attributes
    ----------
    name : of the sensor; its random streams depend on it.
    values : the names of what it measures.
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self.name: str = constants["sensor"]
        self.values: list[str] = constants["values"]

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Take the first sample."""
        self._start = self._time = _whole(start)
        self._samples = self._steps = 0
        self._kept = [0.0] * len(self.values)
        self._publish(v)

    def advance(self, v: dict[str, float], end: float) -> None:
        """Keep the values of the present instant and go on to `end`.

        Raises
        ------
        ArithmeticError : a value that is not finite, more samples than can be counted.
        """
        kept = self._values(v, self._time)
        saved = self.snapshot()
        self._samples = self._taken(v, self._time)
        self._kept, self._time, self._steps = kept, _whole(end), self._steps + 1
        try:
            self._publish(v)
        except ArithmeticError:
            self.restore(saved)
            raise

    def refresh(self, v: dict[str, float]) -> None:
        """Compute the values of the present instant from the inputs as they are now.

        Raises
        ------
        ArithmeticError : a value that is not finite.
        """
        self._publish(v)

    def _publish(self, v: dict[str, float]) -> None:
        v.update(zip(self.values, self._values(v, self._time), strict=True))

    def _taken(self, v: dict[str, float], t: float) -> int:
        """Return how many samples have been taken at t."""
        period = v["sample_time"]
        if period <= 0.0:
            return self._steps + 1
        # an instant that only rounding puts after t has come
        near = max(1e-9 * max(period, 1e-3), 16.0 * math.ulp(t))
        taken = math.floor((t + near - self._start) / period) + 1.0
        if not taken <= _MOST_SAMPLES:
            raise ArithmeticError(f"samples {period!r} s apart cannot be counted up to t = {t!r} s")
        return int(taken)

    def _values(self, v: dict[str, float], t: float) -> list[float]:
        taken = self._taken(v, t)
        if taken == self._samples:
            return self._kept
        frozen = v["frozen"] >= 0.5 or v["freeze.from"] <= t < v["freeze.until"]
        if frozen and self._samples > 0:
            return self._kept
        found = []
        for i, name in enumerate(self.values, 1):
            value = v[f"true.{name}"] + v[f"bias.{name}"] + v[f"drift.{name}"] * (t - self._start)
            if v[f"noise.{name}"] > 0.0:
                value += v[f"noise.{name}"] * self._draw(v, f"noise {i}", taken - 1)
            step = v[f"resolution.{name}"]
            if not math.isfinite(value / step if step > 0.0 else value):
                raise ArithmeticError(f"{name} is not finite at t = {t!r} s")
            if step > 0.0:
                value = step * float(round(value / step))
            found.append(min(max(value, v[f"least.{name}"]), v[f"greatest.{name}"]))
        return found

    def _draw(self, v: dict[str, float], purpose: str, k: int) -> float:
        if v["uniform"] >= 0.5:
            return 2.0 * single_uniform(int(v["seed"]), self.name, purpose, k) - 1.0
        return standard_normal(int(v["seed"]), self.name, purpose, k)

    def snapshot(self) -> dict[str, Any]:
        """Return the clock and the values of the instant before."""
        return {
            "start": self._start,
            "time": self._time,
            "samples": self._samples,
            "steps": self._steps,
            "kept": [*self._kept],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`."""
        self._start, self._time = saved["start"], saved["time"]
        self._samples, self._steps = saved["samples"], saved["steps"]
        self._kept = [*saved["kept"]]
