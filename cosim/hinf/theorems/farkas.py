"""Farkas' lemma for any theorem: multipliers that leave no solution to its inequalities.

Inequalities M_k(v) > 0 are affine in their unknowns v. Multipliers W_k >= 0, not all zero, with

    sum_k <W_k, M_k(v)> = c   for every v,   c <= 0,

leave no v that meets them all: the left side would be positive. <A, B> is the sum of A_ij B_ij.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import flint

from cosim.hinf.theorems.inequality import HALF, Inequality, shapes_of


def products(
    inequalities: Sequence[Inequality], multipliers: Sequence[Any], fixed: Mapping[str, Any]
) -> tuple[dict[str, Any], Any]:
    """Return sum_k <W_k, M_k(v)> as <C, U> for each unknown U, by name, and its constant.

    C is a `fmpq_mat`, symmetric where U is, 1 x 1 where U is a number.

    Parameters
    ----------
    multipliers : one symmetric `fmpq_mat` W_k per inequality.
    fixed : numbers that are no unknowns here, by name.
    """
    shapes, constant = shapes_of(inequalities), flint.fmpq(0)
    by_name: dict[str, Any] = {}
    for inequality, W in zip(inequalities, multipliers, strict=True):
        for unknown, left, right, weight, is_number in inequality.terms:
            product = 2 * weight * left.on(inequality.rows) * W
            product *= right.on(inequality.rows).transpose()
            if unknown is None or is_number:
                product = flint.fmpq_mat(1, 1, [sum(product[i, i] for i in range(product.nrows()))])
            if unknown is None or unknown in fixed:
                constant += product[0, 0] * (1 if unknown is None else fixed[unknown])
                continue
            if shapes[unknown].symmetric:
                product = HALF * (product + product.transpose())
            by_name[unknown] = by_name[unknown] + product if unknown in by_name else product
    return by_name, constant


def farkas_failure(
    inequalities: Sequence[Inequality], multipliers: Sequence[Any], fixed: Mapping[str, Any]
) -> str | None:
    """Return which unknown is not cancelled, or that the constant is positive; None if neither."""
    left, constant = products(inequalities, multipliers, fixed)
    for name, C in left.items():
        for i in range(C.nrows()):
            for j in range(C.ncols()):
                if C[i, j] != 0:
                    return f"the multipliers do not cancel {name}[{i}][{j}]"
    return "the multipliers leave a positive constant" if constant > 0 else None
