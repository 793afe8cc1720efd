"""A design of observer and gain for a vehicle: searched, or from a rule where actuators lag.

The rule: K of a linear-quadratic regulator on the model without delays, L = c C'/d of each
measurement, which is stable alone for every age up to d where c < 1. It is proved as any other pair
of gains is, and not the best one; the search (`design_output_feedback`) is, but loses its way among
the fast states of actuators.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from cosim import hinf
from cosim.core import NotAchievableError
from cosim.models import DelaySystem, Measurement

_SHARES = (0.4, 0.2)
"""c of L = c C'/d."""
_SMALL = 1e-4
_DIGITS = 4
_BITS = 12


def observed_design(system: DelaySystem, measured: Sequence[Measurement]) -> hinf.OutputFeedback:
    """Return a certified observer and gain.

    Raises
    ------
    NotAchievableError : none could be certified.
    """
    estimated = estimated_states(system)
    if all(estimated):
        return hinf.design_output_feedback(system, measured)
    K = regulator(system)
    refused = NotAchievableError("no gains were tried")
    for share in _SHARES:
        L = [_short(share / x.d * x.C.T) for x in measured]
        try:
            return hinf.design_output_feedback(
                system, measured, gain=K, injections=L, order=0, estimated=estimated
            )
        except NotAchievableError as error:
            refused = error
    raise refused


def estimated_states(system: DelaySystem) -> list[bool]:
    """Return which states must be estimated: not what a lag makes of the commands alone."""
    A = np.abs(system.A) + sum((np.abs(d.A) for d in system.delays), np.zeros_like(system.A))
    driven = np.asarray(np.hstack([system.C, system.E]).any(axis=1))
    commanded = np.asarray(system.B.any(axis=1))
    return [bool(driven[i] or not commanded[i] or np.delete(A[i], i).any()) for i in range(len(A))]


def regulator(system: DelaySystem) -> np.ndarray:
    """Return K (m, n) of a linear-quadratic regulator, to four digits.

    Raises
    ------
    NotAchievableError : the commands do not stabilise the vehicle.
    """
    n, m = system.B.shape
    A = system.A + sum((d.A for d in system.delays), np.zeros_like(system.A))
    Q = system.D.T @ system.D + _SMALL * np.eye(n)
    R = system.D2.T @ system.D2 + _SMALL**2 * np.eye(m)
    try:
        P = scipy.linalg.solve_continuous_are(A, system.B, Q, R)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise NotAchievableError(
            "the commands do not stabilise the controlled states",
            where="control.states",
            got=str(error),
            hint="fewer states, or actuators that move them",
        ) from error
    K = -np.linalg.solve(R, system.B.T @ P)
    return np.array([[float(f"{x:.{_DIGITS}g}") for x in row] for row in K])


def _short(L: np.ndarray) -> np.ndarray:
    """Round to so few bits that products with the noise are exact."""
    largest = np.abs(L).max(axis=0)
    step = np.exp2(np.floor(np.log2(np.where(largest > 0, largest, 1.0))) - _BITS)
    return np.asarray(np.round(L / step) * step + 0.0)
