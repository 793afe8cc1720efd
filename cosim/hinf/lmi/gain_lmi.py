"""The LMI that designs a gain for a given multiplier (`cosim.hinf.theorems.design`).

Without parts in its result: K may connect all states.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from cosim.hinf.exact import exact_matrix
from cosim.hinf.lmi.condition import BOUND, bounded
from cosim.hinf.lmi.conic import solve
from cosim.hinf.lmi.loop_units import channel_units, closed_loop, own_units
from cosim.hinf.lmi.margin import TOLERANCE, widest_margin
from cosim.hinf.lmi.program import Program
from cosim.hinf.lmi.svec import Array
from cosim.hinf.theorems import (
    Age,
    AgesTheorem,
    Inequality,
    Loop,
    Proof,
    corners_of,
    minus_phi_of_design,
    positive_delays,
    positive_of_ages,
    widest_functional,
)

if TYPE_CHECKING:
    from cosim.models import DelaySystem

Multiplier = Mapping[str, Array]
"""S' (n, n) of the rows of -Phi by name: "r" of x' [s], "W0,1" of a mean."""
_GREATER_BOUND = 1e5  # where a great gain needs it
_SINGULAR = 1e12  # condition number of X beyond which Y X^-1 is noise


def multiplier_of(point: Proof, system: DelaySystem) -> Multiplier:
    """Return the multiplier with which a design loses nothing at the gain of an analysis.

    point : of `Condition.margin`, whose functionals are those of an analysis.
    """
    n, P = len(system.A), point.unknowns["P"]
    X = np.linalg.inv(P[:n, :n])
    rate, columns = np.zeros((n, n)), n
    multiplier = {}
    for j, delay in enumerate(positive_delays(system)):
        rate += delay.d**2 * point.unknowns[f"R[{j}]"]
        for k in range(0 if delay.any_age else cast("AgesTheorem", point.theorem).order):
            multiplier[f"W{j},{k}"] = delay.d * P[:n, columns : columns + n] @ X
            columns += n
    return {"r": rate @ X, **multiplier}


def scalar_multiplier(b: float, system: DelaySystem) -> Multiplier:
    """Return the multiplier x + b x', b [s]."""
    return {"r": b * np.eye(len(system.A))}


class GainLmi:
    """The LMI of one system at one order.

    Parameters
    ----------
    system : Eq. (7), with a positive delay.
    order : N.
    K : (m, n) a gain of about the expected size: it sets the units.
    reference : a gamma of about the expected size; None for stability alone.
    functionals : by delay, of those that hold for it; None: as of `Condition`.
    """

    def __init__(
        self,
        system: DelaySystem,
        order: int,
        K: Array,
        reference: float | None,
        functionals: Sequence[str] | None = None,
    ) -> None:
        self._system, self._reference = system, reference
        back, self._T = own_units(closed_loop(system, K))
        if reference is not None:
            back = back / (float(np.linalg.norm(self._T * back[:, None] * system.C, 2)) or 1.0)
        self._back = back
        kinds = functionals or [widest_functional(x) for x in system.delays]
        loop = Loop.of(system, np.zeros(system.B.T.shape))
        of_positive = [kind for kind, x in zip(kinds, system.delays, strict=True) if x.d > 0]
        self._ages = [Age(loop, j, kind, order) for j, kind in enumerate(of_positive)]

    @property
    def rows(self) -> int:
        """Rows of -Phi at the corner that has most."""
        every = self._main({"r": np.eye(len(self._back))})
        return max(sum(one.rows.values()) for one in every)

    def least_gamma(self, multiplier: Multiplier) -> tuple[float, Array] | None:
        """Return the solver's least gamma and its gain; None if it finds none."""
        program = self._program(multiplier)
        main, others = program.constraints()
        cost = program.cost(["gamma"])
        solution = solve([*main, *others], cost, tolerance=TOLERANCE)
        if not solution.usable or self._reference is None or not solution.value > 0:
            return None
        gain = self._gain(program.values(solution.y))
        return None if gain is None else (float(self._reference * solution.value), gain)

    def central(self, multiplier: Multiplier, gamma: float | None) -> tuple[float, Array] | None:
        """Return the greatest margin t at `gamma` and its gain; t < 0: the LMI is not met.

        None if the solver finds no point.
        """
        program, best = self._program(multiplier), None
        known = {} if self._reference is None else {"gamma": gamma or 1.0}
        constraints = program.constraints(known)

        def gain_at(y: Array) -> Array | None:
            return self._gain(program.values(y, known))

        for bound in (BOUND, _GREATER_BOUND):
            centre = widest_margin(
                *constraints,
                bound,
                accept=lambda y: gain_at(y) is not None,
                enough=0.0,
            )
            gain = None if centre is None else gain_at(centre[1])
            if centre is not None and gain is not None:
                best = centre[0], gain
                if centre[0] > 0:
                    break
        return best

    def _main(self, multiplier: Multiplier) -> Iterator[Inequality]:
        exactly = {name: exact_matrix(S) for name, S in multiplier.items()}
        for corner in corners_of(self._ages):
            yield minus_phi_of_design(
                self._system,
                self._ages,
                exactly,
                corner,
                bounded=self._reference is not None,
            )

    def _program(self, multiplier: Multiplier) -> Program:
        main = list(self._main(multiplier))
        positive = positive_of_ages(len(self._back), self._ages)
        others = [*positive, *bounded(self._system, self._ages)]
        size = self._reference or 1.0
        state = self._T * np.sqrt(size) * self._back
        units = {
            **dict.fromkeys(main[0].rows, state),
            **dict.fromkeys((f"r{age.j}" for age in self._ages), state / self._T),
            **{f"v{a.j}": np.tile(state / self._T, 1 + a.late) for a in self._ages},
            "r": state / self._T,
        }
        system = self._system
        units |= {
            name: np.full(count, 1 / np.sqrt(size))
            for name, count in (("w", system.C.shape[1]), ("z", len(system.D)))
        }
        channel = channel_units(system, self._back, self._T)
        units["p"], units["h"] = np.sqrt(size) * channel, np.full(len(system.H), np.sqrt(size))
        for columns, of_H in system.blocks:
            units["h"][of_H] /= channel[columns][0]
        return Program(main, others, units, numbers={"gamma": size})

    def _gain(self, values: Mapping[str, Any]) -> Array | None:
        """Return K = Y X^-1; None where X is singular."""
        back = self._back
        X, Y = back[:, None] * values["X"] * back, values["Y"] * back
        if not np.linalg.cond(X) < _SINGULAR:
            return None
        return np.asarray(np.linalg.solve(X.T, Y.T).T * back)
