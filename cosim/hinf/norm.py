"""The H-infinity norm of the nominal loop: the largest gain from w to z over all frequencies.

    T(j w) = (sum_i D_i e^{-j w d_i}) (j w I - sum_i A_i e^{-j w d_i})^-1 C + D1

The supremum includes w -> infinity, where T tends to D1. Three facts bound the search:

* beyond a = sum |A_i|, |T(j w) - D1| <= (sum |D_i|) |C| / (w - a): a frequency from which on
  nothing exceeds what has been found can be computed;
* a narrow peak belongs to a root near the axis: the grid holds the imaginary part of every
  root found, and points around it at the distance of its real part;
* between them |T| is sampled finely against the shortest time constant; every local maximum
  is refined, and the grid is halved until the result stays.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from cosim.errors import InputError
from cosim.hinf.closed_loop import ClosedLoop
from cosim.hinf.roots import characteristic_roots, spectral_abscissa

_TOLERANCE = 1e-11
_ROUNDS = 6
_AROUND = np.array([-8.0, -4.0, -2.0, -1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0])


class NormResult(NamedTuple):
    """Norm and the frequency [rad/s] where it is attained (infinity: only in the limit)."""

    value: float
    frequency: float


def gain_at(loop: ClosedLoop, omega: Any) -> NDArray[np.float64]:
    """Largest singular value of T(j omega), for an array of frequencies [rad/s].

    Raises
    ------
    InputError : the loop has no w or no z.
    """
    if loop.C is None or loop.D1 is None:
        raise InputError("this loop has no gain", expected="a disturbance w and an output z")
    s = 1j * np.atleast_1d(np.asarray(omega, dtype=float))
    resolvent = s[:, None, None] * np.eye(loop.order) - loop.state_matrix(s)
    states = np.linalg.solve(resolvent, np.broadcast_to(loop.C, (s.size, *loop.C.shape)))
    T = loop.output_matrix(s) @ states + loop.D1
    gains: NDArray[np.float64] = np.linalg.norm(T, ord=2, axis=(-2, -1))
    return gains


def hinf_norm(loop: ClosedLoop) -> NormResult | None:
    """The norm, to about ten digits; None where the loop is not asymptotically stable.

    Raises
    ------
    InputError : the loop has no w or no z.
    """
    if loop.C is None or loop.D1 is None:
        raise InputError("this loop has no norm", expected="a disturbance w and an output z")
    if spectral_abscissa(loop) >= 0:
        return None
    limit = float(np.linalg.norm(loop.D1, 2))
    roots = characteristic_roots(loop)
    best = NormResult(limit, math.inf)
    points = 400
    for _ in range(_ROUNDS):
        found = _sweep(loop, _grid(loop, roots, limit, points))
        improved = found.value > best.value * (1 + _TOLERANCE)
        if found.value > best.value:
            best = found
        if not improved:
            break
        points *= 2
    return best


def _grid(
    loop: ClosedLoop, roots: NDArray[np.complex128], limit: float, points: int
) -> NDArray[np.float64]:
    speed = sum(float(np.linalg.norm(A, 2)) for A in loop.A)
    assert loop.C is not None  # noqa: S101 - hinf_norm has refused a loop without
    reach = sum(float(np.linalg.norm(D, 2)) for D in loop.D) * float(np.linalg.norm(loop.C, 2))
    scale = max(limit, float(gain_at(loop, 0.0)[0]), 1e-300)
    # beyond `far` the gain stays within a thousandth of its limit, beyond `end` within 1e-10
    far = speed + 1e3 * reach / scale
    end = speed + 1e10 * reach / scale
    parts = [np.array([0.0]), np.geomspace(1e-6 * max(speed, 1e-6), end, points)]
    spacing = 0.5 / max(loop.delays[-1], 1e-9)
    parts.append(np.linspace(0.0, far, min(max(points, int(far / spacing)), 40 * points)))
    for root in roots:
        parts.append(np.abs(abs(root.imag) + _AROUND * max(abs(root.real), 1e-12)))
    return np.unique(np.concatenate(parts))


def _sweep(loop: ClosedLoop, grid: NDArray[np.float64]) -> NormResult:
    """Largest gain on the grid, every local maximum of it refined."""
    gains = gain_at(loop, grid)
    padded = np.concatenate(([-1.0], gains, [-1.0]))
    peaks = np.flatnonzero((gains >= padded[:-2]) & (gains >= padded[2:]))
    top = gains.max()
    best = NormResult(float(top), float(grid[int(np.argmax(gains))]))
    # what lies far below the largest sample cannot overtake it between two samples of a peak
    for k in peaks[gains[peaks] >= 0.5 * top]:
        low, high = grid[max(k - 1, 0)], grid[min(k + 1, grid.size - 1)]
        if not high > low:
            continue
        result = minimize_scalar(
            lambda w: -float(gain_at(loop, w)[0]),
            bounds=(low, high),
            method="bounded",
            options={"xatol": 1e-11 * max(high, 1e-12)},
        )
        if -result.fun > best.value:
            best = NormResult(float(-result.fun), float(result.x))
    return best
