"""The LMI of Theorem 2 with design constraints on the same gain: decay, |K|, the peak of u.

All share X and Y, and so K = Y X^-1. That keeps the problem convex, at some loss:

* decay: the LMI at every corner of the shifted system, with Qbar, R and eps of its own;
* |K| <= k: [[k^2 s I, Y], [Y', X]] >= 0 and X >= s I, since K K' = Y X^-1 X^-1 Y' <= Y X^-1 Y'/s;
* peak: V stays below a level L (`peak_lmi.level_inequalities`, mu = gamma), and
  [[limit_i^2 / L, Y_i], [Y_i', X]] >= 0. L is searched.

The final proofs of the gain use variables that need not be shared.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.lmi.decay_lmi import at_corners
from cosim.hinf.lmi.peak_lmi import AtLevel, level_inequalities, level_units
from cosim.hinf.lmi.problem import Problem
from cosim.hinf.lmi.svec import Array
from cosim.hinf.problem import DesignConstraints
from cosim.hinf.theorems import Inequality, Scalars
from cosim.models import DelaySystem, Matrix

_DECAY = "decay "
"""Before the names of what the proof of the decay has of its own."""


class ConstrainedProblem(Problem):
    """The LMI with design constraints; they do not apply to a gain that is given.

    With a limit on the peak, call `set_level` before solving.

    Parameters
    ----------
    system : Eq. (7).
    design_constraints : what the gain must meet.
    at : k1, k2 for the corners of the decay.
    """

    def __init__(
        self, system: DelaySystem, design_constraints: DesignConstraints, at: Scalars
    ) -> None:
        self._asked, self._at_corners = design_constraints, at
        self._level: tuple[float, float] | None = None
        super().__init__(system)

    def set_level(self, level: float, theta: float = 1.0) -> None:
        """Keep V at or below `level`, and u_i within its limit there.

        Parameters
        ----------
        level : in inner units, which count V in T.
        theta : that of `peak_lmi`.
        """
        if self._level is None:
            self._programs.clear()
        self._level = level, theta

    def _parameters(self, p: Scalars) -> Any:
        level, theta = self._level or (1.0, 1.0)
        return AtLevel(p.k1, p.k2, p.d, self.scaling.T * level, theta)

    def _inequalities(self, gain: Matrix | None) -> tuple[list[Inequality], list[Inequality]]:
        main, others = super()._inequalities(gain)
        if gain is not None:
            return main, others
        asked = self._asked
        if asked.decay is not None:
            others += self._of_decay(asked.decay)
        if asked.gain_limit is not None:
            others += self._of_gain_limit(asked.gain_limit)
        if self._level is not None:
            others += level_inequalities(self.system, asked, bounded=self.has_gamma)
            others += [self._of_peak(i, x) for i, x in enumerate(asked.peak_control or ())]
        return main, others

    def _of_decay(self, rate: float) -> list[Inequality]:
        at = self._at_corners
        each = [
            form.fixed(Scalars(*(tuple(map(exact, values)) for values in (at.k1, at.k2, at.d))))
            for form in at_corners(self.system, rate)
        ]
        each += [one for one in self._positive() if one.name != "X"]
        return [form.renamed(_DECAY, keep=("X", "Y")) for form in each]

    def _of_gain_limit(self, limit: float) -> list[Inequality]:
        m, n = self.system.B.shape[1], len(self.system.A)
        product = Inequality("limit of |K|", {"Y of u": m, "Y of x": n})
        product.number("least X", product.row("Y of u"), exact(limit) ** 2)
        product.square("X", product.row("Y of x"))
        product.twice("Y", product.row("Y of u"), product.row("Y of x"))
        floor = Inequality("least X", {"Y of x": n})
        floor.square("X", floor.row("Y of x"))
        floor.number("least X", floor.row("Y of x"), -1)
        return [product, floor]

    def _of_peak(self, i: int, limit: float) -> Inequality:
        """Return [[limit^2 / L, Y_i], [Y_i', X]] > 0."""
        m, n = self.system.B.shape[1], len(self.system.A)
        form = Inequality(f"peak of u[{i}]", {f"u[{i}]": 1, "Y of x": n})
        unit = exact_matrix(np.eye(m)[:, [i]])
        form.number(None, form.row(f"u[{i}]"), lambda p: limit**2 / p.level)
        form.twice("Y", unit * form.row(f"u[{i}]"), form.row("Y of x"))
        form.square("X", form.row("Y of x"))
        return form

    def _row_units(self) -> dict[str, Array]:
        units, rows = self.scaling, super()._row_units()
        at = self._at(self._at_corners).rows
        rows |= {_DECAY + name: at.get(name, 1.0) * unit for name, unit in rows.items()}
        peaks = {f"u[{i}]": rows["Y of u"][[i]] for i in range(len(units.input))}
        return rows | peaks | level_units(units)

    def _number_units(self) -> dict[str, float]:
        numbers = super()._number_units()
        decay = {_DECAY + name: unit for name, unit in numbers.items()}
        return numbers | decay | {"least X": 1.0 / self.scaling.T}

    def _matrix_units(self) -> dict[str, tuple[Array, Array]]:
        matrices = super()._matrix_units()
        at = self._at(self._at_corners).unknowns
        decay = {_DECAY + k: (at.get(k, 1.0) * a, b) for k, (a, b) in matrices.items()}
        return matrices | decay
