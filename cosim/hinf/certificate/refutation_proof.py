"""Farkas' lemma for the LMI of Theorem 2, in rational arithmetic: that it has no solution.

At fixed k1, k2, delays and gamma, -Omega of `theorem_2` is affine in v = (X, Y, Qbar, Rbar, eps).
Multipliers W >= 0, Z_X > 0 and Z_Qj > 0 (none where any age is allowed: Qbar_j = 0) with

    <W, -Omega(v)> + <Z_X, X> + sum_j <Z_Qj, Qbar_j> = c   for every v,   c <= 0,

leave no v with -Omega > 0, X > 0, Qbar > 0: the left side would be positive.

W is given as Z on the rows other than m_j. -Omega has -dj k1j Rbar_j, -dj k2j Rbar_j and
dj Rbar_j at (x,mj), (xj,mj) and (mj,mj): row m_j times k1j on row x, times k2j on row xj, leaves
rows m_j out. So with T = [I, M], M[x, mj] = k1j I, M[xj, mj] = k2j I, a Z > 0 makes
W = T'Z T >= 0, and not zero.

The equalities follow from the very terms of -Omega that prove solutions.

Other k1, k2 are another matter. But where there is no solution there is none at greater delays or
a smaller gamma either: rows r_j and m_j taken out, Omega grows with every dj, and falls with
gamma.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import flint

from cosim.hinf.certificate.proof import CertificateCheck, require_size, uncertainty_claim
from cosim.hinf.exact import first_bad_matrix, to_text
from cosim.hinf.theorems import Inequality, farkas_failure, minus_omega, positive

if TYPE_CHECKING:
    from cosim.models import DelaySystem


@dataclass(frozen=True)
class Place:
    """Where the LMI is refuted: rationals, k1 and k2 one per delay; gamma None: stability."""

    k1: tuple[Any, ...]
    k2: tuple[Any, ...]
    gamma: Any


@dataclass(frozen=True)
class Multipliers:
    """`flint.fmpq_mat`: Z on the rows of the LMI but m_j; Q one per delay, None: any age."""

    Z: Any
    X: Any
    Q: tuple[Any, ...]

    def matrices(self) -> list[tuple[str, Any]]:
        """Return every multiplier with its name: all must be symmetric and positive."""
        several = [(f"Q[{j}]", Q) for j, Q in enumerate(self.Q) if Q is not None]
        return [("Z", self.Z), ("X", self.X), *several]


def conditions(system: DelaySystem, place: Place) -> list[Inequality]:
    """Return the inequalities that have no solution: -Omega at a place, X and every Qbar_j."""
    form = minus_omega(system, place.k1, place.k2, bounded=place.gamma is not None)
    return [form, *(one for one in positive(system) if not one.name.startswith("R"))]


def kept_rows(form: Inequality) -> dict[str, int]:
    """Return the rows of -Omega that Z has, those of m_j left out."""
    return {name: size for name, size in form.rows.items() if not name.startswith("m")}


def lifted(form: Inequality, place: Place, Z: Any) -> Any:
    """Return W = T'Z T of all rows of -Omega."""
    kept, n = kept_rows(form), form.rows["x"]
    starts = dict(zip(kept, itertools.accumulate(kept.values(), initial=0), strict=False))
    T = flint.fmpq_mat(sum(kept.values()), sum(form.rows.values()))
    column = 0
    for name, size in form.rows.items():
        for i in range(size):
            if name.startswith("m"):
                j = int(name[1:])
                T[i, column] = place.k1[j - 1]
                T[j * n + i, column] = place.k2[j - 1]
            else:
                T[starts[name] + i, column] = 1
            column += 1
    return T.transpose() * Z * T


def fixed_at(place: Place) -> dict[str, Any]:
    """Return the numbers of a place that are no unknowns of its inequalities."""
    return {} if place.gamma is None else {"gamma": place.gamma}


def refutation_claim(system: DelaySystem, place: Place) -> dict[str, Any]:
    """Return the claim of a refutation as JSON values."""
    return {
        "property": "no X, Y, Q, R, eps meets the LMI of Theorem 2 at these k1, k2",
        "gamma": None if place.gamma is None else to_text(place.gamma),
        "k1": [to_text(value) for value in place.k1],
        "k2": [to_text(value) for value in place.k2],
        "delays": [
            {
                "d": delay.d,
                "age": ("any age up to it" if delay.any_age else "constant") + ", it or more",
                "feedback": delay.feedback,
            }
            for delay in system.delays
        ],
        **uncertainty_claim(system),
        "inputs": "doubles",
    }


def refuted(system: DelaySystem, place: Place, multipliers: Multipliers) -> CertificateCheck:
    """Prove the claim of `refutation_claim`, or return why it is not proved.

    Raises
    ------
    InputError : the LMI has more than `MAX_ROWS` rows.
    """
    reason = _failure(system, place, multipliers)
    return CertificateCheck(
        valid=reason is None, reason=reason, claim=refutation_claim(system, place)
    )


def _failure(system: DelaySystem, place: Place, multipliers: Multipliers) -> str | None:
    n, N = system.A.shape[0], len(system.delays)
    rows = (1 + 2 * N) * n + system.H.shape[0] + system.C.shape[1] + system.D.shape[0]
    require_size(rows, done="refuted")
    if any(value == 0 for value in place.k2):
        return "a k2 is 0"
    bad = first_bad_matrix(multipliers.matrices())
    if bad is not None:
        return f"the multiplier {bad} is not positive definite"
    form, *others = conditions(system, place)
    height = sum(kept_rows(form).values())
    if multipliers.Z.nrows() != height:
        return f"the multiplier Z has {multipliers.Z.nrows()} rows, the LMI {height}"
    own = [multipliers.X, *(Q for Q in multipliers.Q if Q is not None)]
    W = lifted(form, place, multipliers.Z)
    return farkas_failure([form, *others], [W, *own], fixed_at(place))
