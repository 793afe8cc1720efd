"""The rows of the LMI of `bessel_legendre_lmi`, and its functional on them.

Rows: [x, x', x1.., W.., w, p, z, h]; all but the last four are transformed, xh = X^-1 x.
"""

from __future__ import annotations

import numpy as np

from cosim.hinf.lmi.analysis_lmi import couplings
from cosim.hinf.lmi.svec import Array, product, svec
from cosim.models import DelaySystem


def symmetrised(left: Array, right: Array) -> Array:
    """Return the svec of left'right + right'left."""
    half = left.T @ right
    return svec(half + half.T)


class BesselLegendreRows:
    """Selection matrices of the rows.

    Parameters
    ----------
    system : Eq. (7).
    order : N, of every delay that is constant.
    T : the unit of time [s].
    performance : number of w and of z; (0, 0) for stability alone.

    Attributes
    ----------
    at : selection matrix of each block of rows, by name.
    on : those of x and of every delayed x; that of a delay of zero is x.
    times : (i, d / T) per positive delay.
    """

    def __init__(
        self, system: DelaySystem, order: int, T: float, performance: tuple[int, int]
    ) -> None:
        self._n = n = len(system.A)
        self.times = [(i, x.d / T) for i, x in enumerate(system.delays) if x.d > 0]
        self._orders = {i: 0 if system.delays[i].any_age else order for i, _ in self.times}
        sizes = {"x": n, "r": n} | {f"x{i}": n for i, _ in self.times}
        sizes |= {f"W{i},{k}": n for i, _ in self.times for k in range(self._orders[i])}
        sizes |= {"w": performance[0], "p": system.E.shape[1]}
        sizes |= {"z": performance[1], "h": system.H.shape[0]}
        self.total = sum(sizes.values())
        self.at: dict[str, Array] = {}
        start = 0
        for name, size in sizes.items():
            self.at[name] = np.eye(size, self.total, start)
            start += size
        delayed = [self.at.get(f"x{i}", self.at["x"]) for i in range(len(system.delays))]
        self.on = [self.at["x"], *delayed]

    @property
    def rows_of_P(self) -> int:
        """Number of rows of P: n for x, and n for every W."""
        return self._n * (1 + sum(self._orders.values()))

    def functional(
        self, any_age: list[bool]
    ) -> tuple[dict[str, Array], list[tuple[str, int, float]]]:
        """Return the columns of P, Q, R in V', and (Q, row block of P, weight) added to P > 0."""
        at, columns = self.at, {}
        y, rate = [at["x"]], [at["r"]]
        bessel: list[tuple[str, int, float]] = []
        for i, d in self.times:
            s = max(1.0, d)
            here, there = at["x"], at[f"x{i}"]
            v = [
                here
                - (-1) ** k * there
                - sum((c * at[f"W{i},{j}"] for j, c in enumerate(couplings(k))), 0 * here)
                for k in range(self._orders[i] + 1)
            ]
            columns[f"R{i}"] = product(at["r"], at["r"], weight=0.5 * (d / s) ** 2) - sum(
                product(term, term, weight=0.5 * (2 * k + 1) / s**2) for k, term in enumerate(v)
            )
            if not any_age[i]:
                columns[f"Q{i}"] = product(here, here, weight=0.5)
                columns[f"Q{i}"] -= product(there, there, weight=0.5)
            for k in range(self._orders[i]):
                bessel.append((f"Q{i}", len(y), (2 * k + 1) * s**2 / d))
                y.append(d / s * at[f"W{i},{k}"])
                rate.append(v[k] / s)
        columns["P"] = product(np.concatenate(y), np.concatenate(rate))
        return columns, bessel
