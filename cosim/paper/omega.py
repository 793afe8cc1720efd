"""Omega of Theorem 2, Eq. (14), block by block as the paper writes it, and corrected.

One formula for fractions (proof) and for cvxpy (solver): nothing here says which it is given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

NAMES = ("x", "x_d", "w", "z", "ẋ", "m", "h")
"""The seven block rows of Eq. (14)."""


@dataclass(frozen=True)
class Data:
    """What is given: the matrices of Eq. (7), d, k1, k2, gamma."""

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
        """Rows of each block of `NAMES`."""
        n, q = self.C.shape
        return (n, n, q, self.D.shape[0], n, n, self.H.shape[0])

    def each(self, kind: Callable[[Any], Any]) -> Data:
        """Every matrix and number as another kind."""
        values = {name: kind(getattr(self, name)) for name in self.__dataclass_fields__}
        return Data(**{name: v.item() if v.ndim == 0 else v for name, v in values.items()})


@dataclass(frozen=True)
class Unknowns:
    """What is sought: X, Rbar, Qbar (n, n), Y (m, n), eps."""

    X: Any
    R: Any
    Q: Any
    Y: Any
    eps: Any


@dataclass(frozen=True)
class Reading:
    """Which of the two misprints are put right."""

    omega_12: bool = True
    omega_25: bool = True


CORRECTED = Reading()
PRINTED = Reading(omega_12=False, omega_25=False)


def omega(s: Data, v: Unknowns, reading: Reading = CORRECTED) -> list[list[Any]]:
    """The upper block rows of Omega, from the diagonal on.

    Printed: Omega_12 has k2 A1 X for k2^-1 A1 X, Omega_25 has A1 for A1'.
    """
    n, _, q, p, _, _, r = s.sizes
    X, R, d, k1, over = v.X, v.R, s.d, s.k1, 1 / s.k2
    BY, EE = s.B @ v.Y, v.eps * (s.E @ s.E.T)
    factor = over if reading.omega_12 else s.k2
    late = s.A1.T if reading.omega_25 else s.A1
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
            _zero(n, q),
            _zero(n, p),
            d * over * (X @ late),
            d * R,
            over * (X @ s.H1.T),
        ],
        [-s.gamma * _one(q), s.D1.T, d * s.C.T, _zero(q, n), _zero(q, r)],
        [-s.gamma * _one(p), _zero(p, n), _zero(p, n), _zero(p, r)],
        [-d * R + d * d * EE, _zero(n, n), _zero(n, r)],
        [-d * R, _zero(n, r)],
        [-v.eps * _one(r)],
    ]


def _zero(rows: int, columns: int) -> Any:
    return np.zeros((rows, columns), dtype=int)


def _one(size: int) -> Any:
    return np.eye(size, dtype=int)
