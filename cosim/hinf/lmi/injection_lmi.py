"""The LMI that designs the injections of an observer, for an SDP solver.

The error of an observer, e' = sum_j A_j e(t-d_j) - sum_i L_i (C_i e(t-tau_i) + N_i w_i) + C w, is
no state feedback, and a transposed design is none of it where an age varies. As in
`ages_synthesis_lmi`, e' is kept as a row r, tied to the loop by a multiplier, here in front:

    2 (e + b r)'U (sum_j A_j e_j + C w - r) - 2 (e + b r)'sum_i W_i (C_i e_i + N_i w_i),

added to V' of order 0, with z'z / gamma - gamma w'w for z = e in units of the state. It is linear
in U (n, n; not symmetric) and in W_i, and L_i = U^-1 W_i. The scalar b [s] is searched by those who
call. What is found is a start: the pair of plant and observer is analysed after it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from cosim.hinf.certificate import AgeFunctional, Support, rows_of, state_blocks, unknowns_of
from cosim.hinf.lmi.ages_forms import Form, LateAge, PartOfLoop, count_of
from cosim.hinf.lmi.conic import Constraint, solve
from cosim.hinf.lmi.svec import Array, svec
from cosim.models import DelaySystem, Measurement

_TOLERANCE = 1e-8
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
        own = np.ix_(estimated, estimated)
        n, unit = int(estimated.sum()), state[estimated]
        delays = [
            *(replace(x, A=x.A[own], H=np.zeros((0, n))) for x in plant.delays),
            *(x.delay(n) for x in measurements),
        ]
        outer = T / unit[:, None]
        self._A = [outer * A * unit for A in (plant.A[own], *(x.A for x in delays))]
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
        system = DelaySystem(plant.A[own], C=np.hstack(self._w), D=np.eye(n), delays=delays)
        kinds: tuple[AgeFunctional, ...] = tuple(
            "interval" if x.any_age else "constant" for x in delays if x.d > 0
        )
        late = [(i, x) for i, x in enumerate(delays) if x.d > 0]
        ages = [
            LateAge(i, kind, x.d / T, x.least_age / T, 0.0)
            for (i, x), kind in zip(late, kinds, strict=True)
        ]
        self._on = {i: f"x{j}" for j, (i, _) in enumerate(late)}
        # of each delay only what acts through it
        acting = [*self._A[1 : 1 + len(plant.delays)], *self._C]
        needed = [np.flatnonzero(x.any(axis=0)) for x in acting]
        self._S = [np.eye(n)[own] for own in needed]
        supports = [Support("states", tuple(map(int, needed[i]))) for i, _ in late]
        rows = rows_of(system, 0, kinds, gamma=True, supports=supports) | {"r": n}
        blocks = state_blocks(system, 0, kinds, supports)
        self._forms = PartOfLoop(0, 0, ages, {"S": self._S}, rows, blocks)
        shapes = {"gain U": (n, n), "0 P": (sum(blocks.values()),) * 2}
        asked = system, 0, kinds
        shapes |= {f"gain W{i}": (n, len(x)) for i, x in enumerate(self._C)}
        for j, names in enumerate(unknowns_of(*asked, gamma=True, supports=supports)):
            shapes |= {f"0 {j} {name}": shape for name, shape in names.items()}
        self._at, self._width = {}, 0
        for name, shape in shapes.items():
            self._at[name] = slice(self._width, self._width + count_of(name, shape))
            self._width = self._at[name].stop

    def _measured(self, measurements: Sequence[Measurement]) -> list[tuple[Measurement, Array]]:
        return list(zip(measurements, self._outputs, strict=True))

    def least_gamma(self, b: float) -> tuple[float, list[Array]] | None:
        """Return the solver's least gamma, in own units, and every L (n, k_i); None without one."""
        (corner,) = self._forms.corners()
        at = self._forms.rows_at(corner)
        form = Form(at["x"].shape[1])
        self._forms.add_functional(form, at, at["r"], corner)
        M = at["x"] + b / self._T * at["r"]
        late = [at[self._on[i]] if i in self._on else S @ at["x"] for i, S in enumerate(self._S)]
        first = len(late) - len(self._C)
        ends = np.cumsum([x.shape[1] for x in self._w])
        w = np.split(at["w"], ends[:-1])
        flow = self._A[0] @ at["x"] + self._w[0] @ w[0]
        for A, S, x in zip(self._A[1 : 1 + first], self._S, late, strict=False):
            flow = flow + A @ S.T @ x
        form.twice("gain U", M, np.asarray(flow - at["r"]))
        for i, (C, noise) in enumerate(zip(self._C, self._noise, strict=True)):
            sensed = C @ self._S[first + i].T @ late[first + i] + noise[:, None] * w[1 + i]
            form.twice(f"gain W{i}", M, sensed, -1.0)
        form.constant = at["x"].T @ at["x"]
        own = form.constraint(self._at, self._width + 1)
        phi = Constraint(own.size, -own.constant, -own.columns)
        phi.columns[:, -1] += svec(at["w"].T @ at["w"])
        positive = [x.constraint(self._at, self._width + 1) for x in self._forms.positive()]
        positive = [
            Constraint(x.size, x.constant - _LEVEL * svec(np.eye(x.size)), x.columns)
            for x in positive
        ]
        cost = np.zeros(self._width + 1)
        cost[-1] = 1.0
        found = solve([phi, *positive], cost, tolerance=_TOLERANCE)
        if not (found.usable and found.y[-1] > 0):
            return None
        n = len(self._state)
        U = found.y[self._at["gain U"]].reshape(n, n)
        try:
            factors = scipy.linalg.lu_factor(U)
        except (ValueError, np.linalg.LinAlgError):
            return None
        injections = []
        for i, size in enumerate(self._outputs):
            W = found.y[self._at[f"gain W{i}"]].reshape(n, len(size))
            L = np.zeros((len(self._estimated), len(size)))
            own_units = scipy.linalg.lu_solve(factors, W)
            L[self._estimated] = self._state[:, None] * own_units / size / self._T
            injections.append(L)
        if not all(np.isfinite(L).all() for L in injections):
            return None
        return float(np.sqrt(found.y[-1])), injections
