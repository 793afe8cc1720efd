"""Output weights: factors of the rows of z = D x + D1 w + D2 u."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cosim.core import InputError, counted
from cosim.models import DelaySystem


def weighted(
    system: DelaySystem, weights: Sequence[float], *, where: str = "weights"
) -> DelaySystem:
    """Multiply row i of D, D1 and D2 by weights[i].

    The products are rounded to doubles; proofs are about those.

    Parameters
    ----------
    system : Eq. (7) with p outputs z.
    weights : p positive numbers.
    where : named in messages.

    Raises
    ------
    InputError : not one positive number per output, or an entry that overflows.
    """
    p = system.D.shape[0]
    values = np.array([float(value) for value in weights])
    if len(values) != p:
        raise InputError(
            "the weights do not fit the system",
            where=where,
            expected=f"{counted(p, 'number')}, one per output z"
            if p
            else "none: this system has no z",
            got=f"{len(values)} of them",
        )
    wrong = [value for value in values if not (math.isfinite(value) and value > 0)]
    if wrong:
        raise InputError(
            "not a weight",
            where=where,
            expected="positive numbers",
            got=f"{wrong[0]:g}",
            hint="leave an output without weight out of D, D1 and D2",
        )
    s, column = system, values[:, None]
    try:
        return replace(s, D=column * s.D, D1=column * s.D1, D2=column * s.D2)
    except ValueError as error:
        raise InputError(str(error), where=where) from error
