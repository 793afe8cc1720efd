"""A proof by Theorem 2 as JSON, of a design and of its guarantees.

    {"X": [["p/q", ...]], "Q": [...], "R": [...], "eps": ..., "k1": [...], "k2": [...],
     "gamma": ...}

Q is zero where any age is allowed; gamma is null where stability alone is proved. The certificate
of a design adds Y = K X.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.certificate.unknowns_json import (
    blocks_in,
    counts_of,
    numbers_from_json,
    numbers_to_json,
    unknowns_from_json,
    unknowns_to_json,
)
from cosim.hinf.theorems import Proof, Theorem2

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

THEOREM_2_KEYS = ("X", "Q", "R", "eps", "k1", "k2", "gamma")


def theorem_2_to_json(proof: Proof) -> dict[str, Any]:
    """Return the JSON values that `theorem_2_from_json` reads."""
    theorem = cast("Theorem2", proof.theorem)
    counts = counts_of("X", len(theorem.k1), blocks_in(proof.unknowns))
    scalars = {"k1": numbers_to_json(theorem.k1), "k2": numbers_to_json(theorem.k2)}
    return {**unknowns_to_json(proof.unknowns, counts), **scalars}


def theorem_2_from_json(
    system: DelaySystem, gain: Matrix, data: Any, where: str, *, bounded: bool
) -> Proof:
    """Read a proof by Theorem 2 that `theorem_2_to_json` wrote; `bounded` : with a gamma.

    Raises
    ------
    InputError : a missing key, a wrong shape, a text that is no number.
    """
    known_keys(data, where, THEOREM_2_KEYS, required=THEOREM_2_KEYS)
    N = len(system.delays)
    k1, k2 = (numbers_from_json(data[name], N, f"{where}.{name}") for name in ("k1", "k2"))
    theorem, counts = Theorem2(k1, k2), counts_of("X", N, len(system.blocks))
    shapes = theorem.shapes(system, gain, bounded=bounded)
    return Proof(theorem, unknowns_from_json(data, shapes, counts, where))
