"""The state feedback that reports the use of its assumptions: age, envelope, limits.

The age is that of the measurement in use, by its stamp; the envelope is used by what is measured,
and the limits by what is commanded before it is limited.
"""

from __future__ import annotations

import builtins
import math
from typing import Any

from cosim.components.hinf_controller.behaviour import StateFeedback  # type: ignore[import-untyped]

from cosim.models import feedback_command, greatest_share, share_of_age, watch

USES = ("age", "envelope", "saturation")
"""What is watched, in the order of the variables."""


class WatchedFeedback(StateFeedback):  # type: ignore[misc]  # known where it is loaded
    """As `StateFeedback`, with the outputs `present.USE`, `assumption.USE`, `assumption.met`."""

    def __init__(self, constants: dict[str, Any]) -> None:
        super().__init__(constants)
        self._bounded: list[str] = constants["envelope"]  # measured values with a bound

    def conditions(self, v: Any) -> list[tuple[Any, str]]:
        """Bounds that shares are taken of must be positive."""
        bounds = [f"envelope.{name}" for name in self._bounded] + self._limits
        return [(v[name], f"{name} must be positive") for name in dict.fromkeys(bounds)]

    def shares(self, v: Any, c: tuple[Any, Any], ns: Any) -> list[Any]:
        """Compute the use of the envelope and of the limits for the inputs in `v`."""
        values = [v[name] for name in self._bounded]
        envelope = greatest_share(values, [v[f"envelope.{name}"] for name in self._bounded], ns)
        if not self._limits:
            return [envelope, 0.0]
        x = [v[name] for name in self._measured]
        reference = [0.0 if name is None else v[name] for name in self._reference]
        free = feedback_command(c[0], x, reference, c[1], [v[name] for name in self.integrals])
        return [envelope, greatest_share(free, [v[name] for name in self._limits], ns)]

    def initialise(self, v: dict[str, float], start: float) -> None:
        """Start as without a watch, with nothing used."""
        for quantity, message in self.conditions(v):
            if not quantity > 0:
                raise ValueError(message)
        super().initialise(v, start)
        v["message_age.state"] = 0.0
        for use in USES:
            v[f"present.{use}"] = v[f"assumption.{use}"] = 0.0
        watch(v, USES)

    def advance(self, v: dict[str, float], end: float) -> None:
        """Sample as without a watch; the age counts to `end`, up to which a measurement is in use.

        Raises
        ------
        ValueError : a stamp in the future.
        ArithmeticError : a use that is not finite.
        """
        stamp, now = v["stamp.state"], self._time
        if stamp > now + 1e-9 * max(1.0, abs(now)):
            raise ValueError(f"stamp.state is {stamp!r} s, in the future of t = {now!r} s")
        envelope, saturation = self.shares(v, self._constants, builtins)
        before, age, most = self._samples, end - max(stamp, self._start), v["age.state"]
        share = share_of_age(age, most, end)[0] if most > 0.0 else 0.0
        if not all(map(math.isfinite, (share, envelope, saturation))):
            raise ArithmeticError(f"the use of an assumption at {end!r} s overflows")
        super().advance(v, end)
        v["message_age.state"] = age
        v["present.age"] = share
        v["present.envelope"] = envelope
        if self._sample_time == 0.0 or self._samples > before:
            v["present.saturation"] = saturation
        watch(v, USES)
