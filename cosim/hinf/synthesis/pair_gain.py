"""The gain of a pair of plant and observer as a function of K and L together, for a descent.

The loop of a pair (`cosim.hinf.certificate.pair_of`) is affine in K and in L. Written with the
"control" (u, L_1 C_1 e, ..., L_p C_p e) and its gain

    [K -K; 0 L_1 C_1; ...; 0 L_p C_p],   B' = [B 0 .. 0; 0 -I .. -I],

it is a `LoopGain`, whose derivatives by that gain give those by K and L; the columns -L_i N_i of
the noise add theirs. Here L_i C_i is rounded: this is for a search, never for a proof.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cosim.hinf.certificate import pair_of
from cosim.hinf.synthesis.loop_gain import LoopGain, Reals, Value
from cosim.models import DelaySystem, Matrix, Measurement


class PairGain:
    """The abscissa and the gain of a pair as functions of theta (1, N): K, then every L by rows.

    Parameters
    ----------
    plant, measurements : as of `pair_of`.
    known : its other arguments, by name.
    K, L : kept as they are where they are given; theta is zero there.
    only_uncertain : the gain is that from p to q, as of `LoopGain`.
    """

    def __init__(
        self,
        plant: DelaySystem,
        measurements: Sequence[Measurement],
        known: dict[str, Any],
        *,
        K: Matrix | None = None,
        L: Sequence[Matrix] | None = None,
        only_uncertain: bool = False,
    ) -> None:
        n, m = plant.B.shape
        estimated = known.get("estimated")
        self._chosen = np.ones(n, dtype=bool) if estimated is None else np.array(estimated)
        errors = np.eye(n)[self._chosen]
        silent = (0.0,) * len(errors)
        errors_measured = [replace(x, C=errors, noise=silent) for x in measurements]
        pair = pair_of(
            plant, errors_measured, np.zeros((m, n)), [errors.T for _ in errors_measured], **known
        )
        self._rows = [x.C[:, self._chosen] for x in measurements]
        self._noise = [np.array(x.noise) * (not only_uncertain) for x in measurements]
        system, self._first = pair.system, plant.C.shape[1]
        columns = 0 if only_uncertain else sum(len(x) for x in self._noise)
        if columns:
            C = np.hstack([system.C, np.zeros((len(system.A), columns))])
            D1 = np.hstack([system.D1, np.zeros((len(system.D), columns))])
            system = replace(system, C=C, D1=D1)
        self._C = None if only_uncertain else system.C
        self._loop = LoopGain(
            *(system,), only_uncertain=only_uncertain, by_disturbance=columns > 0, in_parts=True
        )
        self._K = (m, n)
        self.scalings, self.has_gain = self._loop.scalings, self._loop.has_gain
        self.has_scaling = self._loop.has_scaling
        zeros = [np.zeros(x.C.T.shape) for x in measurements]
        parts = _coupled(plant, measurements)
        free = np.zeros((m, n)) if K is not None else parts[0], zeros if L is not None else parts[1]
        self.free = self.theta(*free) > 0
        given = np.zeros((m, n)) if K is None else K, zeros if L is None else L
        self._given = self.theta(*given)

    def theta(self, K: Matrix, L: Sequence[Matrix]) -> Matrix:
        """Return K and L (each (n, k_i)) as one row."""
        return np.concatenate([K.ravel(), *(L_i[self._chosen].ravel() for L_i in L)])[None]

    def gains(self, theta: Matrix) -> tuple[Matrix, list[Matrix]]:
        """Return K (m, n) and every L (n, k_i) of a row."""
        K, *chosen = self._parts(theta)
        L = [np.zeros((len(self._chosen), x.shape[1])) for x in chosen]
        for full, rows in zip(L, chosen, strict=True):
            full[self._chosen] = rows
        return K, L

    def _parts(self, theta: Matrix) -> list[Matrix]:
        """Return K, and every L without the rows of known states."""
        sizes = [self._K, *((x.shape[1], x.shape[0]) for x in self._rows)]
        ends = np.cumsum([a * b for a, b in sizes])
        pieces = np.split((theta + self._given)[0], ends[:-1])
        return [x.reshape(s) for x, s in zip(pieces, sizes, strict=True)]

    def _at(self, theta: Matrix) -> tuple[LoopGain, Matrix]:
        """Return the loop at the noise of theta, and the gain of the pair."""
        K, *L = self._parts(theta)
        errors, (m, n) = int(self._chosen.sum()), self._K
        gain = np.zeros((m + errors * len(L), n + errors))
        gain[:m] = np.hstack([K, -K[:, self._chosen]])
        for i, (L_i, rows) in enumerate(zip(L, self._rows, strict=True)):
            first = m + i * errors
            gain[first : first + errors, n:] = L_i @ rows
        if self._C is None or self._C.shape[1] == self._first:
            return self._loop, gain
        C, first = self._C.copy(), self._first
        C[n:, first:] = -np.hstack([L_i * x for L_i, x in zip(L, self._noise, strict=True)])
        return self._loop.with_disturbance(C), gain

    def _by_theta(self, value: Value) -> Value:
        """Return a value with the derivative by theta in place of that by the pair's gain."""
        (m, n), errors = self._K, int(self._chosen.sum())
        by_K, by_all_L = value.in_gain[:m, :n].copy(), []
        by_K[:, self._chosen] -= value.in_gain[:m, n:]
        column = self._first
        for i, (rows, noise) in enumerate(zip(self._rows, self._noise, strict=True)):
            first = m + i * errors
            by_L = value.in_gain[first : first + errors, n:] @ rows.T
            if value.in_disturbance is not None:
                by_L = by_L - value.in_disturbance[n:, column : column + len(noise)] * noise
            column += len(noise)
            by_all_L.append(by_L.ravel())
        return value._replace(in_gain=np.concatenate([by_K.ravel(), *by_all_L])[None])

    def abscissa(self, K: Matrix) -> Value:
        """Return the greatest real part of the characteristic roots [1/s]."""
        loop, gain = self._at(K)
        return self._by_theta(loop.abscissa(gain))

    def gain(self, K: Matrix, log_e: float | Reals = 0.0) -> Value:
        """Return the logarithm of the gain at scalings e, as `LoopGain.gain`."""
        loop, gain = self._at(K)
        return self._by_theta(loop.gain(gain, log_e))

    def balanced(self, K: Matrix) -> Reals:
        """Return scalings log e for a search to start from, as `LoopGain.balanced`."""
        loop, gain = self._at(K)
        return loop.balanced(gain)

    def excess(self, K: Matrix, ratio: float, within: float) -> Value:
        """Return by how much the damping of a root misses `ratio`, as `LoopGain.excess`."""
        loop, gain = self._at(K)
        return self._by_theta(loop.excess(gain, ratio, within))


def parts_of_plant(
    plant: DelaySystem, measurements: Sequence[Measurement]
) -> list[NDArray[np.bool_]]:
    """Return the states of each part of a plant, such as an axis, as one truth value per state.

    Parts have no entry of A, A_j, B, C, D or of a measurement in common; only F may connect them.
    """
    n = len(plant.A)
    links = sum((np.abs(x.A) for x in plant.delays), np.abs(plant.A)) + np.eye(n)
    rows = [plant.B.T, plant.C.T, plant.D, *(row for x in measurements for row in x.C)]
    links = links + sum(np.abs(np.atleast_2d(x)).T @ np.abs(np.atleast_2d(x)) for x in rows)
    count, label = connected_components(links, directed=False)
    return [label == k for k in range(count)]


def _coupled(
    plant: DelaySystem, measurements: Sequence[Measurement]
) -> tuple[Matrix, list[Matrix]]:
    """Return ones where K and L may act: within a part of the plant."""
    same = sum(np.outer(x, x) for x in parts_of_plant(plant, measurements)) + 0.0

    def reached(matrix: Matrix) -> Matrix:
        return np.asarray(np.abs(matrix) @ same > 0, dtype=np.float64)

    return reached(plant.B.T), [reached(x.C).T for x in measurements]
