"""Farkas' lemma for the LMI of Theorem 2, in rational arithmetic: that it has no solution.

At fixed k1, k2, delays and gamma, -Omega of `theorem_2` is affine in v = (X, Y, Qbar, Rbar, eps).
Multipliers Z > 0, Z_X > 0 and Z_Qj > 0 (none where any age is allowed: Qbar_j = 0) with

    <Z, -Omega(v)> + <Z_X, X> + sum_j <Z_Qj, Qbar_j> = c   for every v,   c <= 0,

leave no v with -Omega > 0, X > 0, Qbar > 0: the left side would be positive. Z is written for rows
r_j of Theorem 2 and converted to the rows of `theorem_2`.

The equalities follow from the very terms of -Omega that prove solutions.

Other k1, k2 are another matter. But where there is no solution there is none at greater delays or
a smaller gamma either: rows s_j taken out, Omega grows with every dj, and falls with gamma.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cosim.hinf.certificate.proof import CertificateCheck, require_size, uncertainty_claim
from cosim.hinf.exact import first_bad_matrix, to_text
from cosim.hinf.theorems import Inequality, farkas_failure, minus_omega, positive, rates_from_rows

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
    """`flint.fmpq_mat`: Z on rows r_j in place of s_j; Q one per delay, None: any age."""

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
    height = sum(form.rows.values())
    if multipliers.Z.nrows() != height:
        return f"the multiplier Z has {multipliers.Z.nrows()} rows, the LMI {height}"
    back = rates_from_rows(system, form).inv()
    _, *of_others = (M for _, M in multipliers.matrices())
    Z = back * multipliers.Z * back.transpose()
    return farkas_failure([form, *others], [Z, *of_others], fixed_at(place))
