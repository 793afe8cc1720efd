"""The exact certificate: a proof, in rational arithmetic, of what the deployed K guarantees.

A solver's "optimal" lies at the edge and proves nothing. Here the solver's variables are
taken as the doubles that they are (dyadic rationals), the deployed K as its doubles, Y := K X
exactly, and the corrected LMI of Theorem 2 (`exact_lmi`) is shown to hold:

    -Omega > 0,  X > 0,  every Qbar_j > 0 (exactly 0 where any age is allowed),  k2_j /= 0.

-Omega > 0 implies Rbar_j > 0 for every delay dj > 0, eps > 0 and gamma > |D1|. The system's
matrices and delays are their doubles, too: the claim says `"inputs": "doubles"`.

As JSON a certificate carries everything that the proof needs and can be checked by anyone:

    {"claim": {...}, "system": {...}, "variables": {"X": [["p/q", ...]], ...}, "K": [[...]]}
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import flint
import numpy as np

from cosim.errors import InputError
from cosim.hinf.exact_lmi import ExactVariables, minus_omega
from cosim.hinf.rational import (
    exact,
    exact_matrix,
    first_bad_matrix,
    first_bad_pivot,
    from_text,
    is_symmetric,
    to_text,
)
from cosim.hinf.system_json import known_keys, matrix, system_from_json, system_to_json

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from cosim.models.delay_system import DelaySystem, Matrix

_KEYS = ("claim", "system", "variables", "K")
_VARIABLES = ("X", "Y", "Q", "R", "eps", "k1", "k2", "gamma")


@dataclass(frozen=True)
class Variables:
    """The LMI's variables as a solver leaves them: float arrays and floats.

    X (n, n); Q, R one (n, n) per delay: Qbar = P^-1 Q P^-1, Rbar = R^-1 (Q zero where any age
    is allowed); k1, k2 one number per delay. `eps` is not looked at where nothing is
    uncertain, `gamma` not where the system has no w or no z.
    """

    X: Matrix
    Q: tuple[Matrix, ...]
    R: tuple[Matrix, ...]
    eps: float | None
    k1: tuple[float, ...]
    k2: tuple[float, ...]
    gamma: float | None


@dataclass(frozen=True)
class Certificate:
    """Outcome of an exact check.

    valid : the claim is proved.
    reason : why it is not; None if it is.
    claim : what is proved if `valid`, as in the JSON (see `claim_of`).
    """

    valid: bool
    reason: str | None
    claim: dict[str, Any]


def certify(system: DelaySystem, K: ArrayLike, variables: Variables) -> Certificate:
    """Prove, or fail to prove, the LMI for u = K x(t-d_f) with the doubles of K.

    The matrices of `variables` are symmetrised first, exactly.

    Parameters
    ----------
    system : the system, its doubles taken exactly.
    K : (m, n) the gain that flies.
    variables : a solution of the LMI, as floats.

    Raises
    ------
    InputError
        If shapes do not fit or a number is not finite; never because an inequality fails.
    """
    gain = _gain(K, system)
    return _proved(system, gain, _exact_variables(system, variables))


def certificate_to_json(system: DelaySystem, K: ArrayLike, variables: Variables) -> dict[str, Any]:
    """What `check_certificate` checks, for `json.dumps`; says nothing about validity.

    Raises
    ------
    InputError
        If shapes do not fit or a number is not finite.
    """
    gain = _gain(K, system)
    v = _exact_variables(system, variables)
    return {
        "claim": claim_of(system, v.gamma),
        "system": system_to_json(system),
        "variables": {
            "X": _matrix_text(v.X),
            "Y": _matrix_text(exact_matrix(gain) * v.X),
            "Q": [_matrix_text(Q) for Q in v.Q],
            "R": [_matrix_text(R) for R in v.R],
            "eps": None if v.eps is None else to_text(v.eps),
            "k1": [to_text(value) for value in v.k1],
            "k2": [to_text(value) for value in v.k2],
            "gamma": None if v.gamma is None else to_text(v.gamma),
        },
        "K": gain.tolist(),
    }


def check_certificate(data: Any) -> Certificate:
    """Check a certificate from its JSON alone, with rational arithmetic and no solver.

    Top-level keys beside the four of the module's docstring are notes: nothing is claimed
    about them.

    Raises
    ------
    InputError
        For what is no certificate: a missing key, a wrong shape, a number that is none. A
        well-formed certificate whose claim is not proved is returned with `valid` False.
    """
    if not isinstance(data, dict):
        raise InputError(
            "not a certificate", expected="an object of keys", got=type(data).__name__
        )
    own = {key: data[key] for key in _KEYS if key in data}
    known_keys(own, "certificate", _KEYS, required=_KEYS)
    system = system_from_json(data["system"])
    n, m = system.B.shape
    gain = matrix(data["K"], "K")
    gain = _gain(gain if m else np.zeros((0, n)), system)
    v, Y = _variables_from_json(system, data["variables"])
    claim = claim_of(system, v.gamma)
    if data["claim"] != claim:
        return Certificate(
            valid=False,
            reason="the claim is not the one that system and variables make",
            claim=claim,
        )
    named = [("X", v.X), *((f"Q[{j}]", Q) for j, Q in enumerate(v.Q))]
    for name, value in [*named, *((f"R[{j}]", R) for j, R in enumerate(v.R))]:
        if not is_symmetric(value):
            return Certificate(valid=False, reason=f"{name} is not symmetric", claim=claim)
    if exact_matrix(gain) * v.X != Y:
        return Certificate(valid=False, reason="Y is not K X", claim=claim)
    return _proved(system, gain, v)


def read_certificate(path: str | Path) -> Any:
    """The data of a certificate file, for `check_certificate`.

    Raises
    ------
    InputError
        If the file cannot be read or is no JSON, with the line.
    """
    try:
        return json.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError("cannot be read", where=str(path), got=error.strerror) from error
    except json.JSONDecodeError as error:
        where = f"{path}, line {error.lineno}, column {error.colno}"
        raise InputError("not JSON", where=where, got=error.msg) from error
    except (ValueError, RecursionError) as error:
        raise InputError("not a certificate in JSON", where=str(path), got=str(error)) from error


def claim_of(system: DelaySystem, gamma: Any) -> dict[str, Any]:
    """What a valid certificate says, in words and numbers that JSON can carry.

    Parameters
    ----------
    system : the system.
    gamma : the rational bound of the gain from w to z; None if only stability is claimed.
    """
    return {
        "property": "stability" if gamma is None else "stability and H-infinity gain <= gamma",
        "gamma": None if gamma is None else to_text(gamma),
        "delays": [
            {
                "d": delay.d,
                "age": "any, however it varies, up to d" if delay.any_age else "constant, up to d",
                "feedback": delay.feedback,
            }
            for delay in system.delays
        ],
        "uncertain": bool(system.E.size),
        "inputs": "doubles",
    }


def _proved(system: DelaySystem, gain: Matrix, v: ExactVariables) -> Certificate:
    reason = _failure(system, gain, v)
    return Certificate(valid=reason is None, reason=reason, claim=claim_of(system, v.gamma))


def _failure(system: DelaySystem, gain: Matrix, v: ExactVariables) -> str | None:
    """Which condition is not proved; None if all are."""
    for j, delay in enumerate(system.delays):
        if v.k2[j] == 0:
            return f"k2[{j}] is 0"
        if delay.any_age and v.Q[j] != 0 * v.Q[j]:
            return f"Q[{j}] is not exactly 0, as a delay of any age needs"
    positive = [("X", v.X)]
    positive += [(f"Q[{j}]", v.Q[j]) for j, x in enumerate(system.delays) if not x.any_age]
    # where dj > 0, R is a diagonal block of -Omega
    positive += [(f"R[{j}]", v.R[j]) for j, x in enumerate(system.delays) if x.d == 0]
    name = first_bad_matrix(positive)
    if name is not None:
        return f"{name} is not positive definite"
    lmi = minus_omega(system, exact_matrix(gain) * v.X, v)
    bad = first_bad_pivot(lmi.lower)
    if bad is not None:
        total = len(lmi.lower)
        return (
            f"-Omega is not positive definite: pivot {bad + 1} of {total}, "
            f"in the rows of {lmi.row_names[bad]}, is not positive"
        )
    return None


def _gain(K: ArrayLike, system: DelaySystem) -> Matrix:
    gain = np.asarray(K, dtype=np.float64)
    n, m = system.B.shape
    if gain.shape != (m, n):
        raise InputError("wrong shape", where="K", expected=str((m, n)), got=str(gain.shape))
    if not np.isfinite(gain).all():
        raise InputError("not finite", where="K", expected="finite numbers", got=str(gain.tolist()))
    return gain


def _exact_variables(system: DelaySystem, v: Variables) -> ExactVariables:
    n, N = system.A.shape[0], len(system.delays)
    for name, values in (("Q", v.Q), ("R", v.R), ("k1", v.k1), ("k2", v.k2)):
        if len(values) != N:
            raise InputError("one per delay", where=name, expected=str(N), got=str(len(values)))

    def symmetric(name: str, value: Any) -> Any:
        array = np.asarray(value, dtype=np.float64)
        if array.shape != (n, n) or not np.isfinite(array).all():
            raise InputError(
                "not a matrix of finite numbers",
                where=name,
                expected=f"shape ({n}, {n})",
                got=f"shape {array.shape}",
            )
        rational = exact_matrix(array)
        return (rational + rational.transpose()) / flint.fmpq(2)

    def scalar(name: str, value: float | None) -> Any:
        if value is None or not np.isfinite(value):
            raise InputError("not finite", where=name, expected="a finite number", got=repr(value))
        return exact(value)

    return ExactVariables(
        X=symmetric("X", v.X),
        Q=tuple(symmetric(f"Q[{j}]", Q) for j, Q in enumerate(v.Q)),
        R=tuple(symmetric(f"R[{j}]", R) for j, R in enumerate(v.R)),
        eps=scalar("eps", v.eps) if system.E.size else None,
        k1=tuple(scalar(f"k1[{j}]", value) for j, value in enumerate(v.k1)),
        k2=tuple(scalar(f"k2[{j}]", value) for j, value in enumerate(v.k2)),
        gamma=scalar("gamma", v.gamma) if system.has_performance else None,
    )


def _variables_from_json(system: DelaySystem, data: Any) -> tuple[ExactVariables, Any]:
    """The variables and Y, as their texts say."""
    known_keys(data, "variables", _VARIABLES, required=_VARIABLES)
    (n, m), N = system.B.shape, len(system.delays)
    for name in ("Q", "R", "k1", "k2"):
        if not isinstance(data[name], list) or len(data[name]) != N:
            raise InputError(
                "one per delay", where=f"variables.{name}", expected=f"a list of {N}"
            )
    for name, needed in (("eps", bool(system.E.size)), ("gamma", system.has_performance)):
        if needed != (data[name] is not None):
            raise InputError(
                "does not fit the system",
                where=f"variables.{name}",
                expected="a number" if needed else "null",
                got=str(data[name])[:60],
            )
    v = ExactVariables(
        X=_matrix_from_text(data["X"], "variables.X", n, n),
        Q=tuple(_matrix_from_text(Q, f"variables.Q[{j}]", n, n) for j, Q in enumerate(data["Q"])),
        R=tuple(_matrix_from_text(R, f"variables.R[{j}]", n, n) for j, R in enumerate(data["R"])),
        eps=None if data["eps"] is None else from_text(data["eps"], "variables.eps"),
        k1=tuple(from_text(x, f"variables.k1[{j}]") for j, x in enumerate(data["k1"])),
        k2=tuple(from_text(x, f"variables.k2[{j}]") for j, x in enumerate(data["k2"])),
        gamma=None if data["gamma"] is None else from_text(data["gamma"], "variables.gamma"),
    )
    return v, _matrix_from_text(data["Y"], "variables.Y", m, n)


def _matrix_text(value: Any) -> list[list[str]]:
    return [
        [to_text(value[i, j]) for j in range(value.ncols())] for i in range(value.nrows())
    ]


def _matrix_from_text(rows: Any, where: str, height: int, width: int) -> Any:
    fits = (
        isinstance(rows, list)
        and len(rows) == height
        and all(isinstance(row, list) and len(row) == width for row in rows)
    )
    if not fits:
        raise InputError(
            "wrong shape", where=where, expected=f"{height} rows of {width} numbers as p/q"
        )
    entries = [
        from_text(entry, f"{where}[{i}][{j}]")
        for i, row in enumerate(rows)
        for j, entry in enumerate(row)
    ]
    return flint.fmpq_mat(height, width, entries)
