"""The LMI of Theorem 2 with design constraints on the same gain: decay, |K|, the peak of u.

All share X and Y, and so K = Y X^-1. That keeps the problem convex, at some loss:

* decay: the LMI at every corner of the shifted system, with Qbar, R and eps of its own;
* |K| <= k: [[k^2 s I, Y], [Y', X]] >= 0 and X >= s I, since K K' = Y X^-1 X^-1 Y' <= Y X^-1 Y'/s;
* peak: V stays below a level L (`peak_lmi.level_cones`, mu = gamma), and
  [[limit_i^2 / L, Y_i], [Y_i', X]] >= 0. L is searched.

The final proofs of the gain use variables that need not be shared.
"""

from __future__ import annotations

import numpy as np
import scipy

from cosim.hinf.lmi.affine import Affine
from cosim.hinf.lmi.assembly import Scalars
from cosim.hinf.lmi.conic import Constraint
from cosim.hinf.lmi.decay_lmi import CornersProblem
from cosim.hinf.lmi.peak_lmi import level_constraints, scaled_design_constraints
from cosim.hinf.lmi.problem import Problem
from cosim.hinf.lmi.scaling import Scaling
from cosim.hinf.problem import DesignConstraints
from cosim.models import DelaySystem, Matrix


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
        self._asked, self._at = design_constraints, at
        self._level: tuple[float, float] | None = None
        super().__init__(system)

    def _set_units(self, units: Scaling) -> None:
        """Assemble the LMI and its constraints; a level counts in T, which all units share."""
        d, corners = self._asked, None
        if d.decay is not None:
            corners = CornersProblem(self.system, d.decay, units)
        own = 0 if corners is None else corners.structure.size
        self._spare = own + 1
        super()._set_units(units)
        self._design_constraints = scaled_design_constraints(d, units)
        self._fixed: list[Constraint] = []
        self._levels: list[Constraint] = []
        if corners is not None:
            theirs, place = corners.structure, self.structure.spare[:own].copy()
            place[theirs.X.place] = self.structure.X.place
            place[theirs.Y.place] = self.structure.Y.place
            move = scipy.sparse.csc_array((np.ones(own), (np.arange(own), place)), (own, self._t))
            self._fixed = [
                Constraint(c.size, c.constant, scipy.sparse.csc_array(c.columns @ move))
                for c in corners.constraints(self._at)
            ]
        if d.gain_limit is not None:
            self._fixed += self._gain_constraints(d.gain_limit)
        if self._level is not None:
            self.set_level(*self._level)

    def set_level(self, level: float, theta: float = 1.0) -> None:
        """Keep V at or below `level`, and u_i within its limit there; in inner units."""
        s, d = self.structure, self._design_constraints
        self._level = (level, theta)
        self._levels = level_constraints(s, d, level, theta, self._t)
        for i, limit in enumerate(d.peak_control or ()):
            M = Affine(1 + s.X.place.shape[0])
            M.constant(0, 0, np.array([[limit**2 / level]]))
            M.unknown(0, 1, s.Y.place[i : i + 1]).unknown(1, 1, s.X.place)
            self._levels.append(M.constraint(self._t))

    def _more(self, p: Scalars, gain: Matrix | None, *, margin: bool) -> list[Constraint]:
        del p
        if gain is not None:
            return []
        whole = [*self._fixed, *self._levels]
        return [c.less(np.zeros(len(c.constant))) for c in whole] if margin else whole

    def _gain_constraints(self, limit: float) -> list[Constraint]:
        """Return |K| <= limit; in inner units s counts in T: K~ = K S / U, X~ = T X / S^2."""
        s, units = self.structure, self.scaling
        m, n = s.Y.place.shape
        sigma = int(s.spare[-1])
        product = Affine(m + n).term(0, 0, sigma, limit**2 * np.diag(units.input**-2.0))
        product.unknown(0, m, s.Y.place).unknown(m, m, s.X.place)
        floor = Affine(n).unknown(0, 0, s.X.place)
        floor.term(0, 0, sigma, -np.diag(units.state**-2.0))
        return [product.constraint(self._t), floor.constraint(self._t)]
