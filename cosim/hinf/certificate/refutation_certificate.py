"""Certificates that no design exists, as JSON: two kinds that `check_certificate` reads.

    {"kind": "refutation", "claim": {...}, "system": {...},
     "at": {"k1": ["p/q"], "k2": ["p/q"], "gamma": "p/q"},
     "multipliers": {"Z": [["p", ...]], "X": [...], "Q": [[...], null]}}

    {"kind": "gamma floor", "claim": {...}, "system": {...}, "gamma": "p/q", "w": ["p/q"]}

The second holds for every delay, k1, k2 and gain: |D1 w| >= gamma |w| with w not zero. The
blocks (w,w), (w,z), (z,z) of Omega are -gamma I, D1', -gamma I, and at [w; D1 w / gamma] their
form is (|D1 w|^2 - gamma^2 |w|^2) / gamma >= 0, so Omega < 0 has no solution. And for u = K x the
gain from w to z is that of D1 at infinite frequency: it is at least |D1|, whatever K.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import flint
import numpy as np

from cosim.core import InputError, format_value
from cosim.hinf.certificate.proof import CertificateCheck, judged, uncertainty_claim
from cosim.hinf.certificate.refutation_proof import Multipliers, Place, refutation_claim, refuted
from cosim.hinf.certificate.system_json import known_keys, system_from_json, system_to_json
from cosim.hinf.certificate.theorem import theorem_of
from cosim.hinf.exact import (
    exact,
    exact_matrix,
    from_text,
    matrix_from_text,
    matrix_to_text,
    to_text,
)

if TYPE_CHECKING:
    from cosim.models import DelaySystem

REFUTATION = "refutation"
FLOOR = "gamma floor"
_KEYS = ("kind", "claim", "system", "at", "multipliers")
_FLOOR_KEYS = ("kind", "claim", "system", "gamma", "w")


def refutation_to_json(
    system: DelaySystem, place: Place, multipliers: Multipliers
) -> dict[str, Any]:
    """Return the certificate as JSON values for `check_refutation`, without checking it."""
    claim = refutation_claim(system, place)
    return {
        "kind": REFUTATION,
        "theorem": theorem_of(claim),
        "claim": claim,
        "system": system_to_json(system),
        "at": {
            "k1": [to_text(value) for value in place.k1],
            "k2": [to_text(value) for value in place.k2],
            "gamma": None if place.gamma is None else to_text(place.gamma),
        },
        "multipliers": {
            "Z": matrix_to_text(multipliers.Z),
            "X": matrix_to_text(multipliers.X),
            "Q": [None if Q is None else matrix_to_text(Q) for Q in multipliers.Q],
        },
    }


def check_refutation(data: dict[str, Any]) -> CertificateCheck:
    """Check a refutation from its JSON alone, with rational arithmetic and no solver.

    Raises
    ------
    InputError : not a certificate. (Where the claim is not proved, no error: `valid` is False.)
    """
    own = {key: data[key] for key in _KEYS if key in data}
    known_keys(own, "certificate", _KEYS, required=_KEYS)
    system = system_from_json(data["system"])
    place = _place(system, data["at"])
    multipliers = _multipliers(system, data["multipliers"])
    claim = refutation_claim(system, place)
    return judged(
        data,
        claim,
        [(f"the multiplier {name}", M) for name, M in multipliers.matrices()],
        lambda: refuted(system, place, multipliers).reason,
        makers="system and place",
    )


def gamma_floor(system: DelaySystem, gamma: float) -> dict[str, Any] | None:
    """Prove that gamma <= ||D1||, which no gain achieves: the certificate; None if unproved."""
    _, _, right = np.linalg.svd(system.D1)
    for w in (right[0], *np.eye(system.D1.shape[1])):
        column = exact_matrix(np.asarray(w, dtype=np.float64)[:, None])
        if _attains(system, exact(gamma), column):
            claim = _floor_claim(system, exact(gamma))
            return {
                "kind": FLOOR,
                "theorem": theorem_of(claim),
                "claim": claim,
                "system": system_to_json(system),
                "gamma": to_text(exact(gamma)),
                "w": [to_text(column[i, 0]) for i in range(column.nrows())],
            }
    return None


def check_gamma_floor(data: dict[str, Any]) -> CertificateCheck:
    """Check a certificate of `gamma_floor` from its JSON alone.

    Raises
    ------
    InputError : not a certificate. (Where the claim is not proved, no error: `valid` is False.)
    """
    own = {key: data[key] for key in _FLOOR_KEYS if key in data}
    known_keys(own, "certificate", _FLOOR_KEYS, required=_FLOOR_KEYS)
    system = system_from_json(data["system"])
    gamma = from_text(data["gamma"], "certificate.gamma")
    q = system.D1.shape[1]
    rows = [[x] for x in data["w"]] if isinstance(data["w"], list) else data["w"]
    w = matrix_from_text(rows, "certificate.w", q, 1)
    claim = _floor_claim(system, gamma)
    short = "|D1 w| is less than gamma |w|, or w is zero"
    reason = None if _attains(system, gamma, w) else short
    return judged(data, claim, [], lambda: reason, makers="system and gamma")


def _floor_claim(system: DelaySystem, gamma: Any) -> dict[str, Any]:
    return {
        "property": "no delay, k1, k2 and K meet the LMI of Theorem 2: gamma <= ||D1||",
        "gamma": to_text(gamma),
        "delays": [],
        **uncertainty_claim(system),
        "inputs": "doubles",
    }


def _attains(system: DelaySystem, gamma: Any, w: Any) -> bool:
    """Whether |D1 w| >= gamma |w| > 0, for a gamma > 0."""
    there = exact_matrix(system.D1) * w
    size = (w.transpose() * w)[0, 0] if w.nrows() else flint.fmpq(0)
    gain = (there.transpose() * there)[0, 0] if there.nrows() else flint.fmpq(0)
    return bool(gamma > 0 and size > 0 and gain >= gamma * gamma * size)


def _place(system: DelaySystem, data: Any) -> Place:
    known_keys(data, "at", ("k1", "k2", "gamma"), required=("k1", "k2", "gamma"))
    N = len(system.delays)
    for name in ("k1", "k2"):
        if not isinstance(data[name], list) or len(data[name]) != N:
            raise InputError("one per delay", where=f"at.{name}", expected=f"a list of {N}")
    if (data["gamma"] is None) == system.has_performance:
        raise InputError(
            "does not fit the system",
            where="at.gamma",
            expected="a number" if system.has_performance else "null",
            got=format_value(data["gamma"]),
        )
    return Place(
        tuple(from_text(x, f"at.k1[{j}]") for j, x in enumerate(data["k1"])),
        tuple(from_text(x, f"at.k2[{j}]") for j, x in enumerate(data["k2"])),
        None if data["gamma"] is None else from_text(data["gamma"], "at.gamma"),
    )


def _multipliers(system: DelaySystem, data: Any) -> Multipliers:
    known_keys(data, "multipliers", ("Z", "X", "Q"), required=("Z", "X", "Q"))
    n, N = system.A.shape[0], len(system.delays)
    if not isinstance(data["Q"], list) or len(data["Q"]) != N:
        raise InputError("one per delay", where="multipliers.Q", expected=f"a list of {N}")
    for j, (Q, delay) in enumerate(zip(data["Q"], system.delays, strict=True)):
        if (Q is None) != delay.any_age:
            raise InputError(
                "does not fit the system",
                where=f"multipliers.Q[{j}]",
                expected="null" if delay.any_age else "a matrix",
                got=format_value(Q),
            )
    rows = (1 + N + sum(delay.d > 0 for delay in system.delays)) * n + system.H.shape[0]
    rows += system.C.shape[1] + system.D.shape[0] if system.has_performance else 0
    return Multipliers(
        matrix_from_text(data["Z"], "multipliers.Z", rows, rows),
        matrix_from_text(data["X"], "multipliers.X", n, n),
        tuple(
            None if Q is None else matrix_from_text(Q, f"multipliers.Q[{j}]", n, n)
            for j, Q in enumerate(data["Q"])
        ),
    )
