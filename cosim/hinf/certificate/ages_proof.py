"""The claim of a gain whose ages are known, and its proof in rational arithmetic.

The inequalities are those of `cosim.hinf.theorems.ages`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import prod
from typing import TYPE_CHECKING, Any

from cosim.hinf.certificate.ages_terms import (
    AgeFunctional,
    AgesVariables,
    check_functionals,
    check_supports,
)
from cosim.hinf.certificate.analysis_proof import EXACTLY
from cosim.hinf.certificate.proof import CertificateCheck, claim_of, require_size
from cosim.hinf.certificate.theorem import uncertainty_text
from cosim.hinf.exact import exact
from cosim.hinf.theorems import (
    Age,
    Loop,
    Shape,
    Supports,
    age_inequalities,
    first_failure,
    shapes_of_ages,
)

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix

MAX_CORNERS = 64
"""Most corners at which -Phi is shown: two or four for each delay whose age varies."""


def ages_claim(system: DelaySystem, v: AgesVariables) -> dict[str, Any]:
    """Return the claim of a certificate: as `claim_of`, with the ages and all hypotheses."""
    claim = claim_of(system, v.gamma)
    measured = _OF_ENTRIES if system.has_masks else _FEEDBACK[system.is_structured]
    own = iter(v.functionals)
    for delay_claim, delay in zip(claim["delays"], system.delays, strict=True):
        if delay.d > 0:
            delay_claim.update(_age_claim(delay, next(own), exactly=_exactly(v)))
    return claim | {"order": v.order, "hypotheses": _hypotheses(v, measured, claim)}


def _exactly(v: AgesVariables) -> bool:
    """Whether the claim is about exactly the constant delays."""
    return v.order > 0 and not v.down_to_zero


def _age_claim(delay: Delay, functional: str, *, exactly: bool) -> dict[str, Any]:
    """Return the part of the claim that says how an age varies; numbers are doubles, as d is."""
    if functional == "constant":
        return {"age": EXACTLY if exactly else "constant, up to d"}
    least = {"least_age": delay.least_age}
    if functional == "interval":
        if delay.least_age == 0:
            return {"age": "any, however it varies, up to d"}
        return least | {"age": "any, however it varies, from least_age to d"}
    if functional == "rate":
        return least | {"age": "from least_age to d, |age'| <= rate", "rate": delay.rate}
    return least | {"age": "sampled: from least_age at rate one to d at most"}


_FEEDBACK = {
    False: "u = K x(t - age_f(t)): the whole state is measured",
    True: "u = K sum_i S_i x(t - age_i(t)), S_i the diagonal of the truth values of feedback",
}
"""What is measured, by whether the feedback is of single states."""

_OF_ENTRIES = "u = sum_i (K o M_i) x(t - age_i(t)), M_i the truth values of feedback by entry of K"


def _hypotheses(v: AgesVariables, measured: str, claim: dict[str, Any]) -> list[str]:
    """Return what the theorem asks for, sentence by sentence."""
    texts = [
        "x' = sum_i (A_i + dA_i) x(t - age_i(t)) + B u + C w for almost every t >= 0",
        measured,
        "every age is a measurable function of time",
        "stability: w = 0 and any continuous initial function on [-max d, 0]",
    ]
    if v.gamma is not None:
        texts.append(
            "gain: x = 0 for t <= 0, w square integrable on [0, T], and then the integral of z'z "
            "over [0, T] is at most gamma^2 times that of w'w, for every T > 0"
        )
    if claim["uncertain"]:
        texts.append(f"uncertainty: {uncertainty_text(claim)}")
    if any(own == "rate" for own in v.functionals):
        texts.append("an age with a bounded rate is Lipschitz continuous")
    if any(own in {"wirtinger", "looped"} for own in v.functionals):
        texts.append(
            "a sampled age, a = least_age: x(t - age) = x(s_k) for s_k + a <= t < s_(k+1) + a, "
            "0 < s_(k+1) - s_k <= d - a, s_0 + a <= 0, finitely many s_k in any bounded time"
        )
    return texts


def ages_proved(system: DelaySystem, gain: Matrix, v: AgesVariables) -> CertificateCheck:
    """Prove the claim of `ages_claim` for u = K x(t - age_f), or return why it is not proved.

    Parameters
    ----------
    system : its doubles are taken exactly.
    gain : (m, n) K, its doubles taken exactly.
    v : symmetric matrices, M, X_b, Y and numbers that fit the system, as rationals.

    Raises
    ------
    InputError : more than `MAX_ROWS` rows or `MAX_CORNERS` corners, or a functional or a support
        that does not hold for a delay.
    """
    reason = _failure(system, gain, v)
    return CertificateCheck(valid=reason is None, reason=reason, claim=ages_claim(system, v))


def _failure(system: DelaySystem, gain: Matrix, v: AgesVariables) -> str | None:
    check_functionals(system, v.functionals)
    check_supports(system, gain, v.supports)
    loop = Loop.of(system, gain, v.supports)
    ages = ages_of(loop, v)
    more = sum(x.matrices["U"].nrows() for x in v.terms if x.functional == "looped")
    require_size(_rows(system, ages) + more)
    require_size(prod(len(age.corners()) for age in ages), MAX_CORNERS, "corners")
    if v.gamma is not None and not v.gamma > 0:
        return "gamma is not positive"
    return first_failure(age_inequalities(loop, ages, bounded=v.gamma is not None), v.by_name())


def _rows(system: DelaySystem, ages: Sequence[Age]) -> int:
    """Return the rows of -Phi without those that one corner adds."""
    rows = len(system.A) + system.C.shape[1] + system.E.shape[1]
    return int(rows + sum(age.width * len(age.names) for age in ages))


def shapes_of_proof(
    system: DelaySystem,
    gain: Matrix,
    order: int,
    functionals: Sequence[AgeFunctional],
    supports: Supports,
    *,
    bounded: bool,
) -> dict[str, Shape]:
    """Return the shape of every unknown of a proof by its name in the inequalities.

    Raises
    ------
    InputError : more than `MAX_ROWS` rows.
    """
    loop = Loop.of(system, gain, supports)
    ages = [Age(loop, j, own, order) for j, own in enumerate(functionals)]
    require_size(_rows(system, ages))
    return shapes_of_ages(loop, ages, bounded=bounded)


def ages_of(loop: Loop, v: AgesVariables) -> list[Age]:
    """Return the terms of every positive delay."""
    down = v.down_to_zero and v.order > 0
    return [
        Age(loop, j, own, v.order, exact(0.0) if down and own == "constant" else None)
        for j, own in enumerate(v.functionals)
    ]
