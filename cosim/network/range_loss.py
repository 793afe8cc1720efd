"""Probability of a loss by range: a table, or the logit that `cosim link fit` fits."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated

from cosim.core import InputError
from cosim.network.checks import is_finite
from cosim.network.keys import NumberKey, check_keys
from cosim.network.single_draws import single_log


@dataclass(frozen=True, slots=True)
class RangeTable:
    """Probability of a loss by range: on lines between the points of a table, constant outside.

    Parameters
    ----------
    ranges : increasing [m], at least one.
    losses : the probability at each of them.

    Raises
    ------
    InputError : ranges that do not increase, other than one probability for each.
    """

    ranges: tuple[float, ...]
    losses: tuple[float, ...]

    def __post_init__(self) -> None:
        rising = all(a < b for a, b in zip(self.ranges, self.ranges[1:], strict=False))
        if not self.ranges or not rising or not all(is_finite(r) for r in self.ranges):
            raise InputError(
                "the ranges of a table of losses do not increase",
                where="loss.ranges",
                expected="at least one range [m], each greater than the one before",
                got=repr(self.ranges),
            )
        right = all(is_finite(p) and 0.0 <= p <= 1.0 for p in self.losses)
        if len(self.losses) != len(self.ranges) or not right:
            raise InputError(
                "a table of losses has a probability for each range",
                where="loss.losses",
                expected=f"{len(self.ranges)} numbers from 0 to 1",
                got=repr(self.losses),
            )

    def loses(self, u: float, range_m: float) -> bool:
        """Whether a packet is lost at a range, for a draw u from [0, 1); in exact arithmetic."""
        place = bisect_right(self.ranges, range_m)
        if place in (0, len(self.ranges)):
            return u < self.losses[min(place, len(self.losses) - 1)]
        (r, s), (p, q) = (column[place - 1 : place + 1] for column in (self.ranges, self.losses))
        share = (Fraction(range_m) - Fraction(r)) / (Fraction(s) - Fraction(r))
        return Fraction(u) < Fraction(p) + (Fraction(q) - Fraction(p)) * share


@dataclass(frozen=True, slots=True)
class RangeLogit:
    """Probability p of a loss by range: log(p / (1 - p)) = intercept + slope range.

    The law that `cosim link fit` fits to a recording with ranges.
    """

    intercept: Annotated[float, NumberKey("logit of the loss at range 0")]
    slope: Annotated[float, NumberKey("growth of the logit of the loss per metre")]

    def __post_init__(self) -> None:
        check_keys("loss.", self)

    def loses(self, u: float, range_m: float) -> bool:
        """Whether a packet is lost at a range, for a draw u from [0, 1).

        u < p as log(u / (1 - u)) < log(p / (1 - p)), by the logarithm of `draws`, which is the same
        on every machine.
        """
        if u == 0.0:
            return True
        return single_log(u) - single_log(1.0 - u) < self.intercept + self.slope * range_m
