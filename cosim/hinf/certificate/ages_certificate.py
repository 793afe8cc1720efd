"""The certificate of a gain whose ages are known: kinds "analysis" and "ages".

    {"kind": "analysis" or "ages", "theorem": [...], "claim": {...}, "system": {...},
     "K": [[...]], "variables": {...}}

An analysis takes an age that varies to be any one from zero to its bound, the other kind takes it
as it is; `proof_json` has their variables. Beside these there may be `guarantees`
(`cosim.hinf.certificate.guarantees`). The claim of ages as they are lists the theorem's hypotheses
in full.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from cosim.hinf.certificate.claim import (
    ANY_AGE,
    EXACTLY,
    UP_TO,
    Statement,
    claim_of,
    document_of,
)
from cosim.hinf.certificate.proof_json import (
    ages_from_json,
    ages_to_json,
    analysis_from_json,
    analysis_to_json,
)
from cosim.hinf.certificate.system_json import gain_from_json, system_from_json, system_to_json
from cosim.hinf.certificate.theorem import uncertainty_text
from cosim.hinf.exact import to_text
from cosim.hinf.theorems import AgesTheorem, Proof

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix


def loop_to_json(system: DelaySystem, gain: Matrix, proof: Proof) -> dict[str, Any]:
    """Return the certificate of a given gain as JSON values, without checking it.

    proof : of an `AgesTheorem`, in rationals.
    """
    is_analysis = cast("AgesTheorem", proof.theorem).is_analysis
    return document_of(
        loop_claim(system, proof),
        kind="analysis" if is_analysis else "ages",
        system=system_to_json(system),
        variables=(analysis_to_json if is_analysis else ages_to_json)(proof),
        K=gain.tolist(),
    )


def read_loop(data: dict[str, Any]) -> Statement:
    """Read what the certificate of a given gain states.

    Raises
    ------
    InputError : not a certificate.
    """
    system = system_from_json(data["system"])
    gain = gain_from_json(data["K"], system)
    read = analysis_from_json if data["kind"] == "analysis" else ages_from_json
    proof = read(system, gain, data["variables"])
    return Statement(loop_claim(system, proof), lambda: proof.failure(system, gain), (system, gain))


def loop_claim(system: DelaySystem, proof: Proof) -> dict[str, Any]:
    """Return the claim: as `claim_of`, with the order and every age, and what ages as they are ask.

    Also where nothing is proved yet: of the theorem and a gamma alone.
    """
    theorem, claim = cast("AgesTheorem", proof.theorem), claim_of(system, proof.gamma)
    late = zip(
        theorem.functionals, theorem.lower or (None,) * len(theorem.functionals), strict=True
    )
    for delay_claim, delay in zip(claim["delays"], system.delays, strict=True):
        if delay.d > 0:
            functional, low = next(late)
            age = _age_claim(delay, functional, _covered_from(theorem, low))
            delay_claim.update(age)
        elif theorem.is_analysis and not delay.any_age:
            low = None if theorem.lower is None else 0
            delay_claim["age"] = _constant(_covered_from(theorem, low))
    more = {} if theorem.is_analysis else {"hypotheses": _hypotheses(system, theorem, claim)}
    return claim | {"order": theorem.order} | more


def _covered_from(theorem: AgesTheorem, low: Any) -> Any:
    """Return the least constant delay that is covered; None: exactly d."""
    return 0 if theorem.order == 0 else low


def _constant(low: Any) -> str:
    if low is None:
        return EXACTLY
    return UP_TO if low == 0 else f"constant, from {to_text(low)} to d"


def _age_claim(delay: Delay, functional: str, low: Any) -> dict[str, Any]:
    """Return the part of the claim that says how an age varies; numbers are doubles, as d is."""
    least = {"least_age": delay.least_age}
    if functional == "constant":
        return {"age": _constant(low)}
    if functional == "jensen":
        return {"age": ANY_AGE}
    if functional == "interval":
        if delay.least_age == 0:
            return {"age": ANY_AGE}
        return least | {"age": "any, however it varies, from least_age to d"}
    if functional == "rate":
        return least | {"age": "from least_age to d, |age'| <= rate", "rate": delay.rate}
    return least | {"age": "sampled: from least_age at rate one to d at most"}


_MEASURED = {
    False: "u = K x(t - age_f(t)): the whole state is measured",
    True: "u = K sum_i S_i x(t - age_i(t)), S_i the diagonal of the truth values of feedback",
}
"""What is measured, by whether the feedback is of single states."""

_OF_ENTRIES = "u = sum_i (K o M_i) x(t - age_i(t)), M_i the truth values of feedback by entry of K"


def _hypotheses(system: DelaySystem, theorem: AgesTheorem, claim: dict[str, Any]) -> list[str]:
    """Return what the theorem asks for, sentence by sentence."""
    texts = [
        "x' = sum_i (A_i + dA_i) x(t - age_i(t)) + B u + C w for almost every t >= 0",
        _OF_ENTRIES if system.has_masks else _MEASURED[system.is_structured],
        "every age is a measurable function of time",
        "stability: w = 0 and any continuous initial function on [-max d, 0]",
    ]
    if claim["gamma"] is not None:
        texts.append(
            "gain: x = 0 for t <= 0, w square integrable on [0, T], and then the integral of z'z "
            "over [0, T] is at most gamma^2 times that of w'w, for every T > 0"
        )
    if claim["uncertain"]:
        texts.append(f"uncertainty: {uncertainty_text(claim)}")
    if "rate" in theorem.functionals:
        texts.append("an age with a bounded rate is Lipschitz continuous")
    if {"wirtinger", "looped"} & set(theorem.functionals):
        texts.append(
            "a sampled age, a = least_age: x(t - age) = x(s_k) for s_k + a <= t < s_(k+1) + a, "
            "0 < s_(k+1) - s_k <= d - a, s_0 + a <= 0, finitely many s_k in any bounded time"
        )
    return texts
