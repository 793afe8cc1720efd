"""Complex matrices of balls (`flint.acb_mat`), and bounds of their norms."""

from __future__ import annotations

from typing import Any

import flint
import numpy as np


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
