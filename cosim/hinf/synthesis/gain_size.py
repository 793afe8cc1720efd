"""A remark on a gain that is far larger than its loop has reason to need.

Without a price on u in z, or without one that matters, a smaller gamma always asks for more gain,
and the solver returns one of 10^10 as readily as one of 10. What is large depends on the units.
Two figures that do not:

* the fastest rate of the loop, the largest |lambda| of the sum of its A_i + B K, against that
  without control and the inverse of its longest delay. Both are the same in all units of x and u.
* |B K| against |A_i|, both in 1/s; these change with the units of the states, so that the factor
  is more generous.

Where neither rate nor delay gives a scale, as of an integrator alone, it is 1/s.
"""

from __future__ import annotations

import numpy as np

from cosim.models import DelaySystem, Matrix

FASTER, FASTER_FREE = 1e3, 1e2
"""How much faster than all that it has to deal with a loop may be without a remark; free: where z
does not contain every input."""

LARGER = 1e6
"""How much larger than all |A_i| together |B K| may be without a remark."""


def gain_remark(system: DelaySystem, K: Matrix) -> str | None:
    """Return what is remarkable about the size of a gain K (m, n), with the cure; or None."""
    open_ = system.A + sum((delay.A for delay in system.delays), np.zeros_like(system.A))
    added = system.B @ K
    longest = max((delay.d for delay in system.delays), default=0.0)
    fastest = max(_fastest(open_), _fastest(system.A), 1 / longest if longest > 0 else 0.0)
    scale = fastest if fastest > 0 else 1.0
    size = sum((_norm(delay.A) for delay in system.delays), _norm(system.A))
    faster, larger = _fastest(open_ + added) / scale, _norm(added) / max(size, scale)
    free = not system.has_performance or not system.D2.any(axis=0).all()
    most = FASTER_FREE if free else FASTER
    if faster <= most and larger <= LARGER:
        return None
    why = (
        f"it makes the loop {faster:.1e} times as fast as the system and its delays"
        if faster > most
        else f"|B K| is {larger:.1e} times what the system's own matrices are"
    )
    price = (
        "z does not contain every input: give u a weight in z (rows of D2)"
        if free
        else "give u a larger weight in z (D2, or weights)"
    )
    return f"|K| = {_norm(K):.3g} is very large: {why}; {price}, or bound |K| with a gain limit"


def _fastest(A: Matrix) -> float:
    return float(np.abs(np.linalg.eigvals(A)).max())


def _norm(A: Matrix) -> float:
    return float(np.linalg.norm(A, 2)) if A.size else 0.0
