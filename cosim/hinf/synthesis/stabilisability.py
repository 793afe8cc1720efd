"""Test whether some gain can stabilise a system: Hautus' test at the unstable roots.

A root s of the open loop with Re s >= 0 is not moved by any u = K x(t-d_f), if

    rank [s I - sum_i A_i e^{-s d_i},  B] < n

(Bhat & Koivo, IEEE Trans. Autom. Control 21, 1976; a delay of the feedback multiplies B by
e^{-s d_f}, which is not zero). Computed, not proved: it only explains a failure.
"""

from __future__ import annotations

import numpy as np

from cosim.core import NotAchievableError
from cosim.hinf.delay_lti import characteristic_roots, close
from cosim.hinf.lmi import scaling_of
from cosim.models import DelaySystem

_RANK = 1e-8  # a singular value below this share of the largest is zero
_AXIS = 1e-8  # roots this near to the axis, in the system's own units, are on it


class NoGainError(NotAchievableError):
    """No other route leads to a gain either: the cause is the system, not the condition."""


def unstabilisable_root(system: DelaySystem) -> complex | None:
    """Return a root [1/s] with Re >= 0 that no gain moves; None if none is found."""
    units = scaling_of(system)
    inner = units.system(system)
    n, m = inner.B.shape
    try:
        roots = characteristic_roots(close(inner, np.zeros((m, n))), 2 * n + 8)
    except NotAchievableError:
        return None  # too many roots to be counted: nothing is known
    for s in roots:
        if s.real < -_AXIS:
            break
        matrix = s * np.eye(n) - inner.A
        for delay in inner.delays:
            matrix = matrix - delay.A * np.exp(-s * delay.d)
        values = np.linalg.svd(np.hstack([matrix, inner.B]), compute_uv=False)
        if values[-1] <= _RANK * max(float(values[0]), 1.0):
            return complex(s) / units.T
    return None


def unstabilisable_error(system: DelaySystem) -> NotAchievableError | None:
    """Return the error that names a root no gain moves; None if none is found."""
    root = unstabilisable_root(system)
    if root is None:
        return None
    where = f"{root.real:.6g}" + (f" +- {abs(root.imag):.6g}j" if root.imag else "")
    n = system.A.shape[0]
    what = "no input reaches" if system.B.any() else "there is no input that acts, so none reaches"
    return NoGainError(
        f"no gain stabilises this system: {what} its root at {where} 1/s",
        where=system.name or None,
        expected=f"rank [s I - sum A_i exp(-s d_i), B] = {n} at every root s with Re s >= 0",
        got=f"less at s = {where} 1/s",
        hint="an input that acts on it, a damping term if it is an integrator, or the system "
        "without the states that belong to it",
    )
