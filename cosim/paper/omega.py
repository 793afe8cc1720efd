"""Omega of Theorem 2, Eq. (14), block by block: as printed, and corrected.

One formula serves fractions (proof) and cvxpy (solver).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cosim.paper.lmi import unit_block, zeros

NAMES = ("x", "x_d", "w", "z", "ẋ", "m", "h")
"""The seven block rows of Eq. (14)."""


@dataclass(frozen=True)
class Data:
    """The given quantities: the matrices of Eq. (7), d, k1, k2, gamma."""

    A: Any
    A1: Any
    B: Any
    C: Any
    D: Any
    D1: Any
    D2: Any
    E: Any
    H: Any
    H1: Any
    d: Any
    k1: Any
    k2: Any
    gamma: Any

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of rows of each block of `NAMES`."""
        n, q = self.C.shape
        return (n, n, q, self.D.shape[0], n, n, self.H.shape[0])

    def each(self, kind: Callable[[Any], Any]) -> Data:
        """Return a copy with every matrix and number converted by `kind`."""
        values = {name: kind(getattr(self, name)) for name in self.__dataclass_fields__}
        return Data(**{name: v.item() if v.ndim == 0 else v for name, v in values.items()})


@dataclass(frozen=True)
class Unknowns:
    """The unknowns: X, Rbar, Qbar (n, n), Y (m, n), eps."""

    X: Any
    R: Any
    Q: Any
    Y: Any
    eps: Any


@dataclass(frozen=True)
class Reading:
    """Which of the two misprints of Eq. (14) are corrected."""

    omega_12: bool = True
    omega_25: bool = True


CORRECTED = Reading()
PRINTED = Reading(omega_12=False, omega_25=False)


def omega(s: Data, v: Unknowns, reading: Reading = CORRECTED) -> list[list[Any]]:
    """Return the upper block rows of Omega, from the diagonal on.

    The paper prints k2 A1 X for k2^-1 A1 X in Omega_12, and A1 for A1' in Omega_25.
    """
    n, _, q, p, _, _, r = s.sizes
    X, R, d, k1, over = v.X, v.R, s.d, s.k1, 1 / s.k2
    BY, EE = s.B @ v.Y, v.eps * (s.E @ s.E.T)
    factor = over if reading.omega_12 else s.k2
    A1 = s.A1.T if reading.omega_25 else s.A1
    return [
        [
            X @ s.A.T + s.A @ X + v.Q + 2 * k1 * X + BY.T + BY + EE,
            factor * (s.A1 @ X) - k1 * over * X + X,
            s.C,
            X @ s.D.T + (s.D2 @ v.Y).T,
            d * (X @ s.A.T + BY.T) + d * EE,
            d * k1 * R,
            X @ s.H.T,
        ],
        [
            -(over * over) * v.Q - 2 * over * X,
            zeros(n, q),
            zeros(n, p),
            d * over * (X @ A1),
            d * R,
            over * (X @ s.H1.T),
        ],
        [-s.gamma * unit_block(q), s.D1.T, d * s.C.T, zeros(q, n), zeros(q, r)],
        [-s.gamma * unit_block(p), zeros(p, n), zeros(p, n), zeros(p, r)],
        [-d * R + d * d * EE, zeros(n, n), zeros(n, r)],
        [-d * R, zeros(n, r)],
        [-v.eps * unit_block(r)],
    ]
