"""The LMI that designs the injections of an observer, for an SDP solver.

The error of an observer, e' = sum_j A_j e(t-d_j) - sum_i L_i (C_i e(t-tau_i) + N_i w_i) + C w, is
no state feedback, and a transposed design is none of it where an age varies. As in
`cosim.hinf.theorems.design`, e' is kept as a row r, tied to the loop by a multiplier in front:

    2 (e + b r)'U (sum_j A_j e_j + C w - r) - 2 (e + b r)'sum_i W_i (C_i e_i + N_i w_i),

added to V' of order 0, with z'z / gamma - gamma w'w for z = e in units of the state. It is linear
in U (n, n; not symmetric) and in W_i, and L_i = U^-1 W_i. The scalar b [s] is searched by those who
call. What is found is a start: the pair of plant and observer is analysed after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.lmi.conic import Constraint, solve
from cosim.hinf.lmi.margin import TOLERANCE
from cosim.hinf.lmi.program import Program
from cosim.hinf.lmi.svec import Array, svec
from cosim.hinf.theorems import (
    Age,
    Inequality,
    Loop,
    Support,
    corners_of,
    positive_of_ages,
    subtract_derivative,
)
from cosim.models import DelaySystem, Measurement

_NOISE = 0.01  # least noise, in units of what is measured: without any, L may have no bound
_LEVEL = 1e-3  # of every positive matrix, at least: U must be far from singular


class InjectionLmi:
    """The LMI of one plant's error; its multiplier is b [s].

    Parameters
    ----------
    plant, measurements : as of `pair_of`; ages that vary count as any age up to their bounds.
    estimated : (n,) whether each state has an error.
    state : (n,) units of the states.
    T : unit of time [s].
    """

    def __init__(
        self,
        plant: DelaySystem,
        measurements: Sequence[Measurement],
        estimated: NDArray[np.bool_],
        state: Array,
        T: float,
    ) -> None:
        errors = np.ix_(estimated, estimated)
        n, unit = int(estimated.sum()), state[estimated]
        delays = [
            *(replace(x, A=x.A[errors], H=np.zeros((0, n))) for x in plant.delays),
            *(x.delay(n) for x in measurements),
        ]
        delays = [
            replace(x, d=x.d / T, least_age=x.least_age / T, rate=None, sampled=False)
            for x in delays
        ]
        outer = T / unit[:, None]
        self._A = [outer * A * unit for A in (plant.A[errors], *(x.A for x in delays))]
        self._T, self._state, self._estimated = T, unit, estimated
        self._outputs = [np.abs(x.C) @ state for x in measurements]
        self._C = [
            x.C[:, estimated] * unit / size[:, None] for x, size in self._measured(measurements)
        ]
        self._noise = [
            np.maximum(np.array(x.noise) / size, _NOISE) for x, size in self._measured(measurements)
        ]
        first = outer * plant.C[estimated]
        self._w = [first, *(np.zeros((n, len(x))) for x in self._noise)]
        system = DelaySystem(plant.A[errors], C=np.hstack(self._w), D=np.eye(n), delays=delays)
        positive = [x for x in delays if x.d > 0]
        # of each delay only what acts through it
        acting = [*self._A[1 : 1 + len(plant.delays)], *self._C]
        needed = [np.flatnonzero(x.any(axis=0)) for x in acting]
        self._needed = [
            x if delay.d > 0 else np.arange(n) for x, delay in zip(needed, delays, strict=True)
        ]
        supports = [
            Support("states", tuple(map(int, x)))
            for x, delay in zip(needed, delays, strict=True)
            if delay.d > 0
        ]
        loop = Loop.of(system, np.zeros((0, n)), supports)
        self._ages = [
            Age(loop, j, "interval" if delay.any_age else "constant", 0)
            for j, delay in enumerate(positive)
        ]
        places = iter(range(len(positive)))
        self._on = [f"x{next(places)}" if delay.d > 0 else "x" for delay in delays]

    def _measured(self, measurements: Sequence[Measurement]) -> list[tuple[Measurement, Array]]:
        return list(zip(measurements, self._outputs, strict=True))

    def least_gamma(self, b: float) -> tuple[float, list[Array]] | None:
        """Return the solver's least gamma, in own units, and every L (n, k_i); None without one."""
        n = len(self._state)
        positive = positive_of_ages(n, self._ages)
        program = Program([self._minus_phi(exact(b / self._T))], list(positive), {})
        main, others = program.constraints()
        level = [
            Constraint(c.size, c.constant - _LEVEL * svec(np.eye(c.size)), c.columns)
            for c in others
        ]
        solution = solve([*main, *level], program.cost(["gamma"]), tolerance=TOLERANCE)
        values = program.values(solution.y)
        if not (solution.usable and values["gamma"] > 0):
            return None
        try:
            factors = scipy.linalg.lu_factor(values["U"])
        except (ValueError, np.linalg.LinAlgError):
            return None
        injections = []
        for i, size in enumerate(self._outputs):
            L = np.zeros((len(self._estimated), len(size)))
            inside = scipy.linalg.lu_solve(factors, values[f"W[{i}]"])
            L[self._estimated] = self._state[:, None] * inside / size / self._T
            injections.append(L)
        if not all(np.isfinite(L).all() for L in injections):
            return None
        return float(np.sqrt(values["gamma"])), injections

    def _minus_phi(self, b: Any) -> Inequality:
        """Return -Phi in U, W[i], the square of gamma, and what the ages have."""
        n, widths = len(self._state), [w.shape[1] for w in self._w]
        rows = {"x": n} | {name: age.width for age in self._ages for name in age.names}
        of_w = {f"w{i}": width for i, width in enumerate(widths) if width}
        form = Inequality("-Phi of an error", rows | of_w | {"r": n})
        x, r = form.row("x"), form.row("r")
        (corner,) = corners_of(self._ages)
        subtract_derivative(form, self._ages, corner, r, [x])
        m, first = x + b * r, len(self._on) - len(self._C)
        flow = exact_matrix(self._A[0]) * x - r
        for i, A in enumerate(self._A[1 : 1 + first]):
            flow = flow + exact_matrix(A[:, self._needed[i]]) * form.row(self._on[i])
        if "w0" in of_w:
            flow = flow + exact_matrix(self._w[0]) * form.row("w0")
        form.twice("U", m, flow, -1)
        for i, (C, noise) in enumerate(zip(self._C, self._noise, strict=True)):
            seen = C[:, self._needed[first + i]]
            sensed = exact_matrix(seen) * form.row(self._on[first + i])
            sensed = sensed + exact_matrix(np.diag(noise)) * form.row(f"w{1 + i}")
            form.twice(f"W[{i}]", m, sensed)
        form.number(None, x, -1)
        for name in of_w:
            form.number("gamma", form.row(name))
        return form
