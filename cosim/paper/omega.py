"""Omega of Theorem 2, Eq. (14), term by term: as printed, and corrected."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cosim.hinf.exact import exact, exact_matrix
from cosim.hinf.theorems import Inequality, Signal
from cosim.models import DelaySystem
from cosim.paper.exact import Exact, fraction

NAMES = ("x", "x_d", "w", "z", "ẋ", "m", "h")
"""The seven block rows of Eq. (14)."""


@dataclass(frozen=True)
class Case:
    """What Eq. (14) is about: Eq. (7) with one delay, k1, k2 and gamma, each a double."""

    system: DelaySystem
    k1: float
    k2: float
    gamma: float


@dataclass(frozen=True)
class Reading:
    """Which of the two misprints of Eq. (14) are corrected."""

    omega_12: bool = True
    omega_25: bool = True


CORRECTED = Reading()
PRINTED = Reading(omega_12=False, omega_25=False)


def minus_omega_as_read(case: Case, reading: Reading = CORRECTED) -> Inequality:
    """Return -Omega in X, Y, Q, R (with a bar in the paper), eps and gamma.

    The paper prints k2 A1 X for k2^-1 A1 X in Omega_12, and A1 for A1' in Omega_25.
    """
    s, delay = case.system, case.system.delays[0]
    A, A1, B, C, D, D1, D2, E, H, H1 = map(
        exact_matrix, (s.A, delay.A, s.B, s.C, s.D, s.D1, s.D2, s.E, s.H, delay.H)
    )
    d, k1, k2 = map(exact, (delay.d, case.k1, case.k2))
    n, q = s.C.shape
    sizes = dict(zip(NAMES, (n, n, q, len(s.D), n, n, len(s.H)), strict=True))
    form = Inequality("-Omega", sizes)
    x, x_d, w, z, slope, m, h = map(form.row, NAMES)

    def put(unknown: str | None, left: Signal, right: Signal, weight: Any = 1) -> None:
        """Add weight (left' U right + its transpose) to Omega."""
        form.twice(unknown, left, right, -weight)

    for rows, weight in ((x, 1), (slope, d)):  # Omega_11, Omega_15
        put("X", A.transpose() * rows, x, weight)
        put("Y", B.transpose() * rows, x, weight)
        put(None, rows, C * w, weight)  # Omega_13, Omega_35
    put("X", x, x, k1)
    form.square("Q", x, -1)
    put("X", (1 / k2 if reading.omega_12 else k2) * (A1.transpose() * x), x_d)
    put("X", x, x_d, 1 - k1 / k2)
    put("X", D.transpose() * z, x)
    put("Y", D2.transpose() * z, x)
    put("R", m, x, d * k1)
    put("X", H.transpose() * h, x)
    form.square("Q", x_d, 1 / k2**2)
    put("X", x_d, x_d, -1 / k2)
    if reading.omega_25:
        put("X", A1.transpose() * slope, x_d, d / k2)
    else:
        put("X", x_d, A1 * slope, d / k2)
    put("R", m, x_d, d)
    put("X", H1.transpose() * h, x_d, 1 / k2)
    put(None, z, D1 * w)
    for rows in (w, z):
        form.number("gamma", rows)
    for rows in (slope, m):
        form.square("R", rows, d)
    form.number("eps", E.transpose() * (x + d * slope), -1)
    form.number("eps", h)
    return form


def matrix_at(form: Inequality, unknowns: Mapping[str, Any]) -> Exact:
    """Return the matrix of an inequality at `fmpq_mat` and `fmpq`, as an array of fractions."""
    lower = form.at(unknowns)
    rows = range(len(lower))
    entries = [fraction(lower[max(i, j)][min(i, j)]) for i in rows for j in rows]
    return np.array(entries, dtype=object).reshape(len(lower), len(lower))
