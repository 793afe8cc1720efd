"""The certificate of an analysis with known ages as JSON: `check_certificate`, kind "ages".

    {"kind": "ages", "claim": {...}, "system": {...}, "K": [[...]],
     "variables": {"order": 1, "P": [["p/q", ...]], "eps", "gamma",
                   "down_to_zero": false,
                   "terms": [{"functional": "looped", "matrices": {"U": ..., "X_a": ...}}]}}

`terms` has one entry per positive delay; the matrices are those of `ages_terms.unknowns_of`. The
claim lists the theorem's hypotheses in full.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cosim.core import InputError
from cosim.hinf.certificate.ages_proof import ages_claim, ages_proved
from cosim.hinf.certificate.ages_terms import (
    AgesVariables,
    AgeTerms,
    check_functionals,
    is_symmetric_unknown,
    late_delays,
    state_blocks,
    unknowns_of,
)
from cosim.hinf.certificate.analysis_certificate import check_null, loop_from_json, order_from_json
from cosim.hinf.certificate.block_multipliers import eps_from_json, eps_to_json, exact_eps
from cosim.hinf.certificate.proof import CertificateCheck
from cosim.hinf.certificate.rational import (
    exact,
    exact_matrix,
    exact_symmetric,
    from_text,
    matrix_from_text,
    matrix_to_text,
    to_text,
)
from cosim.hinf.certificate.system_json import (
    format_value,
    known_keys,
    system_to_json,
)
from cosim.hinf.certificate.theorem import theorem_of

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

AGES = "ages"
_VARIABLES = ("order", "P", "terms", "eps", "gamma", "down_to_zero")
_TERMS = ("functional", "matrices")


def exact_ages(system: DelaySystem, v: AgesVariables) -> AgesVariables:
    """Convert the doubles of `v` to rationals, and symmetrise the symmetric matrices exactly."""
    terms = tuple(
        AgeTerms(
            own.functional,
            {
                name: exact_symmetric(value) if is_symmetric_unknown(name) else exact_matrix(value)
                for name, value in own.matrices.items()
            },
        )
        for own in v.terms
    )
    return AgesVariables(
        order=v.order,
        P=exact_symmetric(v.P),
        terms=terms,
        eps=exact_eps(system, v.eps),
        gamma=None if v.gamma is None else exact(v.gamma),
        down_to_zero=v.down_to_zero,
    )


def ages_to_json(system: DelaySystem, gain: Matrix, v: AgesVariables) -> dict[str, Any]:
    """Return the certificate as JSON values for `check_ages`, without checking it."""
    claim = ages_claim(system, v)
    return {
        "kind": AGES,
        "theorem": theorem_of(claim),
        "claim": claim,
        "system": system_to_json(system),
        "variables": {
            "order": v.order,
            "P": matrix_to_text(v.P),
            "terms": [
                {
                    "functional": own.functional,
                    "matrices": {k: matrix_to_text(M) for k, M in own.matrices.items()},
                }
                for own in v.terms
            ],
            "eps": eps_to_json(v.eps),
            "gamma": None if v.gamma is None else to_text(v.gamma),
            "down_to_zero": v.down_to_zero,
        },
        "K": gain.tolist(),
    }


def check_ages(data: dict[str, Any]) -> CertificateCheck:
    """Check an analysis with known ages from its JSON alone, with rationals and no solver.

    Raises
    ------
    InputError : not a certificate. (Where the claim is not proved, no error: `valid` is False.)
    """
    system, gain, more = loop_from_json(data)
    v = _variables(system, data["variables"])
    claim, symmetric = ages_claim(system, v), v.symmetric_matrices()
    return more.judged(
        data, (system, gain), claim, symmetric, lambda: ages_proved(system, gain, v).reason
    )


def _variables(system: DelaySystem, data: Any) -> AgesVariables:
    known_keys(data, "variables", _VARIABLES, required=_VARIABLES)
    order = order_from_json(data["order"])
    late, tables = late_delays(system), data["terms"]
    if not isinstance(tables, list) or len(tables) != len(late):
        raise InputError(
            "one per positive delay",
            where="variables.terms",
            expected=f"a list of {len(late)}",
            got=format_value(tables),
        )
    for j, table in enumerate(tables):
        known_keys(table, f"variables.terms[{j}]", _TERMS, required=_TERMS)
    functionals = tuple(table["functional"] for table in tables)
    check_functionals(system, functionals)
    if not isinstance(data["down_to_zero"], bool):
        raise InputError(
            "not a truth value",
            where="variables.down_to_zero",
            expected="true or false",
            got=format_value(data["down_to_zero"]),
        )
    if not system.has_performance:
        check_null("gamma", data["gamma"], expected=True)
    gamma = None if data["gamma"] is None else from_text(data["gamma"], "variables.gamma")
    terms = []
    for j, (table, shapes) in enumerate(
        zip(tables, unknowns_of(system, order, functionals, gamma=gamma is not None), strict=True)
    ):
        where = f"variables.terms[{j}].matrices"
        known_keys(table["matrices"], where, tuple(shapes), required=tuple(shapes))
        matrices = {
            name: matrix_from_text(table["matrices"][name], f"{where}.{name}", *shape)
            for name, shape in shapes.items()
        }
        terms.append(AgeTerms(table["functional"], matrices))
    rows = len(system.A) * len(state_blocks(system, order, functionals))
    return AgesVariables(
        order=order,
        P=matrix_from_text(data["P"], "variables.P", rows, rows),
        terms=tuple(terms),
        eps=eps_from_json(system, data["eps"], "variables.eps"),
        gamma=gamma,
        down_to_zero=data["down_to_zero"],
    )
