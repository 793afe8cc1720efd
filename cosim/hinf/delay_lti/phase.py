"""The argument principle in floating point: how far the phase of det M(s) turns along a path.

With f = det M, the steps are such that neither the phase nor f'/f allows a turn to be missed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Complexes = NDArray[np.complex128]

_PHASE = 0.7  # greatest phase [rad] and greatest |step f'/f| between neighbouring samples
_MOST_SAMPLES = 400_000  # beyond, counting takes minutes and gigabytes
_ROUNDS = 60
_LARGEST_START = 20_000.0


class Characteristic(Protocol):
    """A matrix M(s) that is singular at the characteristic roots of a system with delays."""

    @property
    def delays(self) -> Sequence[float] | Reals:
        """The delays [s]."""

    def characteristic_matrix(self, s: Any) -> tuple[Complexes, Complexes]:
        """Return M(s) and dM/ds, each s.shape + (k, k)."""

    def bound(self, real: float) -> float:
        """Return a bound of the terms of M(s) but s, Re s >= real [1/s]."""


class NotFollowedError(ArithmeticError):
    """The phase cannot be followed: a zero on the path (`where`), or too many samples (`many`)."""

    def __init__(self, where: float, *, many: bool) -> None:
        super().__init__(where)
        self.where, self.many = where, many


def log_derivative(system: Characteristic, s: Any) -> tuple[Complexes, Complexes]:
    """Return the phase factor f/|f| and f'/f of f = det M at the points `s`.

    Raises
    ------
    numpy.linalg.LinAlgError : M is singular there in doubles.
    """
    M, slope = system.characteristic_matrix(s)
    phase, _ = np.linalg.slogdet(M)
    return phase, np.trace(np.linalg.solve(M, slope), axis1=-2, axis2=-1)


def turn_along(
    sample: Callable[[Reals], tuple[Complexes, Complexes]], where: Reals
) -> tuple[float, Reals]:
    """Return the turn of f [rad] along a path, and the parameters it was sampled at.

    Parameters
    ----------
    sample : the phase factor of f and f'/f ds/dx at parameters x of the path.
    where : parameters to start from, rising.

    Raises
    ------
    NotFollowedError : a zero on the path, to rounding, or too many samples.
    """
    phase, slope = sample(where)
    speed = np.abs(slope)
    for _ in range(_ROUNDS):
        turn = np.angle(phase[1:] / phase[:-1])
        steep = np.diff(where) * np.maximum(speed[1:], speed[:-1]) > _PHASE
        split = np.flatnonzero(steep | (np.abs(turn) > _PHASE))
        if not split.size:
            return float(turn.sum()), where
        if where.size > _MOST_SAMPLES:
            break
        middle = 0.5 * (where[split] + where[split + 1])
        phases, slopes = sample(middle)
        where = np.insert(where, split + 1, middle)
        phase = np.insert(phase, split + 1, phases)
        speed = np.insert(speed, split + 1, np.abs(slopes))
    raise NotFollowedError(float(where[split[0]]), many=where.size > _MOST_SAMPLES)


def even_samples(low: float, high: float, longest: float) -> Reals:
    """Return frequencies [rad/s] to start from, close enough for the longest delay [s]."""
    return np.linspace(low, high, 65 + int(min(2.0 * (high - low) * longest, _LARGEST_START)))
