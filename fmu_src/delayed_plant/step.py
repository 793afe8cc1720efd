"""The internal step that a plant starts with, from how fast its equation can be."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cosim.fmu import round_below

_SHARE = 0.16  # of the time in which x' can turn x over: RK4 then errs by some 1e-6 of x per unit
_LONGEST, _SHORTEST = 0.1, 1e-9  # [s]


def default_step(matrices: Mapping[str, np.ndarray]) -> float:
    """The largest of 1, 2, 5 times a power of ten with step (|A| + |A1| + ...) <= 0.16 [s].

    |.| is the Frobenius norm: no solution of x' = A x + A1 x(t-d) + ... moves faster. The
    example of section 5 gets its 0.01 s.

    Parameters
    ----------
    matrices : by letter; A and those of the delays, A1, A2, ..., are looked at.
    """
    rate = sum(
        math.hypot(*matrix.ravel()) for letter, matrix in matrices.items() if letter[0] == "A"
    )
    longest = min(_LONGEST, max(_SHARE / rate, _SHORTEST)) if rate > 0 else _LONGEST
    return round_below(longest)
