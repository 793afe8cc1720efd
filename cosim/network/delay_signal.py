"""A delay that follows a signal of the run, so that it is known only when a message is sent."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from cosim.core import InputError
from cosim.network.checks import MAX_NS, is_finite
from cosim.network.keys import DurationKey, NumberKey, check_keys


@dataclass(frozen=True, slots=True)
class DelaySignal:
    """The delay of each message is offset + scale value, with the value at the instant of sending.

    The value is an output, or computed from several outputs, such as the distance of a vehicle
    from its base: with scale = 1 / 1500 s/m and the range in metres the delay is that of sound.

    Parameters
    ----------
    scale : seconds of delay per unit of the value; negative where the delay falls with it.
    offset_ns : delay where the value is 0 [ns], not negative.

    Raises
    ------
    InputError : a parameter out of its range; the message names it.
    """

    scale: Annotated[float, NumberKey("seconds of delay per unit of the value")]
    offset_ns: Annotated[int, DurationKey("delay where the value is 0")] = 0

    def __post_init__(self) -> None:
        check_keys("delay.", self)

    def delay_ns(self, value: Any, *, where: str = "delay") -> int:
        """Return the delay [ns] of a message sent while the signal has this value.

        offset + scale value 10**9 in exact arithmetic, rounded once to the nearest (ties to
        even), so that it is the same on every machine.

        Raises
        ------
        InputError : a value that is no finite number, or a delay outside [0, 2**53]; `where`
            is named in the message.
        """
        if not is_finite(value):
            raise InputError(
                "the value that decides the delay is not a finite number",
                where=where,
                expected="a finite number",
                got=f"{value!r} ({type(value).__name__})",
            )
        if float(self.scale) == 0.0 or value == 0:
            return int(self.offset_ns)
        if (
            abs(float(self.scale) * float(value)) < 2.0 * MAX_NS
        ):  # else out of range, and long to compute
            a, b = float(self.scale).as_integer_ratio()
            c, d = float(value).as_integer_ratio()
            delay = _nearest(int(self.offset_ns) * b * d + a * c * 10**9, b * d)
            if 0 <= delay <= MAX_NS:
                return delay
        raise InputError(
            "the value makes a delay out of range",
            where=where,
            expected="a delay from 0 to 2**53 ns",
            got=f"{value!r}, which makes {self.offset_ns / 1e9 + self.scale * value:g} s",
            hint="the delay is offset + scale * value; scale is in seconds per unit of the value",
        )


def _nearest(numerator: int, denominator: int) -> int:
    """The integer nearest to a fraction with a positive denominator, ties to even."""
    whole, rest = divmod(numerator, denominator)
    return whole + (2 * rest > denominator or (2 * rest == denominator and whole % 2 == 1))
