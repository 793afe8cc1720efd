"""Prove that the LMI of Theorem 2 has no solution: the solver's multipliers, made exact.

1. Of all multipliers of Farkas' lemma of trace one, those of greatest least eigenvalue: the
   multipliers of  minimise s  over  s I + C_k + L_k(y) >= 0,  (C_k scaled by a free tau >= 0),
   traces summing up to at least one. There is room for rounding exactly if s > 0.
2. Back into the rows and units of the exact LMI, as doubles.
3. The equalities, exactly, each by entries that no later one reads: Y by (x_f,z) and
   (x_f,r_b), Rbar_j by (rj,rj), eps by (h,h), X and Qbar_j by their own multipliers.
4. The proof (`refutation_proof`); without one, nothing is claimed.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import scipy

from cosim.hinf.certificate import (
    Multipliers,
    Place,
    conditions,
    fixed_at,
    kept_rows,
    lifted,
    refutation_to_json,
    refuted,
)
from cosim.hinf.exact import exact, exact_symmetric
from cosim.hinf.lmi.assembly import Scalars, unit_of_R
from cosim.hinf.lmi.conic import Constraint, solve
from cosim.hinf.lmi.problem import Problem
from cosim.hinf.lmi.svec import Array, svec
from cosim.hinf.theorems import Inequality, products

if TYPE_CHECKING:
    from cosim.models import DelaySystem

_TIGHT = 1e-12
"""What is left of the equalities is mended exactly, and must be small against the multipliers."""
_BELOW_ZERO = 1.0
"""c <= -this times the least eigenvalue: what rounding may add to c."""


def refute(
    system: DelaySystem, problem: Problem, p: Scalars, gamma: float | None
) -> dict[str, Any] | None:
    """Prove that the LMI has no solution at `p` and `gamma`: the JSON, or None without proof.

    Parameters
    ----------
    system : with the delays of `p`.
    problem : of the same system, whatever its delays.
    """
    found = _central(problem, p, gamma)
    if found is None:
        return None
    place = Place(
        tuple(exact(value) for value in p.k1),
        tuple(exact(value) for value in p.k2),
        None if gamma is None else exact(gamma),
    )
    multipliers = _made_exact(system, place, _rows(problem, p).T @ found @ _rows(problem, p))
    if multipliers is None or not refuted(system, place, multipliers).valid:
        return None
    return refutation_to_json(system, place, multipliers)


def _central(problem: Problem, p: Scalars, gamma: float | None) -> Array | None:
    """The multiplier of -Omega in the problem's own rows; None if there is none with room."""
    lmi = problem.lmi(p, gamma)
    unknowns = problem.structure.size
    constraints, traces, of_tau = [], np.zeros(unknowns + 2), 0.0
    for c in lmi:
        one = svec(np.eye(c.size))
        columns = scipy.sparse.hstack(
            [
                scipy.sparse.csc_array(c.columns),
                scipy.sparse.csc_array(c.constant[:, None]),
                scipy.sparse.csc_array(one[:, None]),
            ]
        )
        constraints.append(Constraint(c.size, np.zeros(len(one)), scipy.sparse.csc_array(columns)))
        traces += np.asarray(constraints[-1].columns.T @ one)
        of_tau += float(np.linalg.norm(c.constant))
    if of_tau > 0:
        traces[-2] += _BELOW_ZERO
        tau = np.eye(1, unknowns + 2, unknowns)
        constraints.append(Constraint(1, np.zeros(1), scipy.sparse.csc_array(tau)))
    constraints.append(Constraint(1, -np.ones(1), scipy.sparse.csc_array(traces[None, :])))
    solution = solve(constraints, np.eye(1, unknowns + 2, unknowns + 1).ravel(), tolerance=_TIGHT)
    if not solution.usable or not solution.value > 0:
        return None
    return np.asarray(solution.Z[0] + solution.Z[-1][0, 0] * np.eye(lmi[0].size))


def _rows(problem: Problem, p: Scalars) -> Array:
    """F: the problem's rows from those of the exact LMI, Omega_problem = F Omega F'."""
    structure, units = problem.structure, problem.scaling
    F = np.zeros((structure.rows, structure.rows))

    def put(row: str, column: str, value: float | Array) -> None:
        i, j = structure.offset[row], structure.offset[column]
        size = len(value) if isinstance(value, np.ndarray) else ends[row] - i
        F[i : i + size, j : j + size] = np.diag(np.broadcast_to(value, size))

    starts = sorted(structure.offset.values())
    ends = {
        name: min([x for x in starts if x > start], default=structure.rows)
        for name, start in structure.offset.items()
    }
    x, r = units.T / units.state, 1.0 / units.state
    lengths = [d / units.T for d in p.d]
    put("x0", "x0", x)
    for j, k2 in enumerate(p.k2, 1):
        put(f"x{j}", f"x{j}", x / np.sqrt(abs(units.T * k2)))
    channels = 1.0 / units.per_block(structure.system, units.c)[1]
    for name, value in (("w", units.a), ("z", units.a), ("h", channels)):
        if name in structure.offset:
            put(name, name, value)
    base = structure.base
    for j in (j for j in range(1, len(lengths) + 1) if f"r{j}" in structure.offset):
        d, longest = lengths[j - 1], lengths[(base or 1) - 1]
        if j == base:
            put(f"r{j}", f"r{j}", r / np.sqrt(d * unit_of_R(d)))
        else:
            share = np.sqrt(unit_of_R(d) * (1 + d / longest))
            put(f"r{j}", f"r{j}", r / np.sqrt(d) / share)
            put(f"r{j}", f"r{base}", -r * np.sqrt(d) / longest / share)
    return F


def _made_exact(system: DelaySystem, place: Place, Z: Array) -> Multipliers | None:
    """Multipliers near Z that meet the equalities exactly."""
    inequalities = conditions(system, place)
    form, names = inequalities[0], [one.name for one in inequalities[1:]]
    none = [flint.fmpq_mat(len(system.A), len(system.A)) for _ in names]
    W = exact_symmetric(np.asarray(Z / np.abs(Z).max(), dtype=np.float64))
    rows = [name for name, size in kept_rows(form).items() for _ in range(size)]

    def left() -> dict[str, Any]:
        """What the product with W leaves of each unknown."""
        every = [lifted(form, place, W), *none]
        return products(inequalities, every, fixed_at(place))[0]

    if not _cancel_Y(system, form, rows, W, left()["Y"]):
        return None
    over = left()
    for j in (j for j, x in enumerate(system.delays) if x.d > 0):
        _add(W, rows.index(f"r{j + 1}"), -1 / exact(system.delays[j].d) * over[f"R[{j}]"])
    over = left()
    for b, (_, of_H) in enumerate(system.blocks):
        at = rows.index("h") + of_H.start
        W[at, at] -= over[f"eps[{b}]"][0, 0]
    over = left()
    own = {name: -1 * over[name] for name in names}
    Q = tuple(None if x.any_age else own[f"Q[{j}]"] for j, x in enumerate(system.delays))
    return _integers(Multipliers(W, own["X"], Q))


def _cancel_Y(system: DelaySystem, form: Inequality, rows: list[str], W: Any, left: Any) -> bool:
    """Correct W so that nothing is left of Y, in the rows of the fed-back state alone."""
    n, m = system.B.shape
    acting = next((j for j, x in enumerate(system.delays, 1) if x.feedback), 0)
    start = rows.index(f"x{acting}" if acting else "x")
    late = [(x.d, j) for j, x in enumerate(system.delays, 1) if x.d > 0]
    columns = [k for k, row in enumerate(rows) if row == "z"]
    if late:
        columns += [k for k, row in enumerate(rows) if row == f"r{max(late)[1]}"]
    # every term of Y is He(left'Y x_f): what W[x_f, column] is multiplied by
    kept = dict(Counter(rows))
    acts = [2 * t.weight * t.left.on(kept) for t in form.terms if t.unknown == "Y"]
    total = sum(acts[1:], acts[0])
    G = flint.fmpq_mat(m, len(columns), [total[i, k] for i in range(m) for k in columns])
    if left == 0 * left:
        return True
    gram = G * G.transpose()
    if gram.det() == 0:
        return False
    change = G.transpose() * gram.solve(left)
    for a in range(n):
        for k, column in enumerate(columns):
            _put(W, start + a, column, W[start + a, column] - change[k, a])
    return True


def _add(matrix: Any, first: int, block: Any) -> None:
    """Add a symmetric block to a diagonal block."""
    for i in range(block.nrows()):
        for j in range(block.ncols()):
            matrix[first + i, first + j] += block[i, j]


def _put(matrix: Any, i: int, j: int, value: Any) -> None:
    matrix[i, j] = value
    matrix[j, i] = value


def _integers(multipliers: Multipliers) -> Multipliers:
    """The same multipliers times the least common multiple of all denominators."""
    matrices = [M for M in (multipliers.Z, multipliers.X, *multipliers.Q) if M is not None]
    scale = flint.fmpz(1)
    for M in matrices:
        for entry in M.entries():
            scale = scale.lcm(entry.q)
    Q = tuple(None if M is None else M * scale for M in multipliers.Q)
    return Multipliers(multipliers.Z * scale, multipliers.X * scale, Q)
