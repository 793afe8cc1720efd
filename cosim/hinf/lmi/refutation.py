"""Prove that the LMI of Theorem 2 has no solution: the solver's multipliers, made exact.

1. Of all multipliers of Farkas' lemma of trace one, those of greatest least eigenvalue: the
   multipliers of  minimise s  over  s I + C_k + L_k(y) >= 0,  (C_k scaled by a free tau >= 0),
   traces summing up to at least one. There is room for rounding exactly if s > 0.
2. Back into the rows and units of the exact LMI, as doubles.
3. The equalities, exactly, each by entries that no later one reads: Y by (x_f,z) and
   (x_f,s_b), Rbar_j by (sj,sj), that of the longest delay last, eps by (h,h), X and Qbar_j by
   their own multipliers.
4. The proof (`refutation_proof`); without one, nothing is claimed.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import flint
import numpy as np
import scipy

from cosim.hinf.certificate import (
    Place,
    conditions,
    fixed_at,
    refutation_failure,
    refutation_to_json,
)
from cosim.hinf.exact import exact, exact_symmetric
from cosim.hinf.lmi.conic import Constraint, solve
from cosim.hinf.lmi.problem import Problem
from cosim.hinf.lmi.svec import Array, svec
from cosim.hinf.theorems import Inequality, Scalars, longest_delay, products, rates_from_rows

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
    centre = _central(problem, p, gamma)
    if centre is None:
        return None
    place = Place(
        tuple(exact(value) for value in p.k1),
        tuple(exact(value) for value in p.k2),
        None if gamma is None else exact(gamma),
    )
    units = problem.units_of_rows(p)
    multipliers = _made_exact(system, place, units[:, None] * centre * units)
    if multipliers is None or refutation_failure(system, place, multipliers) is not None:
        return None
    return refutation_to_json(system, place, multipliers)


def _central(problem: Problem, p: Scalars, gamma: float | None) -> Array | None:
    """The multiplier of -Omega in the problem's units of rows; None if there is none with room."""
    main, others = problem.lmi(p, gamma)
    unknowns = main[0].columns.shape[1]
    constraints, traces, of_tau = [], np.zeros(unknowns + 2), 0.0
    for c in (*main, *others):
        one = svec(np.eye(c.size))
        each = (c.columns, c.constant[:, None], one[:, None])
        columns = scipy.sparse.csc_array(
            scipy.sparse.hstack(list(map(scipy.sparse.csc_array, each)))
        )
        constraints.append(Constraint(c.size, np.zeros(len(one)), columns))
        traces += np.asarray(columns.T @ one)
        of_tau += float(np.linalg.norm(c.constant))
    if of_tau > 0:
        traces[-2] += _BELOW_ZERO
        tau = np.eye(1, unknowns + 2, unknowns)
        constraints.append(Constraint(1, np.zeros(1), scipy.sparse.csc_array(tau)))
    constraints.append(Constraint(1, -np.ones(1), scipy.sparse.csc_array(traces[None, :])))
    solution = solve(constraints, np.eye(1, unknowns + 2, unknowns + 1).ravel(), tolerance=_TIGHT)
    if not solution.usable or not solution.value > 0:
        return None
    rows = problem.rows_of_parts()
    Z = np.zeros((sum(map(len, rows)),) * 2)
    for at, multiplier in zip(rows, solution.Z, strict=False):
        Z[np.ix_(at, at)] = multiplier
    return np.asarray(Z + solution.Z[-1][0, 0] * np.eye(len(Z)))


def _made_exact(system: DelaySystem, place: Place, Z: Array) -> dict[str, Any] | None:
    """Multipliers near Z that meet the equalities exactly."""
    inequalities = conditions(system, place)
    form, names = inequalities[0], [one.name for one in inequalities[1:]]
    none = [flint.fmpq_mat(len(system.A), len(system.A)) for _ in names]
    W = exact_symmetric(np.asarray(Z / np.abs(Z).max(), dtype=np.float64))
    rows = [name for name, size in form.rows.items() for _ in range(size)]

    def left() -> dict[str, Any]:
        """What the product with W leaves of each unknown."""
        return products(inequalities, [W, *none], fixed_at(place))[0]

    if not _cancel_Y(system, form, rows, W, left()["Y"]):
        return None
    spread = [j for j, x in enumerate(system.delays) if x.d > 0]
    longest = longest_delay(system)
    for j in sorted(spread, key=lambda j: j == longest):
        size = exact(system.delays[j].d)  # the weight of R_j at (sj,sj)
        if longest is not None and j != longest:
            size *= exact(system.delays[longest].d) ** 2
        _add(W, rows.index(f"s{j + 1}"), -1 / size * left()[f"R[{j}]"])
    over = left()
    for b, (_, of_H) in enumerate(system.blocks):
        at = rows.index("h") + of_H.start
        W[at, at] -= over[f"eps[{b}]"][0, 0]
    over = left()
    G = rates_from_rows(system, form)
    return _integers({"Z": G * W * G.transpose(), **{name: -1 * over[name] for name in names}})


def _cancel_Y(system: DelaySystem, form: Inequality, rows: list[str], W: Any, left: Any) -> bool:
    """Correct W so that nothing is left of Y, in the rows of the fed-back state alone."""
    n, m = system.B.shape
    acting = next((j for j, x in enumerate(system.delays, 1) if x.feedback), 0)
    start = rows.index(f"x{acting}" if acting else "x")
    longest = longest_delay(system)
    of_e = None if longest is None else f"s{longest + 1}"
    columns = [k for k, row in enumerate(rows) if row in ("z", of_e)]
    # every term of Y is He(left'Y x_f): what W[x_f, column] is multiplied by
    acts = [2 * t.weight * t.left.on(form.rows) for t in form.terms if t.unknown == "Y"]
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


def _integers(multipliers: dict[str, Any]) -> dict[str, Any]:
    """The same multipliers times the least common multiple of all denominators."""
    scale = flint.fmpz(1)
    for M in multipliers.values():
        for entry in M.entries():
            scale = scale.lcm(entry.q)
    return {name: M * scale for name, M in multipliers.items()}
