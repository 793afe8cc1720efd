"""A reference solver for delay differential equations that shares no code with the simulator.

    x'(t) = f(t, x(t), [x(t - d_1), ..., x(t - d_m)])

by the method of steps: SciPy's DOP853 from one discontinuity to the next, with the solver's
own dense output for the delayed values. A jump of x' at s (the start, a switch of an input, a
kink of the history) comes back as a jump of the (k+1)-th derivative at s plus any sum of k
delays. Every such image up to `DEPTH` delays ends an integration, so that nothing but smooth
pieces is ever integrated. For tests: exact to about ten digits, and in no hurry.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, field
from itertools import combinations_with_replacement, pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.integrate import solve_ivp

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from scipy.integrate import OdeSolution

    Array = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
    Rate = Callable[[float, Array, list[Array]], Sequence[float] | Array]

DEPTH = 7
"""Delays summed up for images: one order more than DOP853's dense output can notice."""

NEAR = 1e-11
"""Stops closer than this [s] are one and the same, but for rounding."""


@dataclass(frozen=True)
class Hold:
    """Piecewise-constant input: `values[k]` from `times[k]` (included) to `times[k+1]`.

    Before `times[0]` it is `values[0]`. Pass `times` to `solve` as `switches`.
    """

    times: Sequence[float]
    values: Sequence[Array | float]

    def __call__(self, t: float) -> Array | float:
        return self.values[max(bisect_right(self.times, t) - 1, 0)]


@dataclass
class Solution:
    """x(t) from the oldest history to the end; grows while it is being computed."""

    history: Callable[[float], Array]
    knots: list[float]
    pieces: list[OdeSolution] = field(default_factory=list)

    def __call__(self, t: float) -> Array:
        """Give x(t), shape (n,)."""
        if t <= self.knots[0]:
            return self.history(t)
        if t > self.knots[-1]:
            raise ValueError(f"time: expected at most {self.knots[-1]}, got {t}")
        k = min(bisect_right(self.knots, t), len(self.pieces)) - 1
        value: Array = self.pieces[k](t)
        return value

    def sample(self, times: Sequence[float] | Array) -> Array:
        """Give x at several times, shape (len(times), n)."""
        return np.array([self(float(t)) for t in times])


def smooth_segments(
    jumps: Sequence[float], delays: Sequence[float], end: float
) -> list[tuple[float, float]]:
    """Cut [0, end] at the jumps and their images, no segment longer than the shortest delay.

    Of two stops that differ by rounding alone, the one made of fewer delays stays: a switch
    stays as it was given.
    """
    shifts = [
        (math.fsum(sum_of), count)
        for count in range(DEPTH + 1)
        for sum_of in combinations_with_replacement(delays, count)
    ]
    stops = [(0.0, -1)]
    images = [(t + shift, count) for t in jumps for shift, count in shifts]
    for t, count in sorted([*images, *((shift, n) for shift, n in shifts), (end, -1)]):
        if t - stops[-1][0] > NEAR and t < end + NEAR:
            stops.append((t, count))
        elif abs(t - stops[-1][0]) <= NEAR and count < stops[-1][1]:
            stops[-1] = (t, count)
    longest = min(delays, default=math.inf)
    segments: list[tuple[float, float]] = []
    for (a, _), (b, _) in pairwise(stops):
        parts = max(1, math.ceil((b - a) / longest - 1e-12))
        segments += pairwise([a + (b - a) * k / parts for k in range(parts)] + [b])
    return segments


def solve(
    f: Rate,
    history: Sequence[float] | Callable[[float], Sequence[float]],
    delays: Sequence[float],
    end: float,
    *,
    switches: Sequence[float] = (),
    rtol: float = 1e-12,
    atol: float = 1e-13,
) -> Solution:
    """Integrate from t = 0 to `end`.

    Parameters
    ----------
    f : x'(t) from t, x(t) (n,) and the list of x(t - d_i). Inputs are read inside f at the t
        it is given, which never is a switching time itself: on either side of one it is
        moved inward by one unit in the last place.
    history : x(t) for t <= 0: a constant (n,), or a function continuous with x(0).
    delays : d_1 ... d_m [s]; 0 stands for the present state.
    end : last time [s].
    switches : times at which inputs jump, and kinks of the history (negative).
    rtol, atol : tolerances of DOP853.
    """
    if callable(history):
        past: Callable[[float], Array] = lambda t: np.asarray(history(t), dtype=float)  # noqa: E731
    else:
        constant = np.array(history, dtype=float)
        past = lambda t: constant  # noqa: ARG005, E731
    real = sorted({d for d in delays if d > 0})
    solution = Solution(past, [0.0])
    x = past(0.0)
    for a, b in smooth_segments(switches, real, end):
        low, high = math.nextafter(a, math.inf), math.nextafter(b, -math.inf)

        def rate(t: float, x: Array, a: float = a, low: float = low, high: float = high) -> Array:
            inside = min(max(t, low), high)
            delayed = [solution(min(inside - d, a)) if d > 0 else x for d in delays]
            return np.asarray(f(inside, x, delayed), dtype=float)

        run = solve_ivp(rate, (a, b), x, "DOP853", dense_output=True, rtol=rtol, atol=atol)
        if not run.success or run.sol is None:
            raise ArithmeticError(f"reference integration on [{a}, {b}]: {run.message}")
        x = run.y[:, -1]
        solution.pieces.append(run.sol)
        solution.knots.append(b)
    return solution
