"""How a Clock of FMI 3.0 ticks, as the model description declares it.

A time-based Clock is an input that the master lets tick: "constant", "fixed" and "tunable" ones at
t = shift + k interval, "changing" ones when the interval is over that the FMU gives after each
tick, "countdown" ones when one is over that the FMU may give after any event. A "triggered" Clock
ticks when something happens: as an output in its FMU, as an input where it is connected.

Intervals and instants are rational numbers of seconds, so that the tick number 10 000 of a Clock
of 1/3 s is where it belongs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal, cast, get_args

IntervalVariability = Literal["constant", "fixed", "tunable", "changing", "countdown", "triggered"]
"""What is known of the intervals of a Clock, see the module."""


@dataclass(frozen=True, slots=True)
class Clock:
    """The declaration of a Clock.

    Attributes
    ----------
    variability : of its intervals.
    interval : declared [s]; None: the FMU gives it in the initialisation, or later.
    shift : delay of the first tick of a periodic Clock [s].
    resolution : ticks per second that rational intervals are given in; None: not declared.
    supports_fraction : whether the FMU gives and takes intervals as rational numbers.
    priority : of Clocks that tick at the same instant, the least is first.
    """

    variability: IntervalVariability
    interval: Fraction | None = None
    shift: Fraction = Fraction(0)
    resolution: int | None = None
    supports_fraction: bool = False
    priority: int | None = None

    @property
    def time_based(self) -> bool:
        """Whether the master lets it tick by the time."""
        return self.variability != "triggered"

    @property
    def periodic(self) -> bool:
        """Whether it ticks at multiples of an interval."""
        return self.variability in ("constant", "fixed", "tunable")


def declared_clock(attribute: Callable[[str], str | None]) -> Clock:
    """Return a Clock from its attributes in the XML.

    Raises
    ------
    ValueError : an attribute that is none, or an interval that is not positive.
    """
    variability = attribute("intervalVariability")
    if variability not in get_args(IntervalVariability):
        raise ValueError(f"a Clock of intervalVariability {variability!r}")
    resolution = attribute("resolution")
    ticks = None if resolution is None else int(resolution)
    interval = _rational(attribute("intervalCounter"), attribute("intervalDecimal"), ticks)
    periodic = variability in ("constant", "fixed", "tunable")
    if interval is not None and (interval < 0 or (periodic and interval == 0)):
        raise ValueError(f"a Clock with an interval of {float(interval):g} s")
    priority = attribute("priority")
    return Clock(
        cast("IntervalVariability", variability),
        interval,
        _rational(attribute("shiftCounter"), attribute("shiftDecimal"), ticks) or Fraction(0),
        ticks,
        attribute("supportsFraction") in ("true", "1"),
        None if priority is None else int(priority),
    )


def _rational(counter: str | None, decimal: str | None, resolution: int | None) -> Fraction | None:
    if counter is not None and resolution:
        return Fraction(int(counter), resolution)
    return None if decimal is None else Fraction(decimal.strip())
