"""State-space models of other libraries: anything with A, B, C, D and `dt`.

python-control's `control.ss` and SciPy's `signal.StateSpace` make such; neither is imported.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def plant_from(model: Any, ncon: int) -> tuple[Matrix, Matrix, Matrix, Matrix, Matrix, Matrix]:
    """Split a state-space model as `control.hinfsyn` does: the last `ncon` inputs are controls.

    Parameters
    ----------
    model : has A (n, n), B (n, q + m), C (p, n), D (p, q + m), and `dt` 0 or None.
    ncon : m.

    Returns
    -------
    A, B, C, D, D1, D2 of Eq. (7): x' = A x + C w + B u, z = D x + D1 w + D2 u.

    Raises
    ------
    ValueError : no state-space model, a discrete one, or one with fewer inputs.
    """
    missing = [name for name in "ABCD" if not hasattr(model, name)]
    if missing:
        raise ValueError(
            f"plant: expected a state-space model with A, B, C and D, got {type(model).__name__} "
            "(control.ss makes one of a transfer function)"
        )
    dt = getattr(model, "dt", None)
    if dt is True or dt:  # in python-control, True is an unspecified step
        step = "an unspecified step" if dt is True else f"dt = {dt:g} s"
        raise ValueError(f"plant: expected continuous time, got a discrete model with {step}")
    try:
        A, B, C, D = (np.array(getattr(model, name), dtype=np.float64) for name in "ABCD")
    except (TypeError, ValueError) as error:
        raise ValueError("plant: expected A, B, C and D of real numbers") from error
    if B.ndim != 2 or isinstance(ncon, bool) or not 0 <= ncon <= B.shape[1]:
        inputs = B.shape[-1] if B.ndim else 0
        raise ValueError(f"ncon: expected 0 to {inputs}, the number of inputs, got {ncon!r}")
    q = B.shape[1] - ncon
    return A, B[:, q:], B[:, :q], C, D[:, :q], D[:, q:]
