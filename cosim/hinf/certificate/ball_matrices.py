"""Complex matrices of balls (`flint.acb_mat`): the exact closed loop, and bounds of norms."""

from __future__ import annotations

from typing import Any

import flint
import numpy as np

from cosim.hinf.certificate.rational import exact_matrix
from cosim.models import DelaySystem


def exact_terms(system: DelaySystem, K: Any) -> dict[float, tuple[Any, Any]]:
    """Return (A_i, D_i) of u = K x by delay, `flint.fmpq_mat`: d = 0 first, equal delays merged.

    K is (m, n) doubles; A_i + B K S_i and D2 K S_i are formed in rationals.
    """
    gain = exact_matrix(K)
    terms: dict[float, tuple[Any, Any]] = {}
    open_ = [(0.0, system.A, system.D)]
    open_ += [(x.d, x.A, np.zeros_like(system.D)) for x in system.delays]
    for (d, A, D), selection in zip(open_, system.selections, strict=True):
        on_state, on_output = exact_matrix(A), exact_matrix(D)
        if selection.any() and gain.nrows():
            selected = exact_matrix(K * selection)
            on_state = on_state + exact_matrix(system.B) * selected
            on_output = on_output + exact_matrix(system.D2) * selected
        if d in terms:
            on_state, on_output = terms[d][0] + on_state, terms[d][1] + on_output
        terms[d] = (on_state, on_output)
    return terms


def balls(matrix: Any) -> Any:
    """Convert a `flint.fmpq_mat` to a `flint.acb_mat` at the working precision."""
    return flint.acb_mat(flint.arb_mat(matrix))


def floats(matrix: Any) -> Any:
    """Return the centres of a `flint.acb_mat` as an array."""
    return np.array([[complex(x) for x in row] for row in matrix.tolist()])


def size(matrix: Any) -> Any:
    """Return the Frobenius norm, rounded up: a bound of the largest singular value."""
    return (matrix * matrix.conjugate().transpose()).trace().real.upper().sqrt()


def below(matrix: Any, square: Any) -> bool:
    """Whether it is proved that the largest singular value is less than sqrt(square).

    Elimination of square I - X*X without pivoting, as in `rational.first_bad_pivot`: a
    Hermitian matrix with positive pivots is positive definite.
    """
    star = matrix.conjugate().transpose()
    # either product has the largest singular value
    gram = star * matrix if matrix.ncols() <= matrix.nrows() else matrix * star
    n = gram.nrows()
    rows = [[-gram[i, j] for j in range(i)] + [square - gram[i, i].real] for i in range(n)]
    for k in range(n):
        pivot = rows[k][k]
        if not pivot > 0:
            return False
        for i in range(k + 1, n):
            factor = rows[i][k] / pivot
            for j in range(k + 1, i):
                rows[i][j] -= factor * rows[j][k].conjugate()
            rows[i][i] -= (factor * rows[i][k].conjugate()).real
    return True
