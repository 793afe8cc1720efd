"""The LMI of the peaks of states and controls of a loop (`cosim.hinf.certificate.state_peaks`).

With P, Q, R, eps of the analysis of order 0, mu and one beta_i for each row g_i,

    minimise   sum_i beta_i / (size of row i)^2
    subject to -Phi > 0 (without z, with mu w'w),   [P g_i'; g_i beta_i] >= 0,
               x0'(P + sum_j dj Qj) x0 + mu energy^2 <= 1   at every corner x0,

so that |g_i x(t)|^2 <= beta_i. A small margin keeps the point off the boundary; what it proves is
computed exactly.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cosim.hinf.certificate import (
    AnalysisVariables,
    StatePeaks,
    bounds_above,
    exact,
    exact_analysis,
    half_of_corners,
    peak_system,
    squared_state_peaks,
)
from cosim.hinf.lmi.analysis_lmi import AnalysisLmi
from cosim.hinf.lmi.conic import Constraint, solve
from cosim.hinf.lmi.svec import Array, product, svec

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

_MARGINS = (1e-6, 1e-5, 1e-4, 1e-3)
_TOLERANCE = 1e-8


class _PeakLmi(AnalysisLmi):
    """The analysis of a loop without z, with its peaks."""

    def least(
        self, lengths: list[float], rows: Array, starts: Array, energy: float, margin: float
    ) -> AnalysisVariables | None:
        """Return the point of least peaks; None if the solver finds none.

        lengths : the delays [s]. The others as in `StatePeaks`.
        """
        own_rows, own_starts = rows / self._back, self._back[:, None] * starts
        constraints = self._at(lengths, 1.0, fixed=False)
        width, count = constraints[0].columns.shape[1], len(rows)
        n = len(self._back)
        size = float(np.linalg.norm(own_starts)) or 1.0
        level = 1.0 / size**2
        asked = []
        for i, c in enumerate(constraints):
            off = level * margin * svec(np.eye(c.size))
            columns = np.asarray(c.columns)
            wider = np.hstack([columns, np.zeros((len(c.constant), count))])
            asked.append(Constraint(c.size, c.constant - (off if i <= 1 else 0.0), wider))
        places, first = {}, 0
        for name, own in self._unknowns(lengths).items():
            places[name] = slice(first, first + own * (own + 1) // 2)
            first = places[name].stop
        k = own_starts.shape[1]
        for signs in half_of_corners(k):
            on = _quadratic(own_starts @ np.array(signs, float))
            column = np.zeros((1, width + count))
            column[0, places["P"]] -= on
            for i, d, _ in self._times(lengths):
                if f"Q{i}" in places:
                    column[0, places[f"Q{i}"]] -= d * on
            if self._performance:
                column[0, width - 1] -= energy**2 / self._T
            asked.append(Constraint(1, np.ones(1), column))
        select = np.eye(n, n + 1)
        P = product(select, select, weight=0.5)
        for i, row in enumerate(own_rows):
            constant = np.zeros((n + 1, n + 1))
            constant[n, :n] = constant[:n, n] = row
            columns = np.zeros(((n + 1) * (n + 2) // 2, width + count))
            columns[:, places["P"]] = P
            last = np.zeros((n + 1, n + 1))
            last[n, n] = 1.0
            columns[:, width + i] = svec(last)
            asked.append(Constraint(n + 1, svec(constant), columns))
        cost = np.zeros(width + count)
        cost[width:] = 1.0 / (np.maximum((own_rows**2).sum(axis=1), 1e-300) * size**2)
        found = solve(asked, cost, tolerance=_TOLERANCE)
        if not found.usable:
            return None
        gamma = float(found.y[width - 1]) if self._performance else None
        if gamma is not None and not gamma > 0:
            return None
        return self._variables(found.y, lengths, gamma, down_to_zero=False)


def _quadratic(x: Array) -> Array:
    """Return the coefficients of x'P x in the unknowns of a symmetric P."""
    n = len(x)
    both = np.outer(x, x)
    return np.asarray(product(np.eye(n), np.eye(n), weight=0.5).T @ svec(both))


def proved_state_peaks(
    system: DelaySystem, gain: Matrix, rows: Matrix, starts: Matrix, energy: float
) -> StatePeaks | None:
    """Return proved bounds of |g_i x(t)|, near the least of this method; None without a proof.

    Parameters
    ----------
    system, gain : the loop (n states).
    rows : (r, n) the g_i.
    starts : (n, k) the initial states, of which every combination with |a_k| <= 1 is covered.
    energy : int w'w <= energy^2.
    """
    bare = peak_system(system, energy=energy > 0)
    lmi = _PeakLmi(bare, gain, 0, performance=energy > 0)
    lengths = [x.d for x in system.delays]
    for margin in _MARGINS:
        point = lmi.least(lengths, rows, starts, energy, margin)
        if point is None:
            continue
        v = exact_analysis(bare, point)
        peaks = StatePeaks(rows, starts, (exact(0.0),) * len(rows), exact(energy), v)
        try:
            bounds = bounds_above(squared_state_peaks(system, peaks))
        except ZeroDivisionError:
            continue
        peaks = replace(peaks, bounds=bounds)
        if peaks.failure(system, gain) is None:
            return peaks
    return None
