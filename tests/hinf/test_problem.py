"""The solver's LMI of Theorem 2 is the proved one, another solver agrees, slopes are slopes."""

from __future__ import annotations

import warnings
from dataclasses import replace

import cvxpy as cp
import numpy as np
import pytest
from numpy.typing import NDArray
from solver_points import random_system

from cosim.hinf import as_cvxpy
from cosim.hinf.exact import exact
from cosim.hinf.lmi import Answer, Constraint, Problem, in_cvxpy, solve
from cosim.hinf.theorems import Scalars, minus_omega_of_scalars
from cosim.models import DelaySystem, paper_example

Array = NDArray[np.float64]


def _delays(system: DelaySystem) -> tuple[float, ...]:
    return tuple(delay.d for delay in system.delays)


def _reference_gamma(
    system: DelaySystem, k1: tuple[float, ...], k2: tuple[float, ...], gain: Array | None = None
) -> float:
    """Least gamma by the reference formulation and Clarabel."""
    asked = as_cvxpy(system, k1, k2, gain=gain)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        asked.problem.solve(solver=cp.CLARABEL)
    assert asked.problem.status == "optimal"
    return float(asked.gamma.value)


@pytest.mark.parametrize("case", range(8))
def test_the_matrix_of_the_solver_is_the_proved_one_at_any_k1_k2(case: int) -> None:
    """At random unknowns, k1, k2 of either sign and delays: its rows in units, nothing else."""
    rng = np.random.default_rng(case)
    system = random_system(
        rng,
        late=bool(case & 1),
        any_age=bool(case & 2),
        uncertain=bool(case & 4),
        blocks=[[1, 1], [2, 1]] if case & 6 == 6 else None,
    )
    problem = Problem(system)
    for _ in range(3):  # other weights of what was compiled once
        k1, k2 = (tuple(float(x) for x in rng.standard_normal(2)) for _ in range(2))
        d = tuple(float(x) for x in rng.uniform(0.1, 5.0, 2))
        p = Scalars(k1, k2, d)
        main, _ = problem.lmi(p, None)
        y = rng.standard_normal(main[0].columns.shape[1])
        v = problem.unknowns_at(y, p)
        exactly = Scalars(*(tuple(map(exact, values)) for values in (k1, k2, d)))
        whole = in_cvxpy(minus_omega_of_scalars(system, bounded=True).fixed(exactly), v)
        units = problem.units_of_rows(p)
        inner = units[:, None] * whole * units
        size = np.abs(inner).max()
        for at, part in zip(problem.rows_of_parts(), main, strict=True):
            np.testing.assert_allclose(part.at(y), inner[np.ix_(at, at)], atol=1e-12 * size)
            inner[np.ix_(at, at)] = 0.0
        assert not inner.any()  # nothing connects the parts


def test_least_gamma_of_the_paper_is_the_published_correction() -> None:
    """Section 5 at k1 = .6, k2 = .2: 5.0132; the printed gain and the reference solver agree."""
    system = paper_example.system()
    problem = Problem(system)
    p = Scalars((0.6,), (0.2,), (0.3,))
    free = problem.least_gamma(p)
    assert isinstance(free, Answer)
    assert free.value == pytest.approx(5.0132, abs=5e-5)
    assert free.value == pytest.approx(_reference_gamma(system, (0.6,), (0.2,)), rel=2e-6)
    K = np.array([paper_example.PRINTED_K])
    given = problem.least_gamma(p, K)
    assert isinstance(given, Answer)
    assert given.value == pytest.approx(_reference_gamma(system, (0.6,), (0.2,), K), rel=2e-6)


@pytest.mark.parametrize("case", range(6))
def test_least_gamma_of_random_systems_equals_the_reference(case: int) -> None:
    """Two delays, feedback immediate or late: both formulations, both solvers, one number."""
    rng = np.random.default_rng(100 + case)
    system = random_system(
        rng, late=bool(case & 1), any_age=bool(case & 2), uncertain=bool(case & 4), scale=0.3
    )
    k1, k2 = (-0.5, -0.5), (0.7, 0.9)
    ours = Problem(system).least_gamma(Scalars(k1, k2, _delays(system)))
    if not isinstance(ours, Answer):
        with pytest.raises(AssertionError):
            _reference_gamma(system, k1, k2)
        return
    assert ours.value == pytest.approx(_reference_gamma(system, k1, k2), rel=1e-5)


def test_slopes_are_the_difference_quotients() -> None:
    """d gamma / d k1 and d k2 by the multipliers, against solves to either side."""
    problem = Problem(paper_example.system())
    p = Scalars((0.6,), (0.2,), (0.9,))
    at = problem.least_gamma(p)
    assert isinstance(at, Answer)
    for i, name in enumerate(("k1", "k2")):
        values = []
        for h in (1e-3, -1e-3):
            end = problem.least_gamma(replace(p, **{name: (getattr(p, name)[0] + h,)}))
            assert isinstance(end, Answer)
            values.append(end.value)
        assert at.slopes[i] == pytest.approx((values[0] - values[1]) / 2e-3, rel=1e-3)


def svec(A: Array) -> Array:
    """The upper triangle by columns, so that svec(A) . svec(B) = trace(A B)."""
    weight = np.sqrt(2.0) * (1.0 - np.eye(len(A))) + np.eye(len(A))
    return np.concatenate([(weight * A)[: j + 1, j] for j in range(len(A))])


def _constraint(C: Array, *matrices: Array) -> Constraint:
    """C - sum_i y_i A_i >= 0."""
    return Constraint(len(C), svec(C), np.column_stack([-svec(A) for A in matrices]))


def test_the_solver_finds_a_largest_eigenvalue() -> None:
    """min t with t I - M >= 0 is the largest eigenvalue of M (numpy's)."""
    M = np.random.default_rng(5).standard_normal((7, 7))
    M = M + M.T
    solution = solve([_constraint(-M, -np.eye(7))], np.array([1.0]))
    assert solution.status == "solved"
    assert solution.value == pytest.approx(np.linalg.eigvalsh(M)[-1], abs=1e-8)
    # and the multiplier is the projector on its eigenvector
    vector = np.linalg.eigh(M)[1][:, -1]
    np.testing.assert_allclose(solution.Z[0], np.outer(vector, vector), atol=1e-5)


def test_the_solver_shows_why_nothing_is_feasible() -> None:
    """y >= 1 and y <= 0: the multipliers (1, 1) say so, and so do those returned."""
    one = np.ones((1, 1))
    solution = solve([_constraint(-one, -one), _constraint(0 * one, one)], np.array([1.0]))
    assert solution.status == "infeasible"
    lower, upper = (Z[0, 0] for Z in solution.Z)
    assert lower == pytest.approx(1.0)
    assert upper == pytest.approx(lower, rel=1e-6)
