"""Linear matrix inequalities as plain arrays, solved by Clarabel.

    minimise q'y   subject to   M_k(y) = M_k0 + sum_i y_i M_ki >= 0,   k = 1, 2, ...

with the dual   maximise -sum_k <M_k0, Z_k>   subject to   sum_k <M_ki, Z_k> = q_i,  Z_k >= 0.

Without a modelling layer nothing is rebuilt between solves. A solution is no proof: the exact
certificate decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np
import scipy

from cosim.core import still_working
from cosim.hinf.lmi.solver_status import Status, count, status_of
from cosim.hinf.lmi.svec import Array, smat, svec

TOLERANCE = 1e-9
"""Of gap and residuals, by default."""


@dataclass(frozen=True)
class Constraint:
    """M0 + sum_i y_i M_i >= 0.

    size : rows of M.
    constant : svec(M0).
    columns : svec(M_i), one column per unknown of the problem.
    """

    size: int
    constant: Array
    columns: Array | scipy.sparse.csc_array

    def at(self, y: Array) -> Array:
        """Return M(y) as a full matrix."""
        return smat(self.constant + self.columns @ y, self.size)

    def less(self, column: Array) -> Constraint:
        """Return M(y) - t W >= 0 with one more unknown t; `column` is svec(W)."""
        if isinstance(self.columns, np.ndarray):
            return Constraint(self.size, self.constant, np.column_stack([self.columns, -column]))
        more = scipy.sparse.csc_array(-column[:, None])
        return Constraint(
            self.size,
            self.constant,
            scipy.sparse.csc_array(scipy.sparse.hstack([self.columns, more])),
        )

    def below(self, bound: float) -> Constraint:
        """Return bound I - M(y) >= 0."""
        return Constraint(self.size, bound * svec(np.eye(self.size)) - self.constant, -self.columns)


@dataclass(frozen=True)
class Solution:
    """The result of a solve.

    status : `solved`; `inaccurate`: a point for which a proof may still be tried; `infeasible`:
        with multipliers that show it; `unbounded`; `failed`: nothing is known.
    y : the unknowns; the last iterate unless solved.
    value : q'y.
    Z : one multiplier per constraint; where `infeasible`, -sum <M0, Z> = 1, <M_i, Z> about 0.
    solver_message : the status in the solver's words.
    """

    status: Status
    y: Array
    value: float
    Z: tuple[Array, ...]
    solver_message: str

    @property
    def usable(self) -> bool:
        """Whether there is a point for which a proof can be tried; the proof decides."""
        return self.status in {"solved", "inaccurate"}


def solve(
    constraints: Sequence[Constraint],
    q: Array,
    *,
    equal: tuple[Array, float] | None = None,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Minimise q'y over the constraints, and over a'y = r for `equal` = (a, r)."""
    still_working()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.max_threads = 1  # the last digits must not depend on the number of threads
    rows = [scipy.sparse.csc_array(-c.columns) for c in constraints]
    right = [c.constant for c in constraints]
    cones: list[Any] = [clarabel.PSDTriangleConeT(c.size) for c in constraints]
    if equal is not None:
        rows.append(scipy.sparse.csc_array(equal[0][None, :]))
        right.append(np.array([equal[1]]))
        cones.append(clarabel.ZeroConeT(1))
    b = np.concatenate(right)
    try:
        solver = clarabel.DefaultSolver(
            scipy.sparse.csc_matrix((len(q), len(q))),
            q,
            scipy.sparse.csc_matrix(scipy.sparse.vstack(rows)),
            b,
            cones,
            settings,
        ).solve()
    except BaseException as error:
        # Rust's panic on numbers far out of range is no Exception, and cannot be named
        if type(error).__name__ != "PanicException":
            raise
        count("Panic")
        nothing = np.full(len(q), np.nan)
        return Solution("failed", nothing, np.nan, (), "Panic")
    y, z = np.array(solver.x), np.array(solver.z)
    word = str(solver.status)
    if not (np.isfinite(y).all() and np.isfinite(z).all()):
        word = f"{word} with numbers that are not finite"
    status = status_of(word)
    count(word)
    if status == "infeasible":
        z = z / max(-float(b @ z), 1e-300)
    ends = np.cumsum([len(c.constant) for c in constraints])
    Z = tuple(
        smat(entries, c.size) for entries, c in zip(np.split(z, ends), constraints, strict=False)
    )
    return Solution(status, y, float(q @ y), Z, word)
