"""The certificate of an analysis with known ages as JSON: `check_certificate`, kind "ages".

    {"kind": "ages", "claim": {...}, "system": {...}, "K": [[...]],
     "variables": {"order": 1, "P": [["p/q", ...]], "eps", "gamma",
                   "down_to_zero": false,
                   "terms": [{"functional": "looped", "matrices": {"U": ..., "X_a": ...}}]}}

`terms` has one entry per positive delay; the matrices are those of the inequalities. Beside
them "states" or "controls", numbers from 1, is the support of the delay; without it the terms are
about the whole state. The claim lists the theorem's hypotheses in full.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from cosim.core import InputError, format_value
from cosim.hinf.certificate.ages_proof import ages_claim, ages_proved, shapes_of_proof
from cosim.hinf.certificate.ages_terms import (
    AgesVariables,
    AgeTerms,
    check_functionals,
    check_supports,
    is_symmetric_unknown,
    late_delays,
)
from cosim.hinf.certificate.analysis_certificate import loop_from_json
from cosim.hinf.certificate.analysis_variables import check_null, order_from_json
from cosim.hinf.certificate.block_multipliers import eps_from_json, eps_to_json, exact_eps
from cosim.hinf.certificate.proof import CertificateCheck
from cosim.hinf.certificate.system_json import known_keys, system_to_json
from cosim.hinf.certificate.theorem import theorem_of
from cosim.hinf.exact import (
    exact,
    exact_matrix,
    exact_symmetric,
    from_text,
    matrix_from_text,
    matrix_to_text,
    to_text,
)
from cosim.hinf.theorems import UNKNOWNS, Support

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

AGES = "ages"
_VARIABLES = ("order", "P", "terms", "eps", "gamma", "down_to_zero")
_TERMS = ("functional", "matrices")
_SUPPORT: tuple[Literal["states", "controls"], ...] = ("states", "controls")


def exact_ages(system: DelaySystem, v: AgesVariables) -> AgesVariables:
    """Convert the doubles of `v` to rationals, and symmetrise the symmetric matrices exactly."""
    terms = tuple(
        AgeTerms(
            own.functional,
            {
                name: exact_symmetric(value) if is_symmetric_unknown(name) else exact_matrix(value)
                for name, value in own.matrices.items()
            },
            own.support,
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
                | _support_to_json(own.support)
                for own in v.terms
            ],
            "eps": eps_to_json(v.eps),
            "gamma": None if v.gamma is None else to_text(v.gamma),
            "down_to_zero": v.down_to_zero,
        },
        "K": gain.tolist(),
    }


def _support_to_json(support: Support | None) -> dict[str, list[int]]:
    return {} if support is None else {support.of: [i + 1 for i in support.numbers]}


def _support(table: dict[str, Any], where: str) -> Support | None:
    """Read what `_support_to_json` wrote; whether it holds is for `check_supports` to say."""
    given = [key for key in _SUPPORT if key in table]
    numbers = [table[key] for key in given]
    if len(given) > 1 or not all(
        isinstance(x, list) and all(type(i) is int for i in x) for x in numbers
    ):
        raise InputError(
            "not the support of a delay",
            where=where,
            expected=f"a list of integers, {' or '.join(_SUPPORT)}",
            got=", ".join(f"{key} {format_value(table[key])}" for key in given),
        )
    return Support(given[0], tuple(i - 1 for i in numbers[0])) if given else None


def check_ages(data: dict[str, Any]) -> CertificateCheck:
    """Check an analysis with known ages from its JSON alone, with rationals and no solver.

    Raises
    ------
    InputError : not a certificate. (Where the claim is not proved, no error: `valid` is False.)
    """
    system, gain, more = loop_from_json(data)
    v = _variables(system, gain, data["variables"])
    claim, symmetric = ages_claim(system, v), v.symmetric_matrices()
    return more.judged(
        data, (system, gain), claim, symmetric, lambda: ages_proved(system, gain, v).reason
    )


def _variables(system: DelaySystem, gain: Matrix, data: Any) -> AgesVariables:
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
        known_keys(table, f"variables.terms[{j}]", (*_TERMS, *_SUPPORT), required=_TERMS)
    functionals = tuple(table["functional"] for table in tables)
    check_functionals(system, functionals)
    supports = [_support(table, f"variables.terms[{j}]") for j, table in enumerate(tables)]
    check_supports(system, gain, supports)
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
    every = shapes_of_proof(system, gain, order, functionals, supports, bounded=gamma is not None)
    terms = []
    for j, (table, own) in enumerate(zip(tables, supports, strict=True)):
        shapes = {name: s for name in UNKNOWNS if (s := every.get(f"{name}[{j}]")) is not None}
        where = f"variables.terms[{j}].matrices"
        known_keys(table["matrices"], where, tuple(shapes), required=tuple(shapes))
        matrices = {
            name: matrix_from_text(
                table["matrices"][name], f"{where}.{name}", shape.height, shape.width
            )
            for name, shape in shapes.items()
        }
        terms.append(AgeTerms(table["functional"], matrices, own))
    return AgesVariables(
        order=order,
        P=matrix_from_text(data["P"], "variables.P", every["P"].height, every["P"].width),
        terms=tuple(terms),
        eps=eps_from_json(system, data["eps"], "variables.eps"),
        gamma=gamma,
        down_to_zero=data["down_to_zero"],
    )
