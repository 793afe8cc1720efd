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

from cosim.hinf.certificate.claim import uncertainty_claim
from cosim.hinf.certificate.words import PROPERTIES
from cosim.hinf.exact import asymmetric, first_bad_matrix, to_text
from cosim.hinf.theorems import (
    Inequality,
    Shape,
    farkas_failure,
    minus_omega,
    positive,
    rates_from_rows,
    require_size,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from cosim.models import DelaySystem


@dataclass(frozen=True)
class Place:
    """Where the LMI is refuted: rationals, k1 and k2 one per delay; gamma None: stability."""

    k1: tuple[Any, ...]
    k2: tuple[Any, ...]
    gamma: Any


def conditions(system: DelaySystem, place: Place) -> list[Inequality]:
    """Return the inequalities that have no solution: -Omega at a place, X and every Qbar_j.

    Raises
    ------
    InputError : the LMI has more than `MAX_ROWS` rows.
    """
    n, N = system.A.shape[0], len(system.delays)
    rows = (1 + 2 * N) * n + system.H.shape[0] + system.C.shape[1] + system.D.shape[0]
    require_size(rows, done="refuted")
    form = minus_omega(system, place.k1, place.k2, bounded=place.gamma is not None)
    return [form, *(one for one in positive(system) if not one.name.startswith("R"))]


def fixed_at(place: Place) -> dict[str, Any]:
    """Return the numbers of a place that are no unknowns of its inequalities."""
    return {} if place.gamma is None else {"gamma": place.gamma}


def refutation_claim(system: DelaySystem, place: Place) -> dict[str, Any]:
    """Return the claim of a refutation as JSON values."""
    return {
        "property": PROPERTIES["refutation"],
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


def shapes_of_multipliers(system: DelaySystem, place: Place) -> dict[str, Shape]:
    """Return the shapes of Z, X and every Q[j], as those of unknowns.

    Raises
    ------
    InputError : as `conditions`.
    """
    n = len(system.A)
    form, *others = conditions(system, place)
    sizes = {"Z": sum(form.rows.values())} | {one.name: n for one in others}
    return {name: Shape(n, n, symmetric=True, is_number=False) for name, n in sizes.items()}


def refutation_failure(
    system: DelaySystem, place: Place, multipliers: Mapping[str, Any]
) -> str | None:
    """Return why the claim of `refutation_claim` is not proved; None if it is.

    Parameters
    ----------
    multipliers : `fmpq_mat` of `shapes_of_multipliers`: Z on rows r_j in place of s_j, X, Q[j].

    Raises
    ------
    InputError : as `conditions`.
    """
    if any(value == 0 for value in place.k2):
        return "a k2 is 0"
    name = asymmetric(multipliers.items())
    if name is not None:
        return f"the multiplier {name} is not symmetric"
    bad = first_bad_matrix(multipliers.items())
    if bad is not None:
        return f"the multiplier {bad} is not positive definite"
    form, *others = conditions(system, place)
    back = rates_from_rows(system, form).inv()
    Z = back * multipliers["Z"] * back.transpose()
    each = [Z, *(multipliers[one.name] for one in others)]
    return farkas_failure([form, *others], each, fixed_at(place))
