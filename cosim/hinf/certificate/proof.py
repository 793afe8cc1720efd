"""The exact proof of Theorem 2, corrected, for a closed loop, and its claim.

The conditions, in rational arithmetic, for the deployed K and Y := K X:

    -Omega > 0,  X > 0,  every Qbar_j > 0 (exactly 0 where any age is allowed),  k2_j /= 0.

-Omega > 0 implies Rbar_j > 0 for every delay dj > 0, every eps > 0 and gamma > |D1|. The terms of
each delay grow with it, so what holds at dj holds for every constant delay up to dj.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cosim.core import InputError, html_table
from cosim.hinf.certificate.block_multipliers import exact_eps
from cosim.hinf.certificate.document import claim_words, theorem_rows
from cosim.hinf.certificate.system_json import feedback_to_json
from cosim.hinf.certificate.theorem import theorem_of
from cosim.hinf.exact import asymmetric, exact, exact_symmetric, to_text
from cosim.hinf.theorems import ExactVariables, Shift, first_failure, minus_omega, positive
from cosim.models import DelaySystem, Matrix

MAX_ROWS = 400
"""Largest LMI that is checked; the vehicle's with two delays has some 70 rows."""


@dataclass(frozen=True)
class Variables:
    """The LMI's variables from a solver: float arrays and floats.

    X (n, n); Q, R one (n, n) per delay: Qbar = P^-1 Q P^-1, Rbar = R^-1 (Q zero for any age);
    k1, k2 one number per delay. `eps` is one number, or a tuple of one per block of F; it is
    ignored without uncertainty, `gamma` without w and z.
    """

    X: Matrix
    Q: tuple[Matrix, ...]
    R: tuple[Matrix, ...]
    eps: float | tuple[float, ...] | None
    k1: tuple[float, ...]
    k2: tuple[float, ...]
    gamma: float | None


@dataclass(frozen=True, repr=False)
class CertificateCheck:
    """Outcome of an exact check.

    valid : whether the claim is proved.
    reason : why it is not; None if it is.
    claim : the claim, as in the JSON (see `claim_of`).
    not_read : the keys of the file on which the outcome does not depend, as `figures`,
        `system.name`: notes and names, which nothing proves.
    """

    valid: bool
    reason: str | None
    claim: dict[str, Any]
    not_read: tuple[str, ...] = field(default=(), compare=False)  # of the file, not of the proof

    def __repr__(self) -> str:
        found = "valid" if self.valid else f"not valid: {self.reason}"
        return f"<CertificateCheck: {found}; {claim_words(self.claim)}>"

    def _repr_html_(self) -> str:
        """Return the outcome and every sentence of the theorem, as notebooks show them."""
        more = {"not read": ", ".join(self.not_read)} if self.not_read else {}
        return html_table(repr(self), theorem_rows(self.claim) | more)


def judged(
    data: dict[str, Any],
    claim: dict[str, Any],
    matrices: Iterable[tuple[str, Any]],
    reason: Callable[[], str | None],
    *,
    makers: str = "system and variables",
) -> CertificateCheck:
    """Check that a file claims what it can, and then the proof.

    Parameters
    ----------
    data : the certificate, with `claim`, and perhaps `theorem`.
    claim : the one that it makes.
    matrices : those that must be symmetric, with their names.
    reason : runs the proof; why the claim is not proved, or None.
    makers : the parts of the file that make the claim, for messages.
    """
    theorem, name = theorem_of(claim), asymmetric(matrices)
    why: str | None
    if data["claim"] != claim:
        why = f"the claim is not the one that {makers} make"
    elif data.get("theorem", theorem) != theorem:
        why = "the theorem is not the one of the claim"
    else:
        why = reason() if name is None else f"{name} is not symmetric"
    return CertificateCheck(valid=why is None, reason=why, claim=claim)


def claim_of(system: DelaySystem, gamma: Any) -> dict[str, Any]:
    """Return the claim of a certificate as JSON values.

    gamma : the rational bound of the gain from w to z; None if only stability is claimed.
    """
    return {
        "property": "stability" if gamma is None else "stability and H-infinity gain <= gamma",
        "gamma": None if gamma is None else to_text(gamma),
        "delays": [
            {
                "d": delay.d,
                "age": "any, however it varies, up to d" if delay.any_age else "constant, up to d",
                "feedback": feedback_to_json(delay.feedback),
            }
            for delay in system.delays
        ],
        **uncertainty_claim(system),
        "inputs": "doubles",
        **({} if system.feedback is None else {"feedback": feedback_to_json(system.feedback)}),
    }


def uncertainty_claim(system: DelaySystem) -> dict[str, Any]:
    """Return the part of a claim that says which F is covered: one full block, or several."""
    sizes = system.uncertainty_blocks
    more = {} if sizes is None else {"uncertainty_blocks": [list(size) for size in sizes]}
    return {"uncertain": bool(system.blocks), **more}


def proved(system: DelaySystem, gain: Matrix, v: ExactVariables) -> CertificateCheck:
    """Prove the claim of `claim_of` for u = K x(t-d_f), or return why it is not proved.

    Parameters
    ----------
    system : its doubles are taken exactly.
    gain : (m, n) K, its doubles taken exactly.
    v : symmetric matrices and numbers that fit the system.

    Raises
    ------
    InputError : the LMI has more than `MAX_ROWS` rows.
    """
    reason = failure(system, gain, v)
    return CertificateCheck(valid=reason is None, reason=reason, claim=claim_of(system, v.gamma))


def require_size(
    got: int, most: int = MAX_ROWS, what: str = "rows", *, done: str = "proved"
) -> None:
    """Refuse a proof with more of something than are tried; `done` : what is done with the LMI.

    Raises
    ------
    InputError : more than `most`.
    """
    if got > most:
        raise InputError(
            f"the LMI is too large to be {done} here",
            where="system",
            expected=f"at most {most} {what}",
            got=f"{got} {what}",
        )


def failure(
    system: DelaySystem, gain: Matrix, v: ExactVariables, shift: Shift | None = None
) -> str | None:
    """Return which condition is not proved; None if all are. `shift`: for the shifted system.

    Raises
    ------
    InputError : as `proved`.
    """
    if system.is_structured:
        raise InputError(
            "Theorem 2 is for the whole state, fed back at once or through one delay",
            where="system: feedback",
            expected="a system without feedback of single states, or another kind of certificate",
            hint='an analysis of the gain proves it: kind "analysis" or "ages"',
        )
    rows = (1 + 3 * len(system.delays)) * system.A.shape[0] + system.H.shape[0]
    rows += system.C.shape[1] + system.D.shape[0] if v.gamma is not None else 0
    require_size(rows)
    for j, delay in enumerate(system.delays):
        if v.k2[j] == 0:
            return f"k2[{j}] is 0"
        if delay.any_age and v.Q[j] != 0 * v.Q[j]:
            return f"Q[{j}] is not exactly 0, as a delay of any age needs"
    bounded = v.gamma is not None
    form = minus_omega(system, v.k1, v.k2, bounded=bounded, gain=gain, shift=shift)
    return first_failure([*positive(system), form], v.by_name())


def exact_variables(system: DelaySystem, v: Variables) -> ExactVariables:
    """Convert the doubles of `v` to rationals, and symmetrise the matrices exactly.

    Raises
    ------
    InputError : if shapes do not fit the system or a number is not finite.
    """
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
        return exact_symmetric(array)

    def scalar(name: str, value: float | None) -> Any:
        if value is None or not np.isfinite(value):
            raise InputError("not finite", where=name, expected="a finite number", got=repr(value))
        return exact(value)

    return ExactVariables(
        X=symmetric("X", v.X),
        Q=tuple(symmetric(f"Q[{j}]", Q) for j, Q in enumerate(v.Q)),
        R=tuple(symmetric(f"R[{j}]", R) for j, R in enumerate(v.R)),
        eps=exact_eps(system, v.eps),
        k1=tuple(scalar(f"k1[{j}]", value) for j, value in enumerate(v.k1)),
        k2=tuple(scalar(f"k2[{j}]", value) for j, value in enumerate(v.k2)),
        gamma=scalar("gamma", v.gamma) if system.has_performance else None,
    )
