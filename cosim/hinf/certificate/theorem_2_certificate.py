"""The certificate of a gain that Theorem 2 proves: the one without a kind.

    {"claim": {...}, "system": {...}, "variables": {"X": [["p/q", ...]], "Y", ...}, "K": [[...]]}

The doubles of the solver's variables, of K and of the system are taken as the dyadic rationals that
they are, Y = K X exactly. The terms of each delay grow with it, so that what holds at dj holds for
every constant delay up to dj. Where more is proved than gamma, there are `guarantees`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cosim.core import InputError
from cosim.hinf.certificate.claim import Statement, claim_of, document_of
from cosim.hinf.certificate.guarantees import Guarantees
from cosim.hinf.certificate.system_json import known_keys, system_from_json, system_to_json
from cosim.hinf.certificate.system_parts import matrix_from_rows
from cosim.hinf.certificate.theorem_2_json import (
    THEOREM_2_KEYS,
    theorem_2_from_json,
    theorem_2_to_json,
)
from cosim.hinf.exact import exact, exact_matrix, matrix_from_text, matrix_to_text
from cosim.hinf.theorems import Proof, Theorem2
from cosim.models import DelaySystem, Matrix


def theorem_2_proof(
    system: DelaySystem,
    gain: Matrix,
    k1: Sequence[float],
    k2: Sequence[float],
    unknowns: dict[str, Any],
) -> Proof:
    """Return what a solver has found at k1, k2 in rationals: matrices symmetric, Y left out.

    Raises
    ------
    InputError : if shapes do not fit the system or a number is not finite.
    """
    for name, values in (("k1", k1), ("k2", k2)):
        if len(values) != len(system.delays) or not np.isfinite(values).all():
            raise InputError(
                "not one finite number per delay",
                where=name,
                expected=str(len(system.delays)),
                got=str(list(values)),
            )
    theorem = Theorem2(tuple(map(exact, k1)), tuple(map(exact, k2)))
    return Proof(theorem, unknowns).exactly(system, _gain(gain, system))


def certificate_to_json(
    system: DelaySystem, K: ArrayLike, proof: Proof, guarantees: Guarantees | None = None
) -> dict[str, Any]:
    """Return the certificate as JSON values for `check_certificate`, without checking it.

    Raises
    ------
    InputError : if shapes do not fit or a number is not finite.
    """
    gain, more = _gain(K, system), guarantees or Guarantees()
    table = theorem_2_to_json(proof)
    Y = matrix_to_text(exact_matrix(gain) * proof.unknowns["X"])
    return document_of(
        claim_of(system, proof.gamma) | more.claim(),
        system=system_to_json(system),
        variables={"X": table.pop("X"), "Y": Y, **table},
        K=gain.tolist(),
        **more.to_json(),
    )


def read_theorem_2(data: dict[str, Any]) -> Statement:
    """Read what the certificate states.

    Raises
    ------
    InputError : not a certificate.
    """
    system = system_from_json(data["system"])
    n, m = system.B.shape
    rows = matrix_from_rows(data["K"], "K")
    gain = _gain(rows if m or rows.size else np.zeros((0, n)), system)
    table, bounded = data["variables"], system.has_performance
    known_keys(table, "variables", (*THEOREM_2_KEYS, "Y"), required=(*THEOREM_2_KEYS, "Y"))
    others = {key: table[key] for key in THEOREM_2_KEYS}
    proof = theorem_2_from_json(system, gain, others, "variables", bounded=bounded)
    Y = matrix_from_text(table["Y"], "variables.Y", m, n)

    def failure() -> str | None:
        X = proof.unknowns["X"]
        if X.transpose() == X and exact_matrix(gain) * X != Y:
            return "Y is not K X"
        return proof.failure(system, gain)

    return Statement(claim_of(system, proof.gamma), failure, (system, gain))


def _gain(K: ArrayLike, system: DelaySystem) -> Matrix:
    gain = np.asarray(K, dtype=np.float64)
    n, m = system.B.shape
    if gain.shape != (m, n):
        raise InputError("wrong shape", where="K", expected=str((m, n)), got=str(gain.shape))
    if not np.isfinite(gain).all():
        raise InputError("not finite", where="K", expected="finite numbers", got=str(gain.tolist()))
    return gain
