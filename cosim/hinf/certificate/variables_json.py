"""The LMI's variables as JSON, exact numbers as "p/q", of a design and of each guarantee.

    {"X": [["p/q", ...]], "Q": [...], "R": [...], "eps": ..., "k1": [...], "k2": [...],
     "gamma": ...}

eps is a list where F has several blocks. Y = K X is left out; the certificate of a design adds it.
"""

from __future__ import annotations

from typing import Any

from cosim.core import InputError, format_value
from cosim.hinf.certificate.block_multipliers import eps_from_json, eps_to_json
from cosim.hinf.certificate.system_json import known_keys
from cosim.hinf.exact import from_text, matrix_from_text, matrix_to_text, to_text
from cosim.hinf.theorems import ExactVariables
from cosim.models import DelaySystem

_KEYS = ("X", "Q", "R", "eps", "k1", "k2", "gamma")


def variables_to_json(v: ExactVariables) -> dict[str, Any]:
    """Return the JSON values that `variables_from_json` reads."""
    return {
        "X": matrix_to_text(v.X),
        "Q": [matrix_to_text(Q) for Q in v.Q],
        "R": [matrix_to_text(R) for R in v.R],
        "eps": eps_to_json(v.eps),
        "k1": [to_text(value) for value in v.k1],
        "k2": [to_text(value) for value in v.k2],
        "gamma": None if v.gamma is None else to_text(v.gamma),
    }


def variables_from_json(
    data: Any, system: DelaySystem, where: str, *, gain: bool
) -> ExactVariables:
    """Read the variables of `system` that `variables_to_json` wrote; messages name `where`.

    gain : whether a gamma is expected.

    Raises
    ------
    InputError : a missing key, a wrong shape, a text that is no number.
    """
    known_keys(data, where, _KEYS, required=_KEYS)
    n, N = system.A.shape[0], len(system.delays)
    for name in ("Q", "R", "k1", "k2"):
        if not isinstance(data[name], list) or len(data[name]) != N:
            raise InputError("one per delay", where=f"{where}.{name}", expected=f"a list of {N}")

    def scalar(name: str, *, needed: bool) -> Any:
        if needed != (data[name] is not None):
            raise InputError(
                "does not fit the system",
                where=f"{where}.{name}",
                expected="a number" if needed else "null",
                got=format_value(data[name]),
            )
        return from_text(data[name], f"{where}.{name}") if needed else None

    def matrices(name: str) -> tuple[Any, ...]:
        place = f"{where}.{name}"
        return tuple(matrix_from_text(M, f"{place}[{j}]", n, n) for j, M in enumerate(data[name]))

    def scalars(name: str) -> tuple[Any, ...]:
        return tuple(from_text(x, f"{where}.{name}[{j}]") for j, x in enumerate(data[name]))

    return ExactVariables(
        X=matrix_from_text(data["X"], f"{where}.X", n, n),
        Q=matrices("Q"),
        R=matrices("R"),
        eps=eps_from_json(system, data["eps"], f"{where}.eps"),
        k1=scalars("k1"),
        k2=scalars("k2"),
        gamma=scalar("gamma", needed=gain),
    )
