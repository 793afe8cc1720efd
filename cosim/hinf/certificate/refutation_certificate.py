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

from cosim.hinf.certificate.claim import Statement, document_of, uncertainty_claim
from cosim.hinf.certificate.refutation_proof import (
    Place,
    refutation_claim,
    refutation_failure,
    shapes_of_multipliers,
)
from cosim.hinf.certificate.system_json import known_keys, system_from_json, system_to_json
from cosim.hinf.certificate.unknowns_json import (
    Counts,
    check_null,
    numbers_from_json,
    numbers_to_json,
    unknowns_from_json,
    unknowns_to_json,
)
from cosim.hinf.certificate.words import PROPERTIES
from cosim.hinf.exact import (
    exact,
    exact_matrix,
    from_text,
    matrix_from_text,
    to_text,
)

if TYPE_CHECKING:
    from cosim.models import DelaySystem


def refutation_to_json(
    system: DelaySystem, place: Place, multipliers: dict[str, Any]
) -> dict[str, Any]:
    """Return the certificate as JSON values, without checking it."""
    return document_of(
        refutation_claim(system, place),
        kind="refutation",
        system=system_to_json(system),
        at={
            "k1": numbers_to_json(place.k1),
            "k2": numbers_to_json(place.k2),
            "gamma": None if place.gamma is None else to_text(place.gamma),
        },
        multipliers=unknowns_to_json(multipliers, _counts(system)),
    )


def _counts(system: DelaySystem) -> Counts:
    return {"Z": None, "X": None, "Q": len(system.delays)}


def read_refutation(data: dict[str, Any]) -> Statement:
    """Read what a refutation states.

    Raises
    ------
    InputError : not a certificate.
    """
    system = system_from_json(data["system"])
    at, counts = data["at"], _counts(system)
    known_keys(at, "at", ("k1", "k2", "gamma"), required=("k1", "k2", "gamma"))
    k1, k2 = (numbers_from_json(at[x], len(system.delays), f"at.{x}") for x in ("k1", "k2"))
    check_null(at["gamma"], "at.gamma", expected=not system.has_performance)
    place = Place(k1, k2, None if at["gamma"] is None else from_text(at["gamma"], "at.gamma"))
    known_keys(data["multipliers"], "multipliers", tuple(counts), required=tuple(counts))
    shapes = shapes_of_multipliers(system, place)
    multipliers = unknowns_from_json(data["multipliers"], shapes, counts, "multipliers")
    return Statement(
        refutation_claim(system, place),
        lambda: refutation_failure(system, place, multipliers),
        makers="system and place",
    )


def gamma_floor(system: DelaySystem, gamma: float) -> dict[str, Any] | None:
    """Prove that gamma <= ||D1||, which no gain achieves: the certificate; None if unproved."""
    _, _, right = np.linalg.svd(system.D1)
    for w in (right[0], *np.eye(system.D1.shape[1])):
        column = exact_matrix(np.asarray(w, dtype=np.float64)[:, None])
        if _attains(system, exact(gamma), column):
            return document_of(
                _floor_claim(system, exact(gamma)),
                kind="gamma floor",
                system=system_to_json(system),
                gamma=to_text(exact(gamma)),
                w=[to_text(column[i, 0]) for i in range(column.nrows())],
            )
    return None


def read_gamma_floor(data: dict[str, Any]) -> Statement:
    """Read what a certificate of `gamma_floor` states.

    Raises
    ------
    InputError : not a certificate.
    """
    system = system_from_json(data["system"])
    gamma = from_text(data["gamma"], "certificate.gamma")
    rows = [[x] for x in data["w"]] if isinstance(data["w"], list) else data["w"]
    w = matrix_from_text(rows, "certificate.w", system.D1.shape[1], 1)

    def failure() -> str | None:
        if _attains(system, gamma, w):
            return None
        return "|D1 w| is less than gamma |w|, or w is zero"

    return Statement(_floor_claim(system, gamma), failure, makers="system and gamma")


def _floor_claim(system: DelaySystem, gamma: Any) -> dict[str, Any]:
    return {
        "property": PROPERTIES["gamma floor"],
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
