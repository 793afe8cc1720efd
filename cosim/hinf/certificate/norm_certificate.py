"""The certificate of a bound of the nominal norm as JSON: `check_certificate`, kind "norm".

    {"kind": "norm", "theorem": [...], "claim": {...}, "system": {...}, "K": [[...]],
     "gamma": "p/q", "end": 12.5, "steps": [[c, h], ...]}

All delays are constants, exactly d, and nothing is uncertain, whatever E, H of the system are. The
intervals [c-h, c+h] of frequencies in rad/s, up to `end`, are what `norm_proof` needs.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cosim.core import InputError, format_value
from cosim.hinf.certificate.claim import Statement, claim_of, document_of
from cosim.hinf.certificate.norm_proof import MAX_STEPS, NORM_BITS, NormProof
from cosim.hinf.certificate.system_json import gain_from_json, system_from_json, system_to_json
from cosim.hinf.certificate.system_parts import number
from cosim.hinf.certificate.words import PROPERTIES, AgeWord
from cosim.hinf.exact import ball_precision, exact, from_text, to_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cosim.models import DelaySystem, Matrix


def norm_to_json(
    system: DelaySystem,
    gain: Matrix,
    gamma: float,
    steps: Sequence[tuple[float, float]],
    end: float,
) -> dict[str, Any]:
    """Return the certificate as JSON values, without checking it."""
    return document_of(
        _claim(system, exact(gamma)),
        kind="norm",
        system=system_to_json(system),
        K=gain.tolist(),
        gamma=to_text(exact(gamma)),
        end=end,
        steps=[list(step) for step in steps],
    )


def read_norm(data: dict[str, Any]) -> Statement:
    """Read what a bound of the nominal norm states; it is proved in ball arithmetic.

    Raises
    ------
    InputError : not a certificate.
    """
    system = system_from_json(data["system"])
    gain = gain_from_json(data["K"], system)
    if not system.has_performance:
        raise InputError("this system has no gain to bound", where="system", expected="C and D")
    gamma, end = from_text(data["gamma"], "gamma"), number(data["end"], "end")
    rows = data["steps"]
    fits = isinstance(rows, list) and all(isinstance(x, list) and len(x) == 2 for x in rows)
    if not fits or len(rows) > MAX_STEPS:
        raise InputError(
            "not the intervals of a proof",
            where="steps",
            expected=f"at most {MAX_STEPS} pairs of a centre and a half width",
            got=format_value(rows),
        )
    steps = [(number(c, f"steps[{i}]"), number(h, f"steps[{i}]")) for i, (c, h) in enumerate(rows)]

    def failure() -> str | None:
        if not gamma > 0:
            return "gamma is not positive"
        with ball_precision(NORM_BITS):
            return NormProof(system, gain, gamma).failure(steps, end)

    return Statement(_claim(system, gamma), failure, makers="system and gamma")


def _claim(system: DelaySystem, gamma: Any) -> dict[str, Any]:
    claim = claim_of(system, gamma)
    for delay in claim["delays"]:
        delay["age"] = AgeWord.EXACTLY.value
    claim.pop("uncertainty_blocks", None)
    return claim | {"property": PROPERTIES["norm"], "uncertain": False}
