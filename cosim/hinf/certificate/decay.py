"""A rate of decay, proved: every solution with w = 0 falls at least as e^{-alpha t}.

xi(t) = e^{alpha t} x(t) obeys

    xi' = (A_0 + dA_0 + alpha I) xi + sum_j s_j (A_j + dA_j) xi(t-tau_j) + ... B K ...,

s_j = e^{alpha tau_j} on everything that acts through delay j, dA_j = E F(t) H_j and the control
included. Whatever tau_j is between 0 and d_j, and however it varies where any age is allowed,
s_j stays in [1, e^{alpha dj}]. The LMI of `cosim.hinf.theorems.theorem_2` is affine in each
s_j: proved at all corners of that box, with the same X, Q, R and eps, it holds everywhere in it,
and the functional of xi, which bounds xi'Pxi, never rises. Hence |x(t)| <= c e^{-alpha t}.

The upper end of the box is a rational number above e^{alpha dj}, which ball arithmetic shows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import flint

from cosim.core import InputError
from cosim.hinf.certificate.guarantee import NUMBER, Form, Guarantee, Read, numbers
from cosim.hinf.certificate.theorem_2_json import theorem_2_from_json, theorem_2_to_json
from cosim.hinf.exact import ball_precision, exact
from cosim.hinf.theorems import Proof, Shift, Theorem2

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

MAX_ACTING = 5
"""Most delays through which anything acts: 2^5 inequalities."""

_LARGEST_GROWTH = 1e9


def _variables(data: Any, of: Read) -> Proof:
    return theorem_2_from_json(of.system, of.gain, data, of.where, bounded=False)


@dataclass(frozen=True, eq=False)
class Decay(Guarantee):
    """A rate of decay with its proof: exact numbers (`fmpq`).

    rate : alpha [1/s], positive.
    growth : per delay, at least e^{alpha dj}; 1 where nothing acts through it.
    proof : by Theorem 2, without a gamma; of the inequalities at all corners.
    """

    rate: Any
    growth: tuple[Any, ...]
    proof: Proof

    NAME = "decay"
    FORMS = MappingProxyType(
        {
            "rate": NUMBER,
            "growth": numbers(lambda of: len(of.system.delays)),
            "variables": Form(theorem_2_to_json, _variables),
        }
    )
    CLAIMED = ("rate",)

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return which condition is not proved; None if all are.

        Raises
        ------
        InputError : too many inequalities, or too large ones.
        """
        if not self.rate > 0:
            return "the rate is not positive"
        acting = acting_delays(system)
        for j in acting:
            if not is_above_exponential(self.growth[j], self.rate * exact(system.delays[j].d)):
                return f"growth[{j}] is not at least exp(rate d)"
        theorem = cast("Theorem2", self.proof.theorem)
        for growth in corners(self.growth, acting):
            at_corner = replace(theorem, shift=Shift(self.rate, growth))
            reason = replace(self.proof, theorem=at_corner).failure(system, gain)
            if reason is not None:
                return reason
        return None


def acting_delays(system: DelaySystem) -> tuple[int, ...]:
    """Return the indices of the positive delays whose A, H or feedback is not zero.

    Raises
    ------
    InputError : there are more than `MAX_ACTING`.
    """
    acting = tuple(
        j
        for j, x in enumerate(system.delays)
        if x.d > 0 and (x.A.any() or x.H.any() or (x.feedback and system.B.any()))
    )
    if len(acting) > MAX_ACTING:
        raise InputError(
            "too many delays for a proof of decay",
            where="decay",
            expected=f"at most {MAX_ACTING} delays through which anything acts",
            got=str(len(acting)),
        )
    return acting


def corners(growth: tuple[Any, ...], acting: tuple[int, ...]) -> Iterator[tuple[Any, ...]]:
    """Return all s with s_j = 1 or growth_j for the acting delays, and 1 for the others."""
    one = flint.fmpq(1)
    ends = [(one, value) if j in acting else (one,) for j, value in enumerate(growth)]
    return itertools.product(*ends)


def growth_of(system: DelaySystem, rate: float) -> tuple[float, ...]:
    """Return per delay a double at least e^{rate d}; 1 where nothing acts through it.

    Raises
    ------
    InputError : a rate that is not positive, or too great for a delay to prove anything.
    """
    if not (math.isfinite(rate) and rate > 0):
        raise InputError(
            "not a rate of decay",
            where="decay",
            expected="a positive number of 1/s",
            got=repr(rate),
        )
    acting = acting_delays(system)
    values = []
    for j, delay in enumerate(system.delays):
        value = 1.0
        if j in acting:
            power = exact(rate) * exact(delay.d)
            if power > exact(math.log(_LARGEST_GROWTH)):
                raise InputError(
                    f"the rate is too great for a delay of {delay.d:g} s",
                    where="decay",
                    expected=f"at most {math.log(_LARGEST_GROWTH) / delay.d:.4g} 1/s",
                    got=f"{rate:g}",
                )
            value = math.exp(rate * delay.d)
            while not is_above_exponential(exact(value), power):
                value = math.nextafter(value, math.inf)
        values.append(value)
    return tuple(values)


def is_above_exponential(value: Any, power: Any) -> bool:
    """Prove that the rational `value` is at least e^power."""
    with ball_precision(256):
        return bool(flint.arb(value) >= flint.arb(power).exp())
