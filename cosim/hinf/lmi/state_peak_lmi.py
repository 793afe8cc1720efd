"""The LMI of the peaks of states and controls of a loop (`cosim.hinf.certificate.state_peaks`).

With P, Q, R, eps of the analysis of order 0, mu and one beta_i for each row g_i,

    minimise   sum_i beta_i / (size of row i)^2
    subject to -Phi > 0 (without z, with mu w'w),   [P g_i'; g_i beta_i] >= 0,
               x0'(P + sum_j dj Qj) x0 + mu energy^2 <= 1   at every corner x0,

so that |g_i x(t)|^2 <= beta_i. A small margin keeps the point off the boundary; what it proves is
computed exactly.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from cosim.hinf.certificate import (
    StatePeaks,
    bounds_above,
    half_of_corners,
    peak_system,
    squared_state_peaks,
)
from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.lmi.condition import Condition
from cosim.hinf.lmi.conic import Constraint, solve
from cosim.hinf.lmi.margin import TOLERANCE
from cosim.hinf.lmi.program import Program
from cosim.hinf.lmi.svec import Array, svec
from cosim.hinf.theorems import Age, Inequality, Proof

if TYPE_CHECKING:
    from cosim.models import DelaySystem, Matrix

_MARGINS = (1e-6, 1e-5, 1e-4, 1e-3)


class _PeakCondition(Condition):
    """The analysis of a loop without z, with its peaks.

    Parameters
    ----------
    bare, gain : the loop.
    rows, starts, energy : as in `StatePeaks`.
    """

    def __init__(
        self, bare: DelaySystem, gain: Array, rows: Array, starts: Array, energy: float
    ) -> None:
        super().__init__(bare, gain, 0, performance=energy > 0)
        self._rows, self._starts, self._energy = rows, starts, energy
        self._delays = [x.d for x in bare.delays]

    def least(self, margin: float) -> Proof | None:
        """Return the point of least peaks; None if the solver finds none."""
        theorem = self.theorem(self._delays)
        loop, ages = self._at(self._delays, theorem)
        main, others = self._inequalities(loop, ages)
        size = float(np.linalg.norm(self._back[:, None] * self._starts)) or 1.0
        expected = np.sum((self._rows / self._back) ** 2, axis=1) * size**2
        units = {f"beta[{i}]": max(float(x), 1e-300) for i, x in enumerate(expected)}
        program = Program(
            main,
            [*others, *self._started(ages), *self._above_rows()],
            self._row_units(loop, ages),
            numbers=self._numbers() | units,
        )
        unit = np.linalg.norm(program.unit_of("P")[:, None] * self._starts) or 1.0
        known = {"1/gamma": 1.0} if self.performance else {}  # there is no z
        asked, rest = program.constraints(known)
        off = margin / float(unit) ** 2
        inside = [
            Constraint(c.size, c.constant - off * svec(np.eye(c.size)), c.columns) for c in asked
        ]
        solution = solve([*inside, *rest], program.cost([*units], known), tolerance=TOLERANCE)
        if not solution.usable:
            return None
        values = program.values(solution.y, known)
        gamma = values.get("gamma")
        if gamma is not None and not gamma > 0:
            return None
        return Proof(theorem, values)

    def _started(self, ages: Sequence[Age]) -> Iterator[Inequality]:
        """Yield 1 - x0'(P + sum_j dj Qj) x0 - mu energy^2 for every corner x0, up to its sign."""
        for signs in half_of_corners(self._starts.shape[1]):
            form = Inequality("1 - V(x0)", {"one": 1})
            x0 = exact_matrix((self._starts @ np.array(signs, float))[:, None]) * form.row("one")
            form.number(None, form.row("one"))
            form.square("P", x0, -1)
            for age in ages:
                if age.functional == "constant":
                    form.square(f"Q[{age.j}]", x0, -age.d)
            if self.performance:
                form.number("gamma", form.row("one"), -(exact(self._energy) ** 2))
            yield form

    def _above_rows(self) -> Iterator[Inequality]:
        """Yield [P g_i'; g_i beta_i]."""
        for i, row in enumerate(self._rows):
            form = Inequality("[P g'; g beta]", {"x": len(row), "one": 1})
            form.square("P", form.row("x"))
            form.twice(None, form.row("one"), exact_matrix(row[None, :]) * form.row("x"))
            form.number(f"beta[{i}]", form.row("one"))
            yield form


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
    condition = _PeakCondition(bare, gain, rows, starts, energy)
    for margin in _MARGINS:
        point = condition.least(margin)
        if point is None:
            continue
        proof = point.exactly(bare, gain)
        peaks = StatePeaks(rows, starts, (exact(0.0),) * len(rows), exact(energy), proof)
        try:
            bounds = bounds_above(squared_state_peaks(system, peaks))
        except ZeroDivisionError:
            continue
        peaks = replace(peaks, bounds=bounds)
        if peaks.failure(system, gain) is None:
            return peaks
    return None
