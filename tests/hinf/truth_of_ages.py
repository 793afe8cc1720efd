"""The truth about loops whose ages vary, apart from everything in `cosim.hinf`.

Sampled: between two instants the loop x' = A x + G x(s_k) has a closed form, so that a periodic
pattern of sampling intervals gives the matrix that takes the state over one period, and the
pattern is stable exactly where its spectral radius is below one. A constant delay of the
messages is on board: samples under way are part of the state. Delayed terms of constant delay
are not.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]


def over_a_hold(A: Array, G: Array, length: float) -> tuple[Array, Array]:
    """(Phi, Gamma) with x(t + length) = Phi x(t) + Gamma x_held for x' = A x + G x_held."""
    n = len(A)
    whole = expm(length * np.block([[A, G], [np.zeros((n, 2 * n))]]))
    return whole[:n, :n], whole[:n, n:]


def period_radius(A: Array, G: Array, intervals: Sequence[float], latency: float = 0.0) -> float:
    """The spectral radius over one period of sampling intervals, each sample used `latency` later.

    The first sample after the start is at 0; the state is x and every sample that is under way
    or in use. Intervals and latency must be positive, latency zero or more.
    """
    n, period = len(A), float(sum(intervals))
    starts = np.concatenate([[0.0], np.cumsum(intervals)[:-1]])
    instants = [s + k * period for k in range(-2 - int(latency // period), 2) for s in starts]
    # sample i is in use from instants[i] + latency on
    marks = {0.0, period}
    marks |= {s for s in instants if 0 <= s <= period}
    marks |= {s + latency for s in instants if 0 < s + latency < period}
    times = sorted(marks)
    known = [i for i, s in enumerate(instants) if s < 0 and s + latency >= -max(intervals) - 1e-12]
    index = {i: k for k, i in enumerate(known)}
    size = n * (1 + len(known))
    x = np.eye(n, size)
    kept = {i: np.eye(n, size, n * (1 + k)) for i, k in index.items()}
    for start, end in itertools.pairwise(times):
        for i, s in enumerate(instants):
            if abs(s - start) < 1e-12:
                kept[i] = x
        middle = (start + end) / 2
        used = max(i for i, s in enumerate(instants) if s + latency < middle)
        Phi, Gamma = over_a_hold(A, G, end - start)
        x = Phi @ x + Gamma @ kept[used]
    per = len(starts)
    rows = [x, *(kept[i + per] for i in known)]
    return float(np.max(np.abs(np.linalg.eigvals(np.vstack(rows)))))


def gain_over_patterns(
    A: Array,
    G: Array,
    C: Array,
    D: Array,
    intervals: Sequence[float],
    omega: float,
    periods: int = 60,
    steps: int = 24,
) -> float:
    """|z|_2 / |w|_2 of z = D x over a finite time from rest, w a sinusoid along the first C."""
    n, m = len(A), 2
    osc = np.array([[0.0, omega], [-omega, 0.0]])
    entry = np.column_stack([C[:, 0], np.zeros(n)])
    x, kept, w = np.zeros(n), np.zeros(n), np.array([0.0, 1.0])
    top = bottom = 0.0
    for length in list(intervals) * periods:
        kept = x.copy()
        h = length / steps
        whole = np.zeros((2 * n + m, 2 * n + m))
        whole[:n, :n], whole[:n, n : 2 * n], whole[:n, 2 * n :] = A, G, entry
        whole[2 * n :, 2 * n :] = osc
        step = expm(h * whole)
        state = np.concatenate([x, kept, w])
        for _ in range(steps):
            after = step @ state
            # the trapezium rule errs alike above and below; 24 steps a hold make it small
            top += h / 2 * (np.sum((D @ state[:n]) ** 2) + np.sum((D @ after[:n]) ** 2))
            bottom += h / 2 * (state[2 * n] ** 2 + after[2 * n] ** 2)
            state = after
        x, w = state[:n], state[2 * n :]
    return float(np.sqrt(top / bottom))
