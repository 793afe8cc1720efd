"""Damping, proved: a sector for the roots of the nominal loop, cut off at the left.

No sector holds all roots of a loop with a delay (docs/explanation/theory.md), but one can hold
those that matter: every root of det H(s), H(s) = s I - sum_i A_i e^{-s d_i}, with Re s >= -sigma
(`within`) has a damping ratio -Re s / |s| above zeta. F = 0 there, and every age is constant,
exactly d. The doubles of the system and of K are taken exactly; the rest is ball arithmetic
(`flint.arb`), which encloses its own rounding.

The excluded region {Re s >= -sigma, -Re s <= zeta |s|} is what lies right of a path: the ray
s = t (-zeta + j sqrt(1 - zeta^2)) from 0 to Re s = -sigma, and from there straight upwards. The
roots right of it are counted, and none may be left (`cosim.hinf.exact.contour`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import flint

from cosim.core import InputError
from cosim.hinf.certificate.guarantee import NUMBER, Guarantee
from cosim.hinf.certificate.norm_proof import exact_terms
from cosim.hinf.exact import (
    Contour,
    NotCountedError,
    ball_precision,
    exact,
)

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

_BITS = 128
_LARGEST_GROWTH = 1e9


@dataclass(frozen=True, eq=False)
class Damping(Guarantee):
    """A bound of damping ratios; it is its own proof, which needs no further numbers (`fmpq`).

    ratio : zeta, between 0 and 1.
    within : sigma [1/s], positive: the bound is for roots with Re s >= -within.
    """

    ratio: Any
    within: Any

    NAME = "damping"
    FORMS = MappingProxyType({"ratio": NUMBER, "within": NUMBER})
    CLAIMED = ("ratio", "within")

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return why it is not proved; None if it is."""
        if not 0 < self.ratio < 1:
            return "the ratio is not between 0 and 1"
        if not self.within > 0:
            return "within is not positive"
        if any(delay.sampled for delay in system.delays):
            return "a sampled age is not constant: its loop has no characteristic roots"
        if exceeds_growth(self.within, system):
            return "within is too great for the longest delay"
        return self._failure_of_roots(system, gain)

    def _failure_of_roots(self, system: DelaySystem, gain: Matrix) -> str | None:
        terms = {d: A for d, (A, _) in exact_terms(system, gain).items()}
        with ball_precision(_BITS):
            ratio, within = flint.arb(self.ratio), flint.arb(self.within)
            corner = flint.acb(-within, (1 - ratio**2).sqrt() * within / ratio)
            try:
                roots = Contour.balanced(terms).count([flint.acb(0), corner])
            except NotCountedError as error:
                return str(error)
        excluded = "characteristic roots with Re s >= -within have no greater damping ratio"
        return f"{roots} {excluded}" if roots else None


def checked_damping(
    system: DelaySystem, ratio: float | None, within: float | None, prefix: str = ""
) -> Damping | None:
    """Return the damping that is asked for, by doubles; None where neither is given.

    Raises
    ------
    InputError : one without the other, a number out of range, or a sampled age.
    """
    if ratio is None and within is None:
        return None
    for name, value in (("damping", ratio), ("within", within)):
        if value is None:
            raise InputError(
                "damping is asked for roots with Re s >= -within: give both",
                where=f"{prefix}{name}",
                expected="a ratio between 0 and 1 (damping) and a positive number of 1/s (within)",
                got="damping alone" if name == "within" else "within alone",
                hint="no sector holds the roots of a loop with a delay all the way to the left",
            )
    if not (ratio is not None and math.isfinite(ratio) and 0 < ratio < 1):
        raise InputError(
            "not a damping ratio",
            where=f"{prefix}damping",
            expected="a number between 0 and 1",
            got=repr(ratio),
        )
    if not (within is not None and math.isfinite(within) and within > 0):
        raise InputError(
            "not a bound of real parts",
            where=f"{prefix}within",
            expected="a positive number of 1/s",
            got=repr(within),
        )
    if any(delay.sampled for delay in system.delays):
        raise InputError(
            "damping is that of characteristic roots, which a loop with a sampled age has not",
            where=f"{prefix}damping",
            expected="ages that are constant, or taken at their greatest value",
            hint="ask for a rate of decay, or leave out sampled",
        )
    asked = Damping(exact(ratio), exact(within))
    if exceeds_growth(asked.within, system):
        longest = max(delay.d for delay in system.delays)
        raise InputError(
            f"the roots are asked for too far to the left for a delay of {longest:g} s",
            where=f"{prefix}within",
            expected=f"at most {math.log(_LARGEST_GROWTH) / longest:.4g} 1/s",
            got=f"{within:g}",
        )
    return asked


def exceeds_growth(within: Any, system: DelaySystem) -> bool:
    """Whether e^{within d} of the longest delay is too great for a proof."""
    longest = max((delay.d for delay in system.delays), default=0.0)
    return bool(within * exact(longest) > exact(math.log(_LARGEST_GROWTH)))
