"""The variables of an analysis as JSON: every rational "p/q", none of it checked.

    {"order": 0, "P": [["p/q", ...]], "Q": [...], "R": [...], "eps", "gamma"}

and `lower`, as in `analysis_certificate`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cosim.core import InputError, format_value
from cosim.hinf.certificate.analysis_proof import MAX_ORDER, ExactAnalysis, orders_of
from cosim.hinf.certificate.block_multipliers import eps_from_json, eps_to_json
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.exact import exact, from_text, matrix_from_text, matrix_to_text, to_text

if TYPE_CHECKING:
    from cosim.models import Delay, DelaySystem

_REQUIRED = ("order", "P", "Q", "R", "eps", "gamma")
_VARIABLES = (*_REQUIRED, "lower")


def variables_to_json(v: ExactAnalysis) -> dict[str, Any]:
    """Return the variables as JSON values; `variables_from_json` reads them."""
    table: dict[str, Any] = {
        "order": v.order,
        "P": matrix_to_text(v.P),
        "Q": [None if Q is None else matrix_to_text(Q) for Q in v.Q],
        "R": [matrix_to_text(R) for R in v.R],
        "eps": eps_to_json(v.eps),
        "gamma": None if v.gamma is None else to_text(v.gamma),
    }
    if v.lower is not None:
        table["lower"] = [None if d is None else to_text(d) for d in v.lower]
    return table


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
