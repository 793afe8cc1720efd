"""The certificate of an analysis as JSON: what `check_certificate` reads of kind "analysis".

    {"kind": "analysis", "claim": {...}, "system": {...}, "K": [[...]],
     "variables": {"order": 0, "P": [["p/q", ...]], "Q": [...], "R": [...], "eps", "gamma"}}

Q, R: one matrix per positive delay; Q is null where any age is allowed. "lower", where it is
given, has the least of each positive delay that the claim covers, null where any age is allowed.
Beside these there may be `guarantees` (`cosim.hinf.certificate.guarantees`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cosim.core import InputError
from cosim.hinf.certificate.analysis_proof import (
    AnalysisVariables,
    ExactAnalysis,
    analysis_claim,
    analysis_proved,
)
from cosim.hinf.certificate.analysis_variables import variables_from_json, variables_to_json
from cosim.hinf.certificate.block_multipliers import exact_eps
from cosim.hinf.certificate.guarantees import Guarantees, guarantees_from_json
from cosim.hinf.certificate.proof import CertificateCheck
from cosim.hinf.certificate.system_json import known_keys, system_from_json, system_to_json
from cosim.hinf.certificate.system_parts import matrix_from_rows
from cosim.hinf.certificate.theorem import theorem_of
from cosim.hinf.exact import exact, exact_symmetric

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

KIND = "analysis"
_KEYS = ("kind", "claim", "system", "variables", "K")


def exact_analysis(system: DelaySystem, v: AnalysisVariables) -> ExactAnalysis:
    """Convert the doubles of `v` to rationals, and symmetrise the matrices exactly."""
    return ExactAnalysis(
        order=v.order,
        P=exact_symmetric(v.P),
        Q=tuple(None if Q is None else exact_symmetric(Q) for Q in v.Q),
        R=tuple(exact_symmetric(R) for R in v.R),
        eps=exact_eps(system, v.eps),
        gamma=None if v.gamma is None else exact(v.gamma),
        lower=None if v.lower is None else tuple(None if d is None else exact(d) for d in v.lower),
    )


def analysis_to_json(system: DelaySystem, gain: Matrix, v: ExactAnalysis) -> dict[str, Any]:
    """Return the certificate as JSON values for `check_analysis`, without checking it."""
    claim = analysis_claim(system, v)
    return {
        "kind": KIND,
        "theorem": theorem_of(claim),
        "claim": claim,
        "system": system_to_json(system),
        "variables": variables_to_json(v),
        "K": gain.tolist(),
    }


def check_analysis(data: dict[str, Any]) -> CertificateCheck:
    """Check an analysis from its JSON alone, with rational arithmetic and no solver.

    Raises
    ------
    InputError : not a certificate. (Where the claim is not proved, no error: `valid` is False.)
    """
    system, gain, more = loop_from_json(data)
    v = variables_from_json(system, data["variables"])
    claim = analysis_claim(system, v)
    return more.judged(
        data, (system, gain), claim, v.matrices(), lambda: analysis_proved(system, gain, v).reason
    )


def loop_from_json(data: dict[str, Any]) -> tuple[DelaySystem, Matrix, Guarantees]:
    """Read what every certificate of an analysis has: the system, the gain, and guarantees.

    Raises
    ------
    InputError : a missing key, a wrong shape, a number that is none.
    """
    own = {key: data[key] for key in _KEYS if key in data}
    known_keys(own, "certificate", _KEYS, required=_KEYS)
    system = system_from_json(data["system"])
    return system, gain_from_json(data["K"], system), guarantees_from_json(data, system)


def gain_from_json(rows: Any, system: DelaySystem) -> Matrix:
    """Read K (m, n) of a certificate; [] where there is no control.

    Raises
    ------
    InputError : not a matrix, or of another shape.
    """
    n, m = system.B.shape
    if rows == [] and m == 0:
        return np.zeros((0, n))
    gain = matrix_from_rows(rows, "K")
    if gain.shape != (m, n):
        raise InputError("wrong shape", where="K", expected=str((m, n)), got=str(gain.shape))
    check_measured(gain, system)
    return gain


def check_measured(gain: Matrix, system: DelaySystem) -> None:
    """Refuse a gain (m, n) that acts on a state that is not measured, or not by this control.

    Raises
    ------
    InputError : naming the first such entry.
    """
    acting = np.argwhere((gain != 0) & ~system.free)
    if acting.size:
        i, j = acting[0]
        raise InputError(
            "the gain acts on a state that is not measured",
            where=f"K[{i + 1},{j + 1}]",
            expected="0, since no feedback contains this state",
            got=repr(float(gain[i, j])),
            hint="add the state to feedback of the system or of a delay, or make its column zero",
        )
