"""Proved peaks of states and controls of a loop: bounds on rows g_i of |g_i x(t)|, for every t.

The functional of an analysis of order 0, without z, has V' <= mu w'w (mu its gamma) for every
admissible F(t) and age, and x'P x <= V. From an initial state x0, constant before t = 0,

    x(t)'P x(t) <= V(t) <= level = x0'(P + sum_j dj Qj) x0 + mu int w'w,

Qj = 0 where any age is allowed, and (g x)^2 <= g P^-1 g' level. The initial states are

    x0 = sum_k a_k s_k,  |a_k| <= 1,

s_k the columns of `starts`: the level is largest at a corner, since it is convex. For a pair of
plant and observer with an estimate of zero, x0 = (x, e) with e = x: one column (s; s) for each
state that starts away from zero. A row of K' is a control; it acts at its age, but no later one is
greater.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, cast

import flint
import numpy as np

from cosim.core import InputError
from cosim.hinf.certificate.ages_json import analysis_from_json, analysis_to_json
from cosim.hinf.certificate.control_limits import MAX_OFFSETS, half_of_corners, peak_system
from cosim.hinf.certificate.guarantee import NUMBER, ROWS, Form, Guarantee, Read, numbers
from cosim.hinf.certificate.system_parts import matrix_from_rows
from cosim.hinf.exact import exact, exact_matrix, root_above
from cosim.hinf.theorems import AgesTheorem, Proof, positive_delays
from cosim.models import DelaySystem, Matrix


def _starts(data: Any, of: Read) -> Matrix:
    starts = matrix_from_rows(data, of.where)
    check_peaks_asked(of.values["rows"], starts, len(of.system.A), of.where.rpartition(".")[0])
    return starts


def _variables(data: Any, of: Read) -> Proof:
    bare = peak_system(of.system, energy=of.values["energy"] != 0)
    return analysis_from_json(bare, of.gain, data, of.where)


@dataclass(frozen=True, eq=False)
class StatePeaks(Guarantee):
    """Bounds |g_i x(t)| <= bound_i for every t >= 0, with their proof.

    rows : (r, n) the g_i, doubles.
    starts : (n, k) the s_k, doubles; at most eight columns.
    bounds : one per row, `fmpq`.
    energy : int w'w <= energy^2, `fmpq`.
    proof : of the analysis without z, order 0; its gamma is None where the energy is zero.
    """

    rows: Matrix
    starts: Matrix
    bounds: tuple[Any, ...]
    energy: Any
    proof: Proof

    NAME = "state_peaks"
    FORMS = MappingProxyType(
        {
            "rows": ROWS,
            "starts": Form(ROWS.write, _starts),
            "bounds": numbers(lambda of: len(of.values["rows"])),
            "energy": NUMBER,
            "variables": Form(analysis_to_json, _variables),
        }
    )
    CLAIMED = ("rows", "starts", "bounds", "energy")

    def failure(self, system: DelaySystem, gain: Matrix) -> str | None:
        """Return why it is not proved; None if it is."""
        if min((*self.bounds, self.energy), default=0) < 0:
            return "a bound or the energy is negative"
        order = cast("AgesTheorem", self.proof.theorem).order
        if order != 0 or (self.proof.gamma is None) != (self.energy == 0):
            return "its variables are not of order 0, or without gamma where there is an energy"
        bare = peak_system(system, energy=self.energy != 0)
        reason = self.proof.failure(bare, gain)
        if reason is not None:
            return reason
        squares = squared_state_peaks(system, self)
        high = [i for i, (b, s) in enumerate(zip(self.bounds, squares, strict=True)) if b * b < s]
        return f"the bound of row {high[0] + 1} is too low" if high else None


def squared_state_peaks(system: DelaySystem, peaks: StatePeaks) -> list[Any]:
    """Return g P^-1 g' times the level for every row, exactly (`fmpq`)."""
    P, mu = peaks.proof.unknowns["P"], peaks.proof.gamma
    weights = P
    for j, delay in enumerate(positive_delays(system)):
        if not delay.any_age:
            weights = weights + exact(delay.d) * peaks.proof.unknowns[f"Q[{j}]"]
    starts = exact_matrix(peaks.starts)
    product = starts.transpose() * weights * starts
    k, level = product.nrows(), flint.fmpq(0)
    for a in half_of_corners(k):
        level = max(level, sum((a[i] * a[j] * product[i, j] for i in range(k) for j in range(k)),
                               flint.fmpq(0)))  # fmt: skip
    if mu is not None:
        level += mu * peaks.energy * peaks.energy
    rows = exact_matrix(peaks.rows)
    through = P.solve(rows.transpose())
    return [
        level * sum((rows[i, j] * through[j, i] for j in range(rows.ncols())), flint.fmpq(0))
        for i in range(rows.nrows())
    ]


def bounds_above(squares: list[Any]) -> tuple[Any, ...]:
    """Return bounds whose squares are at least these, rounded up to seven digits."""
    return tuple(
        exact(root_above(float(square), partial(_has_square_above, square=square)))
        for square in squares
    )


def _has_square_above(bound: Any, square: Any) -> bool:
    return bool(bound * bound >= square)


def check_peaks_asked(rows: Matrix, starts: Matrix, n: int, where: str) -> None:
    """Refuse rows and starts that do not fit a loop of n states.

    Raises
    ------
    InputError : naming which.
    """
    fits = rows.ndim == 2 and rows.shape[1] == n and len(rows) > 0
    if not (fits and np.isfinite(rows).all()):
        raise InputError(
            "not rows of a state", where=f"{where}.rows", expected=f"rows of {n} finite numbers"
        )
    fits = starts.ndim == 2 and len(starts) == n and starts.shape[1] <= MAX_OFFSETS
    if not (fits and np.isfinite(starts).all()):
        raise InputError(
            "not initial states",
            where=f"{where}.starts",
            expected=f"{n} rows of finite numbers, at most {MAX_OFFSETS} columns",
            got=str(starts.shape),
        )
