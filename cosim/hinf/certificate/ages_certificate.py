"""The certificate of a gain whose ages are known: kinds "analysis" and "ages".

    {"kind": "analysis" or "ages", "theorem": [...], "claim": {...}, "system": {...},
     "K": [[...]], "variables": {...}}

An analysis takes an age that varies to be any one from zero to its bound, the other kind takes it
as it is; `ages_json` has their variables. Beside these there may be `guarantees`
(`cosim.hinf.certificate.guarantees`). The claim of ages as they are lists the theorem's hypotheses
in full.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from cosim.hinf.certificate.ages_json import (
    ages_from_json,
    ages_to_json,
    analysis_from_json,
    analysis_to_json,
)
from cosim.hinf.certificate.claim import Statement, claim_of, document_of
from cosim.hinf.certificate.system_json import gain_from_json, system_from_json, system_to_json
from cosim.hinf.certificate.words import AGE_FROM, AgeWord, hypotheses
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
    of_delays = zip(
        theorem.functionals, theorem.lower or (None,) * len(theorem.functionals), strict=True
    )
    for delay_claim, delay in zip(claim["delays"], system.delays, strict=True):
        if delay.d > 0:
            functional, low = next(of_delays)
            age = _age_claim(delay, functional, _covered_from(theorem, low))
            delay_claim.update(age)
        elif theorem.is_analysis and not delay.any_age:
            low = None if theorem.lower is None else 0
            delay_claim["age"] = _constant(_covered_from(theorem, low))
    claim["order"] = theorem.order
    if not theorem.is_analysis:
        single = "single states" if system.is_structured else "whole state"
        measured = "single entries" if system.has_masks else single
        claim["hypotheses"] = hypotheses(claim, measured=measured)
    return claim


def _covered_from(theorem: AgesTheorem, low: Any) -> Any:
    """Return the least constant delay that is covered; None: exactly d."""
    return 0 if theorem.order == 0 else low


def _constant(low: Any) -> str:
    if low is None:
        return AgeWord.EXACTLY.value
    return AgeWord.UP_TO.value if low == 0 else AGE_FROM.format(least=to_text(low))


def _age_claim(delay: Delay, functional: str, low: Any) -> dict[str, Any]:
    """Return the part of the claim that says how an age varies; numbers are doubles, as d is."""
    if functional == "constant":
        return {"age": _constant(low)}
    if functional == "jensen" or (functional == "interval" and delay.least_age == 0):
        return {"age": AgeWord.ANY.value}
    least = {"least_age": delay.least_age}
    if functional == "interval":
        return least | {"age": AgeWord.ANY_FROM.value}
    if functional == "rate":
        return least | {"age": AgeWord.RATE.value, "rate": delay.rate}
    return least | {"age": AgeWord.SAMPLED.value}
