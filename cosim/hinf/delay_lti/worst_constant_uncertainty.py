"""The worst gain of a loop that a search over constant F with F'F <= 1 finds: a lower bound.

A certified gamma is above the gain at every F, also one that varies. How far above it is cannot be
known, but a constant F with a large gain bounds it: gamma over that gain is at most what the proof
loses. At the peak of |G|, with its singular vectors u and v, the gain changes with F by

    Re(l dF r),    l = u*(D H^-1) E,    r = H_q H^-1 C v,

so that the F whose blocks are the orthogonal factors of Re(l' r') is the best for small F. It is
taken as a whole, or a part of the way where another peak is higher there, again from its own peak.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cosim.hinf.delay_lti.closed_loop import ClosedLoop, close
from cosim.hinf.delay_lti.norm import hinf_norm
from cosim.models import DelaySystem, Matrix

_ROUNDS = 6
_SHORTER = 0.3
"""Share of the way to the next F that is gone where the whole is too far."""


class WorstUncertainty(NamedTuple):
    """The largest gain that was found over constant F.

    gain : the H-infinity norm at F; infinite where a loop that is not stable was found.
    F : (s, r), block-diagonal, with F'F <= 1.
    """

    gain: float
    F: Matrix


def worst_uncertainty(system: DelaySystem, K: ArrayLike) -> WorstUncertainty:
    """Search for the constant F at which the gain from w to z is largest.

    Parameters
    ----------
    system : Eq. (7) with w, z and E, H; all delays are constants, the greatest.
    K : (m, n) state feedback.

    Raises
    ------
    InputError : no w or no z, or K that does not fit.
    NotAchievableError : roots that cannot be found (see `characteristic_roots`).
    """
    F = np.zeros((system.E.shape[1], system.H.shape[0]))
    best, share = WorstUncertainty(0.0, F), 1.0
    toward = F
    for _ in range(_ROUNDS):
        F = best.F + share * (toward - best.F)
        loop = close(_with(system, F), K)
        peak = hinf_norm(loop)
        if peak is None:
            return WorstUncertainty(np.inf, F)
        if not peak.value > best.gain * (1 + 1e-6):
            share *= _SHORTER  # another peak is higher there
            continue
        best = WorstUncertainty(peak.value, F)
        if not np.isfinite(peak.frequency):
            break
        toward = _steepest(system, loop, peak.frequency)
        if np.array_equal(toward, F):
            break
    return best


def _with(system: DelaySystem, F: Matrix) -> DelaySystem:
    """Return the system at one F."""
    EF = system.E @ F
    delays = tuple(replace(x, A=x.A + EF @ x.H) for x in system.delays)
    return replace(system, A=system.A + EF @ system.H, delays=delays)


def _steepest(system: DelaySystem, loop: ClosedLoop, omega: float) -> Matrix:
    """Return the F with F'F <= 1 along which the gain at a frequency grows most."""
    s = 1j * omega
    inverse = np.linalg.inv(s * np.eye(loop.order) - loop.state_matrix(s))
    u, _, v = np.linalg.svd(loop.transfer(omega))
    H = system.H + sum(
        (np.exp(-s * x.constant_age) * x.H for x in system.delays), np.zeros(system.H.shape)
    )
    left = u[:, 0].conj() @ loop.output_matrix(s) @ inverse @ system.E
    right = H @ inverse @ np.asarray(loop.C) @ v[0].conj()
    F = np.zeros((system.E.shape[1], system.H.shape[0]))
    for columns, rows in system.blocks:
        slope = np.outer(left[columns], right[rows]).real
        first, _, last = np.linalg.svd(slope, full_matrices=False)
        F[columns, rows] = first @ last
    return F
