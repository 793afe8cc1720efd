"""Behaviour of a sensor: sampling, bias, drift, noise, steps, range; c/sensor.c does the same."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from cosim.network import single_uniform, standard_normal

_MOST_SAMPLES = 2.0**53


def _whole(t: float) -> float:
    """Return a time in whole nanoseconds, as masters count: sums of steps are rounded."""
    return float(round(t * 1e9)) / 1e9


class Sensor:
    """Each output is its input, sampled, with what is wrong with the sensor, and held until then.

    A stamped sensor samples at start + offset + k sample_time; an instant between two
    communication points takes the values of the earlier one. They are seen at the next point, with
    the time at which they were taken: no output has direct feedthrough, so that they can travel.

    One without a stamp samples at start + k sample_time, at the first communication point from
    there on, and is seen at that point. Frozen, it keeps the values before.

    The noise of sample k is number k of its stream, whatever the steps.

    Attributes
    ----------
    name : of the sensor; its random streams depend on it.
    stamped : whether it has a stamp.
    lanes : role -> name of the variable of each value; "input", "output", "bias" and "noise", and
        without a stamp "drift", "resolution", "least" and "greatest".
    """

    def __init__(self, constants: dict[str, Any]) -> None:
        self.name: str = constants["sensor"]
        self.stamped: bool = constants["stamped"]
        self.lanes: dict[str, list[str]] = constants["lanes"]

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Begin: with a stamp without a sample, values of zero, taken a second before the run."""
        self._start = self._time = _whole(start)
        self._samples = 0
        self._kept = [0.0] * len(self.lanes["output"])
        if self.stamped:
            v["stamp"] = start - 1.0
            self._write(v, self._kept)
        else:
            self.refresh(v)

    def advance(self, v: dict[str, float], end: float) -> None:
        """Keep the values of the present instant and go on to `end`.

        Raises
        ------
        ArithmeticError : more samples than can be counted, or a value that is not finite.
        """
        saved = self.snapshot()
        taken, kept = self._values(v, end)
        if self.stamped and taken > self._samples:
            v["stamp"] = self._time
        self._samples, self._kept, self._time = taken, kept, _whole(end)
        try:
            self._write(v, kept if self.stamped else self._values(v, self._time)[1])
        except ArithmeticError:
            self.restore(saved)
            raise

    def refresh(self, v: dict[str, float]) -> None:
        """Compute the values of the present instant from the inputs as they are now.

        Raises
        ------
        ArithmeticError : as for `advance`.
        """
        if not self.stamped:
            self._write(v, self._values(v, self._time)[1])

    def _write(self, v: dict[str, float], values: Sequence[float]) -> None:
        v.update(zip(self.lanes["output"], values, strict=True))

    def _taken(self, v: dict[str, float], end: float) -> int:
        """Return how many samples belong to the present instant and those before.

        With a stamp that are the instants before `end`, without one those up to now.
        """
        period, until = v["sample_time"], end if self.stamped else self._time
        first = self._start + (v["offset"] if self.stamped else 0.0)
        # an instant before `end`, or after now, only by rounding
        near = max(1e-9 * max(period, 1e-3), 16.0 * math.ulp(until))
        if period <= 0.0:
            return self._samples + (self._time + near >= first)
        taken = math.floor((until + (-near if self.stamped else near) - first) / period) + 1.0
        if not taken <= _MOST_SAMPLES:
            raise ArithmeticError(
                f"samples {period!r} s apart cannot be counted up to t = {until!r} s"
            )
        return max(int(taken), self._samples)

    def _values(self, v: dict[str, float], end: float) -> tuple[int, list[float]]:
        """Return the samples so far and the values, new ones where a sample is due."""
        taken, t = self._taken(v, end), self._time
        if taken == self._samples or self._is_frozen(v):
            return taken, self._kept
        found = []
        for i, output in enumerate(self.lanes["output"]):
            of = {role: v[names[i]] for role, names in self.lanes.items()}
            value = of["input"] + of["bias"] + of.get("drift", -0.0) * (t - self._start)
            if of["noise"] > 0.0:
                value += of["noise"] * self._draw(v, f"noise {i + 1}", taken - 1)
            step = of.get("resolution", 0.0)
            if not math.isfinite(value / step if step > 0.0 else value):
                raise ArithmeticError(f"{output} is not finite at t = {t!r} s")
            if step > 0.0:
                value = step * float(round(value / step))
            found.append(min(max(value, of.get("least", value)), of.get("greatest", value)))
        return taken, found

    def _is_frozen(self, v: dict[str, float]) -> bool:
        if self.stamped or self._samples == 0:
            return False
        return v["frozen"] >= 0.5 or v["freeze.from"] <= self._time < v["freeze.until"]

    def _draw(self, v: dict[str, float], purpose: str, k: int) -> float:
        if not self.stamped and v["uniform"] >= 0.5:
            return 2.0 * single_uniform(int(v["seed"]), self.name, purpose, k) - 1.0
        return standard_normal(int(v["seed"]), self.name, purpose, k)

    def snapshot(self) -> dict[str, Any]:
        """Return the sampling clock and the values that are kept."""
        return {
            "start": self._start,
            "time": self._time,
            "samples": self._samples,
            "kept": [*self._kept],
        }

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a `snapshot`."""
        self._start, self._time = saved["start"], saved["time"]
        self._samples, self._kept = saved["samples"], [*saved["kept"]]
