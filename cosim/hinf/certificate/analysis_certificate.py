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
    MAX_ORDER,
    AnalysisVariables,
    ExactAnalysis,
    analysis_claim,
    analysis_proved,
    orders_of,
)
from cosim.hinf.certificate.block_multipliers import eps_from_json, eps_to_json, exact_eps
from cosim.hinf.certificate.guarantees import Guarantees, guarantees_from_json
from cosim.hinf.certificate.proof import CertificateCheck
from cosim.hinf.certificate.rational import (
    exact,
    exact_symmetric,
    from_text,
    matrix_from_text,
    matrix_to_text,
    to_text,
)
from cosim.hinf.certificate.system_json import (
    format_value,
    known_keys,
    matrix_from_rows,
    system_from_json,
    system_to_json,
)
from cosim.hinf.certificate.theorem import theorem_of

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem, Matrix

KIND = "analysis"
_KEYS = ("kind", "claim", "system", "variables", "K")
_REQUIRED = ("order", "P", "Q", "R", "eps", "gamma")
_VARIABLES = (*_REQUIRED, "lower")


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
    lower = None if v.lower is None else [None if d is None else to_text(d) for d in v.lower]
    claim = analysis_claim(system, v)
    return {
        "kind": KIND,
        "theorem": theorem_of(claim),
        "claim": claim,
        "system": system_to_json(system),
        "variables": variables_to_json(v) | ({} if lower is None else {"lower": lower}),
        "K": gain.tolist(),
    }


def variables_to_json(v: ExactAnalysis) -> dict[str, Any]:
    """Return the variables but `lower` as JSON values."""
    return {
        "order": v.order,
        "P": matrix_to_text(v.P),
        "Q": [None if Q is None else matrix_to_text(Q) for Q in v.Q],
        "R": [matrix_to_text(R) for R in v.R],
        "eps": eps_to_json(v.eps),
        "gamma": None if v.gamma is None else to_text(v.gamma),
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


def order_from_json(order: Any) -> int:
    """Read the order of a certificate.

    Raises
    ------
    InputError : no integer, or out of range.
    """
    if isinstance(order, bool) or not isinstance(order, int) or not 0 <= order <= MAX_ORDER:
        raise InputError(
            "not an order",
            where="variables.order",
            expected=f"an integer from 0 to {MAX_ORDER}",
            got=format_value(order),
        )
    return order


def check_null(name: str, value: Any, *, expected: bool) -> None:
    """Refuse a value where null is `expected`, and null where a value is.

    Raises
    ------
    InputError : naming the variable.
    """
    if (value is None) != expected:
        raise InputError(
            "does not fit the system",
            where=f"variables.{name}",
            expected="null" if expected else "a value",
            got="null" if value is None else "a value",
        )


def variables_from_json(system: DelaySystem, data: Any, where: str = "variables") -> ExactAnalysis:
    """Read the variables of an analysis of a system; messages of the table name `where`.

    Raises
    ------
    InputError : a missing key, a wrong shape, a number that is none.
    """
    known_keys(data, where, _VARIABLES, required=_REQUIRED)
    order = order_from_json(data["order"])
    n, orders = system.A.shape[0], orders_of(system, order)
    late = [delay for delay in system.delays if delay.d > 0]
    for name in ("Q", "R"):
        if not isinstance(data[name], list) or len(data[name]) != len(late):
            raise InputError(
                "one per positive delay",
                where=f"variables.{name}",
                expected=f"a list of {len(late)}",
                got=format_value(data[name]),
            )
    checks = [(f"Q[{j}]", data["Q"][j], delay.any_age) for j, delay in enumerate(late)]
    if not system.has_performance:
        checks.append(("gamma", data["gamma"], True))
    for name, value, expected in checks:
        check_null(name, value, expected=expected)
    rows = n * (1 + sum(orders))
    return ExactAnalysis(
        order=order,
        P=matrix_from_text(data["P"], "variables.P", rows, rows),
        Q=tuple(
            None if Q is None else matrix_from_text(Q, f"variables.Q[{j}]", n, n)
            for j, Q in enumerate(data["Q"])
        ),
        R=tuple(matrix_from_text(R, f"variables.R[{j}]", n, n) for j, R in enumerate(data["R"])),
        eps=eps_from_json(system, data["eps"], "variables.eps"),
        gamma=None if data["gamma"] is None else from_text(data["gamma"], "variables.gamma"),
        lower=_lower(late, order, data["lower"]) if "lower" in data else None,
    )


def _lower(late: list[Delay], order: int, texts: Any) -> tuple[Any, ...]:
    """The least of each positive delay: from 0 to the delay, null where any age is allowed."""
    fits = order > 0 and isinstance(texts, list) and len(texts) == len(late)
    if not fits or any((x is None) != delay.any_age for x, delay in zip(texts, late, strict=True)):
        raise InputError(
            "does not fit the system",
            where="variables.lower",
            expected=f"from order 1 on: {len(late)} numbers, null where any age is allowed",
            got=format_value(texts),
        )
    lower = []
    for j, (text, delay) in enumerate(zip(texts, late, strict=True)):
        low = None if text is None else from_text(text, f"variables.lower[{j}]")
        if low is not None and not 0 <= low <= exact(delay.d):
            raise InputError(
                "not below the delay",
                where=f"variables.lower[{j}]",
                expected=f"0 to {delay.d}",
                got=format_value(text),
            )
        lower.append(low)
    return tuple(lower)
